"""The sheet's conversation (section 11) byte by byte; wrong baud rates; a monitor's silence."""

import random
from itertools import pairwise

import pytest

from fakes.wires.wire import MemoryPort
from hw.ax3500.session import Ax3500
from tests.support.bench_ax3500_session import FakeBench

TICK_S = 0.005
CHARACTER_S = 10 / 9600
POWER_UP = bytes.fromhex(
    "52 6F 62 6F 74 65 71 20 76 31 2E 39 62 20 30 36 2F 30 31 2F 30 37 0D"
    "73 0D 45 6E 63 6F 64 65 72 20 76 31 2E 37 0D 30 30 0D"
    "3A 30 30 30 30 30 30 30 30 30 30 46 45 30 30 30 30 39 38 39 38 33 39 36 41 42 37 42 37 30 30"
    "30 30 0D"
)
ENTER, ENTERED = bytes.fromhex("0D") * 10, bytes.fromhex("4F 4B 0D")
PLUS = bytes.fromhex("2B 0D")
EXCHANGES = {  # what the host says -> what comes back, the first time, the second
    "5E 38 41 0D": ["5E 38 41 0D 36 38 0D"],
    "5E 30 30 0D": ["5E 30 30 0D 30 30 0D"],
    "5E 30 31 0D": ["5E 30 31 0D 43 35 0D"],
    "5E 38 39 0D": ["5E 38 39 0D 30 30 0D"],
    "3F 45 0D": ["3F 45 0D 37 30 0D 36 43 0D"],
    "3F 51 30 0D": ["3F 51 30 0D 30 46 41 0D", "3F 51 57 30 0D 37 44 30 0D"],
    "3F 51 31 0D": ["3F 51 31 0D 46 31 35 0D", "3F 51 31 0D 38 33 30 0D"],
}


class Script:
    """The device's side of section 11, one character each 1.04 ms; what is not in it gets `-`."""

    def __init__(self, plus: bool) -> None:
        self.heard = bytearray()
        self.phase = 0  # which of the counters' two answers is given
        self._plus, self._queue, self._free_s = plus, bytearray(POWER_UP), 0.0
        self._line = bytearray()
        self._entered = False

    def exchange(self, now_s: float, received: bytes) -> bytes:
        if not self._queue:
            self._free_s = now_s
        for byte in received:
            self.heard.append(byte)
            self._line.append(byte)
            if not self._entered:
                if self._line.endswith(ENTER):
                    self._entered, self._queue = True, self._queue + ENTERED
                    self._line.clear()
            elif byte == 0x0D:
                self._queue += self._answer(bytes(self._line))
                self._line.clear()
        sent = bytearray()
        while self._queue and self._free_s + CHARACTER_S <= now_s:
            self._free_s += CHARACTER_S
            sent.append(self._queue.pop(0))
        return bytes(sent)

    def say(self, data: bytes) -> None:
        self._queue += data

    def _answer(self, line: bytes) -> bytes:
        answers = EXCHANGES.get(line.hex(" ").upper())
        if answers is None:
            return line + b"-\r" if line != b"\r" else b"\r"
        answer = bytes.fromhex(answers[min(self.phase, len(answers) - 1)])
        return answer + (PLUS if self._plus and line.startswith(b"^") else b"")


@pytest.mark.parametrize("plus", [True, False])
@pytest.mark.parametrize("motors", [True, False])
def test_section_11_byte_by_byte(plus: bool, motors: bool) -> None:
    port, script, now_s = MemoryPort(), Script(plus), 0.0
    ax = Ax3500(
        port,
        poll_hz=20.0,
        left_channel=1,
        right_channel=2,
        inverted_channels=(),
        enter_rs232=True,
        max_counts_per_s=30_000.0,
        enable_motors=motors,
    )

    def run(seconds: float) -> list[tuple[float, float]]:
        nonlocal now_s
        counted = []
        for _ in range(round(seconds / CHARACTER_S)):
            now_s += CHARACTER_S
            for byte in script.exchange(now_s, port.take()):
                port.give(bytes([byte]))  # each character alone
            ax.hear(now_s)
            counted += [(counts.left, counts.right) for counts in ax.step(now_s)]
        return counted

    first = run(4.0)
    assert ax.status.state == "running"
    assert set(first) == {(250.0, -235.0)}
    assert (ax.stream.identity, ax.controller.status) == (0x68, 0)
    assert ax.controller.battery_v == pytest.approx(24.06, abs=0.005)
    assert ax.controller.internal_v == pytest.approx(12.02, abs=0.005)
    script.phase = 1
    assert run(1.0)[-1] == (2000.0, -2000.0)
    stops = ax.stream.watchdog_stops
    assert stops > 10
    script.say(b"WWW")
    run(0.5)
    assert ax.stream.watchdog_stops >= stops + 3
    commands = {line for line in bytes(script.heard).split(b"\r") if line.startswith(b"!")}
    assert commands == ({b"!A00", b"!B00"} if motors else set())
    assert ax.status.rejected == 0


def garbled(data: bytes, seed: int) -> bytes:
    """What a receiver at another baud rate makes of it: other bits, and of a CR no CR."""
    chance = random.Random(seed)
    return bytes(byte for byte in (chance.randrange(1, 256) for _ in data) if byte & 0x7F != 0x0D)


@pytest.mark.parametrize("seed", range(4))
def test_a_wrong_baud_rate_is_named(seed: int) -> None:
    bench = FakeBench()
    bench.fake.deaf = True
    for k in range(100):
        bench.port.give(garbled(b":0000000000FE00", 100 * seed + k))
        bench.run(0.05)
    assert bench.state == "starting"
    assert "check baud rate, parity E and 7 bits" in bench.cause
    bench.fake.deaf = False
    bench.run(6.0)
    assert (bench.state, bench.cause) == ("running", "")


@pytest.mark.parametrize("mode", ["rc", "rs232", "rs232_watchdog", "analog"])
@pytest.mark.parametrize("enter", [True, False])
def test_a_monitor_says_nothing_but_queries_in_any_mode(mode: str, enter: bool) -> None:
    bench = FakeBench(mode, enter=enter)  # type: ignore[arg-type]
    bench.run(3.0, (1.0, 1.0))
    bench.fake.restart(bench.now_s)
    bench.run(4.0, (1.0, 1.0))
    bench.ax.stop()
    lines = set(bytes(bench.port.written).split(b"\r"))
    assert all(line[:1] in (b"", b"?", b"^") and b" " not in line for line in lines)
    assert lines <= {b"", b"^8A", b"^89"} | {b"?" + c for c in (b"Q0", b"Q1")} | {
        b"?" + bytes([letter]) for letter in b"AMEI"
    }
    assert (b"?Q0" in lines) is (enter or mode.startswith("rs232"))


def test_there_is_never_more_than_one_line_on_the_way() -> None:
    bench = FakeBench("rs232_watchdog", enable=True, poll_hz=60.0, look_s=0.0005)
    bench.fake.minus_on_empty = True
    bench.start()
    begun = len(bench.port.written)
    sizes = []
    for _ in range(400):
        bench.tick((0.2, 0.2))
        sizes.append(bytes(bench.port.written[begun:]).count(b"\r"))
    assert max(b - a for a, b in pairwise(sizes)) == 1
    assert bench.ax.status.rejected == 0
