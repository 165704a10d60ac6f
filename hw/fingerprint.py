"""Which protocol bytes seem to be: for naming the wrong device on a port. No I/O, no clock.

It looks for what chance hardly makes: headers of several bytes, right checksums, fixed words.
It refuses to guess: bytes that prove nothing give None.
Source: the sheets of the devices (CoLa: lms111 2; MT: mti 2; Roboteq: ax3500 1 and 8; SCIP: urg04lx
2 and 3), docs/protocols/planner-link.md 2, NMEA 0183, RFC 9110 and RFC 4253.
"""

import re
import zlib
from collections.abc import Callable
from itertools import accumulate, pairwise

from cobs import cobs

KEPT = 4096  # bytes heard, since the connection opened
SENT_KEPT = 512
LOOK_S = 0.1  # between two looks
ECHO_LEAST = 8  # bytes
NOISE_LEAST = 320  # bytes without a frame: more than a usual MT message
NOISE_SHARE = 0.25  # of bytes that no text has
SEEMS = "what answers there seems to be "

NAMES = {
    "cola-b": "a SICK scanner that speaks CoLa-B",
    "cola-a": "a SICK scanner that speaks CoLa-A",
    "mt": "an Xsens MTi",
    "roboteq": "a Roboteq motor controller",
    "scip": "a Hokuyo scanner that speaks SCIP",
    "nmea": "a GNSS receiver or compass that speaks NMEA",
    "planner-link": "an end of the planner link",
    "http": "a web server",
    "ssh": "an SSH server",
    "console": "a computer's login console",
    "echo": "an echo of what mapod sends, as from a loop-back plug",
    "noise": "bytes that fit no protocol, as at a wrong baud rate",
}
OWN = {
    "lms111": {"cola-a", "cola-b"},
    "urg04lx": {"scip"},
    "stripe": {"http"},
    "visionary": {"cola-b"},
    "kinect": set(NAMES),  # of a port of this machine nobody else can be at the other end
    "folder": set(NAMES),
    "mti": {"mt"},
    "ax3500": {"roboteq", "echo"},
}
ON_SERIAL_LINES = {"mti", "ax3500", "urg04lx"}  # where a wrong baud rate is possible

COLA_TYPES = rb"s(?:RA|WA|AN|EA|SN|FA|RN|WN|MN|EN|RI)"
COLA_B = re.compile(rb"\x02{4}\x00[\x00-\x03].." + COLA_TYPES, re.DOTALL)
COLA_A = re.compile(rb"(?<!\x02)\x02" + COLA_TYPES + rb"(?: [\x20-\x7e]{2}|[ 0]*\x03)")
ROBOTEQ = re.compile(
    rb"Roboteq v\d|:[0-9A-F]{24,32}\r|\?[A-Za-z]\r(?:[0-9A-F]{2}\r){2}|\^[0-9A-F]{2}\r[0-9A-F]{2}\r"
)
SCIP = re.compile(rb"SCIP[12]\.\d\n|\n(?:00P|99b|0Ee|0Dd|0Cc|10Q|02R)\n")
NMEA = re.compile(rb"\$([A-Z]{2}[A-Z]{3},[\x20-\x29\x2b-\x7e]{0,90})\*([0-9A-Fa-f]{2})")
HTTP = re.compile(rb"HTTP/\d(?:\.\d)? \d{3} |(?:GET|POST|HEAD) /\S* HTTP/\d")
SSH = re.compile(rb"SSH-[12]\.\d+-")
CONSOLE = re.compile(rb"(?:^|[\r\n])[\w.-]{1,40} login: |(?:^|\n)Password: $")
MT_START, MT_EXTENDED, MT_LONGEST = b"\xfa\xff", 0xFF, 2048
PLANNER_CRC_START, PLANNER_SHORTEST, PLANNER_LONGEST = 0x2994717F, 12, 368


def maybe_protocol(data: bytes) -> str | None:
    for key, seems in TESTS.items():
        if seems(data):
            return key
    return None


