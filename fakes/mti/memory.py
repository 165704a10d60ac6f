"""What an MTi keeps over a loss of power: its settings, and which values each one takes.

Source: MTi sheet, sections 3 and 5.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from fakes.mti.messages import (
    FRAME_BYTES,
    HEADERS,
    ORIENTED,
    SIZES,
    is_mode,
    is_settings,
    kind_of,
    mtdata_length,
    packet_size,
)
from fakes.mti.models import FIFTH, FOURTH, LEGACY, MODELS, SHIPPED_OUTPUTS, Model
from fakes.wires.timing import F64

NO_PERIOD, NOT_IMPLEMENTED, NO_BAUD, BAD_PARAMETER = 0x03, 0x04, 0x20, 0x21  # Error codes
TOO_MUCH_DATA = 0x29
MIN_PERIOD = 225
MOST_ENTRIES = 32  # of an output configuration
MAX_HZ = 0xFFFF
HEADER_HZ = 100  # of messages that hold headers alone

Outputs = tuple[tuple[int, int], ...]  # MTData2: packet id, Hz


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
    outputs: Outputs = SHIPPED_OUTPUTS
    scenario: int = field(init=False)
    G_reset: F64 = field(default_factory=lambda: np.eye(3))  # orientation resets that were stored:
    A_reset: F64 = field(default_factory=lambda: np.eye(3))  # of the earth and of the object

    def __post_init__(self) -> None:
        self.mtdata2 = not self.model.legacy
        self.scenario = self.model.scenario_word & 0xFF

    def restore(self) -> None:
        shipped = Memory(self.model)
        for part in fields(self):
            setattr(self, part.name, getattr(shipped, part.name))

    @property
    def baud(self) -> int:
        """Of the line, from the next power-up on."""
        return self.model.bauds[self.baud_code]

    @property
    def scenario_version(self) -> int:
        return next(version for kind, version, _ in self.model.scenarios if kind == self.scenario)

    def length(self) -> int:
        """Bytes of an MTData message; 0 while it speaks MTData2."""
        return 0 if self.mtdata2 else mtdata_length(self.mode, self.settings)

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

    def check_fits(self, outputs: Outputs, baud: int) -> int:
        """0, or the Error of outputs that a line of this rate cannot carry."""
        step = stride(outputs, self.model.base_hz)
        messages_hz = self.model.base_hz / step if step else 0.0
        headers = sum(3 + packet_size(i) for i, _ in outputs if not is_rated(i))
        rated = sum((3 + packet_size(i)) * hz for i, hz in outputs if is_rated(i))
        bytes_per_s = messages_hz * (headers + FRAME_BYTES) + rated
        return TOO_MUCH_DATA if bytes_per_s * 10 > baud else 0


@dataclass(frozen=True, slots=True)
class Register:
    """One setting on the wire; the request without data reads it."""

    name: str
    form: str  # of struct
    allows: Callable[[Any, Model], bool] = lambda value, model: True
    error: int = BAD_PARAMETER  # for a value that is not allowed
    generations: tuple[int, ...] = (LEGACY, FOURTH, FIFTH)
    mtdata_only: bool = False  # gone while the device speaks MTData2

    def exists(self, memory: Memory) -> bool:
        has_it = memory.model.generation in self.generations
        return has_it and not (self.mtdata_only and memory.mtdata2)

    def read(self, memory: Memory) -> bytes:
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


OLDER = (LEGACY, FOURTH)
REGISTERS = {
    0x04: Register("period", ">H", lambda period, _: period >= MIN_PERIOD, NO_PERIOD, OLDER),
    0x18: Register("baud_code", ">B", lambda code, model: code in model.bauds, NO_BAUD),
    0x64: Register(
        "scenario", ">H", lambda kind, model: any(kind == k for k, _, _ in model.scenarios)
    ),
    0x82: Register(
        "heading_rad", ">f", lambda rad, _: abs(rad) <= math.pi, generations=(LEGACY,)
    ),
    0x84: Register("location", ">H"),
    0xD0: Register("mode", ">H", lambda mode, _: is_mode(mode), BAD_PARAMETER, OLDER, True),
    0xD2: Register(
        "settings", ">I", lambda word, model: is_settings(word, model.gnss or not model.legacy),
        BAD_PARAMETER, OLDER, True,
    ),
    0xD4: Register("skip", ">H", generations=OLDER, mtdata_only=True),
    0xDA: Register("error_mode", ">H", lambda mode, _: mode <= 3),
}  # fmt: skip


def maybe_outputs(data: bytes, model: Model) -> Outputs | int:
    """The output configuration that is taken of a wanted one, or the code of an Error."""
    if len(data) % 4 or len(data) > 4 * MOST_ENTRIES:
        return BAD_PARAMETER
    taken = []
    for identifier, rate_hz in struct.iter_unpack(">HH", data):
        entry = _maybe_entry(identifier, rate_hz, model)
        if entry is not None:
            taken.append(entry)
        elif model.generation == FIFTH:  # the others leave out what they have not
            return BAD_PARAMETER
    return tuple(taken)


def _maybe_entry(identifier: int, rate_hz: int, model: Model) -> tuple[int, int] | None:
    """One output as it is taken; None: the device has it not."""
    kind = kind_of(identifier)
    if kind in HEADERS:
        return (identifier, MAX_HZ) if identifier == kind else None
    most_hz = model.rates_hz.get(kind)
    if most_hz is None or kind not in SIZES:
        return None
    if identifier & 0xC and (kind not in ORIENTED or identifier & 0xC == 0xC):
        return None
    if rate_hz in (0, MAX_HZ) or rate_hz >= most_hz:
        return identifier, most_hz
    return identifier, max(hz for hz in range(1, rate_hz + 1) if most_hz % hz == 0)


def is_rated(identifier: int) -> bool:
    """Whether a packet comes at a rate of its own: no header."""
    return kind_of(identifier) not in HEADERS


def stride(outputs: Outputs, base_hz: int) -> int:
    """The base ticks from one instant to the next at which anything is due; 0: never."""
    rates = [hz for identifier, hz in outputs if is_rated(identifier)]
    if not rates:
        return base_hz // HEADER_HZ if outputs else 0
    return math.gcd(*(base_hz // hz for hz in rates))
