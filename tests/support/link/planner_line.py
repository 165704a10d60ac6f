"""A sender and the fakes' receiver on a line that loses frames, for tests of the planner link."""

import random

import numpy as np
import numpy.typing as npt

from core.records import FREE, OBSTACLE, ObstacleMap, PoseReport, StopZoneReport, SweepPoints
from fakes.planner_mcu.receiver import FakePlanner
from fakes.wires.wire import MemoryPort
from hw.planner_link.answers import AnswerSource
from hw.planner_link.receivers import one_link
from hw.planner_link.tiles import F32
from hw.planner_link.vectors import VectorSource
from mapod_link.serial_line import serial_from_frame

I8 = npt.NDArray[np.int8]
I32 = npt.NDArray[np.int32]
POSE_REPORT = PoseReport(1.0, 2.0, 0.3, 0.0, 0.0, 0.5, 0.1, 0x7F, 0.02, 0.01, 0.05, 1)
ZONE = StopZoneReport(
    1.25, 1.48, 0.0, np.inf, 1.92, 0.65, 0.0, 0.43, -0.7854, (np.inf,) * 8, 2, 0b0011
)
CODE = np.array([0, 2, 1], dtype=np.uint8)  # by cell value: unknown, obstacle (1), free (-1)


class Sky:
    """A window that changes and moves at random, as the obstacle map does."""

    def __init__(self, size: int, seed: int, corner: tuple[int, int] = (0, 0)) -> None:
        self.size, self.random = size, np.random.default_rng(seed)
        self.cells: I8 = np.zeros((size, size), dtype=np.int8)
        self.corner = corner
        self.epoch = 0
        self.trusted = True
        self._changed: list[int] = []

    def change(self, count: int) -> None:
        """Some cells get another meaning; in lumps, as beams touch them."""
        for _ in range(count):
            j, i = self.random.integers(0, self.size, 2)
            value = self.random.choice([FREE, FREE, OBSTACLE, 0])
            for n in range(int(self.random.integers(1, 6))):
                at = (int(j), int(i + n) % self.size)
                self.cells[at] = value
                self._changed.append(at[0] * self.size + at[1])

    @property
    def every_other(self) -> npt.NDArray[np.bool_]:
        """A pattern that takes a run for each cell."""
        pattern = np.zeros((self.size, self.size), dtype=np.bool_)
        pattern[::2, ::2] = True
        return pattern

    def show(self, where: npt.NDArray[np.bool_], value: int) -> None:
        self.cells[where] = value
        self._changed += np.flatnonzero(where).tolist()

    def move(self, di: int, dj: int) -> None:
        old_i, old_j = self.corner
        self.corner = (old_i + di, old_j + dj)
        for i in range(self.corner[0], self.corner[0] + self.size):
            if not old_i <= i < old_i + self.size:
                self.cells[:, i % self.size] = 0
        for j in range(self.corner[1], self.corner[1] + self.size):
            if not old_j <= j < old_j + self.size:
                self.cells[j % self.size, :] = 0

    def window(self) -> ObstacleMap:
        changed: I32 = np.array(sorted(set(self._changed)), dtype=np.int32)
        self._changed.clear()
        return ObstacleMap(self.cells, *self.corner, changed, self.epoch, self.trusted)

    def meant(self) -> npt.NDArray[np.uint8]:
        """What the planner should hold, in window coordinates."""
        cells = np.roll(self.cells, (-self.corner[1], -self.corner[0]), axis=(0, 1))
        codes = CODE[cells]
        return codes if self.trusted else np.where(codes == 1, 0, codes).astype(np.uint8)


