"""A fake AX3500 alone, and with a session on it: wheels, wire, clock, a record of what was said."""

import math
from typing import Any

from core.records import WheelCounts
from fakes.ax3500.device import FakeAx3500
from fakes.ax3500.properties import Mode
from fakes.wires.wire import MemoryPort, Wire
from hw.ax3500.session import Ax3500, Ax3500Options

TICK_S = 0.005
MAX_COUNTS_PER_S = 2122.0
FULL_COUNTS_PER_S = 2000.0  # of wheels that turn as their power says


class SteadyWheels:
    """Turns at a speed that tests may change, or that the motors' power sets."""

    def __init__(self) -> None:
        self.counts_per_s = [0.0, 0.0]
        self.turned = [0.0, 0.0]
        self.powers: list[tuple[float, float]] = []
        self.obey = False  # the motors

    def counts(self) -> tuple[float, float]:
        return self.turned[0], self.turned[1]

    def set_power(self, one: float, two: float) -> None:
        self.powers.append((one, two))
        if self.obey:
            self.counts_per_s = [FULL_COUNTS_PER_S * one, FULL_COUNTS_PER_S * two]

    def power(self) -> tuple[float, float]:
        return self.powers[-1] if self.powers else (0.0, 0.0)

    def turn(self, passed_s: float, acceleration: float = 0.0) -> None:
        for k in (0, 1):
            self.turned[k] += self.counts_per_s[k] * passed_s + acceleration * passed_s**2 / 2
            self.counts_per_s[k] += acceleration * passed_s


class Bench:
    """A controller whose characters take no time, unless asked for, and a clock."""

    def __init__(self, mode: Mode = "rs232", *, paced: bool = False, **properties: Any) -> None:
        self.wheels = SteadyWheels()
        self.fake = FakeAx3500(self.wheels, 1, mode, paced=paced)
        self.now_s = 100.0
        self.fake.reply_delay_s = 0.0
        for name, value in properties.items():
            assert hasattr(self.fake, name), name
            setattr(self.fake, name, value)
        self.fake.exchange(self.now_s, b"")

    def run(self, seconds: float, received: bytes = b"", step_s: float = 0.005) -> bytes:
        """What it sends in that time, the bytes written at its beginning."""
        sent = self.fake.exchange(self.now_s, received)
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            sent += self.fake.exchange(self.now_s, b"")
        return sent

    def ask(self, line: str) -> list[str]:
        """The lines that come back at once, after the echo, which is checked."""
        sent = self.fake.exchange(self.now_s, f"{line}\r".encode("ascii")).decode("ascii")
        assert sent.startswith(f"{line}\r"), sent
        return sent.split("\r")[1:-1]

    def drive(self, one: int, two: int) -> None:
        self.fake.radio_overrides = True
        self.fake.command(one, two)

    def place(self, one: int, two: int) -> None:
        self.wheels.turned = [float(one), float(two)]


class OddAx3500(FakeAx3500):
    """Gives some queries other lines than it should."""

    def __init__(self, wheels: SteadyWheels, mode: Mode) -> None:
        super().__init__(wheels, 1, mode)
        self.odd: dict[str, list[str]] = {}

    def _answer(self, text: str, at_s: float) -> list[str]:
        return self.odd[text] if text in self.odd else super()._answer(text, at_s)


class RecordingPort(MemoryPort):
    """Keeps all that was ever written to it."""

    written = b""

    def write(self, data: bytes) -> None:
        self.written += data
        super().write(data)


class FakeBench:
    """One fake, one session, one clock. The wire takes what is written at that instant.

    Args:
        look_s: where given, the session also hears what arrives between its ticks, as often.
    """

    def __init__(
        self,
        mode: Mode = "rs232",
        *,
        enable: bool = False,
        enter: bool = False,
        poll_hz: float = 20.0,
        tick_s: float = TICK_S,
        look_s: float = math.inf,
        seed: int = 1,
        max_counts_per_s: float = MAX_COUNTS_PER_S,
        **settings: Any,
    ) -> None:
        self.wheels = SteadyWheels()
        self.fake = OddAx3500(self.wheels, mode)
        self.port, self.now_s = RecordingPort(), 0.0
        self.tick_s, self._looks = tick_s, max(1, round(tick_s / look_s))
        self.wire = Wire(self.fake, self.port, seed)
        usual: dict[str, Any] = {"left_channel": 1, "right_channel": 2, "invert": [], "radio": True}
        options = Ax3500Options(poll_hz=poll_hz, enter_rs232=enter, **(usual | settings))
        self.ax = Ax3500(
            self.port, options, max_counts_per_s=max_counts_per_s, enable_motors=enable
        )

    @property
    def state(self) -> str:
        return self.ax.status.state

    @property
    def cause(self) -> str:
        return self.ax.status.cause

    def run(
        self, seconds: float, wish: tuple[float, float] | None = None, *, acceleration: float = 0.0
    ) -> list[WheelCounts]:
        """What was measured in that time, a wish for the motors asked for at every tick."""
        measured: list[WheelCounts] = []
        for _ in range(round(seconds / self.tick_s)):
            measured += self.tick(wish, acceleration)
        return measured

    def tick(
        self, wish: tuple[float, float] | None = None, acceleration: float = 0.0
    ) -> list[WheelCounts]:
        """One tick, and before it the looks in between."""
        for look in range(self._looks):
            self.elapse(self.tick_s / self._looks, acceleration)
            if look < self._looks - 1:
                self.ax.hear(self.now_s)
                self.wire.step(self.now_s)
        if wish is not None:
            self.ax.drive(*wish)
        measured = self.ax.step(self.now_s)
        self.wire.step(self.now_s)
        return measured

    def elapse(self, seconds: float, acceleration: float = 0.0) -> None:
        """Let time pass in which nobody looks."""
        self.now_s += seconds
        self.wheels.turn(seconds, acceleration)
        self.wire.step(self.now_s)

    def start(self, wish: tuple[float, float] | None = None, seconds: float = 2.0) -> None:
        """Until it runs, zero asked for; then a wish until the wheels have it."""
        self.run(seconds, (0.0, 0.0))
        if wish is not None:
            self.run(0.5, wish)
