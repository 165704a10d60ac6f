"""The C header keeps those of a receiver's rules that the conformance tests do not see.

Numbers, orders, epochs, restarts, silence: tests/tools/conformance asks the same header for them.
"""

import struct

import pytest

from mapod_link.frames import (
    DIGEST,
    GEOM,
    MAP,
    POSE,
    STOP_ZONE,
    TILE,
    bytes_from_frame,
)
from tests.support.link.c_link import NO_YAW, NOT_KNOWN, Ask, CReceiver, ExternalPose
from tests.support.link.planner_sender import (
    GOOD_HEALTH,
    NONCE,
    STOPS,
    geom_body,
    map_body,
    op,
    pose_body,
)

FREE_ROW = op(1, 9)


class Line:
    """A sender without a mind, and its receiver."""

    def __init__(self, seq: int = 0) -> None:
        self.receiver = CReceiver(NONCE, max_cells=100)
        self.seq, self.now_s = seq, 10.0

    def send(self, kind: int, body: bytes, *, lost: bool = False, t_ms: int | None = None) -> bool:
        """The next frame; whether it was accepted."""
        self.seq, self.now_s = (self.seq + 1) % 65536, self.now_s + 0.01
        t_ms = round(self.now_s * 1000) if t_ms is None else t_ms
        frame = bytes_from_frame(kind, self.seq, t_ms, body)
        return not lost and self.receiver.feed_datagram(self.now_s, frame)

    def begin(self) -> "Line":
        """Geometry 7, a pose, and a row of FREE cells."""
        assert self.send(GEOM, geom_body())
        assert self.send(POSE, pose_body())
        assert self.send(MAP, map_body(FREE_ROW))
        return self

    def advice(self) -> tuple[str, str]:
        return self.receiver.link_advice(self.now_s)


def test_it_is_blank_and_says_stop_until_the_first_map() -> None:
    line = Line()
    assert line.advice() == ("stop", "no map yet")
    line.send(GEOM, geom_body())
    line.send(POSE, pose_body())
    assert line.receiver.blank
    assert line.receiver.stale(line.now_s)
    assert line.advice() == ("stop", "no map yet")
    line.send(MAP, map_body(FREE_ROW))
    assert line.advice() == ("go", "")
    assert line.receiver.window()[0].tolist() == [1] * 9


@pytest.mark.parametrize(("health", "mode", "why"), STOPS)
def test_each_line_of_the_table_stops_the_planner(health: int, mode: int, why: str) -> None:
    line = Line().begin()
    line.send(POSE, pose_body(health, mode))
    assert line.advice() == ("stop", "mode" if why.startswith("mode") else why)
    line.send(POSE, pose_body(GOOD_HEALTH, 2))
    assert line.advice() == ("go", "")


def test_a_gap_makes_the_planner_slow_until_what_was_lost_is_repaired() -> None:
    line = Line().begin()
    line.send(MAP, map_body(), lost=True)
    line.send(POSE, pose_body())
    assert line.advice() == ("slow", "a frame is missing")
    line.send(MAP, map_body(repaired=4))
    assert line.advice() == ("go", "")


def test_what_is_stale_stays_so_when_the_millisecond_clock_wraps() -> None:
    line = Line().begin()
    day_s = 86_400
    for day in range(1, 51):
        assert line.receiver.stale(line.now_s + day * day_s)
    assert line.receiver.stale(line.now_s + 2**32 / 1000)


def test_it_works_across_the_wrap_of_clock_numbers_and_origin() -> None:
    line = Line(seq=65_533)
    line.now_s = 2**32 / 1000 - 0.025
    line.begin()
    for k in range(10):
        line.send(POSE, pose_body())
        line.send(MAP, map_body(FREE_ROW, ox=32_766 + k, oy=-32_766 - k, start=9))
        assert not line.receiver.stale(line.now_s)
        assert not line.receiver.suspect
    window = line.receiver.window()
    assert window[1].tolist() == [1] * 9
    assert window[2].tolist() == [1] * 8 + [0]


def test_a_window_that_is_too_large_leaves_no_map() -> None:
    line = Line().begin()
    line.send(GEOM, geom_body(8, width=11, height=10))
    assert line.receiver.accepted["too_large"] == 1
    assert line.receiver.window().size == 0
    assert line.advice() == ("stop", "no map yet")
    line.receiver.poll(line.now_s)
    assert line.receiver.poll(line.now_s + 0.25)[0][0] == 0x19
    line.send(GEOM, geom_body(9))
    line.send(POSE, pose_body())
    line.send(MAP, map_body(FREE_ROW, geom_id=9))
    assert line.advice() == ("go", "")


def test_a_digest_that_differs_stops_the_planner_until_one_agrees_or_a_new_epoch_begins() -> None:
    line = Line().begin()
    right = line.receiver.digest()
    for end in ((DIGEST, struct.pack("<BxxxI", 7, right)), (GEOM, geom_body(8))):
        line.send(DIGEST, struct.pack("<BxxxI", 7, right ^ 1))
        assert line.receiver.state(line.now_s).need_full
        assert line.advice() == ("stop", "the map is not the sender's")
        line.send(*end)
        assert not line.receiver.state(line.now_s).need_full


def test_echoes_of_what_travels_the_other_way_are_left_alone() -> None:
    line = Line().begin()
    for kind in range(8, 13):
        assert not line.send(kind, bytes(16))
    assert line.receiver.state(line.now_s).last == 3
    line.seq = 3
    for kind in (0, 7, 13, 15):
        assert line.send(kind, bytes(3))
    assert line.receiver.accepted["unknown_type"] == 4
    assert not line.receiver.suspect


