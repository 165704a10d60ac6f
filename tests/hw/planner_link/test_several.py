"""Several planners on one map: each told everything by its own numbers, and one who drives."""

import math
from collections.abc import Sequence

import pytest

from core.records import DriveRequest
from fakes.planner_mcu.receiver import FakePlanner
from fakes.wires.wire import MemoryPort
from hw.planner_link.receivers import Planners
from hw.planner_link.requests import MOST_COMMANDERS, ReplayGuard, Requests
from hw.planner_link.sender import LinkSettings, Wire
from mapod_link.asking import drive_body, hello_body
from mapod_link.frames import bytes_from_frame, signed_bytes_from_frame
from mapod_link.serial_line import serial_from_frame
from tests.support.link.planner_line import POSE_REPORT, ZONE, Sky, SkyTiles

SESSION, TICK_S = 0x5A17C0DE, 0.02


class Fleet:
    """Two planners or more, on UDP and on a serial line in turn."""

    def __init__(
        self, sky: Sky, refusals: Sequence[str] = ("", ""), key: bytes | None = None
    ) -> None:
        self.sky, self.now_s = sky, 1000.0
        self.ports = [MemoryPort(datagrams=k % 2 == 0) for k in range(len(refusals))]
        self.planners = Planners(
            [
                Wire(port, None if port.datagrams else 921_600, refusal, refusal)
                for port, refusal in zip(self.ports, refusals, strict=True)
            ],
            LinkSettings(size=sky.size, cell_mm=50, tick_s=TICK_S, stale_ms=150, key=key),
            SESSION,
        )
        self.ends = [FakePlanner(seed=k, ack_every=1, key=key) for k in range(len(refusals))]

    def tick(self) -> None:
        self.now_s += TICK_S
        self.planners.step(self.now_s, POSE_REPORT, self.sky.window(), ZONE, SkyTiles(self.sky))
        for port, end in zip(self.ports, self.ends, strict=True):
            for piece in port.take_datagrams():
                if port.datagrams:
                    end.feed_datagram(self.now_s, piece)
                else:
                    end.feed_stream(self.now_s, piece)
            for frame in end.poll(self.now_s):
                port.give(frame if port.datagrams else serial_from_frame(frame))

    def settle(self, ticks: int) -> None:
        for _ in range(ticks):
            self.tick()

    def sessions_told(self) -> list[int]:
        return [end.geom.session for end in self.ends if end.geom]

    def drive(self, way: int, t_ms: int, nonce: int, valid_s: float = 0.3) -> None:
        """A request of 1 m/s by one of the wires."""
        body = drive_body(self.planners.session, nonce, 1.0, 0.0, valid_s)
        frame = bytes_from_frame(10, t_ms % 2**16, t_ms, body)
        port = self.ports[way]
        port.give(frame if port.datagrams else serial_from_frame(frame))
        self.planners.poll(self.now_s)


def test_all_planners_hold_the_map_whatever_happens_to_one_of_them() -> None:
    sky = Sky(31, 2)
    fleet = Fleet(sky, ("", "", ""))
    for k in range(150):
        sky.move(k % 3 - 1, k % 2)
        sky.change(6)
        fleet.ports[1].connected = not 40 < k < 90  # it misses what changed meanwhile
        fleet.ends[2].deaf = 60 < k < 80
        fleet.tick()
    fleet.settle(60)
    for end in fleet.ends:
        assert (end.window() == sky.meant()).all()
        assert not end.suspect
    assert fleet.planners.links[2].frames_lost > 0
    assert fleet.planners.links[0].frames_lost == 0
    before = [end.geom.geom_id for end in fleet.ends if end.geom]
    fleet.ends[0].needs.full = True  # each link has its own epoch
    fleet.settle(10)
    after = [end.geom.geom_id for end in fleet.ends if end.geom]
    assert after == [(before[0] + 1) % 256, *before[1:]]
    sent = sum(link.frames_sent for link in fleet.planners.links)
    lost = sum(link.frames_lost for link in fleet.planners.links)
    assert fleet.planners.counters == {
        "frames_sent": sent, "frames_lost": lost, "answers_rejected": 0, "link_ticks_held": 50 - 1
    }  # fmt: skip


def test_while_one_commander_drives_no_other_does_by_whatever_wire() -> None:
    fleet = Fleet(Sky(9, 2))
    requests = fleet.planners.requests
    fleet.drive(0, 1000, nonce=5)
    assert requests.newest == DriveRequest(1.0, 0.0, fleet.now_s + 0.3)
    assert (requests.driver, requests.link) == ("commander 00000005", 0)
    fleet.drive(1, 1000, nonce=6)
    assert requests.last_refusal == "somebody else is driving"
    assert requests.ask(fleet.now_s, "modbus", 0.1, 0.0, 0.5) == "somebody else is driving"
    fleet.drive(1, 1001, nonce=6, valid_s=0.0)
    assert requests.newest == DriveRequest(0.0, 0.0, -math.inf)
    assert requests.ask(fleet.now_s, "modbus", 0.1, 0.2, 0.5) == ""
    assert requests.newest == DriveRequest(0.1, 0.2, fleet.now_s + 0.5)
    fleet.drive(0, 1400, nonce=5)
    assert requests.last_refusal == "somebody else is driving"
    assert requests.ask(fleet.now_s, "another", 0.0, 0.0, 0.0) == ""
    assert requests.driver == ""


