"""Fakes on ptys and TCP in real time, in a thread, for tests of programs that wait for answers."""

import select
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import numpy as np

from fakes.mti.device import FakeMti
from fakes.wires.wire import PtyWire, TcpWire

STEP_S = 0.002


class StillWheels:
    """Wheels at rest, which remember the power they got."""

    power: tuple[float, float] = (0.0, 0.0)

    def counts(self) -> tuple[float, float]:
        return 0.0, 0.0

    def set_power(self, one: float, two: float) -> None:
        self.power = (one, two)


def level_sensor(yaw_rad: float = 0.0, model: str = "MTi-28") -> FakeMti:
    """An attitude sensor that lies still and level; yaw counter-clockwise from north."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    R_earth_sensor = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    still = R_earth_sensor, np.zeros(3), np.array([0.0, 0.0, 9.81])
    return FakeMti(lambda t_s: still, 1, model)


@contextmanager
def served(*wires: PtyWire | TcpWire) -> Iterator[None]:
    """The wires stepped by the clock until the block ends; then closed."""
    done = threading.Event()

    def serve() -> None:
        while not done.is_set():
            for wire in wires:
                wire.step(time.monotonic())
            select.select([], [], [], STEP_S)

    thread = threading.Thread(target=serve)
    with ExitStack() as open_wires:
        for wire in wires:
            open_wires.enter_context(closing(wire))
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
