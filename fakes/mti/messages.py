"""What an MTi measured, as the data of its messages: legacy MTData, and the packets of MTData2.

Output modes that mapod never asks for (raw, analog, position, velocity, GPS, UTC) are refused.

Source: MTi sheet, sections 3 to 6, and its recordings.
Euler angles: R = Rz(yaw) Ry(pitch) Rx(roll), degrees.
"""

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fakes.wires.timing import F64

FLOAT32, FIXED_12_20, FIXED_16_32, FLOAT64 = 0, 1, 2, 3
NUMBER_SIZES = (4, 4, 6, 8)
PREAMBLE_TWICE = 0xFAFF
FRAME_BYTES = 5  # around the data

TEMPERATURE, CALIBRATED, ORIENTATION, STATUS = 0x0001, 0x0002, 0x0004, 0x0800  # output modes
KNOWN_MODE = TEMPERATURE | CALIBRATED | ORIENTATION | STATUS
COUNTER = 0x1  # output settings
NED_BIT = 0x8000_0000
KNOWN_SETTINGS = 0x0F7D  # counter, orientation, three switches, format, two analog switches

SIZES = {0x0810: 1, 0x2010: 4, 0x2020: 9, 0x2030: 3, 0x4020: 3, 0x8020: 3, 0xC020: 3}  # numbers
QUATERNION, EULER, MATRIX = 0, 1, 2
ORIENTED = {0x2010: QUATERNION, 0x2020: MATRIX, 0x2030: EULER}  # ready one sample later
R_NED_NWU = np.diag([1.0, -1.0, -1.0])
FRAMES: dict[int, F64] = {  # of the earth, from north, west, up
    0x0: np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),  # east, north, up
    0x4: R_NED_NWU,
    0x8: np.eye(3),
}


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


def numbers(values: Sequence[float], number_format: int, preamble: bool = False) -> bytes:
    """Numbers of a message; with `preamble` the smallest holds `FA FF`, as near as may be to it."""
    if number_format == FLOAT32 and not preamble:
        return struct.pack(f">{len(values)}f", *values)
    least = min(range(len(values)), key=lambda k: abs(values[k])) if preamble and values else -1
    return b"".join(_number(value, number_format, k == least) for k, value in enumerate(values))


def _number(value: float, number_format: int, preamble: bool) -> bytes:
    """One number; what a fixed format cannot hold becomes its nearest, or lowest."""
    if number_format in (FLOAT32, FLOAT64):
        data = struct.pack(">f" if number_format == FLOAT32 else ">d", value)
        return data[:-2] + PREAMBLE_TWICE.to_bytes(2, "big") if preamble else data
    fraction, size = (20, 4) if number_format == FIXED_12_20 else (32, 6)
    most = 2 ** (8 * size - 1)
    scaled = round(value * 2**fraction) if math.isfinite(value) else -most
    if preamble:
        upper = round((scaled - PREAMBLE_TWICE) / 2**16)
        scaled = max(-most, upper * 2**16) + PREAMBLE_TWICE
    fixed: bytes = max(-most, min(most - 1, scaled)).to_bytes(size, "big", signed=True)
    return fixed if number_format == FIXED_12_20 else fixed[2:] + fixed[:2]


def orientation(R: F64, kind: int) -> list[float]:
    """A rotation as a quaternion, as Euler angles in degrees, or as a matrix, column by column."""
    if kind == EULER:
        roll = math.atan2(R[2, 1], R[2, 2])
        pitch = -math.asin(max(-1.0, min(1.0, R[2, 0]))) if math.isfinite(R[2, 0]) else math.nan
        yaw = math.atan2(R[1, 0], R[0, 0])
        return [math.degrees(angle) + 0.0 for angle in (roll, pitch, yaw)]  # no -0
    if kind == MATRIX:
        return [float(value) for value in R.T.ravel()]
    return quaternion(R)


def quaternion(R: F64) -> list[float]:
    """w x y z of a rotation matrix, w not negative; by its largest part, so that none is lost."""
    xx, yy, zz = R[0, 0], R[1, 1], R[2, 2]
    parts = [1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz]
    k = max(range(4), key=lambda part: parts[part])
    w, x, y = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    row = (
        (parts[0], w, x, y), (w, parts[1], xy, xz), (x, xy, parts[2], yz), (y, xz, yz, parts[3])
    )[k]  # fmt: skip
    scale = 0.5 / math.sqrt(parts[k])
    sign = -1.0 if row[0] < 0 else 1.0
    return [sign * scale * float(part) + 0.0 for part in row]


def is_mode(mode: int) -> bool:
    return not mode & ~KNOWN_MODE


def is_settings(settings: int, ned: bool) -> bool:
    known = KNOWN_SETTINGS | (NED_BIT if ned else 0)
    return not settings & ~known and settings >> 2 & 3 <= MATRIX


def mtdata(sample: Sample, mode: int, settings: int) -> bytes:
    values: list[float] = []
    if mode & TEMPERATURE:
        values.append(sample.temperature_deg)
    if mode & CALIBRATED:
        vectors = (sample.accel_mps2, sample.rate_radps, sample.magnetic)
        for bit, vector in zip((4, 5, 6), vectors, strict=True):
            if not settings >> bit & 1:
                values += vector.tolist()
    if mode & ORIENTATION:
        R = R_NED_NWU @ sample.R_earth_sensor if settings & NED_BIT else sample.R_earth_sensor
        values += orientation(R, settings >> 2 & 3)
    data = numbers(values, settings >> 8 & 3, sample.preamble)
    data += bytes([sample.status & 0xFF]) if mode & STATUS else b""
    return data + (struct.pack(">H", sample.counter) if settings & COUNTER else b"")


def mtdata_length(mode: int, settings: int) -> int:
    zero = np.zeros(3)
    return len(mtdata(Sample(np.eye(3), zero, zero, zero, 0.0, 0, 0), mode, settings))


HEADERS: dict[int, tuple[int, Callable[[Sample], int]]] = {  # packets in every message; bytes
    0x1020: (2, lambda sample: sample.counter),
    0x1060: (4, lambda sample: sample.fine),
    0xE010: (1, lambda sample: sample.status & 0xFF),
    0xE020: (4, lambda sample: sample.status),
}


def kind_of(identifier: int) -> int:
    """A packet's id without number format and frame."""
    return identifier & 0xFFF0


def packet_size(identifier: int) -> int:
    kind = kind_of(identifier)
    return HEADERS[kind][0] if kind in HEADERS else SIZES[kind] * NUMBER_SIZES[identifier & 3]


def mtdata2(sample: Sample, identifiers: Sequence[int]) -> bytes:
    first = next((i for i in identifiers if kind_of(i) in SIZES), None)
    data = b""
    for identifier in identifiers:
        content = _content(sample, identifier, sample.preamble and identifier == first)
        data += struct.pack(">HB", identifier, len(content)) + content
    return data


def _content(sample: Sample, identifier: int, preamble: bool) -> bytes:
    kind = kind_of(identifier)
    if kind in HEADERS:
        size, value = HEADERS[kind]
        return value(sample).to_bytes(size, "big")
    if kind in ORIENTED:
        R = FRAMES[identifier & 0xC] @ sample.R_earth_sensor
        return numbers(orientation(R, ORIENTED[kind]), identifier & 3, preamble)
    values = {
        0x0810: lambda: [sample.temperature_deg],
        0x4020: sample.accel_mps2.tolist,
        0x8020: sample.rate_radps.tolist,
        0xC020: sample.magnetic.tolist,
    }[kind]()
    return numbers(values, identifier & 3, preamble)