def is_echo(heard: bytes, sent: bytes) -> bool:
    """True if all that was heard is what was sent before, and enough of it to be no chance."""
    return len(heard) >= ECHO_LEAST and heard[-SENT_KEPT // 2 :] in sent


def is_noise(data: bytes) -> bool:
    """True for bytes that are no text and, long as they are, no protocol that is known here."""
    if len(data) < NOISE_LEAST or maybe_protocol(data) is not None:
        return False
    text = sum(0x20 <= byte < 0x7F or byte in b"\r\n\t" for byte in data)
    return text < (1 - NOISE_SHARE) * len(data)


def _is_mt(data: bytes) -> bool:
    sums = [0, *accumulate(data)]  # of all bytes before each: many starts cost no more than one
    at = data.find(MT_START)
    while 0 <= at <= len(data) - 5:
        size, head = data[at + 3], 4
        if size == MT_EXTENDED:
            size, head = int.from_bytes(data[at + 4 : at + 6], "big"), 6
        end = at + head + size + 1
        if size <= MT_LONGEST and end <= len(data) and (sums[end] - sums[at + 1]) % 256 == 0:
            return True
        at = data.find(MT_START, at + 1)
    return False


def _is_nmea(data: bytes) -> bool:
    for found in NMEA.finditer(data):
        checksum = 0
        for byte in found[1]:
            checksum ^= byte
        if checksum == int(found[2], 16):
            return True
    return False


def _is_planner_link(data: bytes) -> bool:
    if _is_planner_frame(data):
        return True
    ends = [-1, *(i for i, byte in enumerate(data) if byte == 0)]
    for last, end in pairwise(ends):
        if PLANNER_SHORTEST < end - last <= PLANNER_LONGEST + 4:
            try:
                frame: bytes = cobs.decode(data[last + 1 : end])  # type: ignore[no-untyped-call]
            except cobs.DecodeError:
                continue
            if _is_planner_frame(frame):
                return True
    return False


def _is_planner_frame(frame: bytes) -> bool:
    if not PLANNER_SHORTEST <= len(frame) <= PLANNER_LONGEST or frame[0] >> 4 != 1:
        return False
    return zlib.crc32(frame[:-4], PLANNER_CRC_START) == int.from_bytes(frame[-4:], "little")


def _found(pattern: re.Pattern[bytes]) -> Callable[[bytes], bool]:
    return lambda data: pattern.search(data) is not None


TESTS: dict[str, Callable[[bytes], bool]] = {  # the least likely by chance first
    "ssh": _found(SSH),
    "http": _found(HTTP),
    "cola-b": _found(COLA_B),
    "planner-link": _is_planner_link,
    "nmea": _is_nmea,
    "cola-a": _found(COLA_A),
    "console": _found(CONSOLE),
    "scip": _found(SCIP),
    "roboteq": _found(ROBOTEQ),
    "mt": _is_mt,
}


class Fingerprint:
    """Watches a connection on which a device should answer, for what else may be there."""

    def __init__(self, device: str) -> None:
        self._own = OWN.get(device, set[str]())
        self._may_be_noise = device in ON_SERIAL_LINES
        self._heard, self._sent = bytearray(), bytearray()
        self._looked_s = float("-inf")
        self._message = ""

    def forget(self) -> None:
        """A new connection, or the device itself has answered."""
        if self._heard or self._sent:
            self._heard, self._sent = bytearray(), bytearray()
        self._message = ""

    def message(self, now_s: float, pieces: list[bytes], sent: bytes) -> str:
        """Take in what was heard and sent; "" or who it seems to be, as the end of a sentence."""
        for piece in pieces:
            self._heard += piece[-KEPT:]
        del self._heard[:-KEPT]
        if any(pieces) and now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            self._look()
        if sent:  # after looking: an echo can't come before what it repeats
            self._sent += sent
            del self._sent[:-SENT_KEPT]
        return self._message

    def _look(self) -> None:
        heard = bytes(self._heard)
        key = "echo" if is_echo(heard, bytes(self._sent)) else maybe_protocol(heard)
        if key is None and self._may_be_noise and is_noise(heard):
            key = "noise"
        if key in self._own:
            self._message = ""
        elif key is not None:
            self._message = SEEMS + NAMES[key]