class SkyTiles:
    """Tiles of a sky: its states, and numbers by place for the other layers; and a sweep."""

    def __init__(self, sky: Sky) -> None:
        self.sky, self.calls = sky, 0
        self.sweep: SweepPoints | None = None

    def maybe_scan(self) -> SweepPoints | None:
        return self.sweep

    def values(self, layer: str, i: int, j: int, width: int, first: int, count: int) -> F32 | None:
        self.calls += 1
        if layer == "slope":
            return None
        places = [(i + k % width, j + k // width) for k in range(first, first + count)]
        return np.array([self._value(layer, *place) for place in places], dtype=np.float32)

    def _value(self, layer: str, i: int, j: int) -> float:
        size, (corner_i, corner_j) = self.sky.size, self.sky.corner
        if not (0 <= i - corner_i < size and 0 <= j - corner_j < size):
            return np.nan
        if layer == "state":
            return float(self.sky.cells[j % size, i % size])
        height_m = ((7 * i + 13 * j) % 400 - 200) / 1000
        return height_m if layer == "height" else abs(height_m) / 1000


class HeldPort(MemoryPort):
    """A wire whose far end takes bytes only when the test says so."""

    held = False

    @property
    def backlog(self) -> int:
        return 100_000 if self.held else 0

    @backlog.setter
    def backlog(self, waiting: int) -> None:
        """The test alone decides."""


class Line:
    """A sender and a receiver with a wire in between that may lose frames."""

    def __init__(
        self,
        sky: Sky,
        *,
        baud: int | None = None,
        rate_hz: float = 50,
        loss: float = 0.0,
        ack_every: int = 1,
        key: bytes | None = None,
        seed: int = 0,
        port: MemoryPort | None = None,
        session: int = 77,
        first_seq: int = 1,
        push: bool = True,
        zone: StopZoneReport | None = None,
        tiles: AnswerSource | None = None,
        vectors: VectorSource | None = None,
        planner: FakePlanner | None = None,
    ) -> None:
        self.sky, self.rate_hz, self.loss = sky, rate_hz, loss
        self.port = port or MemoryPort(datagrams=baud is None)
        self.link = one_link(
            self.port, size=sky.size, cell_mm=200, session=session, tick_s=1 / rate_hz,
            line_baud=baud, key=key, first_seq=first_seq, push=push,
        )  # fmt: skip
        self.zone, self.tiles, self.vectors = zone, tiles, vectors
        self.planner = planner or FakePlanner(ack_every=ack_every, key=key)
        self.now_s, self.random = 100.0, random.Random(seed)
        self.tick_bytes: list[int] = []
        self.frames: list[bytes] = []  # of the last tick

    def tick(self) -> None:
        self.now_s += 1 / self.rate_hz
        told = self.sky.window(), self.zone, self.tiles, self.vectors
        self.link.step(self.now_s, POSE_REPORT, *told)
        pieces = self.port.take_datagrams()
        self.tick_bytes.append(sum(map(len, pieces)))
        self.frames = list(pieces)
        if self.port.datagrams and len(pieces) > 1 and self.random.random() < self.loss:
            pieces[-2:] = [pieces[-1], pieces[-2], pieces[-2]]  # one overtakes, one comes twice
        for piece in pieces:
            if self.random.random() < self.loss:
                continue
            if self.port.datagrams:
                self.planner.feed_datagram(self.now_s, piece)
            else:
                self.planner.feed_stream(self.now_s, piece)
        for frame in self.planner.poll(self.now_s):
            if self.random.random() >= self.loss:
                self.port.give(frame if self.port.datagrams else serial_from_frame(frame))

    def settle(self, seconds: float) -> None:
        for _ in range(round(seconds * self.rate_hz)):
            self.tick()

    def is_up_to_date(self) -> bool:
        """Whether the planner has the window, and the newest frame: else no gap can show yet."""
        corner, origin = self.link._map.corner or (0, 0), self.planner.origin
        same = origin and all((a - b) % 2**16 == 0 for a, b in zip(origin, corner, strict=True))
        return bool(same) and self.planner.numbers.last == self.link._scheduler.seq % 2**16

    def told(self) -> npt.NDArray[np.uint8]:
        """What the sender takes the planner to hold, in window coordinates."""
        size, corner = self.sky.size, self.link._map.corner
        assert corner is not None
        return np.roll(
            self.link._map.published.reshape(size, size), (-corner[1], -corner[0]), axis=(0, 1)
        )

    def holds_what_is_meant(self) -> bool:
        return bool(np.array_equal(self.planner.window(), self.sky.meant()))