def test_a_receiver_that_only_asks_says_so_and_acknowledges_nothing() -> None:
    receiver = CReceiver(NONCE, poll_only=True)
    [hello] = receiver.poll(1.0)
    assert hello[8 + 10] == 1
    receiver.feed_datagram(1.0, bytes_from_frame(GEOM, 1, 1, geom_body()))
    assert receiver.poll(2.0) == []


def test_a_receiver_without_memory_for_a_map_keeps_all_but_the_map() -> None:
    receiver = CReceiver(NONCE, poll_only=True, keeps_map=False, max_cells=2**32 - 1)
    pose = (POSE, pose_body())
    told = [(GEOM, geom_body()), pose, (MAP, map_body(FREE_ROW)), (GEOM, geom_body(8)), pose]
    for seq, (kind, body) in enumerate(told):
        assert receiver.feed_datagram(1.0, bytes_from_frame(kind, seq, 1000 + seq, body))
    assert not receiver.window().any()
    assert receiver.link_advice(1.0) == ("stop", "no map yet")
    assert receiver.pose is not None
    assert receiver.drive(1.0, 0.1, 0.0, 0.3), "the run of the sender is known"


def test_a_stop_zone_counts_for_a_third_of_a_second_by_either_clock() -> None:
    line = Line().begin()
    body = struct.pack("<8HhBB", 900, 65_535, 0, 65_535, 65_535, 500, 0, 65_535, 0, 1, 0)
    assert line.receiver.zone_advice(line.now_s) == "stop"
    line.send(STOP_ZONE, body)
    assert line.receiver.zone_advice(line.now_s + 0.35) == "go"
    assert line.receiver.zone_advice(line.now_s + 0.351) == "stop"
    assert line.receiver.zone_advice(line.now_s) == "stop"
    line.send(STOP_ZONE, body)
    assert line.receiver.zone_advice(line.now_s) == "go"
    line.send(POSE, pose_body(), t_ms=round(line.now_s * 1000) + 400)
    assert line.receiver.zone_advice(line.now_s) == "stop"
    assert not line.send(STOP_ZONE, body[:-1])


def test_pieces_of_tiles_that_contradict_themselves_are_rejected() -> None:
    line = Line().begin()

    def tile(count: int, values: bytes, layer: int = 1, status: int = 0, first: int = 0) -> bytes:
        head = struct.pack("<HBBhhHH", 9, layer, status, -3, 4, 5, 3)
        return head + first.to_bytes(3, "little") + struct.pack("<BHH", 7, count, 50) + values

    assert line.send(TILE, tile(3, struct.pack("<3h", 5, -32_768, -6)))
    assert line.receiver.piece.values[:4] == [5, NOT_KNOWN, -6, 0]
    assert line.send(TILE, tile(5, bytes([0b11_10_01_00, 2]), layer=0))
    assert line.receiver.piece.values[:5] == [0, 1, 2, 0, 2]
    assert line.send(TILE, tile(0, b"", status=2))
    assert line.send(TILE, tile(4, b"??", layer=9))
    assert line.receiver.piece.count == 0
    for wrong in (
        tile(3, bytes(5)),
        tile(0, b""),
        tile(15, bytes(30), first=1),
        tile(1, b"", status=2),
        tile(1, bytes(2))[:19],
    ):
        assert not line.send(TILE, wrong)
    assert line.receiver.rejected == {"body": 5}


def test_values_that_no_frame_tells_are_not_sent() -> None:
    line = Line()
    assert not line.receiver.drive(1.0, 0.1, 0.0, 0.3), "the run of the sender is not known"
    line.begin()
    assert line.receiver.drive(1.0, -32.767, 32.767, 1.0)
    assert not line.receiver.drive(1.0, -32.768, 0.0, 0.3)
    assert not line.receiver.drive(1.0, 0.0, 0.0, 1.001)
    good = ExternalPose(1, 2, NO_YAW, 5, 5, 0, 0, 0)
    assert line.receiver.external_pose(1.0, good)
    for wrong in (
        ExternalPose(-(2**31), 2, NO_YAW, 5, 5, 0, 0, 0),
        ExternalPose(1, 2, 31_416, 5, 5, 0, 9, 0),
        ExternalPose(1, 2, 0, 5, 5, 0, 0, 0),
        ExternalPose(1, 2, 0, 0, 5, 0, 9, 0),
        ExternalPose(1, 2, 0, 5, 5, 10_001, 9, 0),
        ExternalPose(1, 2, 0, 5, 5, 0, 9, 1001),
        ExternalPose(1, 2, 0, 5, 5, 0, 9, 0, 5, -(2**31), NO_YAW, NO_YAW),
        ExternalPose(1, 2, 0, 5, 5, 0, 9, 0, 5, 0, 0, 31_416, 9),
        ExternalPose(1, 2, 0, 5, 5, 0, 9, 0, 5, 0, NO_YAW, 0, 9),
        ExternalPose(1, 2, 0, 5, 5, 0, 9, 0, 5, 0, 0, 0, 0),
    ):
        assert not line.receiver.external_pose(1.0, wrong)
    assert line.receiver.ask(1.0, Ask(1, 0x84))
    assert not line.receiver.ask(1.0, Ask(1, 0x80))
    assert not line.receiver.ask(1.0, Ask(1, 0x18))
    line.receiver.say("stopped")
    assert line.receiver.ack(1.0)[8 + 14] & 0x10
