"""Commands to a SICK LMS1xx, each in both dialects, and readers of their answers. No I/O, no clock.

What is called good differs: 0 after start, stop and standby; 1 after all others (`is_good`).
Source: lms111 sheet, sections 2 to 4.
"""

import struct
from dataclasses import dataclass
from datetime import datetime
from typing import TypeGuard

from hw.lms1xx.cola import Dialect, PayloadError, encode_frame, encode_text
from hw.lms1xx.telegrams import FIELD_FIRST, FIELD_LAST, Answer, Echo

ANSWERS = {"sRN": "sRA", "sWN": "sWA", "sMN": "sAN", "sEN": "sEA"}
GOOD_IS_ZERO = {"LMCstartmeas", "LMCstopmeas", "LMCstandby"}

LOGIN_LEVEL, PASSWORD_HASH = 3, 0xF4724744  # of the user level that may set, as delivered
_SCAN_CONFIG = "IHIii"  # frequency 1/100 Hz, sectors, resolution, first, last (1/10000 deg)
_OUTPUT_RANGE = "HIii"  # sectors, resolution, first, last
# Channels, remission (on, 16 bit, unit), encoders, position, name, comment, time, interval.
_CONTENT = "2B3B2B4BH"
_DATE_TIME = "H5BI"


@dataclass(frozen=True, slots=True)
class Command:
    """One request: packed values for CoLa-B, the same written out for CoLa-A."""

    kind: str  # sRN, sWN, sMN, sEN
    name: str
    values: bytes = b""
    text: str = ""

    def is_answered_by(self, event: object) -> TypeGuard[Answer]:
        if not isinstance(event, Answer):
            return False
        return (event.kind, event.name) == (ANSWERS[self.kind], self.name)

    def encode(self, dialect: Dialect) -> bytes:
        head = f"{self.kind} {self.name}"
        if dialect == "ascii":
            return encode_text(f"{head} {self.text}".rstrip().encode())
        return encode_frame(head.encode() + (b" " + self.values if self.values else b""))


def read(name: str) -> Command:
    return Command("sRN", name)


def _command(kind: str, name: str, layout: str, form: str, *values: int) -> Command:
    """Values by their struct layout and as a text, where no sign means hexadecimal."""
    return Command(kind, name, struct.pack(">" + layout, *values), form.format(*values))


def subscribe(is_wanted: bool = True) -> Command:
    """Scans as they are measured, or no more."""
    return _command("sEN", "LMDscandata", "B", "{}", int(is_wanted))


# It ends measuring until Run.
LOGIN = _command("sMN", "SetAccessMode", "bI", "{:02} {:08X}", LOGIN_LEVEL, PASSWORD_HASH)
READ_SCAN_CONFIG = read("LMPscancfg")
READ_OUTPUT_RANGE = read("LMPoutputRange")
READ_CONTENT = read("LMDscandatacfg")
READ_STATE = read("STlms")
READ_DEVICE_STATE = read("SCdevicestate")
READ_CONTAMINATION = read("LCMstate")
READ_FIRMWARE = read("FirmwareVersion")
READ_IDENT = read("DeviceIdent")
READ_HOURS = read("ODoprh")
READ_POWER_ONS = read("ODpwrc")
READ_LOCATION = read("LocationName")
READ_DIALECT = read("EIHstCola")
START_MEASURING = Command("sMN", "LMCstartmeas")
STOP_MEASURING = Command("sMN", "LMCstopmeas")
RUN = Command("sMN", "Run")  # logs out; settings take effect
REBOOT = Command("sMN", "mSCreboot")
STORE = Command("sMN", "mEEwriteall")  # wears the memory out: for a person to ask for, only


def set_dialect(dialect: Dialect) -> Command:
    """`EIHstCola`: answered in the old dialect; the new one counts from the next connection on."""
    return _command("sWN", "EIHstCola", "B", "{}", int(dialect == "binary"))


@dataclass(frozen=True, slots=True)
class ScanConfig:
    """`LMPscancfg`: how the device scans; its field of view is fixed."""

    centihertz: int
    step: int  # 1/10000 deg


