"""Which pixels of a frame the obstacle map gets."""

import numpy as np
import pytest

from core.objects.evidence import Evidence, evidence_of
from core.objects.frame.floor import Floor
from core.objects.frame.pixels import FLOOR, FLYING, HIGH, NOTHING, PIT, THING
from core.objects.frame.room import Room
from core.records import DepthCamera
from tests.core.objects.test_frame import SETTINGS

ROWS, COLUMNS = 40, 60
LENS_M = 0.5
BARS_M = 0.1, 1.3
FAR_M = 4.0
MOST = 24  # blocks of 10 x 10 pixels


def room() -> Room:
    """Of a camera that looks level; all pixels are floor at 2 m."""
    row, column = np.mgrid[:ROWS, :COLUMNS]
    rays = np.stack([np.ones(row.shape), (29.5 - column) / 60, (19.5 - row) / 60], axis=-1)
    made = Room(DepthCamera((0.001 * rays).astype(np.float32), (0.0, 0.0, 0.0)), SETTINGS)
    made.kinds[...], made.ranges[...] = FLOOR, 2.0
    return made


def evidence(made: Room, most: int = MOST) -> Evidence:
    floor = Floor(LENS_M, 0.0, 0.0, np.eye(3), 1.0, 100, np.array([0.0, 0.0, 1.0]))
    return evidence_of(made, floor, most, BARS_M, FAR_M)


def test_a_thing_between_the_rays_is_met_and_one_lonely_pixel_is_not() -> None:
    made = room()
    made.kinds[:, 14:15], made.ranges[:, 14:15] = THING, 1.0  # a pole, a pixel wide
    made.kinds[2, 33], made.ranges[2, 33] = THING, 0.7  # noise
    found = evidence(made)
    assert len(found.ranges_m) == MOST
    assert (found.ranges_m == 1.0).sum() == ROWS // 10
    assert not (found.ranges_m < 1.0).any()
    points = found.ranges_m[:, None] * found.directions
    np.testing.assert_allclose(np.linalg.norm(found.directions, axis=1), 1.0, rtol=1e-6)
    assert points[found.ranges_m == 1.0, 1] == pytest.approx([0.25] * 4, abs=0.02)
    heights = LENS_M + found.standing_m[:, 2]
    assert len(heights) == 4
    assert (heights >= BARS_M[0]).all()


def test_what_is_low_bars_nothing_and_a_pit_counts_before_the_floor() -> None:
    made = room()
    made.kinds[36:, 20:30], made.ranges[36:, 20:30] = THING, 1.6  # at most 8 cm over the floor
    made.kinds[33:36, 42:45], made.ranges[33:36, 42:45] = PIT, 3.0
    found = evidence(made)
    assert len(found.standing_m) == 0
    assert (found.ranges_m == np.float32(1.6)).sum() == 1
    assert (found.ranges_m == 3.0).sum() == 1


def test_flying_and_high_pixels_tell_nothing_and_no_more_rays_are_given_than_may_be() -> None:
    made = room()
    made.kinds[:20] = FLYING
    made.kinds[20:30] = HIGH
    assert len(evidence(made).ranges_m) == 6
    for most in (1, 5, 23, ROWS * COLUMNS):
        assert 0 < len(evidence(room(), most).ranges_m) <= most
    made.kinds[...] = HIGH
    assert len(evidence(made).ranges_m) == 0


def test_floor_beside_a_block_that_lacks_it_is_not_told() -> None:
    made = room()
    made.kinds[30:35, 0:10] = NOTHING  # half of the block at the lower left: its floor was due
    assert len(evidence(made).ranges_m) == MOST - 4
    made = room()
    made.kinds[:18] = NOTHING  # over the horizon, none is due
    assert len(evidence(made).ranges_m) == MOST - 6
    made = room()
    made.kinds[30:34:3, 0:10:5] = NOTHING  # specks
    assert len(evidence(made).ranges_m) == MOST
