"""Pilots with something missing: the monitor halts the robot, by the world's truth."""

import json
import os
from typing import Any

import pytest

from app import LOOK_S
from core.driving import monitor
from core.driving.control import ORDER_S, DriveControl, Powers
from core.driving.pilot import Pilot
from core.driving.stop_zone import NOTHING, Obstruction
from fakes.scenes.scene import Solid
from logs import LOG, set_up_logging
from tests.app.test_drive import FRONT_M, Commander, driving
from tests.support.cases import few
from tests.support.robot.shipped import FLOOR, shipped

STEP_S = 0.005


class BlindControl(DriveControl):
    """Sees nothing in its way."""

    def look(self, *args: Any, **kw: Any) -> Obstruction:
        return NOTHING


class DeafPilot(Pilot):
    """Goes on whatever any input says."""

    def powers(self, *args: Any, **kw: Any) -> Powers:
        return 0.4, 0.4


def test_a_pilot_that_ignores_the_stop_zone_is_halted_before_the_obstacle_again_and_again() -> None:
    commander = Commander(FLOOR, Solid("box", (3.33, 3.83), (-0.83, 0.87), (0.0, 0.93)))
    app = commander.loop.app
    app.pilot.control = BlindControl(app.config, app.mapper.maps)
    commander.drive(0.9, 0.0, 5.5)
    assert app.monitor.why == monitor.IN_WAY[1]
    assert commander.blocked_by == app.monitor.why
    commander.assert_stands()
    for _ in range(3):
        commander.drive(0.0, 0.0, 0.3)
        commander.drive(0.9, 0.0, 1.2)
    assert app.monitor.halts >= 4
    assert 1.0 < commander.place[0] + FRONT_M < 3.33


DEAF = [  # who falls silent, why it is halted, and from what age on
    ("scanner", monitor.NO_SCANS, monitor.SCANS_STALE_S),
    ("planner", monitor.NOT_ASKED, 0.2),
    ("ahrs", monitor.NO_ATTITUDE, monitor.ATTITUDE_STALE_S),
    ("drive", monitor.NO_POSE, monitor.COUNTS_STALE_S),
]


@pytest.mark.parametrize(("name", "why", "after_s"), few(DEAF, 2))
def test_a_pilot_that_does_not_mind_its_inputs_is_halted(
    name: str, why: str, after_s: float
) -> None:
    commander = driving()
    loop = commander.loop
    loop.app.pilot = DeafPilot(loop.app.config, loop.app.mapper)
    begun_s, powered_s = loop.now_s, 0.0
    (loop.planner if name == "planner" else getattr(loop.rig, name)).mute = True
    while loop.now_s - begun_s < 1.5:
        commander.run(STEP_S)
        if loop.rig.drive.powers() != (0, 0):
            powered_s = loop.now_s - begun_s
    assert loop.app.monitor.halts == 1
    assert loop.app.monitor.why == why
    assert powered_s <= after_s + LOOK_S + ORDER_S + 0.05  # and the newest record's own age


def test_the_log_says_once_why_it_halted() -> None:
    commander = Commander()
    loop = commander.loop
    loop.app.pilot = DeafPilot(loop.app.config, loop.app.mapper)
    read, write = os.pipe()
    writer = set_up_logging(shipped(log={"format": "json", "level": "warning"}), write)
    commander.run(0.1)
    writer.close()
    LOG.close()
    os.close(write)
    with os.fdopen(read) as file:
        told = [line for line in map(json.loads, file) if line["event"] == "drive_halted"]
    assert [line["because"] for line in told] == [monitor.NOT_ASKED]
