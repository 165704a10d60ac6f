"""The map that the public receiver keeps: the sheet's example, and a slow model that saw the same.

Source: planner link, sections 4, 13 and 14, items 1 and 2.
"""

import numpy as np
import pytest

from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN, Geometry, Pose
from mapod_link.frames import DIGEST, GEOM, MAP, POSE, STOP_ZONE, TILE
from mapod_link.receiver import Receiver
from tests.support.planner_sender import (
    NONCE,
    SESSION,
    VECTORS,
    Line,
    geom_body,
    map_body,
    op,
    receiving,
    vector,
)


def planner_of_the_example() -> Receiver:
    planner = Receiver(NONCE)
    for name in ("geom", "pose", "map"):
        planner.feed_datagram(52.3087, vector(name))
    return planner


def test_the_example_is_read_and_ends_in_the_cells_and_the_digest_of_the_sheet() -> None:
    planner = planner_of_the_example()
    assert planner.geom == Geometry(7, 101, 101, 0.05, SESSION, 0.02, 0.15)
    assert planner.pose == Pose(
        1020, 52.3087, 12.34, -2.5, 0.7854, -0.0052, 0.0017, 0.65, -0.12, 0x7F,
        0.012, 0.004, 0.008, 1,
    )  # fmt: skip
    assert planner.origin == (196, -100)
    expected = np.zeros((101, 101), np.uint8)
    expected[60:62, 40:43] = OBSTACLE
    expected[62, 40:] = FREE
    expected[63, :9] = FREE
    np.testing.assert_array_equal(planner.window(), expected)
    assert planner.cell(40, 61) == OBSTACLE
    assert planner.cell(9, 63) == planner.cell(-1, 0) == planner.cell(0, 101) == UNKNOWN
    assert planner.digest() == int(VECTORS["digest_crc"], 16)


def test_the_acknowledgement_is_that_of_the_sheet() -> None:
    planner = planner_of_the_example()
    planner.numbers.gap = 3  # set here only to show the bit, as in the sheet
    [ack] = planner.poll(52.31)
    assert ack == vector("ack")


def test_all_frames_of_the_example_in_a_row_are_taken_and_agree() -> None:
    receiver = Receiver(NONCE)
    names = ["geom", "pose", "map", "digest", "stop_zone", "tile_class", "tile_height"]
    names += ["tile_variance", "tile_slope", "tile_refused"]
    for name in names:
        assert receiver.feed_datagram(1.0, vector(name)), name
    assert receiver.needs.digest_ok
    assert not receiver.suspect
    assert receiver.stop_zone is not None
    counts = {GEOM: 1, POSE: 1, MAP: 1, DIGEST: 1, STOP_ZONE: 1, TILE: 5}
    assert receiver.accepted == counts
    assert (receiver.numbers.last, receiver.ignored.types) == (10, 0)


def test_the_view_follows_the_map_and_cannot_be_written() -> None:
    line = receiving()
    view = line.planner.cells
    line.send(MAP, map_body(op(OBSTACLE, 3), ox=2))
    assert view is line.planner.cells
    assert (view[0, :4] == [OBSTACLE, OBSTACLE, OBSTACLE, UNKNOWN]).all()
    with pytest.raises(ValueError, match="read-only"):
        view[0, 0] = FREE
    copy = line.planner.window()
    line.send(MAP, map_body(op(FREE, 3), ox=2))
    assert copy[0, 0] == OBSTACLE


def test_a_place_in_the_map_frame_has_a_cell() -> None:
    receiver = planner_of_the_example()
    i, j = 196 + 40, -100 + 60
    assert receiver.cell_at((i + 0.5) * 0.05, (j + 0.5) * 0.05) == OBSTACLE
    assert receiver.cell_at((i - 0.5) * 0.05, (j + 0.5) * 0.05) == UNKNOWN
    assert receiver.cell_at(1e6, 0.0) == UNKNOWN
    assert Receiver(NONCE).cell_at(0.0, 0.0) == UNKNOWN


@pytest.mark.parametrize("x_m", [-1700.0, 0.0, 1700.0, 90_000.0])
def test_the_first_origin_lies_near_the_robot_wherever_the_endless_grid_has_wrapped(
    x_m: float,
) -> None:
    line = Line(Receiver(NONCE))
    line.send(GEOM, geom_body())
    pose = round(x_m * 1000).to_bytes(4, "little", signed=True) + bytes(20)
    line.send(POSE, pose)
    corner = round(x_m / 0.05) - 4
    line.send(MAP, map_body(ox=corner, oy=-2))
    assert line.planner.origin == (corner, -2)
    line.send(MAP, map_body(ox=corner + 1, oy=-3))
    assert line.planner.origin == (corner + 1, -3)
