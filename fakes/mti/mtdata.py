"""What an MTi measured, as a legacy MTData message: temperature, vectors, orientation, status.

Output modes that mapod never asks for (raw, analog, position, velocity, GPS, UTC) are refused.

Source: MTi sheet, sections 3, 4 and 6.
"""

import struct
from dataclasses import dataclass

import numpy as np

from fakes.mti.numbers import numbers
from fakes.mti.rotation import F64, MATRIX, NED, R_FROM_NWU, orientation

TEMPERATURE, CALIBRATED, ORIENTATION, STATUS = 0x0001, 0x0002, 0x0004, 0x0800
KNOWN_MODE = TEMPERATURE | CALIBRATED | ORIENTATION | STATUS
COUNTER = 0x1  # output settings
NED_BIT = 0x8000_0000
KNOWN_SETTINGS = 0x0F7D  # counter, orientation, three switches, format, two analog switches


@dataclass(slots=True, eq=False)
class Sample:
    """One instant, in the frames that the device was told to use."""

    R_earth_sensor: F64  # (3, 3), earth is north, west, up
    rate_radps: F64  # (3,)
    accel_mps2: F64  # (3,), with gravity
    magnetic: F64  # (3,), 1 is the field at calibration
    temperature_deg: float
    status: int  # status word; its low byte is the status byte
    counter: int
    fine: int = 0  # 1e-4 s ticks
    preamble: bool = False  # FA FF must occur in the data


def is_mode(mode: int) -> bool:
    """Whether the fake takes this output mode."""
    return not mode & ~KNOWN_MODE


def is_settings(settings: int, ned: bool) -> bool:
    """Whether a device takes these output settings."""
    known = KNOWN_SETTINGS | (NED_BIT if ned else 0)
    return not settings & ~known and settings >> 2 & 3 <= MATRIX


def data_length(mode: int, settings: int) -> int:
    """Bytes of data in a message."""
    zero = np.zeros(3)
    return len(encode(Sample(np.eye(3), zero, zero, zero, 0.0, 0, 0), mode, settings))


def encode(sample: Sample, mode: int, settings: int) -> bytes:
    """The data of an MTData message."""
    values: list[float] = []
    if mode & TEMPERATURE:
        values.append(sample.temperature_deg)
    if mode & CALIBRATED:
        vectors = (sample.accel_mps2, sample.rate_radps, sample.magnetic)
        for bit, vector in zip((4, 5, 6), vectors, strict=True):
            if not settings >> bit & 1:
                values += vector.tolist()
    if mode & ORIENTATION:
        R = R_FROM_NWU[NED] @ sample.R_earth_sensor if settings & NED_BIT else sample.R_earth_sensor
        values += orientation(R, settings >> 2 & 3)
    data = numbers(values, settings >> 8 & 3, sample.preamble)
    data += bytes([sample.status & 0xFF]) if mode & STATUS else b""
    return data + (struct.pack(">H", sample.counter) if settings & COUNTER else b"")