def test_a_frame_that_comes_by_two_wires_counts_once_and_each_wire_has_its_own_refusal() -> None:
    fleet = Fleet(Sky(9, 2), ("", "", "no key"))
    for way in (0, 1):
        fleet.drive(way, 1000, nonce=5)
    assert fleet.planners.requests.accepted == 1
    assert "repetition" in fleet.planners.requests.last_refusal
    fleet.drive(2, 1100, nonce=5)
    assert fleet.planners.requests.refused["no key"] == 1


@pytest.mark.parametrize(
    ("v_mps", "w_radps", "valid_s"),
    [(math.nan, 0.0, 0.5), (0.0, math.inf, 0.5), (0.1, 0.1, 1.001), (0.1, 0.1, -0.1),
     (0.1, 0.1, math.nan), (math.inf, -math.inf, 0.0)],
)  # fmt: skip
def test_a_request_out_of_range_is_refused_by_whatever_way(
    v_mps: float, w_radps: float, valid_s: float
) -> None:
    requests = Requests(ReplayGuard(SESSION))
    assert requests.ask(1.0, "modbus", v_mps, w_radps, valid_s) == "the request is out of range"
    assert requests.newest is None
    assert requests.refused.total() == 1


def test_doubt_speaks_of_the_wire_by_which_it_is_driven_and_of_any_planner_that_stopped() -> None:
    fleet = Fleet(Sky(9, 2))
    fleet.tick()
    assert fleet.planners.stop_reason == ""
    fleet.drive(0, 1000, nonce=5)
    fleet.ports[1].connected = False
    assert fleet.planners.stop_reason == ""
    fleet.ports[0].connected = False
    assert fleet.planners.stop_reason == "the wire in memory is cut"
    fleet.planners.requests.ask(fleet.now_s, "modbus", 0.0, 0.0, 0.0)
    assert fleet.planners.stop_reason == "the wire in memory is cut"  # both are
    fleet.planners.requests.ask(fleet.now_s, "modbus", 0.1, 0.0, 0.5)
    assert fleet.planners.stop_reason == ""
    fleet.ports[0].connected = fleet.ports[1].connected = True
    fleet.ends[1].stopped = True
    fleet.settle(8)
    assert fleet.planners.stop_reason == "the planner says it stopped"
    fleet.ends[1].stopped = False
    fleet.settle(8)
    assert fleet.planners.stop_reason == ""


@pytest.mark.parametrize("key", [None, bytes(range(32))])
def test_before_the_clock_of_the_frames_wraps_all_get_a_new_session(key: bytes | None) -> None:
    sky = Sky(21, 2)
    fleet = Fleet(sky, key=key)
    fleet.now_s = 2**32 / 1000 - 0.5
    for _ in range(15):
        sky.change(5)
        fleet.tick()
    fleet.drive(0, 1000, nonce=5)
    assert fleet.planners.session == SESSION
    assert fleet.sessions_told() == [SESSION, SESSION]
    for _ in range(60):
        sky.change(5)
        sky.move(1, 0)
        fleet.tick()
    assert fleet.planners.session not in (SESSION, 0)
    assert fleet.sessions_told() == [fleet.planners.session] * 2
    for end in fleet.ends:
        assert not end.stale(fleet.now_s)
        assert not end.suspect
        assert (end.window() == sky.meant()).all()
    body = drive_body(SESSION, 5, 1.0, 0.0, 0.3)
    accepted = fleet.planners.requests.accepted
    fleet.ports[0].give(bytes_from_frame(10, 9, 9000, body))
    fleet.planners.poll(fleet.now_s)
    assert fleet.planners.requests.accepted == accepted
    if key is None:
        assert fleet.planners.requests.last_refusal == "it was meant for another run of mapod"


def test_a_full_memory_of_commanders_begins_a_new_session_in_which_no_old_frame_counts() -> None:
    key = bytes(range(32))
    fleet = Fleet(Sky(9, 2), key=key)
    fleet.settle(20)
    end = fleet.ends[0]
    frames = []
    for nonce in range(1, MOST_COMMANDERS + 1):
        body = drive_body(SESSION, nonce, 0.0, 0.0, 0.0)
        frames.append(signed_bytes_from_frame(10, 1, 9, body, key, SESSION, end.nonce))
        fleet.ports[0].give(frames[-1])
        fleet.tick()
    assert fleet.planners.requests.accepted == MOST_COMMANDERS
    fleet.settle(20)
    assert fleet.planners.session != SESSION
    assert fleet.sessions_told() == [fleet.planners.session] * 2
    assert not any(known.stale(fleet.now_s) for known in fleet.ends)
    fleet.ports[0].give(frames[0])
    fleet.tick()
    assert fleet.planners.requests.accepted == MOST_COMMANDERS
    assert end.drive(fleet.now_s, 0.1, 0.0, 0.3)
    fleet.tick()
    fleet.tick()
    assert fleet.planners.requests.accepted == MOST_COMMANDERS + 1


def test_somebody_is_heard_for_a_second_after_each_valid_frame() -> None:
    fleet = Fleet(Sky(9, 2))
    fleet.ends[0].mute = fleet.ends[1].mute = True
    fleet.tick()
    assert not fleet.planners.heard(fleet.now_s)
    fleet.ports[0].give(b"\x19 no frame")
    fleet.planners.poll(fleet.now_s)
    assert not fleet.planners.heard(fleet.now_s)
    fleet.ports[1].give(serial_from_frame(bytes_from_frame(9, 1, 1, hello_body(7, 10_000))))
    fleet.planners.poll(fleet.now_s)
    assert fleet.planners.heard(fleet.now_s + 0.99)
    assert not fleet.planners.heard(fleet.now_s + 1.01)
