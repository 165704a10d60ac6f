"""A scanner that does as a test tells it: what it answers to each command, what its scans carry."""

import struct

from core.records import Scan
from fakes.wires.wire import MemoryPort
from hw.lms1xx.session import Lms111
from tests import VECTORS
from tests.support.lms111_vectors import framed, texted

TICK_S = 0.005
SFA = b"sFA"
CONFIGURING, MEASURING = 2, 7
SETTINGS = {  # name, of the variable -> values as delivered, and the layout of their tokens
    "LMPscancfg": ((2500, 1, 5000, -450000, 2250000), "IHIii"),
    "LMDscandatacfg": ((1, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 1), "2B3B2B4BH"),
    "LMPoutputRange": ((1, 5000, 0, 1800000), "HIii"),
}
WANTED = {
    "LMPscancfg": (5000, 1, 5000, -450000, 2250000),
    "LMDscandatacfg": (1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1),
    "LMPoutputRange": (1, 5000, -449997, 2249997),
}
SETS = {
    "sMN mLMPsetscancfg": "LMPscancfg",
    "sWN LMDscandatacfg": "LMDscandatacfg",
    "sWN LMPoutputRange": "LMPoutputRange",
}
# What it answers, packed and written out; the settings and STlms it makes up itself.
PLAIN: dict[str, tuple[bytes, str]] = {
    "sMN SetAccessMode": (b"sAN SetAccessMode \x01", "sAN SetAccessMode 1"),
    "sMN LMCstartmeas": (b"sAN LMCstartmeas \x00", "sAN LMCstartmeas 0"),
    "sMN Run": (b"sAN Run \x01", "sAN Run 1"),
    "sRN SCdevicestate": (b"sRA SCdevicestate \x01", "sRA SCdevicestate 1"),
    "sRN FirmwareVersion": (
        b"sRA FirmwareVersion \x00\x09V1.80.2  ",
        "sRA FirmwareVersion 9 V1.80.2  ",
    ),
    "sRN LCMstate": (b"sRA LCMstate \x00", "sRA LCMstate 0"),
    "sEN LMDscandata": (b"sEA LMDscandata \x01", "sEA LMDscandata 1"),
    "sWN LMDscandatacfg": (b"sWA LMDscandatacfg ", "sWA LMDscandatacfg"),
    "sWN LMPoutputRange": (b"sWA LMPoutputRange ", "sWA LMPoutputRange"),
}


def written(values: tuple[int, ...], layout: str) -> str:
    """Values as tokens, as devices write them."""
    return " ".join(f"{value & 0xFFFFFFFF:X}" for value in values)


def recorded_scan() -> bytes:
    """The payload of a recorded scan whose measurements are valid."""
    stream = (VECTORS / "lms111_session_d2h.bin").read_bytes()
    at = stream.rindex(b"sSN LMDscandata ")
    return stream[at : at + 0x49E]


def scan_text(payload: bytes) -> bytes:
    """A scan with one 16-bit channel and the time block, written out."""
    head = struct.unpack_from(">HHI2BHHII2B2BHIIH", payload, 16)
    content, scale, offset, first, step, count = struct.unpack_from(">5sIIiHH", payload, 56)
    raw = struct.unpack_from(f">{count}H", payload, 77)
    clock = struct.unpack_from(">H5BI", payload, 77 + 2 * count + 10)
    tokens = [f"{value:X}" for value in head] + ["1", content.decode()]
    tokens += [f"{scale:08X}", f"{offset:08X}"]
    tokens += [f"{value & 0xFFFFFFFF:X}" for value in (first, step, count, *raw)]
    tokens += ["0", "0", "0", "0", "1", *(f"{value:X}" for value in clock), "0"]
    return b"sSN LMDscandata " + " ".join(tokens).encode()


def with_beams(payload: bytes, count: int) -> bytes:
    """A scan with one 16-bit channel, with so many beams of 5 m in steps of 0.25 deg."""
    (old,) = struct.unpack_from(">H", payload, 75)
    head, tail = payload[:73], payload[77 + 2 * old :]
    return head + struct.pack(f">HH{count}H", 2500, count, *[5000] * count) + tail


