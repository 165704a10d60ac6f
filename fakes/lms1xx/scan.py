"""What an LMS111 is set to, and its scan telegram.

Source: lms111 sheet, sections 1, 3 and 5.
"""

from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fakes.lms1xx.cola import Value, fields

U16 = npt.NDArray[np.uint16]
AREA_START, AREA_STOP = -450_000, 2_250_000  # field of view, 1/10000 deg
MODES = ((5000, 5000), (2500, 2500), (2500, 5000))  # 1/100 Hz, 1/10000 deg
NO_ECHO, FIRST_VALID = 0, 16
SERIAL_NUMBER = 18_090_362
TIME = "HBBBBBI"


class Content(NamedTuple):
    """What a scan telegram carries: the arguments of LMDscandatacfg."""

    channels: int = 1  # bit 0: first echo, bit 1: second
    channels_high: int = 0
    rssi: int = 0
    rssi_wide: int = 0  # 16 bit instead of 8
    unit: int = 0
    encoder: int = 0
    encoder_high: int = 0
    position: int = 0
    name: int = 0
    comment: int = 0
    time: int = 0
    interval: int = 1  # every n-th scan is sent

    @property
    def is_possible(self) -> bool:
        unused = (self.channels_high, self.unit, self.encoder_high)
        switches = (self.rssi, self.rssi_wide, self.encoder, *self[7:11])
        if self.channels not in (1, 2, 3) or any(unused) or max(switches) > 1:
            return False
        return 1 <= self.interval <= 50_000


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """All settings of a scan."""

    frequency: int  # 1/100 Hz
    resolution: int  # 1/10000 deg
    start: int  # of the output, as written, 1/10000 deg
    stop: int
    content: Content

    @property
    def period_s(self) -> float:
        return 100.0 / self.frequency

    @property
    def first_index(self) -> int:
        """Of the first point that is sent, counted from the begin of the field of view."""
        return round((self.start - AREA_START) / self.resolution)

    @property
    def points(self) -> int:
        """How many points are sent; the output range is rounded to the grid."""
        return round((self.stop - AREA_START) / self.resolution) - self.first_index + 1

    @property
    def first_angle(self) -> int:
        """Of the first point that is sent, 1/10000 deg."""
        return AREA_START + self.first_index * self.resolution


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One row of values in a telegram."""

    name: bytes  # DIST1, DIST2, RSSI1, RSSI2
    raw: U16  # (n,)
    first: int  # angle of raw[0], 1/10000 deg
    step: int
    wide: bool = True  # 16 bit per value, else 8
    scale: float = 1.0

    def values(self) -> list[Value]:
        head = fields("ffiHH", self.scale, 0.0, self.first, self.step, len(self.raw))
        return [("N", self.name), *head, ("W" if self.wide else "w", self.raw)]


@dataclass(frozen=True, slots=True, eq=False)
class ScanTelegram:
    """One scan as the device tells it, without type and name."""

    status: bytes  # 2 bytes
    telegrams: int  # counters
    scans: int
    scan_us: int  # the device's microseconds, modulo 2^32
    sent_us: int
    outputs: bytes  # 2 bytes
    frequency: int  # 1/100 Hz
    shots: int  # measurement frequency, 100 Hz
    channels: tuple[Channel, ...]
    encoders: tuple[tuple[int, int], ...] = ()  # position, speed
    position: int = 0
    name: bytes | None = None
    comment: bytes | None = None
    when: datetime | None = None
    version: int = 1

    def values(self) -> list[Value]:
        values = [
            *fields("HHIBB", self.version, 1, SERIAL_NUMBER, *self.status),
            *fields("HH", self.telegrams % 2**16, self.scans % 2**16),
            *fields("II", self.scan_us % 2**32, self.sent_us % 2**32),
            *fields("BBBBH", 0, 0, *self.outputs, 0),
            *fields("IIH", self.frequency, self.shots, len(self.encoders)),
        ]
        for encoder in self.encoders:
            values += fields("Ih", *encoder)
        for wide in (True, False):
            rows = [channel for channel in self.channels if channel.wide == wide]
            values.append(("H", len(rows)))
            for row in rows:
                values += row.values()
        values += _optional(fields("ffffffB", *[0.0] * 6, 0) if self.position else None)
        values += _optional(None if self.name is None else [("s", self.name)])
        values += _optional(None if self.comment is None else [("s", self.comment)])
        values += _optional(time_values(self.when) if self.when else None)
        return values + _optional(None)  # event


def _optional(block: list[Value] | None) -> list[Value]:
    return [("H", 0)] if block is None else [("H", 1), *block]


def time_values(when: datetime) -> list[Value]:
    day = (when.year, when.month, when.day)
    return fields(TIME, *day, when.hour, when.minute, when.second, when.microsecond)


def channels_of(settings: ScanSettings, echoes_mm: tuple[U16, U16]) -> tuple[Channel, ...]:
    """The rows that the settings ask for.

    Args:
        echoes_mm: first and second echo, (n,) codes each of the points that are sent.
    """
    content, where = settings.content, (settings.first_angle, settings.resolution)
    wanted = [k for k in (0, 1) if content.channels >> k & 1]
    rows = [Channel(b"DIST%d" % (k + 1), echoes_mm[k], *where) for k in wanted]
    if content.rssi:
        wide = bool(content.rssi_wide)
        for k in wanted:
            bright = _remission(echoes_mm[k], wide)
            rows.append(Channel(b"RSSI%d" % (k + 1), bright, *where, wide=wide))
    return tuple(rows)


def _remission(echo_mm: U16, wide: bool) -> U16:
    """How bright an echo (n,) comes back: less from afar, 0 for none."""
    bright = np.round(254 * np.exp(-echo_mm / 15_000.0)).astype(np.uint16)
    bright[echo_mm < FIRST_VALID] = 0
    return bright * np.uint16(257 if wide else 1)
