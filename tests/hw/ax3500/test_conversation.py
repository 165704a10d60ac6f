"""The sheet's conversation (section 11) byte by byte; wrong baud rates; a monitor's silence."""

import random
from itertools import pairwise

import pytest

from tests.support.bench_ax3500 import FakeBench

TICK_S = 0.005


def garbled(data: bytes, seed: int) -> bytes:
    """What a receiver at another baud rate makes of it: other bits, and of a CR no CR."""
    chance = random.Random(seed)
    return bytes(byte for byte in (chance.randrange(1, 256) for _ in data) if byte & 0x7F != 0x0D)


def test_a_wrong_baud_rate_is_named() -> None:
    bench = FakeBench()
    bench.fake.deaf = True
    for k in range(100):
        bench.port.give(garbled(b":0000000000FE00", k))
        bench.run(0.05)
    assert bench.state == "starting"
    assert "check baud rate, parity E and 7 bits" in bench.cause
    bench.fake.deaf = False
    bench.run(6.0)
    assert (bench.state, bench.cause) == ("running", "")


@pytest.mark.parametrize(
    ("mode", "enter"), [("rc", True), ("analog", False), ("rs232", True), ("rs232_watchdog", False)]
)
def test_a_monitor_says_nothing_but_queries_in_any_mode(mode: str, enter: bool) -> None:
    bench = FakeBench(mode, enter=enter)  # type: ignore[arg-type]
    bench.run(2.5, (1.0, 1.0))
    bench.fake.restart(bench.now_s)
    bench.run(2.5, (1.0, 1.0))
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
