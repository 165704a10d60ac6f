"""What one data message of an MTi says, whichever of the two forms it came in.

It refuses values that are not finite where they matter: an 8-bit checksum lets one damaged frame
in 256 pass. A position or a velocity that is not finite is none: there is no fix.

Source: MTi sheet, sections 4 and 5. The bytes of newer GNSS packets are not in the sheet; their
layout is held against recordings.
"""

import math
import struct
from dataclasses import dataclass
from typing import Any

from core.records import record
from hw.device import BadFrame
from hw.mti.numbers import Quaternion, Vector, maybe_orientation, vector_nwu

MAX_RATE_RADPS = 100.0  # the fastest variant of the device ends at 21
WITHOUT_FIX = frozenset({"lat_lon_deg", "altitude_m", "position_ecef_m", "velocity_mps"})

LEGACY_GPS = struct.Struct(">HBI3i3i3IB")  # 44 bytes
GNSS = struct.Struct(">IHBBBBBBIiBBBBiiiiIIiiiiiIIi7H")  # 94 bytes
UTC = struct.Struct(">IHBBBBBB")
SATELLITES_HEAD, SATELLITE = struct.Struct(">IB3x"), struct.Struct(">BBBB")


@dataclass(frozen=True, slots=True)
class Utc:
    """Date and time of day as the device's receiver knows them."""

    nanoseconds: int
    year: int
    month: int
    day: int
    hour: int
    minute: int
    second: int
    flags: int  # 1 date, 2 time of day, 4 fully resolved (newer); 1 valid (legacy)


@dataclass(frozen=True, slots=True)
class GpsFix:
    """Position, velocity and time of a satellite receiver. NaN or None: the form has it not."""

    itow_s: float  # GPS time of week
    lat_deg: float
    lon_deg: float
    height_m: float  # above the ellipsoid
    velocity_ned_mps: Vector
    horizontal_accuracy_m: float
    vertical_accuracy_m: float
    speed_accuracy_mps: float
    fix: int | None  # newer: 0 none, 2 two-, 3 three-dimensional
    satellites: int | None
    utc: Utc | None
    age: int | None  # legacy: counts of the last byte, and
    pressure_raw: int | None  # the pressure before it, with its age
    pressure_age: int | None


@dataclass(frozen=True, slots=True)
class Satellite:
    """One satellite in view."""

    system: int
    number: int
    carrier_to_noise_db: int
    flags: int


@record()
class MtSample:
    """What one data message says; None where it is silent. Earth frame: x north, y west, z up."""

    counter: int | None = None  # 0..65535, +1 per sample
    fine_ticks: int | None = None  # 0.1 ms
    q_earth_sensor: Quaternion | None = None
    rate_radps: Vector | None = None
    accel_mps2: Vector | None = None  # includes gravity
    magnetic: Vector | None = None  # 1.0: the field at calibration
    temperature_c: float | None = None
    status: int | None = None
    coarse_s: int | None = None
    utc: Utc | None = None
    free_accel_mps2: Vector | None = None  # earth frame, without gravity
    dv_mps: Vector | None = None  # sensor frame, since the last sample
    dq: Quaternion | None = None
    pressure_pa: int | None = None
    lat_lon_deg: tuple[float, float] | None = None  # WGS84
    altitude_m: float | None = None
    position_ecef_m: Vector | None = None
    velocity_mps: Vector | None = None  # earth frame
    raw: tuple[int, ...] | None = None  # (10,) acc xyz, gyr xyz, mag xyz, temperature: AD counts
    analog: tuple[int, ...] | None = None  # of the inputs that are enabled, in their order
    gps: GpsFix | None = None
    satellites: tuple[Satellite, ...] | None = None


