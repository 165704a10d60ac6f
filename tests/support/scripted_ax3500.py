"""An AX3500 written out by hand for the session's tests, and a bench to put it on."""

import re
from collections.abc import Callable

from core.records import WheelCounts
from fakes.wires.wire import MemoryPort, Wire
from hw.ax3500.session import Ax3500

TICK_S = 0.005
CHARACTER_S = 10 / 9600
PROMPT = b"Roboteq v1.9b 06/01/07\rs\rEncoder v1.7\r00\r"
LOG_LINE = b":0000000000FE00009898396AB7B70000\r"
FORBIDDEN = re.compile(rb"!|%|(?<!\?)Z|\^[0-9A-F]{2} |\*|\?Q[2-9]")


def shortened(count: int) -> bytes:
    """Section 5, written out."""
    digits = f"{count & 0xFFFFFFFF:08X}"
    negative = digits[0] in "89ABCDEF"
    filler = "F" if negative else "0"
    while len(digits) > 1 and digits[0] == filler and (digits[1] in "89ABCDEF") == negative:
        digits = digits[1:]
    return digits.encode()


class Scripted:
    """Echoes and answers one character each 1.04 ms; what goes wrong is an attribute."""

    def __init__(self, counts_at: Callable[[float], tuple[float, float]]) -> None:
        self.counts_at = counts_at
        self.in_rs232, self.mute, self.deaf = True, False, False
        self.values: dict[bytes, bytes | None] = {b"^8A": b"68\r+\r"}  # None: echo alone
        self.offset = 0  # of the counters, as after a restart
        self.delay_s = 0.0
        self.heard = b""
        self.asked_s: list[tuple[float, bytes]] = []
        self._line, self._queue, self._free_s = b"", b"", 0.0
        self._crs = 0
        self._log_s = 0.0

    def exchange(self, now_s: float, received: bytes) -> bytes:
        if not self._queue:
            self._free_s = now_s + self.delay_s + 4 * CHARACTER_S
        if not self.deaf:
            for byte in received:
                self._take(now_s, bytes([byte]))
        if not self.in_rs232 and now_s - self._log_s >= 0.224:
            self._log_s = now_s
            self._queue += LOG_LINE
        sent = b""
        while self._queue and self._free_s + CHARACTER_S <= now_s:
            self._free_s += CHARACTER_S
            sent, self._queue = sent + self._queue[:1], self._queue[1:]
        return b"" if self.mute else sent

    def restart(self, now_s: float, *, in_rs232: bool = False, tell: bool = True) -> None:
        one, two = self.counts_at(now_s)
        assert one == two
        self.offset = -int(one)
        self.in_rs232 = in_rs232
        self._line, self._queue = b"", (PROMPT if tell else b"")

    def _take(self, now_s: float, character: bytes) -> None:
        self.heard += character
        self._crs = self._crs + 1 if character == b"\r" else 0
        if not self.in_rs232:
            if self._crs == 10:
                self.in_rs232, self._queue, self._line = True, b"OK\r", b""
            return
        self._queue += character
        if character != b"\r":
            self._line += character
            return
        line, self._line = self._line, b""
        if line:
            self.asked_s.append((now_s, line))
            self._queue += self._answer(now_s, line) or b""

    def _answer(self, now_s: float, line: bytes) -> bytes | None:
        if line in self.values:
            return self.values[line]
        if line in (b"?Q0", b"?Q1"):
            count = int(self.counts_at(now_s + 4 * CHARACTER_S)[line == b"?Q1"] // 1)
            return shortened((count + self.offset + 2**31) % 2**32 - 2**31) + b"\r"
        return b"-\r"


class Bench:
    """One controller, one wire, one clock."""

    def __init__(
        self, device: Scripted, *, enter: bool = False, poll_hz: float = 20.0, seed: int = 1
    ) -> None:
        self.device, self.port, self.now_s = device, MemoryPort(), 0.0
        self.wire = Wire(device, self.port, seed)
        self.ax = Ax3500(
            self.port,
            poll_hz=poll_hz,
            left_channel=1,
            right_channel=2,
            inverted_channels=(),
            enter_rs232=enter,
            max_counts_per_s=2122.0,
            enable_motors=False,
        )

    def state(self) -> str:
        return self.ax.status.state

    def run(self, seconds: float) -> list[WheelCounts]:
        """What was measured in that time; nothing forbidden was sent."""
        measured = []
        for _ in range(round(seconds / TICK_S)):
            self.wire.step(self.now_s)
            measured += self.ax.step(self.now_s)
            self.now_s += TICK_S
        assert not FORBIDDEN.search(self.device.heard)
        return measured


def still(one: float, two: float) -> Callable[[float], tuple[float, float]]:
    return lambda t_s: (one, two)


def at_speed(counts_per_s: float, begin: float = 0.0) -> Callable[[float], tuple[float, float]]:
    return lambda t_s: (begin + counts_per_s * t_s,) * 2
