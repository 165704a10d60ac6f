"""A planner drives the simulated robot through link, app and controller, and everything stops it.

Judged by the world's truth: the power of its wheels and the place of its body.
"""

from typing import Any

import pytest

from app import App, Ports
from core.driving import health
from core.driving.stall import STALLED
from fakes.scenes.scene import Scene, Solid
from fakes.world.robot import MAX_SPEED_MPS
from main import SETTLE_S
from mapod_link.asking import drive_body
from mapod_link.frames import DRIVE, bytes_from_frame
from tests.support.cases import few
from tests.support.robot.closed_loop import SESSION, ClosedLoop
from tests.support.robot.shipped import FLOOR, shipped

FRONT_M = 0.50  # of the simulated chassis, ahead of the axle
TO_DRIVE = ("drive", "h2d")
START_S = 1.7  # until all devices run
READY: dict[str, Any] = {"enable_motors": True, "start_clear_m": 12.0}
BEFORE_STANDING_S = 1.0  # request, exchange with the controller, and the motors' own slowness


class Commander:
    """A loop whose planner asks for a motion, 20 times a second, as long as it is told to."""

    def __init__(
        self, *solids: Solid, key: bytes | None = None, radio: bool = True, cells: int = 101,
        **robot: Any,
    ) -> None:  # fmt: skip
        scene = Scene("hall", solids or (FLOOR,))
        config = shipped(robot=READY | robot, drive={"radio": radio}, map={"cells": cells})
        self.loop = ClosedLoop(config, scene, drives=False, key=key)
        self.asks: tuple[float, float] | None = None
        self.valid_s = 0.2
        self.powers: set[tuple[int, int]] = set()
        self.run(START_S)

    def run(self, seconds: float) -> None:
        """Step for so long; notes every power that the motors got."""
        for _ in range(round(seconds * 200)):
            if self.asks and self.loop.ticks % 10 == 0:
                self.loop.planner.drive(self.loop.now_s, *self.asks, self.valid_s)
            self.loop.step()
            self.powers.add(self.loop.rig.drive.powers())

    def drive(self, v_mps: float, w_radps: float, seconds: float) -> None:
        self.asks = (v_mps, w_radps)
        self.run(seconds)

    @property
    def has_moved(self) -> bool:
        return self.powers != {(0, 0)}

    @property
    def health(self) -> int:
        """As the planner was told."""
        assert self.loop.planner.pose is not None
        return self.loop.planner.pose.health

    @property
    def place(self) -> tuple[float, float, float]:
        """The world's x, y, yaw."""
        return self.loop.rig.world.pose()[:3]

    @property
    def blocked_by(self) -> str:
        return self.loop.app.pilot.control.blocked_by

    def assert_stands(self, within_s: float = BEFORE_STANDING_S) -> None:
        """No power within so long, and no motion after that."""
        self.run(within_s)
        self.powers = set()
        before = self.place
        self.run(0.4)
        assert self.powers == {(0, 0)}
        assert self.place == pytest.approx(before, abs=0.01)


def driving(v_mps: float = 0.4, **robot: Any) -> Commander:
    commander = Commander(**robot)
    commander.drive(v_mps, 0.0, 0.2 + 2.0 * v_mps)
    power = 127 * v_mps / MAX_SPEED_MPS
    assert commander.loop.rig.drive.powers() == pytest.approx((power, power), abs=1)
    return commander


def test_a_request_moves_the_robot_at_its_speed_and_no_faster_than_the_ramp() -> None:
    commander = Commander()
    commander.drive(0.6, 0.0, 0.6)
    assert 0 < commander.loop.app.pilot.control.v_mps <= 0.5 * 0.6 + 0.01
    commander.run(1.0)
    from_m = commander.place[0]
    commander.run(0.5)
    assert commander.place[0] - from_m == pytest.approx(0.3, abs=0.02)
    assert commander.loop.app.mapper.odometry.v_mps == pytest.approx(0.6, abs=0.05)
    commander.drive(0.0, 0.5, 2.0)
    from_rad = commander.place[2]
    commander.run(0.5)
    assert commander.place[2] - from_rad == pytest.approx(0.25, abs=0.03)