class ScriptedLms111:
    """Answers at once; `answers` is what instead (None: nothing); scans come while subscribed."""

    def __init__(self) -> None:
        self.answers: dict[str, bytes | None] = {}  # overrides: whole payloads
        self.late_s: dict[str, float] = {}  # of the answer to a command
        self.asked: list[str] = []
        self.frames: dict[str, bytes] = {}  # the newest of each command, its payload
        self.is_text = False
        self.deaf_until_s = 0.0
        self.settings = {name: values for name, (values, _) in SETTINGS.items()}
        self.state, self.temperature_flag = MEASURING, 0
        self.streams = False
        self.status = (0, 0)
        self.step_by = 1  # of the scan counter, per scan
        self.period_s = 0.02
        self.late_stamp_us = 3100
        self.scan_number = self.telegrams = 0
        self._scan = recorded_scan()
        self._inbox = bytearray()
        self._late: list[tuple[float, bytes]] = []
        self._due_s = 0.0

    def exchange(self, now_s: float, received: bytes) -> bytes:
        if now_s < self.deaf_until_s:
            return b""
        self._inbox += received
        sent = bytearray()
        while (payload := self._maybe_command()) is not None:
            self._answer(now_s, payload)
        for due_s, answer in [late for late in self._late if late[0] <= now_s]:
            self._late.remove((due_s, answer))
            sent += answer
        while self.streams and self._due_s <= now_s:
            sent += self.frame(self.scan_payload(self._due_s))
            self._due_s += self.period_s
        return bytes(sent)

    def frame(self, payload: bytes) -> bytes:
        return texted(payload) if self.is_text else framed(payload)

    def _maybe_command(self) -> bytes | None:
        """The next one; a device is silent to the other dialect."""
        while self._inbox:
            is_binary = self._inbox.startswith(b"\x02\x02\x02\x02")
            if is_binary:
                end = 9 + int.from_bytes(self._inbox[4:8], "big")
                payload = bytes(self._inbox[8 : end - 1])
                assert framed(payload) == self._inbox[:end]  # the host sends nothing else
            else:
                assert self._inbox.startswith(b"\x02s")
                end = self._inbox.index(b"\x03") + 1
                payload = bytes(self._inbox[1 : end - 1])
            del self._inbox[:end]
            if is_binary != self.is_text:
                return payload
        return None

    def _answer(self, now_s: float, payload: bytes) -> None:
        name = payload[:3].decode() + " " + payload[4:].partition(b" ")[0].decode()
        self.asked.append(name)
        self.frames[name] = payload
        answer = self.answers[name] if name in self.answers else self._good(now_s, name, payload)
        if answer is not None:
            self._late.append((now_s + self.late_s.get(name, 0.0), self.frame(answer)))

    def _good(self, now_s: float, name: str, payload: bytes) -> bytes:
        """Does it, and says so."""
        kind, _, variable = name.partition(" ")
        if name in SETS:
            self._set(SETS[name], payload.split(b" ", 2)[2])
        elif name == "sEN LMDscandata":
            self.streams, self._due_s = True, now_s + 0.01
        elif name == "sMN SetAccessMode":
            self.streams, self.state = False, CONFIGURING
        elif name == "sMN Run":
            self.state = MEASURING
        if kind == "sRN" and variable in SETTINGS:
            return self._values(f"sRA {variable} ", variable)
        if name == "sMN mLMPsetscancfg":
            return self._values(
                "sAN mLMPsetscancfg " + ("0 " if self.is_text else "\0"), SETS[name]
            )
        if name == "sRN STlms":
            if self.is_text:
                text = (
                    f"sRA STlms {self.state} {self.temperature_flag} 8 00:34:19 A 01.01.1970 0 0 0"
                )
                return text.encode()
            return b"sRA STlms " + struct.pack(">HB", self.state, self.temperature_flag)
        return PLAIN[name][1].encode() if self.is_text else PLAIN[name][0]

    def _set(self, variable: str, values: bytes) -> None:
        layout = SETTINGS[variable][1]
        if self.is_text:
            tokens = values.decode().split()
            numbers = [int(token, 10 if token[0] in "+-" else 16) for token in tokens]
            self.settings[variable] = tuple(
                number - 2**32 if number >= 2**31 else number for number in numbers
            )
        else:
            self.settings[variable] = struct.unpack(">" + layout, values)

    def _values(self, head: str, variable: str) -> bytes:
        values, layout = self.settings[variable], SETTINGS[variable][1]
        if self.is_text:
            return (head + written(values, layout)).encode()
        return head.encode() + struct.pack(">" + layout, *values)

    def scan_payload(self, now_s: float) -> bytes:
        """The recorded scan with its counters and stamps moved on."""
        payload = bytearray(self._scan)
        self.scan_number = (self.scan_number + self.step_by) % 2**16
        self.telegrams = (self.telegrams + 1) % 2**16
        sent_us = round(now_s * 1e6) % 2**32
        scan_us = (sent_us - self.late_stamp_us) % 2**32
        payload[24:26] = bytes(self.status)
        struct.pack_into(">HHII", payload, 26, self.telegrams, self.scan_number, scan_us, sent_us)
        return scan_text(bytes(payload)) if self.is_text else bytes(payload)


class Bench:
    """The scripted scanner, a wire, a clock, the session."""

    def __init__(self, **changes: object) -> None:
        settings: dict[str, object] = {
            "dialect": "auto",
            "scan_rate_hz": 50,
            "angular_step_deg": 0.5,
            "first_deg": -45.0,
            "last_deg": 225.0,
            "echo": "first",
        }
        self.fake, self.port, self.now_s = ScriptedLms111(), MemoryPort(), 100.0
        self.lms = Lms111(self.port, **(settings | changes))  # type: ignore[arg-type]
        self.causes: list[str] = []  # each when it came up

    def run(self, seconds: float, *, deaf: bool = False) -> list[Scan]:
        """What was measured in that time; deaf: nothing of the device's gets through."""
        scans = []
        for _ in range(round(seconds / TICK_S)):
            sent = self.fake.exchange(self.now_s, self.port.take())
            self.port.give(b"" if deaf else sent)
            scans += self.lms.step(self.now_s)
            if not self.causes or self.causes[-1] != self.lms.status.cause:
                self.causes.append(self.lms.status.cause)
            self.now_s += TICK_S
        return scans

    def reconnect(self, seconds: float = 0.1) -> None:
        """The wire is lost for so long; nobody is subscribed after that."""
        self.port.connected = False
        self.run(seconds)
        self.port.connected = True
        self.fake.streams = False
        self.fake.asked.clear()

    @property
    def state(self) -> str:
        return self.lms.status.state

    @property
    def cause(self) -> str:
        return self.lms.status.cause


def willing(**changes: object) -> Bench:
    """A device that measures as wanted."""
    bench = Bench(**changes)
    bench.fake.settings = dict(WANTED)
    return bench
