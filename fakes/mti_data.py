"""What a legacy MTi measured, as an MTData message in any mode and number format.

Source: MTi sheet, sections 3, 4 and 6. Euler angles: R = Rz(yaw) Ry(pitch) Rx(roll), degrees.
"""

import math
import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

TEMPERATURE, CALIBRATED, ORIENTATION, AUXILIARY = 0x0001, 0x0002, 0x0004, 0x0008
STATUS, RAW = 0x0800, 0x4000
COUNTER = 0x1  # output settings
QUATERNION, EULER, MATRIX = 0, 1, 2
FLOAT32, FIXED_12_20, FIXED_16_32, FLOAT64 = 0, 1, 2, 3
NUMBER_SIZES = (4, 4, 6, 8)
KNOWN_MODE = TEMPERATURE | CALIBRATED | ORIENTATION | AUXILIARY | STATUS
KNOWN_SETTINGS = 0x0F7D  # counter, orientation, three switches, format, two analog switches


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One instant, in the frames that the device was told to use."""

    R_earth_sensor: F64  # (3, 3), earth is north, west, up
    rate_radps: F64  # (3,)
    accel_mps2: F64  # (3,), with gravity
    magnetic: F64  # (3,), 1 is the field at calibration
    temperature_deg: float
    analog: tuple[int, int]
    status: int
    counter: int


def is_mode(mode: int) -> bool:
    """Whether a device without GPS takes this output mode."""
    return mode == RAW or not mode & ~KNOWN_MODE


def is_settings(settings: int) -> bool:
    """Whether a device without GPS takes these output settings."""
    return not settings & ~KNOWN_SETTINGS and settings >> 2 & 3 <= MATRIX


def data_length(mode: int, settings: int) -> int:
    """Bytes of data in a message."""
    zero = np.zeros(3)
    nothing = Sample(np.eye(3), zero, zero, zero, 0.0, (0, 0), 0, 0)
    return len(encode(nothing, mode, settings))


def encode(sample: Sample, mode: int, settings: int) -> bytes:
    """The data of an MTData message."""
    number_format = settings >> 8 & 3
    counter = struct.pack(">H", sample.counter) if settings & COUNTER else b""
    if mode & RAW:
        return _raw(sample) + counter
    numbers: list[float] = []
    if mode & TEMPERATURE:
        numbers.append(sample.temperature_deg)
    if mode & CALIBRATED:
        vectors = (sample.accel_mps2, sample.rate_radps, sample.magnetic)
        for bit, vector in zip((4, 5, 6), vectors, strict=True):
            if not settings >> bit & 1:
                numbers += vector.tolist()
    if mode & ORIENTATION:
        numbers += orientation(sample.R_earth_sensor, settings >> 2 & 3)
    data = b"".join(number(value, number_format) for value in numbers)
    if mode & AUXILIARY:
        for bit, volts in zip((10, 11), sample.analog, strict=True):
            data += b"" if settings >> bit & 1 else struct.pack(">H", volts)
    if mode & STATUS:
        data += bytes([sample.status])
    return data + counter


def number(value: float, number_format: int) -> bytes:
    """One number of a message; what a fixed format cannot hold becomes its nearest, or lowest."""
    if number_format == FLOAT32:
        return struct.pack(">f", value)
    if number_format == FLOAT64:
        return struct.pack(">d", value)
    fraction, size = (20, 4) if number_format == FIXED_12_20 else (32, 6)
    most = 2 ** (8 * size - 1)
    scaled = -most if not math.isfinite(value) else round(value * 2**fraction)
    fixed = int(max(-most, min(most - 1, scaled))).to_bytes(size, "big", signed=True)
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


def _raw(sample: Sample) -> bytes:
    """AD counts around the middle of their range, and the temperature's."""
    counts = np.concatenate(
        [sample.accel_mps2 * 500, sample.rate_radps * 5000, sample.magnetic * 10_000]
    )
    counts = np.clip(np.nan_to_num(counts) + 32_768, 0, 65_535).astype(np.int64)
    return struct.pack(">10H", *counts.tolist(), round(256 * sample.temperature_deg))


def rotation_z(angle_rad: float) -> F64:
    """A turn to the left."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation(vector_rad: F64) -> F64:
    """The turn (3, 3) about a vector (3,) by its length."""
    angle = float(np.linalg.norm(vector_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector_rad / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross))
