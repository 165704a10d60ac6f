"""Where and when a fake MTi is: position on the earth, GNSS messages, UTC, air pressure.

Source: MTi sheet, sections 3 to 5 and its recordings: order of fields in 7010 and 7020 [R]; units
of the legacy GPS block [U]: pressure 2 Pa, velocities cm/s, accuracies mm and cm/s.
"""

import math
import struct
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

SEMI_MAJOR_M, ECCENTRICITY_2 = 6_378_137.0, 6.69437999014e-3  # WGS84
GPS_WEEK_S, LEAP_S = 604_800, 18
GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
UNIX_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
RESOLVED, NO_TIME = 0x37, 0x00  # flags of a UTC packet, as recorded
SATELLITES = 28
FIX_3D, NO_FIX = 3, 0


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where the device is, as its receiver knows it."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    velocity_mps: F64  # (3,) north, west, up
    fix: bool
    utc_s: float  # since 1970

    @property
    def ecef_m(self) -> list[float]:
        """Earth-centred, earth-fixed x, y, z."""
        lat, lon = math.radians(self.lat_deg), math.radians(self.lon_deg)
        normal = SEMI_MAJOR_M / math.sqrt(1 - ECCENTRICITY_2 * math.sin(lat) ** 2)
        return [
            (normal + self.alt_m) * math.cos(lat) * math.cos(lon),
            (normal + self.alt_m) * math.cos(lat) * math.sin(lon),
            (normal * (1 - ECCENTRICITY_2) + self.alt_m) * math.sin(lat),
        ]

    @property
    def pressure_pa(self) -> int:
        """Of the standard atmosphere."""
        return round(101_325 * math.pow(1 - 2.25577e-5 * self.alt_m, 5.25588))


def place_near(home: tuple[float, float, float], moved_m: F64) -> tuple[float, float, float]:
    """Latitude, longitude (deg), altitude (m) at (3,) metres north, west, up of a home."""
    lat = math.radians(home[0])
    flat = 1 - ECCENTRICITY_2 * math.sin(lat) ** 2
    normal_m = SEMI_MAJOR_M / math.sqrt(flat)
    meridian_m = normal_m * (1 - ECCENTRICITY_2) / flat
    return (
        home[0] + math.degrees(moved_m[0] / meridian_m),
        home[1] - math.degrees(moved_m[1] / (normal_m * math.cos(lat))),
        home[2] + float(moved_m[2]),
    )


def _moment(utc_s: float) -> datetime:
    return UNIX_EPOCH + timedelta(microseconds=round(utc_s * 1e6))


def utc(utc_s: float, valid: int) -> bytes:
    """The 12 bytes of message 61, of MTData's last block and of packet 1010."""
    t = _moment(utc_s)
    fields = (t.microsecond * 1000, t.year, t.month, t.day, t.hour, t.minute, t.second, valid)
    return struct.pack(">IH6B", *fields)


def week_ms(utc_s: float) -> int:
    """GPS time of week."""
    since_s = (_moment(utc_s) - GPS_EPOCH).total_seconds() + LEAP_S
    return round(since_s % GPS_WEEK_S * 1000)


def legacy_pvt(place: Place, age: int) -> bytes:
    """The 44 bytes of block 2: pressure and GPS; age counts samples since the receiver spoke."""
    north, west, up = place.velocity_mps * 100
    position = (round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), round(place.alt_m * 1e3))
    return struct.pack(
        ">HBI6i3IB",
        place.pressure_pa // 2,
        age,
        week_ms(place.utc_s),
        *position,
        *(round(v) for v in (north, -west, -up)),
        *((2500, 3500, 40) if place.fix else (2**32 - 1,) * 3),
        age,
    )


def pvt(place: Place) -> bytes:
    """The 94 bytes of packet 7010."""
    t = _moment(place.utc_s)
    north, west, up = (round(1000 * float(v)) for v in place.velocity_mps)
    head = (t.year, t.month, t.day, t.hour, t.minute, t.second, RESOLVED)
    fix = FIX_3D if place.fix else NO_FIX
    height_mm = round(place.alt_m * 1000)
    return struct.pack(
        ">IH6BIi4B4i2I5i2Ii7H",
        week_ms(place.utc_s),
        *head,
        5,  # ns, accuracy of the time
        t.microsecond * 1000,
        *(fix, int(place.fix), 12 if place.fix else 0, 0),
        *(round(place.lon_deg * 1e7), round(place.lat_deg * 1e7), height_mm, height_mm - 38_500),
        *(2265, 2085),  # mm
        *(north, -west, -up, round(math.hypot(north, west))),
        round(math.degrees(math.atan2(-west, north)) * 1e5),
        *(300, 180 * 100_000, 0),
        *(152, 136, 67, 111, 79, 53, 58),  # dilutions of precision, 0.01
    )


def satellites(place: Place) -> bytes:
    """Packet 7020: 8 bytes, and 4 for each satellite."""
    seen = SATELLITES if place.fix else 0
    each = b"".join(bytes([k % 7, k + 1, 20 + k % 25, 0x1F]) for k in range(seen))
    return struct.pack(">IB3x", week_ms(place.utc_s), seen) + each
