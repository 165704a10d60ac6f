"""What an MTi keeps over a loss of power: its settings, and which values each one takes.

Source: MTi sheet, section 3.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fakes.mti.models import FIFTH, FOURTH, LEGACY, MODELS, Model
from fakes.mti.mtdata import data_length, is_mode, is_settings
from fakes.mti.rotation import F64

BAUDS = {
    0x00: 460800, 0x01: 230400, 0x02: 115200, 0x03: 76800, 0x04: 57600, 0x05: 38400, 0x06: 28800,
    0x07: 19200, 0x08: 14400, 0x09: 9600, 0x0A: 921600, 0x80: 921600, 0x0B: 4800,
}  # fmt: skip
NEW_BAUDS = {0x0C: 2_000_000, 0x0D: 4_000_000, 0x0E: 3_686_400}
MIN_PERIOD = 225
NO_PERIOD, NOT_IMPLEMENTED, NO_BAUD, BAD_PARAMETER = 0x03, 0x04, 0x20, 0x21  # Error codes
TOO_MUCH_DATA = 0x29


@dataclass(slots=True, eq=False)
class Memory:
    """The settings, as shipped by the maker unless set."""

    model: Model = MODELS["MTi-28"]
    period: int = 1152  # 1/115200 s
    skip: int = 0
    mode: int = 0x0004
    settings: int = 0x0000_0001
    baud_code: int = 2
    error_mode: int = 1
    location: int = 0
    heading_rad: float = 0.0
    mtdata2: bool = field(init=False)  # which of the two languages of data it speaks
    outputs: tuple[tuple[int, int], ...] = field(init=False)  # MTData2: packet id, Hz
    scenario: int = field(init=False)
    G_reset: F64 = field(default_factory=lambda: np.eye(3))  # orientation resets that were stored:
    A_reset: F64 = field(default_factory=lambda: np.eye(3))  # of the earth and of the object

    def __post_init__(self) -> None:
        self.mtdata2 = not self.model.legacy
        self.outputs = self.model.outputs
        self.scenario = self.model.scenario_word & 0xFF

    @property
    def scenario_version(self) -> int:
        """Of the scenario that is set."""
        return next(version for kind, version, _ in self.model.scenarios if kind == self.scenario)

    def length(self) -> int:
        """Bytes of an MTData message; 0 while it speaks MTData2."""
        return 0 if self.mtdata2 else data_length(self.mode, self.settings)

    def configuration(self) -> bytes:
        """The 118 bytes of message 0D."""
        identity = self.model.short_id
        head = identity + struct.pack(">HH", self.period, self.skip)
        mode, settings = (0, 0) if self.mtdata2 else (self.mode, self.settings)
        tail = struct.pack(">HHI", self.length(), mode, settings)
        version = self.scenario_version if self.model.scenario_word >> 8 else 0
        kind = bytes([version, self.scenario])
        about = self.model.firmware[:3] + self.model.filter
        return head + bytes(88) + b"\0\1" + identity + tail + kind + about


@dataclass(frozen=True, slots=True)
class Register:
    """One setting on the wire; the request without data reads it."""

    name: str
    form: str  # of struct
    allows: Callable[[Any, Model], bool]
    error: int = BAD_PARAMETER  # for a value that is not allowed
    generations: tuple[int, ...] = (LEGACY, FOURTH, FIFTH)
    mtdata_only: bool = False  # gone while the device speaks MTData2

    def exists(self, memory: Memory) -> bool:
        """Whether the device has it, as it is set now."""
        model = memory.model
        return model.generation in self.generations and not (self.mtdata_only and memory.mtdata2)

    def read(self, memory: Memory) -> bytes:
        """As the answer carries it."""
        return struct.pack(self.form, getattr(memory, self.name))

    def write(self, memory: Memory, data: bytes) -> int:
        """0, or the code of an Error."""
        if len(data) != struct.calcsize(self.form):
            return BAD_PARAMETER
        (value,) = struct.unpack(self.form, data)
        if not self.allows(value, memory.model):
            return self.error
        setattr(memory, self.name, value)
        return 0


def bauds(model: Model) -> dict[int, int]:
    """The baud rates of a device by code."""
    return BAUDS if model.legacy else BAUDS | NEW_BAUDS


def _is_angle(value: float, model: Model) -> bool:
    return abs(value) <= math.pi


def _is_any(value: object, model: Model) -> bool:
    return True


def _is_scenario(value: int, model: Model) -> bool:
    return value in (kind for kind, _, _ in model.scenarios)


OLDER = (LEGACY, FOURTH)
REGISTERS = {
    0x04: Register(
        "period", ">H", lambda period, _: bool(period >= MIN_PERIOD), NO_PERIOD, generations=OLDER
    ),
    0x18: Register("baud_code", ">B", lambda code, model: code in bauds(model), NO_BAUD),
    0x64: Register("scenario", ">H", _is_scenario),
    0x82: Register("heading_rad", ">f", _is_angle, generations=(LEGACY,)),
    0x84: Register("location", ">H", _is_any),
    0xD0: Register(
        "mode", ">H", lambda mode, _: is_mode(mode), generations=OLDER, mtdata_only=True
    ),
    0xD2: Register(
        "settings", ">I", lambda word, model: is_settings(word, model.gnss or not model.legacy),
        generations=OLDER, mtdata_only=True,
    ),
    0xD4: Register("skip", ">H", _is_any, generations=OLDER, mtdata_only=True),
    0xDA: Register("error_mode", ">H", lambda mode, _: bool(mode <= 3)),
}  # fmt: skip


def scenarios(model: Model) -> bytes:
    """The five slots of message 63."""
    slots = [struct.pack(">BB20s", kind, version, name.ljust(20))
             for kind, version, name in model.scenarios]  # fmt: skip
    return b"".join(slots).ljust(5 * 22, b"\0")
