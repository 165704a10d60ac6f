"""Lines of a simulated machine for the tools that speak with devices: no time but what they wait.

A fake stands at a path or a TCP port; whoever opens it there talks with it at once. Each fake has
a clock of its own, which goes on from one conversation to the next.
"""

from collections.abc import Callable

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
        own: int = getattr(self._fake, "baud", self._host)
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
        path = f"/dev/ttySIM{len(self._fakes)}"
        self._fakes[path] = fake
        return path

    def tcp(self, fake: Fake) -> str:
        """HOST:PORT of a device on the network."""
        place = f"{HOST}:{2111 + len(self._fakes)}"
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
