"""The planner's end of the link: loss, repair, restarts, and what it answers.

Source: planner link, sections 5, 6 and 14, items 5 and 6.
"""

import random
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.planner import FakePlanner
from fakes.planner_frames import (
    ACK,
    DIGEST,
    FREE,
    GEOM,
    HELLO,
    MAP,
    OBSTACLE,
    POSE,
    bytes_from_frame,
    frame_from_bytes,
)
from tests.planner_sender import (
    GOOD_HEALTH,
    Line,
    begun,
    geom_body,
    map_body,
    op,
    pose_body,
    vector,
)

# Loss and repair


def test_a_gap_makes_the_map_suspect_until_a_map_frame_says_that_it_is_repaired() -> None:
    line = begun()
    missing = line.send(MAP, map_body(op(OBSTACLE, 1)), lost=True)
    assert not line.planner.suspect
    line.send(POSE, pose_body())
    assert line.planner.suspect
    assert line.planner.advice(line.now_s) == ("slow", "a frame is missing")
    line.send(MAP, map_body(repaired=missing - 1))
    assert line.planner.suspect
    line.send(MAP, map_body(op(OBSTACLE, 1), repaired=missing))
    assert not line.planner.suspect
    assert line.planner.advice(line.now_s) == ("go", "")
    assert (line.planner.gaps, line.planner.missing) == (1, 1)


def test_only_the_newest_gap_counts_and_numbers_may_wrap() -> None:
    line = begun(seq=0xFFF9)
    for _ in range(2):
        line.send(POSE, pose_body(), lost=True)
        line.send(POSE, pose_body())
    assert line.seq == 0x10000  # sent modulo 65 536
    newest_gap = line.seq - 1
    line.send(MAP, map_body(repaired=newest_gap - 1))
    assert line.planner.suspect
    line.send(MAP, map_body(repaired=newest_gap))
    assert not line.planner.suspect


def test_a_window_that_jumps_away_leaves_nothing_to_suspect() -> None:
    line = begun()
    line.send(MAP, map_body(op(OBSTACLE, 9)), lost=True)
    line.send(MAP, map_body(ox=9))
    assert not line.planner.suspect
    assert not line.planner.window().any()


def test_late_and_repeated_frames_are_dropped_in_silence() -> None:
    line = begun()
    first = bytes_from_frame(MAP, line.seq + 1, 50, map_body(op(FREE, 1)))
    second = bytes_from_frame(MAP, line.seq + 2, 60, map_body(op(OBSTACLE, 1)))
    for frame in (second, first, second):
        line.planner.feed_datagram(0.06, frame)
    assert line.planner.cell(0, 0) == OBSTACLE
    assert line.planner.repeated == 2
    assert line.planner.suspect
    assert not line.planner.rejected


def test_a_frame_of_unknown_type_counts_as_received() -> None:
    line = begun()
    line.send(5, b"to come")
    line.send(POSE, pose_body())
    assert line.planner.ignored_types == 1
    assert not line.planner.suspect
    assert line.planner.ack(0.0)[2] & 0b11 == 0b11


@pytest.mark.parametrize("silent", [POSE, MAP])
def test_half_a_sender_is_as_stale_as_none(silent: int) -> None:
    line, bodies = begun(), {POSE: pose_body(), MAP: map_body()}
    heard_s = line.now_s
    while line.now_s < heard_s + 0.2:
        other = POSE if silent == MAP else MAP
        line.send(other, bodies[other])
        assert line.planner.stale(line.now_s) == (line.now_s - line.planner_heard(silent) > 0.15)
    assert line.planner.advice(line.now_s) == ("stop", "link stale")
    line.send(silent, bodies[silent])
    assert not line.planner.stale(line.now_s)


def test_a_new_session_begins_its_count_anew_and_its_map_blank() -> None:
    line = begun()
    line.send(MAP, map_body(op(OBSTACLE, 45)))
    line.seq = -1
    line.send(POSE, pose_body())
    assert line.planner.repeated == 1
    line.send(GEOM, geom_body(session=1))
    assert line.planner.blank
    assert line.planner.stale(line.now_s)
    assert not line.planner.window().any()
    line.send(POSE, pose_body())
    line.send(MAP, map_body())
    assert line.planner.advice(line.now_s) == ("go", "")
    assert line.planner.gaps == 0


