"""A Hokuyo scanner whose answers are written down, and a bench with the driver on its line.

Its sums are worked out here, from the sheet; its scans are numbered, so that each can be told.
"""

from collections.abc import Callable, Iterable, Sequence

from core.records import Scan
from fakes.wires.wire import MemoryPort
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.session import Urg04lx
from tests.support.devices.urg04lx_vectors import REPLIES

TICK_S, BAUD, PERIOD_MS = 0.005, 115_200, 100
POINTS = 65  # 0 to 22.5 deg: two lines of data and a part
OPTIONS = Urg04lxOptions(
    model="URG-04LX", from_deg=0.0, to_deg=22.5, cluster=1, skip_scans=0, characters=3,
    stream=True, correction=[0.0] * 4, correction_m=[0.02, 5.6],
)  # fmt: skip
MD = "MD0384044801000"


def summed(text: bytes) -> bytes:
    return text + bytes([sum(text) % 64 + 0x30])


def reply(command: str, status: str, *lines: bytes) -> bytes:
    """In SCIP 2.0; a status of one character: in SCIP 1.1."""
    told = status.encode()
    parts = [command.encode(), told if len(told) == 1 else summed(told), *map(summed, lines)]
    return b"\n".join(parts) + b"\n\n"


def number(value: int, count: int) -> bytes:
    return bytes(0x30 + (value >> 6 * k & 63) for k in reversed(range(count)))


def scan_of(range_mm: int, ticks: int, command: str = MD, points: int = POINTS) -> bytes:
    """A message of a stream, all of whose ranges are the same."""
    data = number(range_mm, 3) * points
    lines = [data[at : at + 64] for at in range(0, len(data), 64)]
    return reply(command, "99", number(ticks, 4), *lines)


class RatedPort(MemoryPort):
    """A line whose rate can be set."""

    baud = BAUD

    def set_rate(self, baud: int) -> None:
        self.baud = baud


class Script:
    """Answers by request; the last of several goes on. What is not there is not answered."""

    def __init__(self) -> None:
        self.baud = BAUD
        self.asked: list[str] = []  # what it heard at its own rate
        self.scans = True  # it streams when asked to
        self._ms, self._streams_ms = 0, -1  # its time; when the next scan is over
        self.answers: dict[str, Sequence[bytes]] = {
            "QT": [reply("QT", "00")],
            "PP": [REPLIES["vendor PP"]],
            "VV": [REPLIES["vendor VV"]],
            "TM0": [reply("TM0", "00")],
            "TM2": [reply("TM2", "00")],
            "BM": [reply("BM", "00")],
            MD: [reply(MD, "00")],
        }

    def step(self, now_s: float, received: bytes) -> bytes:
        self._ms, out = round(now_s * 1000), b""
        for line in received.decode("latin-1").split("\n"):
            if line:
                out += self._answer(line)
        if 0 <= self._streams_ms <= self._ms:
            begun_ms = self._streams_ms - PERIOD_MS
            out += scan_of(1000 + begun_ms // PERIOD_MS % 1000, begun_ms)
            self._streams_ms += PERIOD_MS
        return out

    def _answer(self, request: str) -> bytes:
        self.asked.append(request)
        if request == "QT":
            self._streams_ms = -1
        if request == MD and self.scans:
            self._streams_ms = self._ms + PERIOD_MS
        if request == "TM1" and request not in self.answers:
            return reply("TM1", "00", number(self._ms, 4))
        given = self.answers.get(request, [b""])
        if len(given) > 1:
            self.answers[request] = given[1:]
        return given[0]


class Bench:
    """The script, its line, a clock, the driver."""

    def __init__(self, options: Urg04lxOptions = OPTIONS) -> None:
        self.script, self.port = Script(), RatedPort()
        self.urg = Urg04lx(self.port, options, BAUD)
        self.now_s = 50.0
        self.spoil: Callable[[bytes], Iterable[bytes]] = lambda data: [data]  # on the way to us

    @property
    def state(self) -> str:
        return self.urg.status.state

    @property
    def cause(self) -> str:
        return self.urg.status.cause

    def run(self, seconds: float) -> list[Scan]:
        scans: list[Scan] = []
        for _ in range(round(seconds / TICK_S)):
            heard = self.port.take()
            is_heard = self.script.baud == self.port.baud
            out = self.script.step(self.now_s, heard if is_heard else b"")
            if out and is_heard:
                for piece in self.spoil(out):
                    self.port.give(piece)
            scans += self.urg.step(self.now_s)
            self.now_s += TICK_S
        return scans

    def started(self) -> "Bench":
        self.run(5.0)
        assert (self.state, self.cause) == ("running", "")
        self.script.asked.clear()
        return self
