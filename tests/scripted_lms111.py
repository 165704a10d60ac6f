"""A scanner that does as a test tells it: what it answers to each command, what its scans carry."""

import struct
from pathlib import Path

from core.records import Scan
from fakes.wire import MemoryPort
from hw.lms111_session import Lms111

VECTORS = Path(__file__).parent / "vectors"
TICK_S = 0.005
SFA = b"sFA"
GOOD: dict[str, bytes | None] = {
    "sMN SetAccessMode": b"sAN SetAccessMode \x01",
    "sRN LMPscancfg": b"sRA LMPscancfg " + struct.pack(">IHIii", 2500, 1, 5000, -450000, 2250000),
    "sMN mLMPsetscancfg": b"sAN mLMPsetscancfg \x00"
    + struct.pack(">IHIii", 5000, 1, 5000, -450000, 2250000),
    "sWN LMDscandatacfg": b"sWA LMDscandatacfg ",
    "sRN LMPoutputRange": b"sRA LMPoutputRange " + struct.pack(">HIii", 1, 5000, -449997, 2249997),
    "sWN LMPoutputRange": b"sWA LMPoutputRange ",
    "sMN LMCstartmeas": b"sAN LMCstartmeas \x00",
    "sMN Run": b"sAN Run \x01",
    "sRN STlms": b"sRA STlms " + struct.pack(">HB", 7, 0),
    "sRN SCdevicestate": b"sRA SCdevicestate \x01",
    "sEN LMDscandata": b"sEA LMDscandata \x01",
}


def framed(payload: bytes) -> bytes:
    check = 0
    for byte in payload:
        check ^= byte
    return b"\x02" * 4 + struct.pack(">I", len(payload)) + payload + bytes([check])


def recorded_scan() -> bytes:
    """The payload of a recorded scan whose measurements are valid."""
    stream = (VECTORS / "lms111_session_d2h.bin").read_bytes()
    at = stream.rindex(b"sSN LMDscandata ")
    return stream[at : at + 0x49E]


class ScriptedLms111:
    """Answers at once; `answers` is what to (None: nothing); scans come while subscribed."""

    def __init__(self) -> None:
        self.answers = dict(GOOD)
        self.asked: list[str] = []
        self.frames: dict[str, bytes] = {}  # the newest of each command, its payload
        self.streams = False
        self.status = (0, 0)
        self.step_by = 1  # of the scan counter, per scan
        self.period_s = 0.02
        self.late_stamp_us = 3100
        self.scan_number = self.telegrams = 0
        self._scan = recorded_scan()
        self._inbox = bytearray()
        self._due_s = 0.0

    def exchange(self, now_s: float, received: bytes) -> bytes:
        self._inbox += received
        sent = bytearray()
        while len(self._inbox) >= 8:
            end = 9 + int.from_bytes(self._inbox[4:8], "big")
            payload = bytes(self._inbox[8 : end - 1])
            assert framed(payload) == self._inbox[:end]  # the host sends nothing else
            del self._inbox[:end]
            sent += self._answer(now_s, payload)
        while self.streams and self._due_s <= now_s:
            sent += framed(self.scan_payload(self._due_s))
            self._due_s += self.period_s
        return bytes(sent)

    def _answer(self, now_s: float, payload: bytes) -> bytes:
        name = payload[:3].decode() + " " + payload[4:].partition(b" ")[0].decode()
        self.asked.append(name)
        self.frames[name] = payload
        answer = self.answers[name]
        if name == "sEN LMDscandata" and answer == GOOD[name]:
            self.streams, self._due_s = True, now_s + 0.01
        elif name == "sMN SetAccessMode":
            self.streams = False
        return framed(answer) if answer is not None else b""

    def scan_payload(self, now_s: float) -> bytes:
        """The recorded scan with its counters and stamps moved on."""
        payload = bytearray(self._scan)
        self.scan_number = (self.scan_number + self.step_by) % 2**16
        self.telegrams = (self.telegrams + 1) % 2**16
        sent_us = round(now_s * 1e6) % 2**32
        scan_us = (sent_us - self.late_stamp_us) % 2**32
        payload[24:26] = bytes(self.status)
        struct.pack_into(">HHII", payload, 26, self.telegrams, self.scan_number, scan_us, sent_us)
        return bytes(payload)


class Bench:
    """The scripted scanner, a wire, a clock, the session."""

    def __init__(self, **changes: object) -> None:
        settings: dict[str, object] = {
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

    @property
    def state(self) -> str:
        return self.lms.status.state
