"""What an MTi measured, as packets of an MTData2 message, in any format and earth frame.

Source: MTi sheet, sections 5 and 6, and its recordings.
"""

import struct
from collections.abc import Callable, Sequence

from fakes.mti.mtdata import Sample
from fakes.mti.numbers import NUMBER_SIZES, numbers
from fakes.mti.rotation import ENU, F64, NED, NWU, R_FROM_NWU, orientation

HEADERS = {0x1020: 2, 0x1060: 4, 0xE010: 1, 0xE020: 4}  # in every message; bytes
SIZES = {0x0810: 1, 0x2010: 4, 0x2020: 9, 0x2030: 3, 0x4020: 3, 0x8020: 3, 0xC020: 3}  # numbers
ORIENTED = (0x2010, 0x2020, 0x2030)  # ready one sample later than the rest
TICKS_PER_S = 10_000
FRAMES = {0x0: ENU, 0x4: NED, 0x8: NWU}


def kind_of(identifier: int) -> int:
    """A packet's id without number format and frame."""
    return identifier & 0xFFF0


def packet_size(identifier: int) -> int:
    """Bytes of a packet's data."""
    kind = kind_of(identifier)
    return HEADERS[kind] if kind in HEADERS else SIZES[kind] * NUMBER_SIZES[identifier & 3]


def encode(sample: Sample, identifiers: Sequence[int]) -> bytes:
    """The packets of a sample in the order given."""
    nearest = next((i for i in identifiers if kind_of(i) in NUMBERS), None)
    data = b""
    for identifier in identifiers:
        content = _content(sample, identifier, sample.preamble and identifier == nearest)
        data += struct.pack(">HB", identifier, len(content)) + content
    return data


def _content(sample: Sample, identifier: int, preamble: bool) -> bytes:
    kind = kind_of(identifier)
    if kind in FIXED:
        return FIXED[kind](sample)
    values = NUMBERS[kind](sample, R_FROM_NWU[FRAMES[identifier & 0xC]])
    return numbers(values, identifier & 3, preamble)


FIXED: dict[int, Callable[[Sample], bytes]] = {
    0x1020: lambda s: struct.pack(">H", s.counter),
    0x1060: lambda s: struct.pack(">I", s.fine),
    0xE010: lambda s: bytes([s.status & 0xFF]),
    0xE020: lambda s: struct.pack(">I", s.status),
}

# a sample, the rotation from north-west-up to the packet's frame
NUMBERS: dict[int, Callable[[Sample, F64], list[float]]] = {
    0x0810: lambda s, R: [s.temperature_deg],
    0x2010: lambda s, R: orientation(R @ s.R_earth_sensor, 0),
    0x2020: lambda s, R: orientation(R @ s.R_earth_sensor, 2),
    0x2030: lambda s, R: orientation(R @ s.R_earth_sensor, 1),
    0x4020: lambda s, R: s.accel_mps2.tolist(),
    0x8020: lambda s, R: s.rate_radps.tolist(),
    0xC020: lambda s, R: s.magnetic.tolist(),
}
