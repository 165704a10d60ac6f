"""What an MTi measured, as packets of an MTData2 message, in any format and earth frame.

Source: MTi sheet, sections 5 and 6, and its recordings.
"""

import struct
from collections.abc import Callable, Sequence

import numpy as np

from fakes.mti.gnss import NO_TIME, RESOLVED, SATELLITES, pvt, satellites, utc
from fakes.mti.mtdata import Sample
from fakes.mti.numbers import NUMBER_SIZES, numbers
from fakes.mti.rotation import (
    ENU,
    F64,
    NED,
    NWU,
    R_FROM_NWU,
    orientation,
    quaternion,
    rotation,
)

HEADERS = (0x1010, 0x1020, 0x1060, 0x1070, 0xE010, 0xE020)
HEADER_SIZES = {0x1010: 12, 0x1020: 2, 0x1060: 4, 0x1070: 4, 0xE010: 1, 0xE020: 4}
# numbers in each packet; those with a fixed layout count bytes, negative
SIZES = {
    0x0810: 1, 0x2010: 4, 0x2020: 9, 0x2030: 3, 0x3010: -4, 0x4010: 3, 0x4020: 3, 0x4030: 3,
    0x5020: 1, 0x5030: 3, 0x5040: 2, 0x7010: -94, 0x7020: -(8 + 4 * SATELLITES), 0x8020: 3,
    0x8030: 4, 0xC020: 3, 0xD010: 3,
}  # fmt: skip
FILTERED = (0x2010, 0x2020, 0x2030, 0x4030)  # ready one sample later than the rest
LOCATED = (0x5020, 0x5030, 0x5040, 0xD010)  # ready once the receiver was heard
TICKS_PER_S = 10_000
FRAMES = {0x0: ENU, 0x4: NED, 0x8: NWU}
GRAVITY_MPS2 = 9.81


def kind_of(identifier: int) -> int:
    """A packet's id without number format and frame."""
    return identifier & 0xFFF0


def packet_size(identifier: int) -> int:
    """Bytes of a packet's data."""
    kind = kind_of(identifier)
    if kind in HEADERS:
        return HEADER_SIZES[kind]
    return -SIZES[kind] if SIZES[kind] < 0 else SIZES[kind] * NUMBER_SIZES[identifier & 3]


def encode(sample: Sample, identifiers: Sequence[int], period_s: dict[int, float]) -> bytes:
    """The packets of a sample in the order given; period_s is that of the increments by id."""
    nearest = next((i for i in identifiers if kind_of(i) in NUMBERS), None)
    data = b""
    for identifier in identifiers:
        content = _content(sample, identifier, period_s, sample.preamble and identifier == nearest)
        data += struct.pack(">HB", identifier, len(content)) + content
    return data


def _content(sample: Sample, identifier: int, period_s: dict[int, float], preamble: bool) -> bytes:
    kind = kind_of(identifier)
    if kind in FIXED:
        return FIXED[kind](sample)
    R_frame = R_FROM_NWU[FRAMES[identifier & 0xC]]
    values = NUMBERS[kind](sample, R_frame, period_s.get(identifier, 0.0))
    return numbers(values, identifier & 3, preamble)


FIXED: dict[int, Callable[[Sample], bytes]] = {
    0x1010: lambda s: utc(s.place.utc_s, RESOLVED if s.place.fix else NO_TIME),
    0x1020: lambda s: struct.pack(">H", s.counter),
    0x1060: lambda s: struct.pack(">I", s.fine),
    0x1070: lambda s: struct.pack(">I", s.fine // TICKS_PER_S),
    0x3010: lambda s: struct.pack(">I", s.place.pressure_pa),
    0x7010: lambda s: pvt(s.place),
    0x7020: lambda s: satellites(s.place),
    0xE010: lambda s: bytes([s.status & 0xFF]),
    0xE020: lambda s: struct.pack(">I", s.status),
}


def _free_acceleration(sample: Sample, R_frame: F64) -> list[float]:
    up = sample.R_earth_sensor @ sample.accel_mps2 - np.array([0.0, 0.0, GRAVITY_MPS2])
    return [float(value) for value in R_frame @ up]


# a sample, the rotation from north-west-up to the packet's frame, the seconds of an increment
NUMBERS: dict[int, Callable[[Sample, F64, float], list[float]]] = {
    0x0810: lambda s, R, dt: [s.temperature_deg],
    0x2010: lambda s, R, dt: orientation(R @ s.R_earth_sensor, 0),
    0x2020: lambda s, R, dt: orientation(R @ s.R_earth_sensor, 2),
    0x2030: lambda s, R, dt: orientation(R @ s.R_earth_sensor, 1),
    0x4010: lambda s, R, dt: [float(a) * dt for a in s.accel_mps2],
    0x4020: lambda s, R, dt: [float(a) for a in s.accel_mps2],
    0x4030: lambda s, R, dt: _free_acceleration(s, R),
    0x5020: lambda s, R, dt: [s.place.alt_m],
    0x5030: lambda s, R, dt: s.place.ecef_m,
    0x5040: lambda s, R, dt: [s.place.lat_deg, s.place.lon_deg],
    0x8020: lambda s, R, dt: [float(w) for w in s.rate_radps],
    0x8030: lambda s, R, dt: quaternion(rotation(s.rate_radps * dt)),
    0xC020: lambda s, R, dt: [float(m) for m in s.magnetic],
    0xD010: lambda s, R, dt: [float(v) for v in R @ s.place.velocity_mps],
}
