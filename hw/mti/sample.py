"""What one data message of an MTi says, whichever of the two forms it came in.

Numbers come in four formats, orientations as quaternions or Euler angles (matrices, which nobody
asks for, are stepped over), in three earth frames. The one earth frame of all that leaves here has
x north, y west, z up: what legacy devices use. A newer device's east-north-up is turned by -90
degrees about z, north-east-down by half a turn about x. So yaw is 0 where the sensor's x axis
points north, whatever the device was told.

It refuses values that are not finite and orientations that are not rotations: an 8-bit checksum
lets one damaged frame in 256 pass.
Source: MTi sheet, sections 3 to 6.
"""

import math
import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from msgspec import Struct

from hw.device import BadFrame

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w x y z
Reader = Callable[[bytes, int], Any]  # of a field, from a place on: a tuple of numbers
Turn = Callable[..., "Quaternion | None"]  # of such numbers; None: they are no rotation
Field = tuple[str, int, Reader, Turn | None]  # name, place in the data, how it is read

NUMBER_SIZES = (4, 4, 6, 8)  # float32, fixed 12.20, fixed 16.32, float64
QUATERNION, EULER = 0, 1  # bits 3-2 of the output settings
ORIENTATION_NUMBERS = (4, 3, 9, 0)  # the third kind is a matrix, the fourth reserved
ENU, NED, NWU = 0, 1, 2  # earth frames, by bits 3-2 of a data identifier
ROTATION_TOLERANCE = 0.02  # of lengths and dot products
MAX_RATE_RADPS = 100.0  # the fastest variant of the device ends at 21
HALF_ROOT = math.sqrt(0.5)


class MtSample(Struct, frozen=True):
    """What one data message says; None where it is silent. Earth frame: x north, y west, z up."""

    counter: int | None = None  # 0..65535, +1 per sample
    fine_ticks: int | None = None  # 0.1 ms
    q_earth_sensor: Quaternion | None = None
    rate_radps: Vector | None = None
    accel_mps2: Vector | None = None  # includes gravity
    magnetic: Vector | None = None  # 1.0: the field at calibration
    temperature_c: float | None = None
    status: int | None = None


Decoded = MtSample | BadFrame


def sample_of(fields: Sequence[Field], data: bytes) -> Decoded:
    """The fields of a message, or why it is worth nothing."""
    found = {}
    for name, start, read, maybe_turn in fields:
        values = read(data, start)
        if maybe_turn is not None and (values := maybe_turn(*values)) is None:
            return BadFrame("orientation is not a rotation", data)
        if not math.isfinite(sum(values)):
            return BadFrame(f"{name} is not finite", data)
        if name == "rate_radps" and max(*values, -min(values)) > MAX_RATE_RADPS:
            return BadFrame("rate of turn beyond any such device", data)
        found[name] = values if len(values) > 1 else values[0]
    return MtSample(**found)


@cache
def number_reader(count: int, number_format: int) -> Reader:
    """Reads so many numbers in one of the four formats (section 3, "OutputSettings").

    >>> number_reader(1, 2)(bytes.fromhex("C0000000FFFD"), 0)
    (-2.25,)
    """
    letters = ("f", "i", "Ih", "d")[number_format]
    read: Reader = struct.Struct(">" + letters * count).unpack_from
    if number_format == 1:
        return lambda data, start: tuple(n / 2**20 for n in read(data, start))

    def read_halves(data: bytes, start: int) -> tuple[float, ...]:
        """Of each number the fraction comes first, then the integer below it."""
        parts = read(data, start)
        return tuple(i + f / 2**32 for f, i in zip(parts[::2], parts[1::2], strict=True))

    return read_halves if number_format == 2 else read


def orientation_turn(kind: int, frame: int) -> Turn:
    """Of a quaternion or Euler angles, the quaternion of `maybe_orientation`, or None."""
    if frame == NWU:  # nothing to turn
        return maybe_unit if kind == QUATERNION else maybe_from_euler_deg
    return lambda *values: maybe_orientation(kind, values, frame)


@cache
def integer_reader(size: int) -> Reader:
    """Reads a number without sign, of 1, 2 or 4 bytes."""
    return struct.Struct({1: ">B", 2: ">H", 4: ">I"}[size]).unpack_from


def maybe_orientation(kind: int, values: tuple[float, ...], frame: int) -> Quaternion | None:
    """What takes the sensor to x north, y west, z up; None: it is no rotation, or no known frame.

    Args:
        kind: QUATERNION or EULER.
        values: as they stand on the wire; angles in degrees.
        frame: ENU, NED or NWU.
    """
    q = maybe_unit(*values) if kind == QUATERNION else maybe_from_euler_deg(*values)
    if q is None or frame not in (ENU, NED, NWU):
        return None
    if frame == NWU:
        return q
    w, x, y, z = q
    if frame == NED:  # half a turn about x
        return -x, w, -z, y
    a = HALF_ROOT  # -90 degrees about z
    return a * (w + z), a * (x + y), a * (y - x), a * (z - w)


def maybe_unit(w: float, x: float, y: float, z: float) -> Quaternion | None:
    """The quaternion brought to length 1; None where it is too far from it."""
    norm = math.hypot(w, x, y, z)
    if not abs(norm - 1.0) <= ROTATION_TOLERANCE:  # so that NaN is refused too
        return None
    return w / norm, x / norm, y / norm, z / norm


def maybe_from_euler_deg(roll: float, pitch: float, yaw: float) -> Quaternion | None:
    """Rz(yaw) Ry(pitch) Rx(roll), which takes sensor to earth; None outside of the device's ranges.

    >>> maybe_from_euler_deg(0.0, 0.0, 180.0)
    (6.123233995736766e-17, 0.0, 0.0, 1.0)
    """
    if not (abs(roll) <= 180.5 and abs(pitch) <= 90.5 and abs(yaw) <= 180.5):
        return None
    a, b, c = math.radians(roll) / 2, math.radians(pitch) / 2, math.radians(yaw) / 2
    sa, ca = math.sin(a), math.cos(a)
    sb, cb = math.sin(b), math.cos(b)
    sc, cc = math.sin(c), math.cos(c)
    return (
        ca * cb * cc + sa * sb * sc,
        sa * cb * cc - ca * sb * sc,
        ca * sb * cc + sa * cb * sc,
        ca * cb * sc - sa * sb * cc,
    )
