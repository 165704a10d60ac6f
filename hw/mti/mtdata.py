"""The data messages of an MTi to samples: MTData of legacy devices, MTData2 of newer ones.

MTData is laid out by output mode and output settings and does not describe itself: only its length
can tell that it is of another mode. MTData2 has packets that do: they are decoded by the identifier
that stands in the data, whatever was asked for. What mapod has no use for is stepped over.
Source: MTi sheet, sections 3 to 5.
"""

import struct
from collections.abc import Iterator
from functools import lru_cache

from hw.device import BadFrame
from hw.mti.sample import (
    EULER,
    NED,
    NUMBER_SIZES,
    NWU,
    ORIENTATION_NUMBERS,
    QUATERNION,
    Decoded,
    Field,
    Reader,
    Turn,
    integer_reader,
    number_reader,
    orientation_turn,
    sample_of,
)

TEMPERATURE, CALIBRATED, ORIENTATION, AUXILIARY = 0x0001, 0x0002, 0x0004, 0x0008  # output modes
POSITION, VELOCITY, STATUS, GPS, RAW = 0x0010, 0x0020, 0x0800, 0x1000, 0x4000
COUNTER, UTC = 0x1, 0x2  # output settings
NO_ACCELERATION, NO_RATE, NO_MAGNETIC, NO_ANALOG_1, NO_ANALOG_2 = 0x10, 0x20, 0x40, 0x400, 0x800
IN_NED = 0x8000_0000

FIELDS = {"temperature_c": 1, "accel_mps2": 3, "rate_radps": 3, "magnetic": 3}  # numbers in a block

PACKET = struct.Struct(">HB")  # of MTData2: identifier and size
# data identifier without its low 4 bits: field, numbers or bytes
NUMBERS = {
    0x0810: ("temperature_c", 1),
    0x2010: ("q_earth_sensor", 4),
    0x2030: ("q_earth_sensor", 3),
    0x4020: ("accel_mps2", 3),
    0x8020: ("rate_radps", 3),
    0xC020: ("magnetic", 3),
}
ORIENTATIONS = {0x2010: QUATERNION, 0x2030: EULER}
INTEGERS = {
    0x1020: ("counter", 2),
    0x1060: ("fine_ticks", 4),
    0xE010: ("status", 1),
    0xE020: ("status", 4),
}


class MtDataDecoder:
    """MTData of one output mode and settings."""

    def __init__(self, mode: int, settings: int) -> None:
        self._fields: list[Field] = []
        self.size = 0  # data bytes of a frame
        for name, size in _blocks(mode, settings):
            if read := _maybe_reader(name, size, settings):
                self._fields.append((name, self.size, *read))
            self.size += size

    def __contains__(self, field: str) -> bool:
        """Whether the messages carry a field of this name: "rate_radps", "counter" ..."""
        return any(name == field for name, *_ in self._fields)

    def decode(self, data: bytes) -> Decoded:
        if len(data) != self.size:
            reason = f"{len(data)} data bytes, {self.size} by output mode and settings"
            return BadFrame(reason, data)
        return sample_of(self._fields, data)


def _maybe_reader(name: str, size: int, settings: int) -> tuple[Reader, Turn | None] | None:
    """Of a block of MTData; None where nobody has use for it."""
    number_format, kind = settings >> 8 & 3, settings >> 2 & 3
    if name in FIELDS:
        return number_reader(FIELDS[name], number_format), None
    if name == "q_earth_sensor" and kind <= EULER:
        read = number_reader(ORIENTATION_NUMBERS[kind], number_format)
        return read, orientation_turn(kind, NED if settings & IN_NED else NWU)
    return (integer_reader(size), None) if name in ("counter", "status") else None


def _blocks(mode: int, settings: int) -> Iterator[tuple[str, int]]:
    """Name and size of the blocks present in MTData, in their order (section 4)."""
    number = NUMBER_SIZES[settings >> 8 & 3]
    oriented = ORIENTATION_NUMBERS[settings >> 2 & 3] * number
    processed = 0 if mode & RAW else mode  # raw data excludes all that is computed from it
    calibrated = processed & CALIBRATED
    analog_inputs = (not settings & NO_ANALOG_1) + (not settings & NO_ANALOG_2)
    table: tuple[tuple[str, int, int], ...] = (
        ("raw", mode & RAW, 20),
        ("gps", mode & GPS, 44),
        ("temperature_c", processed & TEMPERATURE, number),
        ("accel_mps2", calibrated and ~settings & NO_ACCELERATION, 3 * number),
        ("rate_radps", calibrated and ~settings & NO_RATE, 3 * number),
        ("magnetic", calibrated and ~settings & NO_MAGNETIC, 3 * number),
        ("q_earth_sensor", processed & ORIENTATION, oriented),
        ("analog", processed & AUXILIARY and analog_inputs, 2 * analog_inputs),
        ("position", processed & POSITION, 3 * number),
        ("velocity", processed & VELOCITY, 3 * number),
        ("status", mode & STATUS, 1),
        ("counter", settings & COUNTER, 2),
        ("utc", settings & UTC, 12),
    )
    return ((name, size) for name, present, size in table if present)


def decode_mtdata2(data: bytes) -> Decoded:
    """The packets of one MTData2 message, in any order."""
    wrong, fields = "", list[Field]()
    start, end = 0, len(data)
    while start < end:
        begin = start + PACKET.size
        if begin > end or begin + data[begin - 1] > end:
            return BadFrame("packet runs over the end of its message", data)
        identifier, size = PACKET.unpack_from(data, start)
        start = begin + size
        if layout := _maybe_layout(identifier):
            name, due, read, turn = layout
            if size == due:
                fields.append((name, begin, read, turn))
            else:
                wrong = wrong or f"packet {identifier:04X} has {size} bytes"
    return BadFrame(wrong, data) if wrong else sample_of(fields, data)


@lru_cache(maxsize=256)  # a device sends a dozen; what seems to be one may send them all
def _maybe_layout(identifier: int) -> Field | None:
    """Of a packet, with its size in the place of its place; None where nobody has use for it."""
    kind, frame, number_format = identifier & 0xFFF0, identifier >> 2 & 3, identifier & 3
    if kind in INTEGERS:
        name, size = INTEGERS[kind]
        return name, size, integer_reader(size), None
    if kind not in NUMBERS:
        return None
    name, count = NUMBERS[kind]
    turn = orientation_turn(ORIENTATIONS[kind], frame) if kind in ORIENTATIONS else None
    read = number_reader(count, number_format)
    return name, count * NUMBER_SIZES[number_format], read, turn