def set_scan_config(config: ScanConfig) -> Command:
    """`mLMPsetscancfg`: answered by a status and the values that the device took."""
    values = (config.centihertz, 1, config.step, FIELD_FIRST, FIELD_LAST)
    return _command("sMN", "mLMPsetscancfg", _SCAN_CONFIG, " ".join(["{:+d}"] * 5), *values)


def set_content(echo: Echo) -> Command:
    """`LMDscandatacfg`: one or both echoes, no remission, with the time block, every scan."""
    form = "{:02} {:02} {} {} {} {:02} {:02} {} {} {} {} {:+d}"
    return _command("sWN", "LMDscandatacfg", _CONTENT, form, *content(echo))


def content(echo: Echo) -> tuple[int, ...]:
    """The twelve values of `LMDscandatacfg` that are wanted."""
    return (1 if echo == "first" else 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1)


def set_output_range(step: int) -> Command:
    """`LMPoutputRange`: the whole field of view; step in 1/10000 deg."""
    values = struct.pack(">" + _OUTPUT_RANGE, 1, step, FIELD_FIRST, FIELD_LAST)
    text = f"1 {step:X} {FIELD_FIRST & 0xFFFFFFFF:X} {FIELD_LAST:X}"
    return Command("sWN", "LMPoutputRange", values, text)


def set_clock(time: datetime) -> Command:
    """`LSPsetdatetime`: needs a login."""
    day = (time.year, time.month, time.day)
    values = (*day, time.hour, time.minute, time.second, time.microsecond)
    return _command("sMN", "LSPsetdatetime", _DATE_TIME, " ".join(["{:+d}"] * 7), *values)


# --- answers


def maybe_number(answer: Answer, layout: str = "B") -> int | None:
    """The first value; None if there is none."""
    try:
        value: int = answer.fields().fields(layout)[0]
    except PayloadError:
        return None
    return value


def is_good(answer: Answer) -> bool:
    """Whether a method's result says that it was done; a write's answer has no result."""
    if answer.kind == "sWA" or answer.name == "mSCreboot":
        return True
    return maybe_number(answer) == (0 if answer.name in GOOD_IS_ZERO else 1)


def _maybe_values(answer: Answer, layout: str) -> tuple[int, ...] | None:
    """All values by a layout, and nothing after them; None if they are not that."""
    fields = answer.fields()
    try:
        values = fields.fields(layout)
    except PayloadError:
        return None
    return None if fields.rest() else values


def maybe_scan_config(answer: Answer) -> ScanConfig | None:
    values = _maybe_values(answer, _SCAN_CONFIG)
    return ScanConfig(values[0], values[2]) if values else None


def maybe_content(answer: Answer) -> tuple[int, ...] | None:
    return _maybe_values(answer, _CONTENT)


def maybe_output_range_deg(answer: Answer) -> tuple[float, float] | None:
    """First and last angle of `LMPoutputRange` (its resolution is often untrue), or None."""
    values = _maybe_values(answer, _OUTPUT_RANGE)
    return (values[2] / 10_000, values[3] / 10_000) if values else None


def maybe_state(answer: Answer) -> tuple[int, bool | None] | None:
    """`STlms`: its code (7: measuring), and whether the temperature is within range.

    Some firmware writes one digit of text even where all else is packed.
    """
    values = answer.values
    if values[:1].isdigit() and values[1:2] in (b"", b" "):
        return int(values[:1]), {b"0": True, b"1": False}.get(values[2:3])
    fields = answer.fields()
    try:
        (code,) = fields.fields("H")
    except PayloadError:
        return None
    try:
        return code, fields.fields("B")[0] == 0
    except PayloadError:
        return code, None


def maybe_texts(answer: Answer, count: int = 1) -> tuple[str, ...] | None:
    """Texts with their lengths: `FirmwareVersion`, `LocationName`; `DeviceIdent` has two."""
    fields = answer.fields()
    try:
        return tuple(fields.text("H").strip() for _ in range(count))
    except PayloadError:
        return None


def maybe_hours(answer: Answer) -> float | None:
    """`ODoprh`: hours of operation."""
    value = maybe_number(answer, "I")
    return None if value is None else value / 10
