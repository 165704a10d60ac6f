"""What the public receiver keeps and advises: the sheet's example, loss, repair, junk, cut streams.

Source: planner link, sections 4, 5, 6, 13 and 14.
"""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN, Geometry, Pose
from mapod_link.frames import DIGEST, GEOM, MAP, POSE, SCAN, STOP_ZONE, TILE
from mapod_link.receiver import Receiver
from tests.support.cases import cut, examples
from tests.support.link.planner_sender import (
    NONCE,
    SESSION,
    STOPS,
    VECTORS,
    Line,
    geom_body,
    map_body,
    op,
    pose_body,
    receiving,
    state_of,
    vector,
    zone_body,
)


def test_while_a_frame_is_missing_it_advises_to_go_slowly() -> None:
    line = receiving()
    missing = line.send(MAP, map_body(op(OBSTACLE, 1)), lost=True)
    line.send(POSE, pose_body())
    assert line.planner.suspect
    assert line.planner.advice(line.now_s) == ("slow", "a frame is missing")
    line.send(MAP, map_body(op(OBSTACLE, 1), repaired=missing))
    assert line.planner.advice(line.now_s) == ("go", "")
    assert (line.planner.numbers.gaps, line.planner.numbers.missing) == (1, 1)


def test_a_window_larger_than_the_receiver_holds_is_refused_and_said() -> None:
    line = Line(Receiver(NONCE, max_cells=44))
    line.send(GEOM, geom_body())
    line.send(POSE, pose_body())
    line.send(MAP, map_body(op(FREE, 45)))
    planner = line.planner
    assert planner.geom is None
    assert (planner.needs.too_many_cells, planner.window().size) == (45, 0)
    assert planner.advice(line.now_s)[1].startswith("the window has 45 cells")
    assert planner.ack(line.now_s)[14] & 1
    line.send(GEOM, geom_body(width=8))
    line.send(POSE, pose_body())
    line.send(MAP, map_body(op(FREE, 40)))
    assert planner.needs.too_many_cells == 0
    assert planner.advice(line.now_s) == ("go", "")


def test_no_map_stays_under_a_geometry_that_cannot_be_held() -> None:
    line = Line(Receiver(NONCE, max_cells=45))
    line.send(GEOM, geom_body())
    line.send(MAP, map_body(op(FREE, 45)))
    line.send(GEOM, geom_body(width=90, session=3))  # another run, the same number
    line.send(MAP, map_body(op(FREE, 45)))
    assert line.planner.blank
    assert not line.planner.window().any()


def test_a_digest_that_differs_stops_until_the_map_is_mended_or_another() -> None:
    line = receiving()
    right = line.planner.digest()
    line.send(DIGEST, struct.pack("<BxxxI", 7, right ^ 1))
    assert line.planner.ack(line.now_s)[14] & 0b10
    assert line.planner.advice(line.now_s) == ("stop", "the map is not the sender's")
    line.send(DIGEST, struct.pack("<BxxxI", 7, right))  # the refresh has mended it
    assert line.planner.advice(line.now_s) == ("go", "")
    line.send(DIGEST, struct.pack("<BxxxI", 7, right ^ 1))
    line.send(GEOM, geom_body(geom_id=8))
    assert not line.planner.needs.full


# What a planner has to do


def test_what_the_stop_zone_allows_is_for_both_ways_and_grows_old() -> None:
    line = receiving()
    assert line.planner.allowed_mps(line.now_s) == (0.0, 0.0)  # nothing is known
    for state, allowed in ((1, 0.65), (2, 0.65), (3, 0.65), (0, 0.0), (9, 0.0)):
        line.send(STOP_ZONE, zone_body(state, 0b1001))
        assert line.planner.allowed_mps(line.now_s) == (allowed, 0.0)
        assert line.planner.advice(line.now_s) == ("go", "")  # the link is well
    zone = line.planner.stop_zone
    assert zone is not None
    assert zone.describe() == "unknown: an obstacle, map or pose not to be trusted"
    line.send(STOP_ZONE, zone_body())
    assert line.planner.allowed_mps(line.now_s + 0.35) == (0.65, 0.0)
    assert line.planner.allowed_mps(line.now_s + 0.36) == (0.0, 0.0)
    line.send(GEOM, geom_body(session=4))
    assert line.planner.stop_zone is None


