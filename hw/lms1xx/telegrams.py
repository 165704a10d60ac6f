"""SICK LMS1xx: CoLa payloads to scan telegrams, answers and refusals. No I/O, no clock.

It refuses telegrams that can't be true (no points, no frequency, lengths that disagree) or that
have more beams than the family has: who takes scans has room for so many and no more. All channels
and options that the sheet names are read, those of sister models too, in both dialects. Device
units end in `ranges_m_from_channel`. Source: lms111 sheet, sections 2 and 5.
"""

import math
import re
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, Literal

import numpy as np
from msgspec import Struct

from core.records import F64
from hw.lms1xx.cola import ColaParser, Dialect, DialectSetting, PayloadError
from hw.lms1xx.cola_fields import READERS, Fields, Raw, TextFields

Echo = Literal["first", "last", "both"]

MAX_BEAMS = 1081  # of any LMS1xx: 270 deg in steps of 0.25 deg, both ends included (section 1)
MAX_CHANNELS, MAX_ENCODERS = 16, 8
LEAST_RANGE_RAW = 16  # smaller values say why there is no measurement
FIELD_FIRST, FIELD_LAST = -450_000, 2_250_000  # whole field of view, 1/10000 deg
CONTENT = re.compile(r"[A-Z]{4}[1-9]")  # DIST1, RSSI2; sister models have more, and of others

_TYPES = {b"sRA", b"sWA", b"sAN", b"sEA", b"sSN"}
POLLED, STREAMED = b"sRA LMDscandata ", b"sSN LMDscandata "
SCANS = (STREAMED, POLLED)
DISTANCES, STRENGTHS = np.dtype(">u2"), np.dtype("u1")
# After the name: version, device, serial number, status, counters, stamps, inputs, outputs,
# layer, scan and measurement frequency, number of encoders.
_FIXED = "HHI2BHHII2B2BHIIH"
_CHANNEL = "5sffiHH"  # content, scale, offset, first angle, step, points
# What may follow the channels, each behind a flag. The layout of an event is not known.
_OPTIONS: dict[str, Callable[[Fields], Any]] = {
    "position": lambda fields: fields.fields("6fB"),
    "name": lambda fields: fields.text("B"),
    "comment": lambda fields: fields.text("B"),
    "time": lambda fields: fields.fields("H5BI"),
    "event": lambda fields: fields.rest(),
}

REFUSALS = {  # those that a host may meet; the sheet has them all
    0x01: "access denied",
    0x02: "unknown method",
    0x03: "unknown variable",
    0x04: "value out of range",
    0x05: "invalid data",
    0x06: "unknown error",
    0x07: "buffer overflow",
    0x08: "arguments too short",
    0x09: "unknown type",
    0x0A: "write access denied",
    0x0B: "unknown command for the name server",
    0x0C: "unknown command",
    0x0D: "server busy",
    0x0E: "array out of bounds",
    0x0F: "unknown event",
    0x10: "text: value overflow",
    0x11: "text: invalid character",
}


class Channel(Struct, frozen=True, eq=False):
    """One block of values, as the device sent them."""

    content: str  # DIST1, DIST2, RSSI1, RSSI2, ...
    scale: float
    offset: float
    layout: tuple[float, float, int]  # device angle of value 0, step, in degrees; number of values
    raw: Raw  # (n,)

    @property
    def first_deg(self) -> float:
        return self.layout[0]

    @property
    def step_deg(self) -> float:
        return self.layout[1]


class ScanTelegram(Struct, frozen=True, eq=False):
    """`LMDscandata`, in the device's own units and clock."""

    arrived_s: float  # host clock
    polled: bool  # asked for, not streamed
    version: int
    serial_number: int
    status: tuple[int, int]  # (0, 0): measurements are valid
    telegram_counter: int
    scan_counter: int
    scan_us: int  # at the scan's zero index; since the device's start, wraps at 2^32
    sent_us: int  # when transmission began
    inputs: tuple[int, int]
    outputs: tuple[int, int]
    scan_hz: float
    measurement_hz: float
    encoders: tuple[tuple[int, int], ...]  # position, speed
    channels: dict[str, Channel]  # by content
    position: tuple[float, ...] | None  # x, y, z, rotation about them, type of rotation
    name: str | None
    comment: str | None
    clock: tuple[int, ...] | None  # year, month, day, hour, minute, second, microsecond
    event: bytes | None  # its layout is not known
    dialect: Dialect = "binary"


class Answer(Struct, frozen=True):
    """Any other telegram: an answer to a command of that name, or an event (sSN)."""

    kind: str  # sRA, sWA, sAN, sEA, sSN
    name: str
    values: bytes  # packed, or written out
    dialect: Dialect = "binary"

    def fields(self) -> Fields:
        return READERS[self.dialect](self.values)


class Refusal(Struct, frozen=True):
    """`sFA`: the device does not do what the command said; it does not say which command."""

    code: int
    dialect: Dialect = "binary"

    @property
    def reason(self) -> str:
        return REFUSALS.get(self.code, f"error code {self.code}")


