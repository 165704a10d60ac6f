"""One Modbus request in, its answer out: function code and data, without the frame around them.

Nothing raises on input: what can't be served gives an exception answer. Checked in the order of
the standard: function, counts and values, addresses.
Source: Modbus application protocol 1.1b3, section 6 (codes 1 to 6, 15, 16, 22, 23, 43/14) and 7.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from hw.modbus.image import RegisterImage, View
from hw.modbus.layout import LATCH, LOW_END, MOST_READ, Answer, Refusal

READ_COILS, READ_INPUT_BITS, READ_HOLDING, READ_INPUTS, WRITE_COIL, WRITE_ONE = 1, 2, 3, 4, 5, 6
WRITE_COILS, WRITE_MANY, MASK_WRITE, WRITE_READ, IDENTIFY = 15, 16, 22, 23, 43
MOST_BITS = 2000
MOST_WRITTEN, MOST_WRITTEN_AND_READ = 123, 121
BITS = 16  # of a register, in reading single ones
DEVICE_ID, CONFORMITY = 0x0E, 0x82  # of code 43; regular identification, object by object as well
BASIC, REGULAR, ONE_OBJECT = range(3), range(7), 4
PAIR, FOUR = struct.Struct(">HH"), struct.Struct(">HHHH")


@dataclass(frozen=True, slots=True)
class Access:
    """The registers as one request may use them."""

    image: RegisterImage
    view: View | None
    who: str
    is_local: bool
    now_s: float
    arrived_s: float
    utc_s: float

    def read(self, first: int, count: int) -> Answer:
        return self.image.read(self.now_s, self.view, first, count, self.utc_s)

    def write(self, first: int, words: list[int]) -> Refusal:
        """Take them, or say why not; nothing in Modbus says who drives from another machine."""
        if self.image.drive is not None and first != LATCH and not self.is_local:
            return Refusal.FUNCTION
        return self.image.write(self.now_s, self.arrived_s, self.view, self.who, first, words)


def answer(pdu: bytes, registers: Access) -> bytes:
    """The answer to one request of at least one byte."""
    function = SERVED.get(pdu[0])
    found = function(pdu, registers) if function is not None else Refusal.FUNCTION
    if isinstance(found, Refusal):
        return refused(pdu[0], found)
    return pdu[:1] + found


def refused(function: int, refusal: Refusal) -> bytes:
    """An exception answer.

    >>> refused(3, Refusal.ADDRESS).hex(" "), refused(0x63, Refusal.FUNCTION).hex(" ")
    ('83 02', 'e3 01')
    """
    return bytes((function | 0x80, refusal))


def _read(pdu: bytes, registers: Access) -> Answer:
    if len(pdu) != 5:
        return Refusal.VALUE
    first, count = PAIR.unpack_from(pdu, 1)
    return _read_counted(first, count, registers)


def _read_counted(first: int, count: int, registers: Access) -> Answer:
    if not 1 <= count <= MOST_READ:
        return Refusal.VALUE
    data = registers.read(first, count)
    return data if isinstance(data, Refusal) else bytes((len(data),)) + data


def _read_bits(pdu: bytes, registers: Access) -> Answer:
    """Bit b of register r is coil and input 16 * r + b, for the registers below the drive's."""
    if len(pdu) != 5:
        return Refusal.VALUE
    first, count = PAIR.unpack_from(pdu, 1)
    if not 1 <= count <= MOST_BITS:
        return Refusal.VALUE
    low, end = first // BITS, (first + count - 1) // BITS + 1
    if end > LOW_END:
        return Refusal.ADDRESS
    data = registers.read(low, end - low)
    if isinstance(data, Refusal):
        return data
    words = struct.unpack(f">{end - low}H", data)
    every: int = sum(word << BITS * k for k, word in enumerate(words)) >> (first - BITS * low)
    every &= (1 << count) - 1
    size = -(-count // 8)
    return bytes((size,)) + every.to_bytes(size, "little")


def _write_coils(pdu: bytes, registers: Access) -> Answer:
    """No single bit can be written: they belong to what mapod tells."""
    return Refusal.ADDRESS


def _write_one(pdu: bytes, registers: Access) -> Answer:
    if len(pdu) != 5:
        return Refusal.VALUE
    first, word = PAIR.unpack_from(pdu, 1)
    return registers.write(first, [word]) or pdu[1:]


def _write_many(pdu: bytes, registers: Access) -> Answer:
    if len(pdu) < 6:
        return Refusal.VALUE
    first, count = PAIR.unpack_from(pdu, 1)
    if not (1 <= count <= MOST_WRITTEN and pdu[5] == 2 * count == len(pdu) - 6):
        return Refusal.VALUE
    words = list(struct.unpack_from(f">{count}H", pdu, 6))
    return registers.write(first, words) or pdu[1:5]


def _mask_write(pdu: bytes, registers: Access) -> Answer:
    """As a write of one register: of those that can be written alone, none has bits to keep."""
    if len(pdu) != 7:
        return Refusal.VALUE
    first, _ = PAIR.unpack_from(pdu, 1)
    return registers.write(first, [0]) or pdu[1:]


def _write_read(pdu: bytes, registers: Access) -> Answer:
    """Write first, then read; nothing is written if there is nothing to be read."""
    if len(pdu) < 10:
        return Refusal.VALUE
    read_first, read_count, first, count = FOUR.unpack_from(pdu, 1)
    is_whole = 1 <= count <= MOST_WRITTEN_AND_READ and pdu[9] == 2 * count == len(pdu) - 10
    if not is_whole or not 1 <= read_count <= MOST_READ:
        return Refusal.VALUE
    if not registers.image.can_read(read_first, read_count):
        return Refusal.ADDRESS
    words = list(struct.unpack_from(f">{count}H", pdu, 10))
    refusal = registers.write(first, words)
    return refusal or _read_counted(read_first, read_count, registers)


def identity_of(version: str) -> dict[int, bytes]:
    """The objects of device identification: vendor, code, revision, url, product, model, app."""
    revision = version.encode("ascii", "replace")[:32]
    return dict(enumerate((b"mapod", b"MP", revision, b"", b"mapod obstacle map", b"MP", b"mapod")))


def _identify(pdu: bytes, registers: Access) -> Answer:
    if len(pdu) < 2 or pdu[1] != DEVICE_ID:
        return Refusal.FUNCTION
    if len(pdu) != 4 or not 1 <= pdu[2] <= 4:
        return Refusal.VALUE
    level, first = pdu[2], pdu[3]
    known = identity_of(registers.image.version)
    if level == ONE_OBJECT:
        if first not in known:
            return Refusal.ADDRESS
        wanted = [first]
    else:
        objects = BASIC if level == 1 else REGULAR
        start = first if first in objects else 0  # an unknown one begins from the start again
        wanted = [number for number in objects if number >= start]
    texts = b"".join(bytes((number, len(known[number]))) + known[number] for number in wanted)
    return bytes((DEVICE_ID, level, CONFORMITY, 0, 0, len(wanted))) + texts


SERVED: dict[int, Callable[[bytes, Access], Answer]] = {
    READ_COILS: _read_bits,
    READ_INPUT_BITS: _read_bits,
    READ_HOLDING: _read,
    READ_INPUTS: _read,
    WRITE_COIL: _write_coils,
    WRITE_ONE: _write_one,
    WRITE_COILS: _write_coils,
    WRITE_MANY: _write_many,
    MASK_WRITE: _mask_write,
    WRITE_READ: _write_read,
    IDENTIFY: _identify,
}
