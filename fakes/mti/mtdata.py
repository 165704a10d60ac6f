"""What an MTi measured, as a legacy MTData message in any mode and number format.

Source: MTi sheet, sections 3, 4 and 6.
"""

import struct
from dataclasses import dataclass

import numpy as np

from fakes.mti.gnss import Place, legacy_pvt, utc
from fakes.mti.numbers import numbers
from fakes.mti.rotation import F64, MATRIX, NED, R_FROM_NWU, orientation

TEMPERATURE, CALIBRATED, ORIENTATION, AUXILIARY = 0x0001, 0x0002, 0x0004, 0x0008
POSITION, VELOCITY, STATUS, GPS, RAW = 0x0010, 0x0020, 0x0800, 0x1000, 0x4000
COUNTER, UTC_TIME = 0x1, 0x2  # output settings
NED_BIT = 0x8000_0000
KNOWN_MODE = TEMPERATURE | CALIBRATED | ORIENTATION | AUXILIARY | STATUS
KNOWN_SETTINGS = 0x0F7D  # counter, orientation, three switches, format, two analog switches
NOWHERE = Place(0.0, 0.0, 0.0, np.zeros(3), False, 0.0)


@dataclass(slots=True, eq=False)
class Sample:
    """One instant, in the frames that the device was told to use."""

    R_earth_sensor: F64  # (3, 3), earth is north, west, up
    rate_radps: F64  # (3,)
    accel_mps2: F64  # (3,), with gravity
    magnetic: F64  # (3,), 1 is the field at calibration
    temperature_deg: float
    analog: tuple[int, int]
    status: int  # status word; its low byte is the status byte
    counter: int
    place: Place = NOWHERE
    fine: int = 0  # 1e-4 s ticks
    gps_age: int = 0  # samples
    preamble: bool = False  # FA FF must occur in the data


def is_mode(mode: int, gnss: bool) -> bool:
    """Whether a device takes this output mode."""
    more = POSITION | VELOCITY | GPS if gnss else 0
    if mode & RAW:
        return not mode & ~(RAW | (GPS if gnss else 0))
    return not mode & ~(KNOWN_MODE | more)


def is_settings(settings: int, gnss: bool, ned: bool) -> bool:
    """Whether a device takes these output settings."""
    known = KNOWN_SETTINGS | (UTC_TIME if gnss else 0) | (NED_BIT if ned else 0)
    return not settings & ~known and settings >> 2 & 3 <= MATRIX


def data_length(mode: int, settings: int) -> int:
    """Bytes of data in a message."""
    zero = np.zeros(3)
    nothing = Sample(np.eye(3), zero, zero, zero, 0.0, (0, 0), 0, 0)
    return len(encode(nothing, mode, settings))


def encode(sample: Sample, mode: int, settings: int) -> bytes:
    """The data of an MTData message."""
    number_format = settings >> 8 & 3
    data = b""
    if mode & RAW:
        data += _raw(sample)
    if mode & GPS:
        data += legacy_pvt(sample.place, sample.gps_age)
    if not mode & RAW:
        values = _first_numbers(sample, mode, settings)
        data += numbers(values, number_format, sample.preamble)
        if mode & AUXILIARY:
            for bit, volts in zip((10, 11), sample.analog, strict=True):
                data += b"" if settings >> bit & 1 else struct.pack(">H", volts)
        data += numbers(_where(sample, mode, settings), number_format)
        if mode & STATUS:
            data += bytes([sample.status & 0xFF])
    if settings & COUNTER:
        data += struct.pack(">H", sample.counter)
    if settings & UTC_TIME:
        data += utc(sample.place.utc_s, 1 if sample.place.fix else 0)
    return data


def _first_numbers(sample: Sample, mode: int, settings: int) -> list[float]:
    """Temperature, vectors and orientation, as far as they are switched on."""
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
    return values


def _where(sample: Sample, mode: int, settings: int) -> list[float]:
    place = sample.place
    values = [place.lat_deg, place.lon_deg, place.alt_m] if mode & POSITION else []
    if mode & VELOCITY:
        velocity_mps = place.velocity_mps
        values += (R_FROM_NWU[NED] @ velocity_mps if settings & NED_BIT else velocity_mps).tolist()
    return values


def _raw(sample: Sample) -> bytes:
    """AD counts around the middle of their range, and the temperature's."""
    counts = np.concatenate(
        [sample.accel_mps2 * 500, sample.rate_radps * 5000, sample.magnetic * 10_000]
    )
    counts = np.clip(np.nan_to_num(counts) + 32_768, 0, 65_535).astype(np.int64)
    temperature = round(256 * sample.temperature_deg) if np.isfinite(sample.temperature_deg) else 0
    heat = 0xFAFF if sample.preamble else max(0, min(0xFFFF, temperature))
    return struct.pack(">10H", *counts.tolist(), heat)
