"""SICK LMS1xx: CoLa-B payloads to telegrams and answers, commands to bytes. No I/O, no clock.

Refuses telegrams that can't be true (no points, no frequency, lengths that disagree); decodes all
channels and options that the sheet names. Device units end in `ranges_m_from_channel`.
Source: lms111 sheet, sections 2, 3 and 5.
"""

import math
import struct
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from core.records import F64
from hw.cola import ColaParser, PayloadError, encode_frame

Echo = Literal["first", "last", "both"]
Raw = npt.NDArray[np.integer[Any]]

MAX_POINTS, MAX_CHANNELS, MAX_ENCODERS = 2000, 8, 8
LEAST_RANGE_RAW = 16  # smaller values say why there is no measurement
FIELD_FIRST, FIELD_LAST = -450_000, 2_250_000  # whole field of view, 1/10000 deg
CHANNELS = {b"DIST1", b"DIST2", b"RSSI1", b"RSSI2"}

_SCAN = b" LMDscandata "
_TYPES = {b"sRA", b"sWA", b"sAN", b"sEA", b"sSN"}
# After the name: version, device, serial number, status, counters, stamps, inputs, outputs,
# reserved, scan and measurement frequency, number of encoders.
_FIXED = struct.Struct(">HHI2BHHII2B2BHIIH")
_CHANNEL = struct.Struct(">5sffiHH")
_SCAN_CONFIG = struct.Struct(">IHIii")  # frequency, sectors, resolution, first, last
_OUTPUT_RANGE = struct.Struct(">HIii")  # sectors, resolution, first, last

REFUSALS = {
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
    0x12: "no system message",
    0x13: "no answer from the system",
    0x14: "internal error",
    0x15: "hub address corrupted",
    0x16: "hub address not decoded",
    0x17: "hub address exceeded",
    0x18: "hub address: blank expected",
    0x19: "asynchronous methods suppressed",
    0x1A: "complex arrays not supported",
}


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One block of values, as the device sent them."""

    content: str  # DIST1, DIST2, RSSI1, RSSI2
    scale: float
    offset: float
    first_deg: float  # device angle of value 0
    step_deg: float
    raw: Raw  # (n,)


@dataclass(frozen=True, slots=True, eq=False)
class ScanTelegram:
    """`LMDscandata`, in the device's own units and clock."""

    arrived_s: float  # host clock
    polled: bool  # asked for, not streamed
    version: int
    device_number: int
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


@dataclass(frozen=True, slots=True)
class Answer:
    """Any other telegram: an answer to a command of that name, or an event (sSN)."""

    kind: str  # sRA, sWA, sAN, sEA, sSN
    name: str
    values: bytes


@dataclass(frozen=True, slots=True)
class Refusal:
    """`sFA`: the device does not do what the command said; it does not say which command."""

    code: int

    @property
    def reason(self) -> str:
        """The code in words."""
        return REFUSALS.get(self.code, f"error code {self.code}")


Telegram = ScanTelegram | Answer | Refusal


def new_parser() -> ColaParser[Telegram]:
    """A parser for the stream of one connection."""
    return ColaParser(decode)


def decode(now_s: float, payload: bytes) -> Telegram:
    """What a payload says; it arrived at now_s.

    Raises:
        PayloadError: not one of the sheet's telegrams, or a scan that can't be true.
    """
    kind = payload[:3]
    if kind == b"sFA" and len(payload) == 5:
        return Refusal(int.from_bytes(payload[3:], "big"))
    if kind not in _TYPES or payload[3:4] != b" ":
        raise PayloadError("unknown telegram")
    if payload.startswith(_SCAN, 3) and kind in (b"sSN", b"sRA"):
        try:
            return _scan_telegram(now_s, payload)
        except struct.error:
            raise PayloadError("scan telegram ends early") from None
    name, _, values = payload[4:].partition(b" ")
    if not (name.isascii() and name.isalnum()):
        raise PayloadError("unknown telegram")
    return Answer(kind.decode(), name.decode(), values)


class _Reader:
    """Takes fields off a payload; struct.error where it ends early."""

    def __init__(self, payload: bytes, at: int) -> None:
        self._payload, self.at = payload, at

    def fields(self, layout: struct.Struct | str) -> tuple[Any, ...]:
        layout = layout if isinstance(layout, struct.Struct) else struct.Struct(">" + layout)
        values = layout.unpack_from(self._payload, self.at)
        self.at += layout.size
        return values

    def u16(self) -> int:
        """One word, which is mostly a count or a flag."""
        value: int = self.fields("H")[0]
        return value

    def flag(self, what: str) -> bool:
        """Whether an optional block follows."""
        value = self.u16()
        if value > 1:
            raise PayloadError(f"{what} flag is {value}")
        return value == 1

    def text(self) -> str:
        """Length and characters."""
        (size,) = self.fields("B")
        (text,) = self.fields(f"{size}s")
        return str(text, "latin-1")

    def array(self, kind: str, count: int) -> Raw:
        """Values without a copy."""
        if self.at + count * np.dtype(kind).itemsize > len(self._payload):
            raise PayloadError("scan telegram ends early")
        values = np.frombuffer(self._payload, kind, count, self.at)
        self.at += values.nbytes
        return values

    def at_end(self) -> bool:
        return self.at == len(self._payload)


