"""What a legacy MTi keeps over a loss of power: its settings, and which values each one takes.

Source: MTi sheet, section 3.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fakes.mti_data import F64, data_length, is_mode, is_settings

DEVICE_ID = 0x00300D2A  # fictitious, type MTi with RS-232
FIRMWARE = bytes([2, 6, 1])
FILTER = bytes([0x33, 2, 8])  # type '3', version
SCENARIOS = ((3, 8, b"machine"), (2, 8, b"human"), (6, 8, b"machine_nomagfield"))
SCENARIO_VERSION = 8
BAUDS = {
    0x00: 460800, 0x01: 230400, 0x02: 115200, 0x03: 76800, 0x04: 57600, 0x05: 38400, 0x06: 28800,
    0x07: 19200, 0x08: 14400, 0x09: 9600, 0x0A: 921600, 0x80: 921600, 0x0B: 4800,
}  # fmt: skip
MIN_PERIOD = 225
NO_PERIOD, NOT_IMPLEMENTED, NO_BAUD, BAD_PARAMETER = 0x03, 0x04, 0x20, 0x21  # Error codes
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(slots=True, eq=False)
class Memory:
    """The settings, as shipped by the maker unless set."""

    period: int = 1152  # 1/115200 s
    skip: int = 0
    mode: int = 0x0004
    settings: int = 0x0000_0001
    baud_code: int = 2
    error_mode: int = 1
    location: int = 0
    scenario: int = 3
    heading_rad: float = 0.0
    declination_rad: float = 0.0
    gravity_mps2: float = 9.81
    alignment: tuple[float, ...] = IDENTITY  # sensor to object, row by row
    extended_mode: int = 0
    processing: int = 0
    G_reset: F64 = field(default_factory=lambda: np.eye(3))  # orientation resets that were stored:
    A_reset: F64 = field(default_factory=lambda: np.eye(3))  # of the earth and of the object

    def configuration(self) -> bytes:
        """The 118 bytes of message 0D."""
        identity = DEVICE_ID.to_bytes(4, "big")
        head = identity + struct.pack(">HH", self.period, self.skip)
        length = data_length(self.mode, self.settings)
        tail = struct.pack(">HHI", length, self.mode, self.settings)
        scenario = self.scenario.to_bytes(2, "big")
        return head + bytes(88) + b"\0\1" + identity + tail + scenario + FIRMWARE + FILTER


@dataclass(frozen=True, slots=True)
class Register:
    """One setting on the wire; the request without data reads it."""

    name: str
    form: str  # of struct
    allows: Callable[[Any], bool]
    error: int = BAD_PARAMETER  # for a value that is not allowed

    def read(self, memory: Memory) -> bytes:
        """As the answer carries it."""
        value = getattr(memory, self.name)
        return struct.pack(self.form, *(value if isinstance(value, tuple) else (value,)))

    def write(self, memory: Memory, data: bytes) -> int:
        """0, or the code of an Error."""
        if len(data) != struct.calcsize(self.form):
            return BAD_PARAMETER
        values = struct.unpack(self.form, data)
        value = values if len(values) > 1 else values[0]
        if not self.allows(value):
            return self.error
        setattr(memory, self.name, value)
        return 0


def _is_angle(value: float) -> bool:
    return abs(value) <= math.pi


def _is_rotation(values: tuple[float, ...]) -> bool:
    R = np.array(values).reshape(3, 3)
    if not np.isfinite(R).all() or np.abs(R).max() > 1.001:
        return False
    return bool(np.abs(R @ R.T - np.eye(3)).max() < 1e-3 and np.linalg.det(R) > 0)


def _is_any(value: object) -> bool:
    return True


def _is_scenario(value: int) -> bool:
    return value in (kind for kind, _, _ in SCENARIOS)


REGISTERS = {
    0x04: Register("period", ">H", lambda period: bool(period >= MIN_PERIOD), NO_PERIOD),
    0x18: Register("baud_code", ">B", lambda code: code in BAUDS, NO_BAUD),
    0x20: Register("processing", ">H", _is_any),
    0x64: Register("scenario", ">H", _is_scenario),
    0x66: Register("gravity_mps2", ">f", lambda value: bool(9.0 < value < 10.5)),
    0x6A: Register("declination_rad", ">f", _is_angle),
    0x82: Register("heading_rad", ">f", _is_angle),
    0x84: Register("location", ">H", _is_any),
    0x86: Register("extended_mode", ">H", _is_any),
    0xD0: Register("mode", ">H", is_mode),
    0xD2: Register("settings", ">I", is_settings),
    0xD4: Register("skip", ">H", _is_any),
    0xDA: Register("error_mode", ">H", lambda mode: bool(mode <= 3)),
    0xE0: Register("alignment", ">9f", _is_rotation),
}


def scenarios() -> bytes:
    """The five slots of message 63."""
    slots = [
        struct.pack(">BB20s", kind, version, name.ljust(20)) for kind, version, name in SCENARIOS
    ]
    return b"".join(slots).ljust(5 * 22, b"\0")
