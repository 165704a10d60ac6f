"""Driving from a page: one at a time, only by a fresh picture, and never past the hand's grip."""

from collections.abc import Iterator

import pytest

from mapod_link.asking import DRIVE_BODY
from mapod_link.frames import DRIVE, GEOM, MAP, POSE, STOP_ZONE, frame_from_bytes
from mapod_link.wires import UdpWire
from tests.support.link.planner_sender import (
    Line,
    geom_body,
    map_body,
    pose_body,
    with_map,
    zone_body,
)
from tools.terminal.planner_end import WatchingReceiver
from tools.view.driving import ANOTHER, DEAD_MAN_S, OLD_PICTURE, Driving, Limits
from tools.view.link_end import LinkEnd

ME, YOU = "me", "you"


class Wheel:
    """A server's driving, and what of it reaches the wire; its time is the sender's."""

    def __init__(self, end: LinkEnd, limits: Limits) -> None:
        self.line = Line[WatchingReceiver](end.receiver)
        self.driving = Driving(end, limits)
        with_map(self.line)
        self.see()

    @property
    def now_s(self) -> float:
        return self.line.now_s

    def see(self, mode: int = 1) -> None:
        """The robot is heard."""
        self.line.send(POSE, pose_body(mode=mode))
        self.line.send(MAP, map_body())
        self.line.send(STOP_ZONE, zone_body())

    def hold(self, v: float, w: float, page: str = ME, seen_s: float | None = None) -> str:
        seen_s = self.now_s if seen_s is None else seen_s
        return self.driving.drive(self.now_s, page, v, w, seen_s)

    def asked(self) -> list[tuple[int, int, int]]:
        """(v, w, valid_ms) of the requests that have left since the last call."""
        frames = map(frame_from_bytes, self.line.planner.poll(self.now_s))
        bodies = [f.body for f in frames if not isinstance(f, str) and f.type == DRIVE]
        return [DRIVE_BODY.unpack(body)[2:5] for body in bodies]

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.line.now_s += 0.05
            self.driving.poll(self.now_s)


@pytest.fixture
def end() -> Iterator[LinkEnd]:
    link_end = LinkEnd(UdpWire("127.0.0.1", 0))
    yield link_end
    link_end.close()


@pytest.fixture
def wheel(end: LinkEnd) -> Wheel:
    return Wheel(end, Limits(1.0, 0.8))


def test_shares_are_of_what_the_zone_and_the_settings_allow(end: LinkEnd, wheel: Wheel) -> None:
    for v, w in ((1.0, 0.0), (0.5, -1.0), (-1.0, 0.5)):
        assert wheel.hold(v, w) == ""
    assert wheel.asked() == [(650, 0, 300), (325, -800, 300), (0, 400, 300)]
    slower = Wheel(end, Limits(0.2, 0.8))
    slower.hold(1.0, 0.0)
    assert slower.asked() == [(200, 0, 300)]
    slower.line.now_s += 0.4  # the zone is too old to allow anything
    slower.line.send(POSE, pose_body())
    slower.line.send(MAP, map_body())
    slower.hold(1.0, 0.0)
    assert slower.asked() == [(0, 0, 300)]


def test_a_hand_that_lets_go_or_falls_silent_stops_it_three_times(wheel: Wheel) -> None:
    for lets_go in (True, False):
        wheel.see()
        assert wheel.hold(1.0, 0.0) == ""
        assert wheel.asked() == [(650, 0, 300)]
        if lets_go:
            wheel.driving.stop(wheel.now_s, ME)
        wheel.pass_time(1.0)
        assert wheel.asked() == [(0, 0, 0)] * 3
        assert wheel.driving.told_to(ME, wheel.now_s)["by"] is None


def test_a_hand_that_holds_on_is_not_stopped(wheel: Wheel) -> None:
    for _ in range(20):
        wheel.see()
        assert wheel.hold(1.0, 0.0) == ""
        wheel.pass_time(DEAD_MAN_S - 0.05)
    assert wheel.asked() == [(650, 0, 300)] * 20


def test_one_page_drives_at_a_time_and_only_that_one_stops(wheel: Wheel) -> None:
    assert wheel.hold(1.0, 0.0, ME) == ""
    assert wheel.hold(-1.0, 0.0, YOU) == ANOTHER
    wheel.driving.stop(wheel.now_s, YOU)
    assert wheel.asked() == [(650, 0, 300)]
    assert wheel.driving.told_to(ME, wheel.now_s)["by"] == "you"
    assert wheel.driving.told_to(YOU, wheel.now_s)["by"] == "another page"
    wheel.driving.stop(wheel.now_s, ME)
    assert wheel.hold(1.0, 0.0, YOU) == ""
    assert wheel.asked() == [(0, 0, 0), (650, 0, 300)]


@pytest.mark.parametrize("seen", [-0.6, 1.0], ids=["old", "of no time that there was"])
def test_nobody_drives_by_an_old_picture(wheel: Wheel, seen: float) -> None:
    assert wheel.hold(1.0, 0.0) == ""
    assert wheel.hold(1.0, 0.0, seen_s=wheel.now_s + seen) == OLD_PICTURE
    assert wheel.asked() == [(650, 0, 300), (0, 0, 0)]


def test_why_it_may_not_drive_is_said_and_nothing_leaves(end: LinkEnd, wheel: Wheel) -> None:
    wheel.see(mode=4)
    assert "mode 4" in wheel.hold(1.0, 0.0)
    wheel.see()
    wheel.line.now_s += 0.2
    assert wheel.hold(1.0, 0.0) == "the robot is not heard any more"
    wheel.line.send(GEOM, geom_body(session=7))
    assert wheel.hold(1.0, 0.0) == "no map has arrived"
    off = Wheel(end, Limits(1.0, 0.8, "[robot] enable_motors is false"))
    assert "enable_motors" in off.hold(1.0, 0.0)
    assert "enable_motors" in str(off.driving.told_to(ME, off.now_s)["why_not"])
    end.trouble = "the wire is gone"
    assert Wheel(end, Limits(1.0, 0.8)).hold(1.0, 0.0) == "the wire is gone"
    assert wheel.asked() == []


def test_a_robot_that_stands_though_it_is_asked_says_why(wheel: Wheel) -> None:
    for _ in range(12):
        wheel.see()
        wheel.hold(-1.0, 0.0)
        wheel.pass_time(0.1)
    assert wheel.driving.told_to(ME, wheel.now_s)["why_not"] == "that way is barred: clear"
    for _ in range(12):
        wheel.see()
        wheel.hold(1.0, 0.0)
        wheel.pass_time(0.1)
    assert "motors enabled" in str(wheel.driving.told_to(ME, wheel.now_s)["why_not"])
