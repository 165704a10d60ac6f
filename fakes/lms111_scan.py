"""What an LMS111 is set to, and its scan telegram in CoLa-B.

Source: lms111 sheet, sections 1, 3 and 5.
"""

import struct
from dataclasses import dataclass
from datetime import datetime

import numpy as np
import numpy.typing as npt

U16 = npt.NDArray[np.uint16]
AREA_START, AREA_STOP = -450_000, 2_250_000  # field of view, 1/10000 deg
MODES = ((5000, 5000), (2500, 2500), (2500, 5000))  # 1/100 Hz, 1/10000 deg
REPORTED_RESOLUTION = 5000  # in LMPoutputRange, at whatever resolution it scans
NO_ECHO, FIRST_VALID = 0, 16
SERIAL_NUMBER = 18_090_362
CONTENT = struct.Struct(">BBBBBBBBBBBH")  # arguments of LMDscandatacfg
CHANNEL_HEAD = struct.Struct(">5sffiHH")
TIME = struct.Struct(">HBBBBBI")


@dataclass(frozen=True, slots=True)
class Content:
    """What a scan telegram carries: the arguments of LMDscandatacfg."""

    channels: int = 1  # bit 0: first echo, bit 1: second
    rssi: bool = False
    rssi_wide: bool = False  # 16 bit instead of 8
    encoder: bool = False
    position: bool = False
    name: bool = False
    comment: bool = False
    time: bool = False
    interval: int = 1  # every n-th scan is sent

    @classmethod
    def maybe_from_bytes(cls, arguments: bytes) -> "Content | None":
        """From the 13 bytes of the wire; None if a value is out of range."""
        low, high, rssi, wide, unit, encoder, encoder_high, *flags = CONTENT.unpack(arguments)
        position, name, comment, time, interval = flags
        switches = (rssi, wide, encoder, position, name, comment, time)
        if low not in (1, 2, 3) or high or unit or encoder_high or max(switches) > 1:
            return None
        if not 1 <= interval <= 50_000:
            return None
        rssi, wide, encoder, position, name, comment, time = map(bool, switches)
        return cls(low, rssi, wide, encoder, position, name, comment, time, interval)

    def to_bytes(self) -> bytes:
        """The 13 bytes of the wire."""
        return CONTENT.pack(
            self.channels, 0, self.rssi, self.rssi_wide, 0, self.encoder, 0,
            self.position, self.name, self.comment, self.time, self.interval,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """All settings of a scan; those of the factory if nothing else is said."""

    frequency: int = 5000  # 1/100 Hz
    resolution: int = 5000  # 1/10000 deg
    start: int = AREA_START  # of the output, as written
    stop: int = AREA_STOP
    content: Content = Content()

    @property
    def period_s(self) -> float:
        """One turn of the mirror."""
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

    def scan_config(self) -> bytes:
        """The 18 bytes of LMPscancfg: the area is always that of the mirror."""
        return struct.pack(">IhIii", self.frequency, 1, self.resolution, AREA_START, AREA_STOP)

    def output_range(self) -> bytes:
        """The 14 bytes of LMPoutputRange."""
        return struct.pack(">HIii", 1, REPORTED_RESOLUTION, self.start, self.stop)


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One row of values in a telegram."""

    name: bytes  # DIST1, DIST2, RSSI1, RSSI2
    raw: U16  # (n,)
    first: int  # angle of raw[0], 1/10000 deg
    step: int
    wide: bool = True  # 16 bit per value, else 8
    scale: float = 1.0

    def encode(self) -> bytes:
        """As on the wire."""
        head = CHANNEL_HEAD.pack(self.name, self.scale, 0.0, self.first, self.step, len(self.raw))
        return head + self.raw.astype(">u2" if self.wide else "u1").tobytes()


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
    position: bool = False
    name: bytes | None = None
    comment: bytes | None = None
    when: datetime | None = None

    def encode(self) -> bytes:
        """As on the wire, from the version to the event flag."""
        parts = [
            struct.pack(">HHI", 1, 1, SERIAL_NUMBER),
            self.status,
            struct.pack(">HHII", self.telegrams % 2**16, self.scans % 2**16,
                        self.scan_us % 2**32, self.sent_us % 2**32),
            bytes(2),  # inputs
            self.outputs,
            struct.pack(">HIIH", 0, self.frequency, self.shots, len(self.encoders)),
            *(struct.pack(">Ih", *encoder) for encoder in self.encoders),
        ]  # fmt: skip
        for wide in (True, False):
            rows = [channel.encode() for channel in self.channels if channel.wide == wide]
            parts += [len(rows).to_bytes(2, "big"), *rows]
        parts += [
            _optional(struct.pack(">6fB", *[0.0] * 6, 0) if self.position else None),
            _optional(_short_text(self.name)),
            _optional(_short_text(self.comment)),
            _optional(time_block(self.when) if self.when else None),
            _optional(None),  # event
        ]
        return b"".join(parts)


def _optional(block: bytes | None) -> bytes:
    return b"\0\0" if block is None else b"\0\1" + block


def _short_text(content: bytes | None) -> bytes | None:
    return None if content is None else bytes([len(content)]) + content


def time_block(when: datetime) -> bytes:
    """Date and time in 11 bytes."""
    return TIME.pack(
        when.year, when.month, when.day, when.hour, when.minute, when.second, when.microsecond
    )


def channels_of(settings: ScanSettings, first_echo_mm: U16) -> tuple[Channel, ...]:
    """The rows that the settings ask for; of the world's one surface there is no second echo.

    Args:
        first_echo_mm: (n,) codes of the points that are sent.
    """
    content, rows = settings.content, []
    echoes = [first_echo_mm, np.full_like(first_echo_mm, NO_ECHO)]
    where = (settings.first_angle, settings.resolution)
    wanted = [k for k in (0, 1) if content.channels >> k & 1]
    rows += [Channel(b"DIST%d" % (k + 1), echoes[k], *where) for k in wanted]
    if content.rssi:
        wide = content.rssi_wide
        rows += [
            Channel(b"RSSI%d" % (k + 1), _remission(echoes[k], wide), *where, wide=wide)
            for k in wanted
        ]
    return tuple(rows)


def _remission(echo_mm: U16, wide: bool) -> U16:
    """How bright an echo (n,) comes back: less from afar, 0 for none."""
    bright = np.round(254 * np.exp(-echo_mm / 15_000.0)).astype(np.uint16)
    bright[echo_mm < FIRST_VALID] = 0
    return bright * np.uint16(257 if wide else 1)
