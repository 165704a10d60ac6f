"""MTData2 messages of newer devices to samples, and samples whose packets came in several messages.

Packets describe themselves: they are decoded by the identifier that stands in the data, whatever
was asked for. Those that mapod has no use for (GNSS, pressure, increments ...) are stepped over.

Source: MTi sheet, section 5.
"""

import dataclasses
import struct

from core.records import record
from hw.device import BadFrame
from hw.mti.numbers import EULER, MATRIX, NUMBER_SIZES, ORIENTATION_NUMBERS, QUATERNION, numbers
from hw.mti.sample import MtSample, SampleBuilder

# data identifier without its low 4 bits: field, numbers or bytes
NUMBERS = {
    0x0810: ("temperature_c", 1),
    0x4020: ("accel_mps2", 3),
    0x8020: ("rate_radps", 3),
    0xC020: ("magnetic", 3),
}
ORIENTATIONS = {0x2010: QUATERNION, 0x2020: MATRIX, 0x2030: EULER}
INTEGERS = {
    0x1020: ("counter", 2),
    0x1060: ("fine_ticks", 4),
    0xE010: ("status", 1),
    0xE020: ("status", 4),
}
STAMPS = frozenset({"counter", "fine_ticks", "status"})  # in every message


def maybe_packets(data: bytes) -> list[tuple[int, bytes]] | None:
    """(identifier, payload) of one message; None where they do not fit into it."""
    found, start = [], 0
    while start < len(data):
        if start + 3 > len(data) or start + 3 + data[start + 2] > len(data):
            return None
        identifier, size = struct.unpack_from(">HB", data, start)
        found.append((identifier, data[start + 3 : start + 3 + size]))
        start += 3 + size
    return found


def decode_mtdata2(data: bytes) -> MtSample | BadFrame:
    """The packets of one MTData2 message, in any order."""
    builder, found = SampleBuilder(), maybe_packets(data)
    if found is None:
        return BadFrame("packet runs over the end of its message", data)
    for identifier, payload in found:
        _take_packet(builder, identifier, payload)
    return builder.sample(data)


def _take_packet(builder: SampleBuilder, identifier: int, payload: bytes) -> None:
    kind, frame, number_format = identifier & 0xFFF0, identifier >> 2 & 3, identifier & 3
    size = _maybe_size(kind, number_format)
    if size is not None and len(payload) != size:
        builder.reject(f"packet {identifier:04X} has {len(payload)} bytes")
    elif kind in NUMBERS:
        field, count = NUMBERS[kind]
        builder.take(field, numbers(payload, 0, count, number_format))
    elif kind in ORIENTATIONS:
        orientation = ORIENTATIONS[kind]
        values = numbers(payload, 0, ORIENTATION_NUMBERS[orientation], number_format)
        builder.take_orientation(orientation, values, frame)
    elif kind in INTEGERS:
        builder.put(INTEGERS[kind][0], int.from_bytes(payload, "big"))


def _maybe_size(kind: int, number_format: int) -> int | None:
    """Bytes of a packet; None where mapod does not read it."""
    if kind in INTEGERS:
        return INTEGERS[kind][1]
    if kind in NUMBERS:
        return NUMBERS[kind][1] * NUMBER_SIZES[number_format]
    if kind in ORIENTATIONS:
        return ORIENTATION_NUMBERS[ORIENTATIONS[kind]] * NUMBER_SIZES[number_format]
    return None


def packet_bytes(identifier: int) -> int:
    """What a packet that mapod reads takes in a message, with its head of 3 bytes."""
    return 3 + (_maybe_size(identifier & 0xFFF0, identifier & 3) or 0)


@record()
class Received:
    """A sample, and what of its frame its time is found by."""

    sample: MtSample
    wire_bytes: int
    arrived_s: float  # host clock, last byte


class SampleMerger:
    """Joins messages of one instant: orientation in one, rate of turn in the next.

    A sample that lacks one of the two is held until a message of another instant comes, or a period
    has passed; then it goes on as it is. Whatever is put in comes out, in order.

    Args:
        period_s: between samples.
        joins: False: no rate of turn will ever come, so nothing waits for it.
    """

    def __init__(self, period_s: float, *, joins: bool = True) -> None:
        self._period_s, self._joins = period_s, joins
        self._held: Received | None = None

    def continues(self, sample: MtSample) -> bool:
        """Whether it belongs to the held sample: the same instant, and nothing said twice."""
        if self._held is None:
            return False
        held = self._held.sample
        if held.fine_ticks is not None and sample.fine_ticks is not None:
            if held.fine_ticks != sample.fine_ticks:
                return False
        elif held.counter is None or held.counter != sample.counter:
            return False
        return not (_said(held) & _said(sample))

    def take(self, received: Received) -> list[Received]:
        """The samples that became complete."""
        if self._held is not None and self.continues(received.sample):
            joined, self._held = _joined(self._held, received), None
            return self._keep_or_give(joined)
        return [*self._give(), *self._keep_or_give(received)]

    def flush(self, now_s: float) -> list[Received]:
        """The held sample, once it has waited for a period."""
        if self._held is not None and now_s - self._held.arrived_s >= self._period_s:
            return self._give()
        return []

    def _keep_or_give(self, received: Received) -> list[Received]:
        sample = received.sample
        whole = (sample.q_earth_sensor is None) == (sample.rate_radps is None)
        if whole or not self._joins:
            return [received]
        self._held = received
        return []

    def _give(self) -> list[Received]:
        held, self._held = self._held, None
        return [] if held is None else [held]


def _said(sample: MtSample) -> set[str]:
    """The fields that a message carries beside its stamps."""
    return {
        field.name
        for field in dataclasses.fields(sample)
        if field.name not in STAMPS and getattr(sample, field.name) is not None
    }


def _joined(first: Received, second: Received) -> Received:
    """Timed by the message with the orientation."""
    values = {
        field.name: getattr(second.sample, field.name)
        for field in dataclasses.fields(MtSample)
        if getattr(first.sample, field.name) is None
    }
    timed = first if first.sample.q_earth_sensor is not None else second
    sample = dataclasses.replace(first.sample, **values)
    return Received(sample, timed.wire_bytes, timed.arrived_s)
