"""MTData2 messages of newer devices to samples.

Packets describe themselves: they are decoded by the identifier that stands in the data, whatever
was asked for. Those that mapod has no use for (GNSS, pressure, increments ...) are stepped over.

Source: MTi sheet, section 5.
"""

import struct

from hw.device import BadFrame
from hw.mti.sample import EULER, NUMBER_SIZES, QUATERNION, MtSample, SampleBuilder, numbers

HEAD = struct.Struct(">HB")  # identifier and size of a packet
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


def decode_mtdata2(data: bytes) -> MtSample | BadFrame:
    """The packets of one MTData2 message, in any order."""
    builder, start = SampleBuilder(), 0
    while start < len(data):
        begin = start + HEAD.size
        if begin > len(data) or begin + data[begin - 1] > len(data):
            return BadFrame("packet runs over the end of its message", data)
        identifier, size = HEAD.unpack_from(data, start)
        start = begin + size
        _take_packet(builder, identifier, data[begin:start])
    return builder.sample(data)


def _take_packet(builder: SampleBuilder, identifier: int, payload: bytes) -> None:
    kind, frame, number_format = identifier & 0xFFF0, identifier >> 2 & 3, identifier & 3
    if kind in INTEGERS:
        field, size = INTEGERS[kind]
    elif kind in NUMBERS:
        field, count = NUMBERS[kind]
        size = count * NUMBER_SIZES[number_format]
    else:
        return
    if len(payload) != size:
        builder.reject(f"packet {identifier:04X} has {len(payload)} bytes")
    elif kind in INTEGERS:
        builder.put(field, int.from_bytes(payload, "big"))
    elif kind in ORIENTATIONS:
        values = numbers(payload, 0, count, number_format)
        builder.take_orientation(ORIENTATIONS[kind], values, frame)
    else:
        builder.take(field, numbers(payload, 0, count, number_format))