def test_maps_of_a_geometry_that_never_arrived_are_not_acknowledged() -> None:
    line = begun()
    line.send(MAP, map_body(op(OBSTACLE, 45)))
    line.send(GEOM, geom_body(geom_id=8, width=5, height=4), lost=True)
    line.send(MAP, map_body(op(FREE, 20), geom_id=8))
    assert (line.planner.window() == OBSTACLE).all()
    line.send(POSE, pose_body())
    assert line.planner.suspect
    ack = line.planner.ack(line.now_s)
    assert ack[2] & 0b111 == 0b100  # the two frames before the pose did not count
    assert ack[14] & 1  # NEED_GEOM
    line.send(GEOM, geom_body(geom_id=8, width=5, height=4))
    line.send(MAP, map_body(op(FREE, 20), geom_id=8))
    assert line.planner.window().tolist() == [[FREE] * 5] * 4
    assert not line.planner.ack(line.now_s)[14] & 0b1001


def test_a_window_larger_than_the_planner_holds_is_refused() -> None:
    planner = FakePlanner(max_cells=44)
    Line(planner).send(GEOM, geom_body())
    assert planner.geom is None
    assert planner.rejected == {"body": 1}


# Answers


def answers(planner: FakePlanner, now_s: float) -> list[tuple[int, int]]:
    """(type, seq) of what the planner sends."""
    frames = [frame_from_bytes(data) for data in planner.poll(now_s)]
    return [("", 0) if isinstance(f, str) else (f.type, f.seq) for f in frames]  # type: ignore[misc]


def test_it_says_hello_until_the_geometry_arrives() -> None:
    planner = FakePlanner()
    assert answers(planner, 0.0) == [(HELLO, 1)]
    assert answers(planner, 0.1) == []
    assert answers(planner, 0.3) == [(HELLO, 2)]
    planner.feed_datagram(0.4, vector("geom"))
    assert answers(planner, 0.6) == [(ACK, 3)]


def test_an_ack_is_due_each_16_frames_and_each_100_ms() -> None:
    line = begun()
    assert answers(line.planner, 0.03) == [(ACK, 1)]
    for _ in range(33):
        line.send(POSE, pose_body())
        line.now_s -= 0.01
    assert answers(line.planner, 0.05) == [(ACK, 2), (ACK, 3)]
    assert answers(line.planner, 0.13) == []
    assert answers(line.planner, 0.15) == [(ACK, 4)]


def test_each_fault_and_a_one_way_link_keep_it_silent() -> None:
    mute, deaf, one_way = FakePlanner(), FakePlanner(), FakePlanner(ack_every=0)
    mute.mute = deaf.deaf = True
    for planner in (mute, deaf, one_way):
        planner.feed_datagram(0.0, vector("geom"))
    assert mute.poll(0.0) == one_way.poll(0.0) == []
    assert deaf.geom is None


@given(st.integers(0, 2**32))
def test_the_mask_of_an_ack_has_a_bit_for_each_frame_that_came(seed: int) -> None:
    line, chance = begun(), random.Random(seed)
    came = [True] * 3
    for _ in range(60):
        came.append(chance.random() < 0.8)
        line.send(POSE, pose_body(), lost=not came[-1])
    last = max(i for i, it_came in enumerate(came) if it_came)
    got_last, mask = struct.unpack_from("<HI", line.planner.ack(line.now_s))
    assert got_last == last + 1
    assert [mask >> i & 1 for i in range(32)] == [int(came[last - 1 - i]) for i in range(32)]


def test_a_digest_that_differs_without_a_gap_asks_for_everything() -> None:
    line = begun()
    right = line.planner.digest()
    line.send(DIGEST, struct.pack("<BxxxI", 7, right))
    assert line.planner.digest_ok
    assert not line.planner.need_full
    line.send(DIGEST, struct.pack("<BxxxI", 7, right ^ 1))
    assert not line.planner.digest_ok
    assert line.planner.ack(line.now_s)[14] & 0b10
    line.send(GEOM, geom_body(geom_id=8))
    assert not line.planner.need_full


@pytest.mark.parametrize(
    ("health", "mode", "why"),
    [
        (GOOD_HEALTH, 4, "mode 4"),
        (GOOD_HEALTH, 0, "mode 0"),
        (GOOD_HEALTH & ~(1 << 4), 1, "pose not valid"),
        (GOOD_HEALTH & ~(1 << 5), 1, "map not valid"),
        (GOOD_HEALTH | 1 << 7, 1, "drop-off ahead"),
        (GOOD_HEALTH | 1 << 9, 2, "attitude out of range"),
        (GOOD_HEALTH | 1 << 15, 2, "operator stop"),
    ],
)
def test_the_planner_stops_for_what_the_pose_frame_says(health: int, mode: int, why: str) -> None:
    line = begun()
    line.send(POSE, pose_body(health, mode))
    assert line.planner.advice(line.now_s) == ("stop", why)
