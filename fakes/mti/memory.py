"""What an MTi keeps over a loss of power: its settings, and which values each one takes.

Source: MTi sheet, section 3; the layout of D6 and D8 after message 0D, and DC [U].
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
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
NO_TURN = (1.0, 0.0, 0.0, 0.0)


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
    declination_rad: float = 0.0
    gravity_mps2: float = 9.81
    lever_arm_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    alignment: tuple[float, ...] = IDENTITY  # sensor to object, row by row
    turns: list[tuple[float, ...]] = field(default_factory=lambda: [NO_TURN, NO_TURN])
    extended_mode: int = 0
    processing: int = 0
    string_output: int = 0
    transmit_delay: int = 0
    sync_in: tuple[int, ...] = (0, 0, 0)  # mode, skip factor, offset
    sync_out: tuple[int, ...] = (0, 0, 0, 0)  # and pulse width
    sync: bytes = b""  # of the newer kind: 12 bytes each
    lat_lon_alt: bytes = b""
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
        head = identity + struct.pack(">HHHHI", self.period, self.skip, *self.sync_in)
        mode, settings = (0, 0) if self.mtdata2 else (self.mode, self.settings)
        tail = struct.pack(">HHI", self.length(), mode, settings)
        version = self.scenario_version if self.model.scenario_word >> 8 else 0
        kind = bytes([version, self.scenario])
        about = self.model.firmware[:3] + self.model.filter
        return head + bytes(80) + b"\0\1" + identity + tail + kind + about


@dataclass(frozen=True, slots=True)
class Register:
    """One setting on the wire; the request without data reads it."""

    name: str
    form: str  # of struct
    allows: Callable[[Any, Model], bool]
    error: int = BAD_PARAMETER  # for a value that is not allowed
    generations: tuple[int, ...] = (LEGACY, FOURTH, FIFTH)
    gnss_only: bool = False
    mtdata_only: bool = False  # gone while the device speaks MTData2

    def exists(self, memory: Memory) -> bool:
        """Whether the device has it, as it is set now."""
        model = memory.model
        return (
            model.generation in self.generations
            and (model.gnss or not self.gnss_only)
            and not (self.mtdata_only and memory.mtdata2)
        )

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
        if not self.allows(value, memory.model):
            return self.error
        setattr(memory, self.name, value)
        return 0


def bauds(model: Model) -> dict[int, int]:
    """The baud rates of a device by code."""
    return BAUDS if model.legacy else BAUDS | NEW_BAUDS


def _is_angle(value: float, model: Model) -> bool:
    return abs(value) <= math.pi


def _is_rotation(values: tuple[float, ...], model: Model) -> bool:
    R = np.array(values).reshape(3, 3)
    if not np.isfinite(R).all() or np.abs(R).max() > 1.001:
        return False
    return bool(np.abs(R @ R.T - np.eye(3)).max() < 1e-3 and np.linalg.det(R) > 0)


def _is_any(value: object, model: Model) -> bool:
    return True


def _is_scenario(value: int, model: Model) -> bool:
    return value in (kind for kind, _, _ in model.scenarios)


OLDER = (LEGACY, FOURTH)
NEW = (FOURTH, FIFTH)
REGISTERS = {
    0x04: Register(
        "period", ">H", lambda period, _: bool(period >= MIN_PERIOD), NO_PERIOD, generations=OLDER
    ),
    0x18: Register("baud_code", ">B", lambda code, model: code in bauds(model), NO_BAUD),
    0x20: Register("processing", ">H", _is_any),
    0x64: Register("scenario", ">H", _is_scenario),
    0x66: Register("gravity_mps2", ">f", lambda value, _: bool(9.0 < value < 10.5)),
    0x68: Register(
        "lever_arm_m", ">3f", lambda arm, _: all(abs(x) < 100 for x in arm), gnss_only=True
    ),
    0x6A: Register("declination_rad", ">f", _is_angle),
    0x82: Register("heading_rad", ">f", _is_angle, generations=(LEGACY,)),
    0x84: Register("location", ">H", _is_any),
    0x86: Register("extended_mode", ">H", _is_any),
    0x8E: Register("string_output", ">H", _is_any, generations=NEW),
    0xD0: Register(
        "mode", ">H", lambda mode, model: is_mode(mode, model.gnss), generations=OLDER,
        mtdata_only=True,
    ),
    0xD2: Register(
        "settings", ">I", lambda word, model: is_settings(word, model.gnss, _knows_ned(model)),
        generations=OLDER, mtdata_only=True,
    ),
    0xD4: Register("skip", ">H", _is_any, generations=OLDER, mtdata_only=True),
    0xD6: Register("sync_in", ">HHI", _is_any, generations=(LEGACY,)),
    0xD8: Register("sync_out", ">HHII", _is_any, generations=(LEGACY,)),
    0xDA: Register("error_mode", ">H", lambda mode, _: bool(mode <= 3)),
    0xDC: Register("transmit_delay", ">H", _is_any, generations=NEW),
    0xE0: Register("alignment", ">9f", _is_rotation, generations=(LEGACY,)),
}  # fmt: skip


def _knows_ned(model: Model) -> bool:
    return model.gnss or not model.legacy


def scenarios(model: Model) -> bytes:
    """The five slots of message 63."""
    slots = [struct.pack(">BB20s", kind, version, name.ljust(20))
             for kind, version, name in model.scenarios]  # fmt: skip
    return b"".join(slots).ljust(5 * 22, b"\0")