@pytest.mark.parametrize(("health", "mode", "why"), STOPS)
def test_the_planner_stops_for_what_the_pose_frame_says(health: int, mode: int, why: str) -> None:
    line = receiving()
    line.send(POSE, pose_body(health, mode))
    assert line.planner.advice(line.now_s) == ("stop", why)


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
    names += ["tile_variance", "tile_slope", "tile_refused", "tile_cause", "tile_age", "tile_z"]
    names += ["scan", "scan_end", "scan_refused", "tile_edge", "tile_foothold"]
    for name in names:
        assert receiver.feed_datagram(1.0, vector(name)), name
    assert receiver.needs.digest_ok
    assert not receiver.suspect
    assert receiver.stop_zone is not None
    counts = {GEOM: 1, POSE: 1, MAP: 1, DIGEST: 1, STOP_ZONE: 1, TILE: 10, SCAN: 3}
    assert receiver.accepted == counts
    assert (receiver.numbers.last, receiver.ignored.types) == (18, 0)


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
    assert receiver.cell_at(float("nan"), 0.0) == receiver.cell_at(0.0, float("inf")) == UNKNOWN
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


def test_an_origin_that_was_told_before_any_pose_is_mended_by_the_next_frame_behind_one() -> None:
    line, corner = Line(Receiver(NONCE)), round(1700.0 / 0.05) - 4
    line.send(GEOM, geom_body())
    line.send(MAP, map_body(op(2, 1), ox=corner))
    line.send(POSE, (1_700_000).to_bytes(4, "little") + bytes(20))
    line.send(MAP, map_body(ox=corner))
    assert line.planner.origin == (corner, 0)
    assert line.planner.cell_at(corner * 0.05 + 0.01, 0.01) == OBSTACLE


@pytest.mark.parametrize(("nonce", "max_cells"), [(-1, 9), (2**32, 9), (NONCE, 2**32)])
def test_a_number_that_no_hello_tells_is_refused_at_once(nonce: int, max_cells: int) -> None:
    with pytest.raises(ValueError, match=r"must be within 0\.\.4294967295, is"):
        Receiver(nonce, max_cells=max_cells)


@given(st.lists(st.binary(max_size=400), max_size=8))
def test_no_bytes_make_the_planner_raise(pieces: list[bytes]) -> None:
    planner = Receiver(NONCE)
    before = state_of(planner)
    for now_s, piece in enumerate(pieces):
        planner.feed_datagram(float(now_s), piece)
        planner.exchange(float(now_s), piece)
    assert state_of(planner) == before


@settings(max_examples=examples(20))
@given(st.lists(st.integers(0, 120)), st.lists(st.sampled_from([b"", b"\0", b"\0\0"]), min_size=4))
def test_where_the_stream_is_cut_makes_no_difference(cuts: list[int], idle: list[bytes]) -> None:
    names = ("geom_serial", "pose_serial", "map_serial")
    stream = b"".join(gap + vector(name) for gap, name in zip(idle, names, strict=False))
    planner = Receiver(NONCE)
    for piece in cut(stream, cuts):
        planner.feed_stream(0.0, piece)
    assert planner.digest() == int(VECTORS["digest_crc"], 16)
    assert planner.accepted == {GEOM: 1, POSE: 1, MAP: 1}
    assert not planner.rejected


def test_a_frame_that_never_ends_is_one_rejection_and_holds_no_memory() -> None:
    planner = Receiver(NONCE)
    for _ in range(100):
        planner.feed_stream(0.0, b"\x01" * 1000)
    planner.feed_stream(0.0, b"\0" + vector("geom_serial"))
    assert planner.rejected == {"cobs": 1}
    assert planner.geom is not None