SILENT = [
    ("planner", "mute", "the commander has fallen silent"),
    ("drive", "cut", ""),
    ("scanner", "cut", "the scanner delivers no scans"),
    ("drive", "mute", ""),
    ("planner", "stopped", "the planner says it stopped"),
    ("ahrs", "cut", "the attitude sensor delivers nothing"),
]


@pytest.mark.parametrize(("target", "fault", "said"), few(SILENT, 2))
def test_whoever_falls_silent_or_has_stopped_stops_it(target: str, fault: str, said: str) -> None:
    commander = driving()
    loop = commander.loop
    setattr(loop.planner if target == "planner" else loop.wires[target], fault, True)
    commander.assert_stands(1.5)  # the controller's own watchdog, where its wire is cut
    assert said in commander.blocked_by
    assert commander.blocked_by


def test_a_request_to_stop_now_stops_it_without_a_ramp() -> None:
    commander = driving()
    commander.asks, commander.valid_s = (0.0, 0.0), 0.0
    commander.run(0.15)  # a frame, and an exchange with the controller
    assert commander.loop.rig.drive.powers() == (0, 0)
    assert commander.blocked_by == ""


def test_it_stops_before_an_obstacle_says_so_and_can_back_off() -> None:
    commander = Commander(FLOOR, Solid("box", (3.33, 3.83), (-0.83, 0.87), (0.0, 0.93)))
    commander.drive(0.9, 0.0, 5.5)
    x_m = commander.place[0]
    assert 3.33 - 0.7 < x_m + FRONT_M < 3.33 - 0.10
    assert commander.blocked_by == "an obstacle is in the way"
    commander.assert_stands()
    commander.drive(-0.4, 0.0, 1.2)
    assert commander.place[0] < x_m - 0.15


@pytest.mark.parametrize(
    "cells", [101, 201]
)  # its floor lies 12 m ahead: outside of the map, in it
def test_it_stops_before_a_drop_and_the_planner_is_told_of_it(cells: int) -> None:
    near = Solid("floor before the drop", (-20.0, 9.27), (-20.0, 20.0), (-1.0, 0.0))
    far = Solid("floor of the ditch", (9.27, 40.0), (-20.0, 20.0), (-1.0, -0.6))
    commander = Commander(near, far, cells=cells)
    told = 0
    commander.asks = (0.9, 0.0)
    for _ in range(60):
        commander.run(0.2)
        told |= commander.health
    assert 7.7 < commander.place[0] + FRONT_M < 9.27 - 0.05
    assert commander.blocked_by == "a drop is in the way"
    assert told & 1 << 7


def test_ground_that_was_not_seen_to_be_free_stops_it_unless_somebody_vouches_for_it() -> None:
    commander = Commander(start_clear_m=1.8)
    commander.drive(0.5, 0.0, 4.0)
    assert 0.7 < commander.place[0] + FRONT_M < 1.8
    assert commander.blocked_by == "ground in the way was not seen to be free"


def test_after_an_emergency_stop_the_commander_must_let_go_first() -> None:
    commander = driving(unknown_stops=False)  # a restart of the controller ends the map
    commander.loop.rig.drive.emergency_stop = True
    commander.assert_stands(1.5)
    assert commander.health & 1 << 15
    assert "emergency stop" in commander.blocked_by
    commander.loop.rig.drive.emergency_stop = False
    commander.loop.rig.drive.reset(commander.loop.now_s)
    commander.asks = (0.6, 0.0)
    commander.powers = set()
    commander.run(2.0)
    assert not commander.has_moved
    assert "lets go" in commander.blocked_by
    commander.drive(0.0, 0.0, 0.5)
    commander.drive(0.6, 0.0, 1.0)
    assert commander.has_moved


