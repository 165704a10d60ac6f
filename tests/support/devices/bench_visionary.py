"""A fake Visionary and its driver on two wires in memory, and a clock."""

from typing import Any

import numpy as np

from core.records import F64, DepthImage
from fakes.visionary.device import FakeVisionary
from fakes.visionary.models import Model
from fakes.visionary.picture import Sight
from fakes.wires.wire import MemoryPort, Wire
from fakes.world.simple import Ground
from hw.visionary.camera import Visionary
from hw.visionary.options import VisionaryOptions

TICK_S = 0.004  # no part of a frame's period
BY_FOUR = b"\x02"  # binningOption


def options_of(**given: Any) -> VisionaryOptions:
    usual: dict[str, Any] = {
        "control": "cola_2",
        "period_s": 0.05,
        "level": "authorized_client",
        "password": "CLIENT",
        "min_confidence": 6554,
        "latency_s": 0.03,
    }
    return VisionaryOptions(**(usual | given))


def points_of(image: DepthImage) -> F64:
    """(rows, columns, 3) metres, sensor frame; NaN where there is none."""
    points = np.array(image.camera.offset_m) + image.numbers[..., None] * image.camera.rays
    return np.where(image.numbers[..., None] > 0, points, np.nan)


class Bench:
    """One camera before a wall, of few pixels where it can, and the driver."""

    def __init__(self, model: Model = "t_mini", sight: Sight | None = None, **given: Any) -> None:
        self.fake = FakeVisionary(model, sight or Ground("wall:1.6").met, 1)
        if model == "t_mini":
            self.fake.memory.written["binningOption"] = BY_FOUR
        self.control, self.stream = MemoryPort(), MemoryPort()
        self.wires = (
            Wire(self.fake.control, self.control, 1),
            Wire(self.fake.stream, self.stream, 2),
        )
        control = "cola_2" if model == "t_mini" else "cola_b"
        self.numbers: list[int] = []  # of ports that it opened
        self.camera = Visionary(
            self.control, options_of(**({"control": control} | given)), self._opened
        )
        self.now_s = 100.0

    def _opened(self, number: int) -> MemoryPort:
        self.numbers.append(number)
        return self.stream

    def run(self, seconds: float) -> list[DepthImage]:
        images: list[DepthImage] = []
        for _ in range(round(seconds / TICK_S)):
            for wire in self.wires:
                wire.step(self.now_s)
            images += self.camera.step(self.now_s)
            self.now_s += TICK_S
        return images

    @property
    def told(self) -> tuple[str, str]:
        return self.camera.status.state, self.camera.status.cause

    @property
    def reasons(self) -> set[str]:
        return {rejection.reason for rejection in self.camera.status.rejections}

    def pull(self, is_in: bool) -> None:
        """The plugs of both wires."""
        self.control.connected = self.stream.connected = is_in
