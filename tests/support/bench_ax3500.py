"""A fake controller with wheels and a clock, as tests of it want them."""

from typing import Any

from fakes.ax3500.device import FakeAx3500
from fakes.ax3500.properties import Mode


class HeldWheels:
    """Wheels at the counts that a test puts there."""

    def __init__(self, one: float = 0.0, two: float = 0.0) -> None:
        self.turned = (one, two)
        self.powers: list[tuple[float, float]] = []

    def counts(self) -> tuple[float, float]:
        return self.turned

    def set_power(self, one: float, two: float) -> None:
        self.powers.append((one, two))


class Bench:
    """A controller whose characters take no time, unless asked for, and a clock."""

    def __init__(self, mode: Mode = "rs232", *, paced: bool = False, **properties: Any) -> None:
        self.wheels = HeldWheels()
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
        """Motor commands, whatever the mode."""
        self.fake.radio_overrides = True
        self.fake.command(one, two)

    def place(self, one: int, two: int) -> None:
        """Turn the wheels there."""
        self.wheels.turned = (float(one), float(two))
