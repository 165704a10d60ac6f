"""MTi data messages to samples: MTData, laid out by output mode and settings, and MTData2.

It refuses values that are not finite and orientations that are not rotations: an 8-bit checksum
lets one damaged frame in 256 pass.

Source: MTi sheet, sections 3 to 6.
"""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from hw.session import BadFrame

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w x y z

NUMBER_SIZES = (4, 4, 6, 8)  # float32, fixed 12.20, fixed 16.32, float64
QUATERNION, EULER, MATRIX = 0, 1, 2  # bits 3-2 of the output settings
ORIENTATION_NUMBERS = (4, 3, 9, 0)  # the fourth kind is reserved
MAX_RATE_RADPS = 100.0  # the fastest variant of the device ends at 21
ROTATION_TOLERANCE = 0.02  # of lengths and dot products

# data identifier of MTData2 without its low 4 bits: field, numbers or bytes
VECTORS = {
    0x0810: ("temperature", 1),
    0x4020: ("accel", 3),
    0x8020: ("rate", 3),
    0xC020: ("magnetic", 3),
}
INTEGERS = {
    0x1020: ("counter", 2),
    0x1060: ("fine_ticks", 4),
    0xE010: ("status", 1),
    0xE020: ("status", 4),
}
ORIENTATIONS = {0x2010: QUATERNION, 0x2020: MATRIX, 0x2030: EULER}


@dataclass(frozen=True, slots=True)
class MtSample:
    """What one data message says; None where it is silent. The earth frame has z up."""

    counter: int | None = None  # 0..65535, +1 per sample
    fine_ticks: int | None = None  # 0.1 ms
    q_earth_sensor: Quaternion | None = None
    rate_radps: Vector | None = None
    accel_mps2: Vector | None = None  # includes gravity
    magnetic: Vector | None = None  # 1.0: the field at calibration
    temperature_c: float | None = None
    status: int | None = None


class MtDataDecoder:
    """MTData of one output mode and settings: the frame does not describe itself."""

    def __init__(self, mode: int, settings: int) -> None:
        self.mode, self.settings = mode, settings
        self._number_format = settings >> 8 & 3
        self._starts: dict[str, int] = {}
        self.size = 0  # data bytes of a frame
        for name, size in _blocks(mode, settings):
            self._starts[name] = self.size
            self.size += size

    def decode(self, data: bytes) -> MtSample | BadFrame:
        """The sample, or why the data cannot be one of this mode and these settings."""
        if len(data) != self.size:
            reason = f"{len(data)} data bytes, {self.size} by output mode and settings"
            return BadFrame(reason, data)
        fields = _Fields()
        for name, count in (("temperature", 1), ("accel", 3), ("rate", 3), ("magnetic", 3)):
            if name in self._starts:
                fields.take(name, self._numbers(data, name, count))
        kind = self.settings >> 2 & 3
        if "orientation" in self._starts and kind <= MATRIX:
            values = self._numbers(data, "orientation", ORIENTATION_NUMBERS[kind])
            fields.take_orientation(kind, values, z_down=bool(self.settings >> 31))
        if "counter" in self._starts:
            fields.counter = int.from_bytes(data[self._starts["counter"] :][:2], "big")
        if "status" in self._starts:
            fields.status = data[self._starts["status"]]
        return fields.sample(data)

    def _numbers(self, data: bytes, name: str, count: int) -> tuple[float, ...]:
        return _numbers(data, self._starts[name], count, self._number_format)


def decode_mtdata2(data: bytes) -> MtSample | BadFrame:
    """The packets of one MTData2 message, in any order; unknown ones are stepped over."""
    fields = _Fields()
    start = 0
    while start < len(data):
        if start + 3 > len(data) or start + 3 + data[start + 2] > len(data):
            return BadFrame("packet runs over the end of its message", data)
        identifier, size = struct.unpack_from(">HB", data, start)
        fields.take_packet(identifier, data[start + 3 : start + 3 + size])
        start += 3 + size
    return fields.sample(data)