def _scan_telegram(now_s: float, payload: bytes) -> ScanTelegram:
    reader = _Reader(payload, 3 + len(_SCAN))
    version, device, serial, s1, s2, telegrams, scans, scan_us, sent_us, *rest = reader.fields(
        _FIXED
    )
    i1, i2, o1, o2, _, centihertz, hectohertz, encoders = rest
    if centihertz == 0:
        raise PayloadError("scan frequency is 0")
    if encoders > MAX_ENCODERS:
        raise PayloadError(f"{encoders} encoders")
    return ScanTelegram(
        arrived_s=now_s,
        polled=payload.startswith(b"sRA"),
        version=version,
        device_number=device,
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
        encoders=tuple((p, s) for p, s in (reader.fields("Ih") for _ in range(encoders))),
        channels=_channels(reader),
        **_options(reader),
    )


def _channels(reader: _Reader) -> dict[str, Channel]:
    """All 16-bit channels, then all 8-bit ones."""
    channels = {}
    for kind in (">u2", "u1"):
        count = reader.u16()
        if count > MAX_CHANNELS:
            raise PayloadError(f"{count} channels")
        for _ in range(count):
            content, scale, offset, first, step, points = reader.fields(_CHANNEL)
            if content not in CHANNELS:
                raise PayloadError(f"unknown channel {content!r}")
            if not (1 <= points <= MAX_POINTS and step > 0):
                raise PayloadError(f"{points} points at a step of {step}")
            if not (0 < scale <= 1000 and abs(offset) <= 1e6):  # false for NaN, too
                raise PayloadError(f"scale {scale}, offset {offset}")
            name = content.decode()
            raw = reader.array(kind, points)
            channels[name] = Channel(name, scale, offset, first / 10_000, step / 10_000, raw)
    return channels


def _options(reader: _Reader) -> dict[str, Any]:
    """What may follow the channels. The layout of the last, an event, is not known."""
    options = {
        "position": reader.fields("6fB") if reader.flag("position") else None,
        "name": reader.text() if reader.flag("name") else None,
        "comment": reader.text() if reader.flag("comment") else None,
        "clock": reader.fields("H5BI") if reader.flag("time") else None,
    }
    if not reader.flag("event") and not reader.at_end():
        raise PayloadError("scan telegram goes on after its end")
    return options


def ranges_m_from_channel(channel: Channel, part: slice, out: F64) -> None:
    """Ranges of a part of a DIST channel into `out` (k,); NaN where nothing was measured."""
    raw = channel.raw[part]
    np.multiply(raw, channel.scale / 1000, out=out, dtype=np.float64)
    if channel.offset:
        out += channel.offset / 1000
    out[(raw < LEAST_RANGE_RAW) | (out <= 0)] = math.nan


def encode_login(level: int, password_hash: int) -> bytes:
    """`SetAccessMode`: answered by 1, or by 0 if refused."""
    values = struct.pack(">bI", level, password_hash)
    return encode_frame(b"sMN SetAccessMode " + values)


# Commands (section 3), as whole frames.
LOGIN = encode_login(3, 0xF4724744)  # authorised client
READ_SCAN_CONFIG = encode_frame(b"sRN LMPscancfg")
READ_OUTPUT_RANGE = encode_frame(b"sRN LMPoutputRange")
START_MEASURING = encode_frame(b"sMN LMCstartmeas")
RUN = encode_frame(b"sMN Run")
READ_STATE = encode_frame(b"sRN STlms")
READ_DEVICE_STATE = encode_frame(b"sRN SCdevicestate")
SUBSCRIBE = encode_frame(b"sEN LMDscandata \x01")
UNSUBSCRIBE = encode_frame(b"sEN LMDscandata \x00")


@dataclass(frozen=True, slots=True)
class ScanConfig:
    """`LMPscancfg`: how the device scans; its field of view is fixed."""

    centihertz: int
    step: int  # 1/10000 deg


def encode_set_scan_config(config: ScanConfig) -> bytes:
    """`mLMPsetscancfg`: answered by a status and the values that the device took."""
    values = _SCAN_CONFIG.pack(config.centihertz, 1, config.step, FIELD_FIRST, FIELD_LAST)
    return encode_frame(b"sMN mLMPsetscancfg " + values)


def maybe_scan_config(values: bytes) -> ScanConfig | None:
    """The 18 bytes of `LMPscancfg`; None if they are not that."""
    if len(values) != _SCAN_CONFIG.size:
        return None
    centihertz, _, step, _, _ = _SCAN_CONFIG.unpack(values)
    return ScanConfig(centihertz, step)


def encode_scan_data_config(echo: Echo) -> bytes:
    """`LMDscandatacfg`: one or both echoes, no remission, with the time block, every scan."""
    channels = b"\x01\x00" if echo == "first" else b"\x03\x00"
    remission, encoders, position, name, comment = b"\0\0\0", b"\0\0", b"\0", b"\0", b"\0"
    options = remission + encoders + position + name + comment + b"\x01"
    return encode_frame(b"sWN LMDscandatacfg " + channels + options + b"\x00\x01")


def encode_output_range(step: int) -> bytes:
    """`LMPoutputRange`: the whole field of view."""
    values = _OUTPUT_RANGE.pack(1, step, FIELD_FIRST, FIELD_LAST)
    return encode_frame(b"sWN LMPoutputRange " + values)


def maybe_output_range_deg(values: bytes) -> tuple[float, float] | None:
    """First and last angle of `LMPoutputRange` (its resolution is often untrue), or None."""
    if len(values) != _OUTPUT_RANGE.size:
        return None
    _, _, first, last = _OUTPUT_RANGE.unpack(values)
    return first / 10_000, last / 10_000


def maybe_state(values: bytes) -> int | None:
    """The status code at the front of `STlms`: 7 is ready; a word, or one digit of text."""
    if values[:1].isdigit() and values[1:2] in (b"", b" "):
        return int(values[:1])
    return int.from_bytes(values[:2], "big") if len(values) >= 2 else None
