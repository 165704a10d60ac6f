"""Each device's session says what it is doing, in states that can be printed."""

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from config_file import load_config
from fakes.ax3500.device import FakeAx3500
from fakes.lms1xx.device import FakeLms111
from fakes.mti.device import FakeMti
from fakes.wires.wire import MemoryPort, Wire
from fakes.world.simple import Motion, Room, TwoWheels
from hw.registry import ATTITUDE_SENSORS, DRIVES, SCANNERS, Surroundings
from tests import ROOT

TICK_S = 0.005
CONFIG = load_config(Path(ROOT / "mapod.toml").read_text(encoding="utf-8"))
AROUND = Surroundings("serial:///dev/none?baud=115200", 3000.0, False)


def scanner(port: MemoryPort) -> tuple[Any, Any]:
    """A device and its fake."""
    made = SCANNERS["lms111"].make(port, CONFIG.scanner.options, AROUND)
    return made, FakeLms111(Room("room").ranges_m_at, 1)


def attitude(port: MemoryPort) -> tuple[Any, Any]:
    """Likewise."""
    made = ATTITUDE_SENSORS["mti"].make(port, CONFIG.ahrs.options, AROUND)
    return made, FakeMti(Motion("still").motion_at, 1)


def drive(port: MemoryPort) -> tuple[Any, Any]:
    """Likewise; its controller belongs to a radio at first."""
    options: Any = CONFIG.drive.options
    options = replace(options, enter_rs232=True)
    return DRIVES["ax3500"].make(port, options, AROUND), FakeAx3500(TwoWheels(), 1, "rc")


@pytest.mark.parametrize(
    ("make", "states"),
    [
        (scanner, "GREETING READING SETTING_UP SUBSCRIBING MEASURING WAITING"),
        (attitude, "FINDING SETTING_UP STARTING DELIVERING WAITING"),
        (drive, "LISTENING ENTERING IDENTIFYING POLLING"),
    ],
)
def test_what_a_session_is_doing_can_be_printed(make: Any, states: str) -> None:
    port = MemoryPort()
    device, fake = make(port)
    wire, seen = Wire(fake, port, 1), []
    for tick in range(1600):
        wire.step(100.0 + tick * TICK_S)
        device.step(100.0 + tick * TICK_S)
        if str(device.status.session) not in seen:
            seen.append(str(device.status.session))
        if device.status.state == "running":
            wire.mute = True
    assert seen == [f"State.{name}" for name in states.split()]