class _Fields:
    """A sample while it is put together; the first thing that is wrong with it is kept."""

    def __init__(self) -> None:
        self.wrong = ""
        self.counter: int | None = None
        self.fine_ticks: int | None = None
        self.status: int | None = None
        self._q: Quaternion | None = None
        self._numbers: dict[str, tuple[float, ...]] = {}

    def take(self, name: str, values: tuple[float, ...]) -> None:
        """Numbers of temperature, accel, rate or magnetic."""
        if not all(map(math.isfinite, values)):
            self.wrong = self.wrong or f"{name} is not finite"
        elif name == "rate" and max(map(abs, values)) > MAX_RATE_RADPS:
            self.wrong = self.wrong or "rate of turn beyond any such device"
        self._numbers[name] = values

    def take_orientation(self, kind: int, values: tuple[float, ...], *, z_down: bool) -> None:
        """Quaternion, Euler angles or matrix, as they stand on the wire."""
        q = (maybe_unit, maybe_from_euler_deg, maybe_from_columns)[kind](*values)
        if q is None:
            self.wrong = self.wrong or "orientation is not a rotation"
        self._q = _z_up_from_z_down(q) if q is not None and z_down else q

    def take_packet(self, identifier: int, payload: bytes) -> None:
        """One packet of an MTData2 message."""
        kind, number_format = identifier & 0xFFF0, identifier & 3
        if kind in INTEGERS:
            name, size = INTEGERS[kind]
            if self._fits(identifier, payload, size):
                setattr(self, name, int.from_bytes(payload, "big"))
        elif kind in VECTORS:
            name, count = VECTORS[kind]
            if self._fits(identifier, payload, count * NUMBER_SIZES[number_format]):
                self.take(name, _numbers(payload, 0, count, number_format))
        elif kind in ORIENTATIONS:
            orientation = ORIENTATIONS[kind]
            count = ORIENTATION_NUMBERS[orientation]
            if self._fits(identifier, payload, count * NUMBER_SIZES[number_format]):
                values = _numbers(payload, 0, count, number_format)
                self.take_orientation(orientation, values, z_down=identifier & 0xC == 4)

    def _fits(self, identifier: int, payload: bytes, size: int) -> bool:
        if len(payload) != size:
            self.wrong = self.wrong or f"packet {identifier:04X} has {len(payload)} bytes"
        return len(payload) == size

    def sample(self, data: bytes) -> MtSample | BadFrame:
        """The sample, if nothing was wrong."""
        if self.wrong:
            return BadFrame(self.wrong, data)
        temperature = self._numbers.get("temperature")
        return MtSample(
            self.counter,
            self.fine_ticks,
            self._q,
            self._maybe_vector("rate"),
            self._maybe_vector("accel"),
            self._maybe_vector("magnetic"),
            temperature[0] if temperature else None,
            self.status,
        )

    def _maybe_vector(self, name: str) -> Vector | None:
        values = self._numbers.get(name)
        return (values[0], values[1], values[2]) if values else None


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
    a, b, c = (math.radians(angle) / 2 for angle in (roll, pitch, yaw))
    sa, ca, sb, cb, sc, cc = (
        math.sin(a),
        math.cos(a),
        math.sin(b),
        math.cos(b),
        math.sin(c),
        math.cos(c),
    )
    return (
        ca * cb * cc + sa * sb * sc,
        sa * cb * cc - ca * sb * sc,
        ca * sb * cc + sa * cb * sc,
        ca * cb * sc - sa * sb * cc,
    )


def maybe_from_columns(*r: float) -> Quaternion | None:
    """Of R_earth_sensor, column by column as on the wire (section 6); None: not a rotation."""
    x, y, z = r[0:3], r[3:6], r[6:9]  # sensor axes in the earth frame
    off = (_dot(x, x) - 1, _dot(y, y) - 1, _dot(z, z) - 1, _dot(x, y), _dot(y, z), _dot(z, x))
    x_cross_y = (
        x[1] * y[2] - x[2] * y[1],
        x[2] * y[0] - x[0] * y[2],
        x[0] * y[1] - x[1] * y[0],
    )
    if not (all(abs(o) <= ROTATION_TOLERANCE for o in off) and _dot(x_cross_y, z) > 0):
        return None
    rows = (  # 4 q_k q, for k = w, x, y, z; the row of the largest q_k is the exact one
        (1 + x[0] + y[1] + z[2], y[2] - z[1], z[0] - x[2], x[1] - y[0]),
        (y[2] - z[1], 1 + x[0] - y[1] - z[2], y[0] + x[1], z[0] + x[2]),
        (z[0] - x[2], y[0] + x[1], 1 - x[0] + y[1] - z[2], z[1] + y[2]),
        (x[1] - y[0], z[0] + x[2], z[1] + y[2], 1 - x[0] - y[1] + z[2]),
    )
    row = max(enumerate(rows), key=lambda item: item[1][item[0]])[1]
    norm = math.hypot(*row)
    return maybe_unit(*(part / norm for part in row))


def _dot(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _z_up_from_z_down(q: Quaternion) -> Quaternion:
    """North-east-down to north-west-up: half a turn of the earth frame about its x axis."""
    w, x, y, z = q
    return -x, w, -z, y


def _blocks(mode: int, settings: int) -> Iterator[tuple[str, int]]:
    """Name and size of the blocks present in MTData, in their order (section 4)."""
    number = NUMBER_SIZES[settings >> 8 & 3]
    processed = 0 if mode & 0x4000 else mode  # raw data excludes all that is computed from it
    calibrated = processed & 0x0002
    analog_inputs = 2 - (settings >> 10 & 1) - (settings >> 11 & 1)
    table: tuple[tuple[str, int, int], ...] = (
        ("raw", mode & 0x4000, 20),
        ("gps", mode & 0x1000, 44),
        ("temperature", processed & 0x0001, number),
        ("accel", calibrated and ~settings & 0x10, 3 * number),
        ("rate", calibrated and ~settings & 0x20, 3 * number),
        ("magnetic", calibrated and ~settings & 0x40, 3 * number),
        ("orientation", processed & 0x0004, ORIENTATION_NUMBERS[settings >> 2 & 3] * number),
        ("analog", processed & 0x0008, 2 * analog_inputs),
        ("position", processed & 0x0010, 3 * number),
        ("velocity", processed & 0x0020, 3 * number),
        ("status", mode & 0x0800, 1),
        ("counter", settings & 1, 2),
        ("utc", settings & 2, 12),
    )
    return ((name, size) for name, present, size in table if present)


def _numbers(data: bytes, start: int, count: int, number_format: int) -> tuple[float, ...]:
    """Numbers in one of the four formats (section 3, "OutputSettings")."""
    match number_format:
        case 0:
            return struct.unpack_from(f">{count}f", data, start)
        case 1:
            return tuple(n / 2**20 for n in struct.unpack_from(f">{count}i", data, start))
        case 2:  # fraction first, then the integer below it
            parts = struct.unpack_from(">" + "Ih" * count, data, start)
            return tuple(i + f / 2**32 for f, i in zip(parts[::2], parts[1::2], strict=True))
        case _:
            return struct.unpack_from(f">{count}d", data, start)