Telegram = ScanTelegram | Answer | Refusal


def new_parser(
    dialect: DialectSetting = "binary", max_beams: int = MAX_BEAMS
) -> ColaParser[Telegram]:
    """A parser for the stream of one connection; max_beams: more for a sister model."""
    return ColaParser(partial(decode, max_beams=max_beams), dialect)


def decode(now_s: float, payload: bytes, dialect: Dialect, max_beams: int) -> Telegram:
    """What a payload says; PayloadError: no telegram of the sheet's, or a scan that can't be."""
    if payload.startswith(SCANS):
        return _scan_telegram(now_s, payload, dialect, max_beams)
    kind = payload[:3]
    if kind == b"sFA":
        return _refusal(payload, dialect)
    if kind not in _TYPES or payload[3:4] != b" ":
        raise PayloadError("unknown telegram")
    name, _, values = payload[4:].partition(b" ")
    if not (name.isascii() and name.isalnum()):
        raise PayloadError("unknown telegram")
    return Answer(kind.decode(), name.decode(), values, dialect)


def _refusal(payload: bytes, dialect: Dialect) -> Refusal:
    """Binary: two bytes right after the type; text: after a space."""
    if dialect == "ascii" and payload[3:4] == b" ":
        return Refusal(TextFields(payload[3:]).fields("H")[0], dialect)
    if dialect == "binary" and len(payload) == 5:
        return Refusal(int.from_bytes(payload[3:], "big"), dialect)
    raise PayloadError("unknown telegram")


def _scan_telegram(now_s: float, payload: bytes, dialect: Dialect, max_beams: int) -> ScanTelegram:
    fields = READERS[dialect](payload, len(STREAMED))
    (
        version, _, serial, s1, s2, telegrams, scans, scan_us, sent_us,
        i1, i2, o1, o2, _, centihertz, hectohertz, encoders,
    ) = fields.fields(_FIXED)  # fmt: skip
    if centihertz == 0:
        raise PayloadError("scan frequency is 0")
    if encoders > MAX_ENCODERS:
        raise PayloadError(f"{encoders} encoders")
    speeds = tuple([fields.fields("Ih") for _ in range(encoders)]) if encoders else ()
    channels = _channels(fields, max_beams)
    position, name, comment, clock, event = _options(fields)
    return ScanTelegram(
        arrived_s=now_s,
        polled=payload.startswith(POLLED),
        version=version,
        serial_number=serial,
        status=(s1, s2),
        telegram_counter=telegrams,
        scan_counter=scans,
        scan_us=scan_us,
        sent_us=sent_us,
        inputs=(i1, i2),
        outputs=(o1, o2),
        scan_hz=centihertz / 100,
        measurement_hz=hectohertz * 100.0,
        encoders=speeds,
        channels=channels,
        position=position,
        name=name,
        comment=comment,
        clock=clock,
        event=event,
        dialect=dialect,
    )


def _channels(fields: Fields, max_beams: int) -> dict[str, Channel]:
    channels = {}
    for kind in (DISTANCES, STRENGTHS):
        (count,) = fields.fields("H")
        if count > MAX_CHANNELS:
            raise PayloadError(f"{count} channels")
        for _ in range(count):
            content, scale, offset, first, step, points = fields.fields(_CHANNEL)
            name = _name(content)
            if points > max_beams:
                raise PayloadError(f"{points} points a scan, more than {max_beams}")
            if not (points >= 1 and step > 0):
                raise PayloadError(f"{points} points at a step of {step}")
            if not (0 < scale <= 1000 and abs(offset) <= 1e6):  # false for NaN, too
                raise PayloadError(f"scale {scale}, offset {offset}")
            raw = fields.array(kind, points)
            layout = first / 10_000, step / 10_000, points
            channels[name] = Channel(name, scale, offset, layout, raw)
    return channels


@lru_cache(64)
def _name(content: bytes) -> str:
    """Of a channel with that content."""
    name = str(content, "latin-1")
    if not CONTENT.fullmatch(name):
        raise PayloadError(f"unknown channel {content!r}")
    return name


def _options(fields: Fields) -> list[Any]:
    """What follows the channels; None for what does not."""
    told = []
    for what, read in _OPTIONS.items():
        (flag,) = fields.fields("H")
        if flag > 1:
            raise PayloadError(f"{what} flag is {flag}")
        told.append(read(fields) if flag else None)
    if fields.rest():
        raise PayloadError("scan telegram goes on after its end")
    return told


def ranges_m_from_channel(channel: Channel, part: slice | tuple[None, slice]) -> F64:
    """Ranges (k,) or (1, k) of a part of a DIST channel; NaN where nothing was measured."""
    m_per_raw = channel.scale / 1000
    ranges_m = channel.raw[part].astype(np.float64)
    ranges_m *= m_per_raw
    ranges_m[ranges_m < LEAST_RANGE_RAW * m_per_raw] = math.nan
    if channel.offset:
        ranges_m += channel.offset / 1000
        ranges_m[ranges_m <= 0] = math.nan
    return ranges_m
