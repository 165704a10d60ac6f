"""The public receiver and the real sender on one line: maps, tiles and zones come through loss.

Source: planner link, section 14, items 2, 5, 10, 11 and 12.
"""

import math

import numpy as np
import pytest

from core.records import StopZoneReport
from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.bodies import FREE, OBSTACLE
from tests.support.planner_line import Line, Sky, SkyTiles

KEY = bytes(range(32))
ZONE = StopZoneReport(
    1.25, 1.48, 0.0, math.inf, math.inf, 0.65, 0.0, 0.43, -0.7854, (math.inf,) * 8, 2, 0b11
)
WAYS = [(None, None), (115_200, None), (None, KEY), (921_600, KEY)]


def line_with(
    baud: int | None, key: bytes | None, loss: float, poll_only: bool = False, seed: int = 1
) -> Line:
    """A small map that changes, its tiles and a stop zone."""
    sky = Sky(21, seed)
    planner = FakePlanner(seed, key, ack_every=4, poll_only=poll_only)
    return Line(
        sky,
        baud=baud,
        key=key,
        loss=loss,
        seed=seed,
        zone=ZONE,
        tiles=SkyTiles(sky),
        planner=planner,
    )


@pytest.mark.parametrize(("baud", "key"), WAYS)
def test_no_free_cell_was_told_to_be_an_obstacle_while_nothing_is_suspect(
    baud: int | None, key: bytes | None
) -> None:
    line = line_with(baud, key, loss=0.05)
    clear = 0
    for k in range(600):
        line.sky.change(3)
        if k % 40 == 39:
            line.sky.move(1, -1)
        line.tick()
        if line.planner.suspect or line.planner.blank or not line.last_arrived:
            continue
        clear += 1
        told = line.told()
        assert not ((line.planner.cells == FREE) & (told == OBSTACLE)).any()
    assert clear > 100
    line.loss = 0.0
    line.settle(1.5)
    assert line.holds_what_is_meant()
    assert not line.planner.suspect
    assert line.planner.digest_ok
    assert not line.planner.need_full


@pytest.mark.parametrize(("baud", "key"), WAYS)
@pytest.mark.parametrize("poll_only", [False, True])
def test_tiles_of_every_layer_come_through_loss(
    baud: int | None, key: bytes | None, poll_only: bool
) -> None:
    line = line_with(baud, key, loss=0.1, poll_only=poll_only)
    line.sky.change(60)
    line.settle(1.0)
    corner = line.sky.corner
    whole = line.planner.ask_tile("class", 0, 0, 21, 21, in_window=True)
    part = line.planner.ask_tile("height", corner[0] + 3, corner[1] + 5, 9, 30)
    variance = line.planner.ask_tile("variance", *corner, 5, 5)
    slope = line.planner.ask_tile("slope", *corner, 5, 5)
    line.settle(6.0)
    assert whole.complete
    assert part.complete
    assert variance.complete
    np.testing.assert_array_equal(whole.values, line.sky.meant())
    assert whole.place == corner
    assert slope.refusal == "the sender has no such layer"
    source = SkyTiles(line.sky)
    heights = source.values("height", *part.place or (0, 0), 9, 0, 270)
    assert heights is not None
    np.testing.assert_allclose(part.values, heights.reshape(30, 9), atol=6e-4)
    assert np.isnan(part.values).any()  # beyond the window


@pytest.mark.parametrize("key", [None, KEY])
def test_a_sender_that_starts_again_is_found_again(key: bytes | None) -> None:
    line = line_with(None, key, loss=0.0)
    line.settle(1.0)
    again = Line(line.sky, key=key, session=78, planner=line.planner, zone=ZONE)
    again.now_s = line.now_s + 0.5
    again.settle(2.0)
    assert line.planner.geom is not None
    assert line.planner.geom.session == 78
    assert not line.planner.stale(again.now_s)
    assert not line.planner.suspect
    assert not line.planner.auth_failed