class SampleBuilder:
    """A sample while it is put together; the first thing that is wrong with it is kept."""

    def __init__(self) -> None:
        self.wrong = ""
        self._values: dict[str, Any] = {}

    def put(self, name: str, value: object) -> None:
        """A field that can't be wrong."""
        self._values[name] = value

    def take(self, name: str, values: tuple[float, ...]) -> None:
        """Numbers of a field: a single one, or a tuple of them."""
        if not all(map(math.isfinite, values)):
            if name in WITHOUT_FIX:
                return
            self.reject(f"{name} is not finite")
        elif name == "rate_radps" and max(map(abs, values)) > MAX_RATE_RADPS:
            self.reject("rate of turn beyond any such device")
        self._values[name] = values if len(values) > 1 else values[0]

    def take_earth(self, name: str, values: tuple[float, ...], frame: int) -> None:
        """A vector (3,) in the device's earth frame."""
        turned = vector_nwu(values, frame)
        if turned is None:
            self.reject(f"{name} in an earth frame that is not known")
        else:
            self.take(name, turned)

    def take_orientation(self, kind: int, values: tuple[float, ...], frame: int) -> None:
        """Quaternion, Euler angles or matrix, as they stand on the wire."""
        q = maybe_orientation(kind, values, frame)
        if q is None:
            self.reject("orientation is not a rotation")
        self._values["q_earth_sensor"] = q

    def reject(self, reason: str) -> None:
        """The message is worth nothing."""
        self.wrong = self.wrong or reason

    def sample(self, data: bytes) -> MtSample | BadFrame:
        """The sample, if nothing was wrong."""
        return BadFrame(self.wrong, data) if self.wrong else MtSample(**self._values)


def utc_from_bytes(data: bytes) -> Utc:
    """12 bytes, as in message ReqUTCTime."""
    return Utc(*UTC.unpack(data))


def gps_from_legacy(data: bytes) -> GpsFix:
    """The 44 bytes of MTData's GPS block."""
    pressure, pressure_age, itow_ms, *rest = LEGACY_GPS.unpack(data)
    lat, lon, height_mm, north, east, down, h_accuracy, v_accuracy, s_accuracy, age = rest
    return GpsFix(
        itow_s=itow_ms / 1000,
        lat_deg=lat * 1e-7,
        lon_deg=lon * 1e-7,
        height_m=height_mm / 1000,
        velocity_ned_mps=(north / 100, east / 100, down / 100),  # cm/s, as the receiver gives it
        horizontal_accuracy_m=h_accuracy / 1000,
        vertical_accuracy_m=v_accuracy / 1000,
        speed_accuracy_mps=s_accuracy / 100,
        fix=None,
        satellites=None,
        utc=None,
        age=age,
        pressure_raw=pressure,
        pressure_age=pressure_age,
    )


def gps_from_gnss(data: bytes) -> GpsFix:
    """The 94 bytes of packet 7010."""
    v = GNSS.unpack(data)
    return GpsFix(
        itow_s=v[0] / 1000,
        lat_deg=v[15] * 1e-7,
        lon_deg=v[14] * 1e-7,
        height_m=v[16] / 1000,
        velocity_ned_mps=(v[20] / 1000, v[21] / 1000, v[22] / 1000),
        horizontal_accuracy_m=v[18] / 1000,
        vertical_accuracy_m=v[19] / 1000,
        speed_accuracy_mps=v[25] / 1000,
        fix=v[10],
        satellites=v[12],
        utc=Utc(v[9] % 1_000_000_000, v[1], v[2], v[3], v[4], v[5], v[6], v[7]),
        age=None,
        pressure_raw=None,
        pressure_age=None,
    )


def maybe_satellites(data: bytes) -> tuple[Satellite, ...] | None:
    """Packet 7020: 8 bytes and 4 for each satellite; None where its count does not fit."""
    if len(data) < SATELLITES_HEAD.size:
        return None
    _, count = SATELLITES_HEAD.unpack_from(data)
    if len(data) != SATELLITES_HEAD.size + count * SATELLITE.size:
        return None
    return tuple(Satellite(*values) for values in SATELLITE.iter_unpack(data[8:]))