def test_shutting_down_goes_on_until_the_controller_has_taken_the_zero() -> None:
    commander = driving()
    app, ticks = commander.loop.app, 0
    app.stop()
    assert not app.settled
    while not app.settled:
        commander.run(0.005)  # while the commander goes on asking
        ticks += 1
        assert ticks <= SETTLE_S * 200
    assert commander.loop.rig.drive.powers() == (0, 0)
    commander.assert_stands(0.3)
    assert commander.blocked_by == "mapod ends"


def test_motors_that_are_not_enabled_never_move_however_many_requests_come() -> None:
    commander = Commander(enable_motors=False)
    commander.valid_s = 1.0
    loop, written = commander.loop, bytearray()
    loop.listen(lambda wire, way, data: written.extend(data if (wire, way) == TO_DRIVE else b""))
    for motion in ((0.6, 0.0), (-0.6, 0.0), (0.0, 1.0), (32.0, 32.0)):
        commander.drive(*motion, 0.4)
    loop.app.stop()
    commander.run(0.2)
    assert not commander.has_moved
    assert b"!" not in written
    assert len(written) > 100
    requests = loop.app.planners.requests
    assert requests.accepted == 0
    assert requests.refused.total() > 25
    assert "not enabled" in requests.last_refusal


def test_a_recording_that_is_played_never_moves_a_motor() -> None:
    commander = Commander()
    loop = commander.loop
    ports = Ports(loop.ports["scanner"], loop.ports["ahrs"], loop.ports["drive"], loop.link_port)
    loop.app = App(loop.config, ports, session=SESSION, replayed=True)
    commander.run(1.2)
    commander.drive(0.5, 0.0, 0.8)
    assert not commander.has_moved
    assert commander.blocked_by == "these are recorded data"


def test_where_there_is_a_key_only_signed_requests_are_obeyed() -> None:
    commander = Commander(key=bytes(range(32)))
    loop = commander.loop
    for seq in range(30):
        body = drive_body(SESSION, loop.planner.nonce, 0.5, 0.0, 0.5)
        frame = bytes_from_frame(DRIVE, 500 + seq, round(loop.now_s * 1000), body)
        loop.link_port.give(frame)
        commander.run(0.01)
    assert not commander.has_moved
    assert loop.app.planners.requests.refused == {"no valid tag": 30}
    commander.drive(0.5, 0.0, 0.5)
    assert commander.has_moved


@pytest.mark.parametrize(("late_s", "stops"), [(0.09, False), (0.11, True)])
def test_a_loop_that_is_too_late_stops_it_for_a_second(late_s: float, stops: bool) -> None:
    commander = driving()
    commander.loop.hang(late_s)
    commander.run(0.3)
    assert (commander.loop.rig.drive.powers() == (0, 0)) is stops
    assert ("late" in commander.blocked_by) is stops
    assert bool(commander.health & health.NO_OVERRUN) is not stops
    commander.run(1.2)
    assert commander.loop.rig.drive.powers() != (0, 0)
    commander.loop.hang(1.2)
    assert commander.loop.rig.drive.powers() == (0, 0)  # by the controller's own watchdog
    assert commander.loop.rig.drive.watchdog_stops == 1


def test_counters_that_stand_still_while_the_robot_drives_stop_it_until_they_move() -> None:
    commander = driving(0.6)
    commander.loop.rig.drive.frozen = True
    before_m = commander.place[0]
    commander.run(2.0)
    assert commander.place[0] - before_m < 0.6
    assert commander.blocked_by == STALLED
    assert not commander.health & health.WHEELS_OK
    commander.asks = (0.0, 0.0)
    commander.run(0.5)
    commander.drive(0.6, 0.0, 1.0)  # letting go is not enough
    assert commander.blocked_by == STALLED
    commander.loop.rig.drive.frozen = False
    commander.run(2.5)
    assert commander.health & health.WHEELS_OK
    assert commander.blocked_by == "ground in the way was not seen to be free"  # nor vouched for
