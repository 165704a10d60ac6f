"""Lines of a simulated machine for the tools that speak with devices: no time but what they wait.

A fake stands at a path or a TCP port; whoever opens it there talks with it at once. Each fake has
a clock of its own, which goes on from one conversation to the next.
"""

from collections.abc import Callable

import pytest

from fakes.wires.pty import heard_at
from fakes.wires.wire import Fake, MemoryPort, Wire
from hw.ports.url import parse_url
from tools.cli.conversation import STEP_S

START_S = 100.0
HOST = "192.0.2.1"  # nobody's


class _AtBaud:
    """What a host at some speed makes of a serial device, and it of the host."""

    def __init__(self, fake: Fake, baud: int) -> None:
        self._fake, self._host = fake, baud

    def exchange(self, now_s: float, received: bytes) -> bytes:
        own: int = getattr(self._fake, "baud", None) or self._host  # None: USB takes any
        said = self._fake.exchange(now_s, heard_at(received, self._host, own))
        return heard_at(said, own, self._host)


class _Line:
    """A conversation's line."""

    def __init__(self, of: "SimulatedLines", place: str, fake: Fake | None) -> None:
        self.port = MemoryPort()
        self._of, self._place = of, place
        self._wire = None if fake is None else Wire(fake, self.port, 1)
        if fake is None:
            self.port.connected = False
            self.port.cause = f"no such device {place}"

    def now_s(self) -> float:
        return self._of.clocks.setdefault(self._place, START_S)

    def wait(self) -> None:
        self._of.clocks[self._place] = self.now_s() + STEP_S
        if self._wire is not None:
            self._wire.step(self.now_s())


class SimulatedLines:
    """All lines of a machine; `tools.cli.conversation.LINE` in a test."""

    def __init__(self) -> None:
        self.clocks: dict[str, float] = {}
        self._fakes: dict[str, Fake] = {}

    def serial(self, fake: Fake) -> str:
        """The path of a serial port with that device."""
        return self._place(fake, f"/dev/ttySIM{len(self._fakes)}")

    def tcp(self, fake: Fake, port: str = "") -> str:
        """HOST:PORT of a device on the network."""
        return self._place(fake, f"{HOST}:{port or 2111 + len(self._fakes)}")

    def _place(self, fake: Fake, new: str) -> str:
        place = next((place for place, known in self._fakes.items() if known is fake), new)
        self._fakes[place] = fake
        return place

    def __call__(self, url: str) -> _Line:
        where = parse_url(url)
        place = where.path or f"{where.host}:{where.port}"
        fake = self._fakes.get(place)
        if fake is not None and where.path:
            fake = _AtBaud(fake, where.baud or 0)
        return _Line(self, place, fake)

    def run(self, place: str, done: Callable[[], object], limit_s: float = 60.0) -> None:
        """Let time pass at a device until it is done, though nobody talks with it."""
        fake = self._fakes[place]
        line = _Line(self, place, fake)
        until_s = line.now_s() + limit_s
        while not done():
            assert line.now_s() < until_s
            line.wait()


class Said:
    """What a command prints about a fake, on either stream."""

    def __init__(
        self,
        capsys: pytest.CaptureFixture[str],
        lines: SimulatedLines,
        main: Callable[[list[str]], int],
        serial: str = "",
    ) -> None:
        """`serial`: settings of the fake's serial line; "" where it is on the network."""
        self._capsys, self._lines, self._main, self._serial = capsys, lines, main, serial

    def __call__(self, fake: Fake, *what: str, status: int = 0) -> str:
        if self._serial:
            url = f"serial://{self._lines.serial(fake)}?{self._serial}"
        else:
            url = f"tcp://{self._lines.tcp(fake)}"
        got = self._main([*what, "--port", url])
        printed = self._capsys.readouterr()
        assert got == status, printed
        return printed.out + printed.err
