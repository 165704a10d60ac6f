"""What was looked over not long ago: between the lens and the far edge, and not for ever."""

import numpy as np
import pytest

from tools.rig.cleaning.recent_views import RecentViews

LENS, KEEP_S = (1.0, 2.0), 4.0
SLOPES = np.linspace(-0.6, 0.6, 13)


def view(near_m: float = 0.8, far_m: float = 3.0, is_seen: bool = True) -> np.ndarray:
    """Floor from a lens that looks along x; in the middle nothing is seen if not `is_seen`."""
    far = np.where((np.abs(SLOPES) > 0.15) | is_seen, far_m, near_m + 0.001)
    near = np.column_stack([np.full(13, near_m), near_m * SLOPES])
    return np.vstack([np.column_stack([far, far * SLOPES]), near[::-1]]) + LENS


def places(*off: tuple[float, float]) -> np.ndarray:
    return np.array(off) + LENS


def test_a_view_vouches_for_what_it_looked_over_and_for_nothing_beside_or_behind() -> None:
    views = RecentViews(KEEP_S)
    views.add(10.0, LENS, view())
    assert views.vouch(places((0.3, 0.0), (0.5, 0.2), (1.5, 0.5), (2.9, 0.0)), 10.0)
    for place in ((3.1, 0.0), (0.5, 0.5), (-0.3, 0.0), (0.1, 0.3)):
        assert not views.vouch(places((1.0, 0.0), place), 10.0)


def test_where_no_floor_was_seen_nothing_near_is_vouched_for() -> None:
    views = RecentViews(KEEP_S)
    views.add(10.0, LENS, view(is_seen=False))
    assert not views.vouch(places((0.5, 0.0)), 10.0)
    assert views.vouch(places((0.5, 0.25)), 10.0)


@pytest.mark.parametrize("nothing", [np.zeros((0, 2)), np.full((4, 2), np.nan)])
def test_views_grow_old_and_a_frame_without_floor_renews_none(nothing: np.ndarray) -> None:
    views, ahead = RecentViews(KEEP_S), places((1.0, 0.0))
    assert not views.vouch(ahead, 0.0)
    views.add(10.0, LENS, view())
    views.add(13.0, LENS, nothing)
    assert views.vouch(ahead, 10.0 + KEEP_S)
    assert not views.vouch(ahead, 10.1 + KEEP_S)
    assert views.last_s == 10.0
