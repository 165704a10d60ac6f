"""The last stop is acknowledged before the line is closed: a close loses what has not left."""

import os
import select
import tty
from typing import Any

import pytest

from fakes.ax3500.device import FakeAx3500
from hw.device import Port
from hw.ports.wires import open_port
from tests.support.bench_ax3500_session import FakeBench, SteadyWheels, session_on
from tests.support.real_wires import START_S, opened

TICK_S, SETTLE_TICKS = 0.005, 100  # 0.5 s, as long as main waits
HANGING_S = 10.0  # a pty that carries nothing for so long fails the test


class CountingPort:
    """A port that knows how many bytes were written to it: as many have to come out."""

    def __init__(self, port: Port) -> None:
        self._port, self.written = port, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    def write(self, data: bytes) -> None:
        self.written += len(data)
        self._port.write(data)


class PtyBench:
    """A session on a pty, the fake at its end; time is simulated, bytes are waited for."""

    def __init__(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.port: Any = CountingPort(opened(open_port(f"serial://{os.ttyname(slave)}?baud=9600")))
        self.wheels, self.now_s, self.heard = SteadyWheels(), START_S, 0
        self.fake = FakeAx3500(self.wheels, 1, "rs232_watchdog")
        self.ax = session_on(self.port)
        os.close(slave)

    def tick(self) -> None:
        """All that was written is heard, and what is said is on its way back."""
        self.now_s += TICK_S
        self.ax.step(self.now_s)
        received = b""
        while len(received) < self.port.written - self.heard:
            assert select.select([self.master], [], [], HANGING_S)[0]
            received += os.read(self.master, 4096)
        self.heard += len(received)
        said = self.fake.exchange(self.now_s, received)
        if said:
            os.write(self.master, said)
            assert select.select([self.port.fileno()], [], [], HANGING_S)[0]

    def drive(self) -> None:
        """Until the wheels have power."""
        for power in (0.0, 0.5):
            for _ in range(400):
                self.ax.drive(power, power)
                self.tick()
                if power and min(self.wheels.power()) > 0.4:
                    return
        pytest.fail(f"the wheels never got power: {self.ax.status.cause}")


def test_every_stop_is_heard_before_the_line_is_closed() -> None:
    for _ in range(8):
        bench = PtyBench()
        bench.drive()
        bench.ax.stop()
        for _ in range(SETTLE_TICKS):
            if bench.ax.settled:
                break
            bench.tick()
        bench.port.close()
        os.close(bench.master)
        assert bench.wheels.power() == (0.0, 0.0)


@pytest.mark.parametrize("fault", ["", "mute", "cut"])
def test_it_is_settled_when_the_zeros_are_acknowledged_or_nobody_is_there(fault: str) -> None:
    bench = FakeBench("rs232_watchdog", enable=True)
    assert bench.ax.settled  # nothing was ever sent
    bench.start((0.5, 0.5))
    assert not bench.ax.settled
    bench.fake.mute, bench.wire.cut = fault == "mute", fault == "cut"
    bench.ax.stop()
    assert not bench.ax.settled
    bench.run(0.1)
    assert bench.ax.settled is (fault != "mute")
