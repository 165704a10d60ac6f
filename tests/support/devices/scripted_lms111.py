"""A scanner that does as a test tells it: what it answers to each command, what its scans carry."""

from collections.abc import Iterator
from datetime import datetime

import numpy as np
from msgspec.structs import replace

from core.records import Scan
from fakes.lms1xx import cola
from fakes.lms1xx.cola import Value, packed, read, unpacked, written
from fakes.lms1xx.scan import U16, Channel, ScanTelegram
from fakes.wires.wire import MemoryPort
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.session import Lms111
from tests import VECTORS

TICK_S = 0.005
UNKNOWN = b"sFA\x00\x03"
CONFIGURING, MEASURING = 2, 7
KINDS = {"LMPscancfg": "IHIii", "LMDscandatacfg": "BBBBBBBBBBBH", "LMPoutputRange": "HIii"}
DELIVERED = {
    "LMPscancfg": (2500, 1, 5000, -450000, 2250000),
    "LMDscandatacfg": (1, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 1),
    "LMPoutputRange": (1, 5000, 0, 1800000),
}
WANTED = {
    "LMPscancfg": (5000, 1, 5000, -450000, 2250000),
    "LMDscandatacfg": (1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1),
    "LMPoutputRange": (1, 5000, -449997, 2249997),
}
SETS = {f"sWN {name}": name for name in KINDS} | {"sMN mLMPsetscancfg": "LMPscancfg"}
TYPES = {"sRN": "sRA", "sWN": "sWA", "sMN": "sAN", "sEN": "sEA"}
GOOD: dict[str, list[Value]] = {  # of settings and of STlms it makes them up itself
    "SetAccessMode": [("B", 1)],
    "LMCstartmeas": [("B", 0)],
    "Run": [("B", 1)],
    "SCdevicestate": [("B", 1)],
    "FirmwareVersion": [("S", b"V1.80.2  ")],
    "LCMstate": [("B", 0)],
    "LMDscandata": [("B", 1)],
}


def recorded_mm() -> U16:
    """The distances of a recorded scan whose measurements are valid, (541,)."""
    stream = (VECTORS / "lms111_session_d2h.bin").read_bytes()
    at = stream.rindex(b"sSN LMDscandata ") + 77
    return np.frombuffer(stream, ">u2", 541, at).astype(np.uint16)


class ScriptedLms111:
    """Answers at once; `answers` is what instead (None: nothing); scans come while subscribed."""

    def __init__(self) -> None:
        self.answers: dict[str, bytes | None] = {}  # overrides: whole payloads
        self.late_s: dict[str, float] = {}  # of the answer to a command
        self.asked: list[str] = []
        self.is_text = False
        self.deaf_until_s = 0.0
        self.settings = dict(DELIVERED)
        self.state, self.temperature_flag = MEASURING, 0
        self.streams = False
        self.status = (0, 0)
        self.step_by, self.period_s = 1, 0.02  # of the scan counter, and from scan to scan
        self.late_stamp_us = 3100
        self.scan_number = self.telegrams = 0
        self.channels = [Channel(b"DIST1", recorded_mm(), -450_000, 5000)]
        self._readers = cola.CommandReader(), cola.TextReader()
        self._late: list[tuple[float, bytes]] = []
        self._due_s = 0.0

    def exchange(self, now_s: float, received: bytes) -> bytes:
        if now_s < self.deaf_until_s:
            return b""
        for payload in self._readers[self.is_text].feed(now_s, received):
            kind, name, arguments = cola.command(payload)
            if kind:
                self._answer(now_s, f"{kind} {name}", arguments)
        sent = bytearray()
        for late in [late for late in self._late if late[0] <= now_s]:
            self._late.remove(late)
            sent += late[1]
        while self.streams and self._due_s <= now_s:
            sent += self.scan(self._due_s)
            self._due_s += self.period_s
        return bytes(sent)

    def frame(self, payload: bytes) -> bytes:
        return cola.text_frame(payload) if self.is_text else cola.frame(payload)

    def scan(self, now_s: float) -> bytes:
        self.scan_number = (self.scan_number + self.step_by) % 2**16
        self.telegrams += 1
        sent_us = round(now_s * 1e6)
        telegram = ScanTelegram(
            status=bytes(self.status),
            telegrams=self.telegrams,
            scans=self.scan_number,
            scan_us=sent_us - self.late_stamp_us,
            sent_us=sent_us,
            outputs=b"\4\0",
            frequency=5000,
            shots=360,
            channels=tuple(self.channels),
            when=datetime(2021, 3, 2),
        )
        return self.frame(self._payload("sSN LMDscandata", telegram.values()))

    def _payload(self, head: str, values: list[Value]) -> bytes:
        if self.is_text:
            return f"{head} ".encode() + written(values) if values else head.encode()
        return f"{head} ".encode() + packed(values)

    def _answer(self, now_s: float, command: str, arguments: bytes) -> None:
        self.asked.append(command)
        if command in self.answers:
            answer = self.answers[command]
        else:
            kind, name = command.split()
            values = list(self._obeyed(now_s, command, name, arguments))
            answer = self._payload(f"{TYPES[kind]} {name}", values)
        if answer is not None:
            self._late.append((now_s + self.late_s.get(command, 0.0), self.frame(answer)))

    def _obeyed(self, now_s: float, command: str, name: str, arguments: bytes) -> Iterator[Value]:
        """Does it; the values of the answer."""
        variable = SETS.get(command, name)
        if command in SETS:
            take = read if self.is_text else unpacked
            self.settings[variable] = take(KINDS[variable], arguments)
        elif command == "sEN LMDscandata":
            self.streams, self._due_s = True, now_s + 0.01
        elif command == "sMN SetAccessMode":
            self.streams, self.state = False, CONFIGURING
        elif command == "sMN Run":
            self.state = MEASURING
        if command == "sMN mLMPsetscancfg":
            yield "B", 0
        if name == "STlms":
            yield from (("H", self.state), ("B", self.temperature_flag))
            yield from (("S", b"00:34:19"), ("S", b"01.01.1970"), ("I", 0), ("I", 0), ("I", 0))
        elif variable in KINDS and not command.startswith("sWN"):
            yield from zip(KINDS[variable], self.settings[variable], strict=True)
        else:
            yield from GOOD.get(name, [])


USUAL = Lms1xxOptions("auto", 50, 0.5, -45.0, 225.0, "first", [])  # all beams


class Bench:
    """The scripted scanner, a wire, a clock, the session."""

    def __init__(self, **changes: object) -> None:
        self.fake, self.port, self.now_s = ScriptedLms111(), MemoryPort(), 100.0
        self.lms = Lms111(self.port, replace(USUAL, **changes))
        self.causes: list[str] = []  # each when it came up

    def run(self, seconds: float, tick_s: float = TICK_S) -> list[Scan]:
        scans = []
        for _ in range(round(seconds / tick_s)):
            self.port.give(self.fake.exchange(self.now_s, self.port.take()))
            scans += self.lms.step(self.now_s)
            if not self.causes or self.causes[-1] != self.lms.status.cause:
                self.causes.append(self.lms.status.cause)
            self.now_s += tick_s
        return scans

    def run_until_asked(self, name: str) -> None:
        for _ in range(4000):
            self.run(TICK_S)
            if name in self.fake.asked:
                return
        raise AssertionError(self.fake.asked)

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
    bench = Bench(**changes)
    bench.fake.settings = dict(WANTED)
    return bench
