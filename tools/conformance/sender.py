"""mapod's own sender at work on a map that changes and moves at random."""

import random
from collections import deque
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from core.records import FREE, OBSTACLE, ObstacleMap, PoseReport, StopZoneReport
from hw.planner_link.answers import AnswerSource
from hw.planner_link.receivers import one_link
from tools.conformance.wire import Splitter, cobs, int16

I8 = npt.NDArray[np.int8]
CODES = np.array([0, 2, 1], dtype=np.uint8)  # by cell value: unknown 0, obstacle 1, free -1
TICK_S = 0.02
STANDING = PoseReport(1.0, 2.0, 0.3, 0.0, 0.0, 0.5, 0.1, 0x7F, 0.02, 0.01, 0.05, 1)


class World:
    """(size, size) cells around a robot that wanders; world cell (i, j) at [j % size, i % size]."""

    def __init__(self, size: int, seed: int, corner: tuple[int, int] = (0, 0)) -> None:
        self.size, self.corner = size, corner
        self.epoch, self.trusted = 0, True
        self._cells: I8 = np.zeros((size, size), dtype=np.int8)
        self._random = random.Random(seed)
        self._changed: set[int] = set()
        self._way = (0, 0)  # last move, to be taken back at times

    def change(self, count: int) -> None:
        """So many short rows of cells get another meaning."""
        chance, size = self._random, self.size
        for _ in range(count):
            j, i = chance.randrange(size), chance.randrange(size)
            value = chance.choice((FREE, FREE, OBSTACLE, 0))
            for n in range(chance.randint(1, 6)):
                at = j * size + (i + n) % size
                self._cells.flat[at] = value
                self._changed.add(at)

    def wander(self) -> None:
        """Move a little, go back where it came from, seldom leap."""
        chance = self._random
        draw = chance.random()
        if draw < 0.01:
            self._way = chance.randint(-self.size - 2, self.size + 2), chance.randint(-3, 3)
        elif draw < 0.2:
            self._way = -self._way[0], -self._way[1]
        else:
            self._way = chance.randint(-2, 2), chance.randint(-2, 2)
        self._move(*self._way)

    def _move(self, di: int, dj: int) -> None:
        """What enters is unknown; the link knows that without being told."""
        (i, j), window = self.corner, np.arange(self.size)
        for cells, old, step in ((self._cells.T, i, di), (self._cells, j, dj)):
            cells[np.setdiff1d(old + step + window, old + window) % self.size] = 0
        self.corner = i + di, j + dj

    def erase(self) -> None:
        """The app begins its map anew."""
        self._cells[:] = 0
        self.epoch += 1
        self._changed.clear()

    def meant(self) -> npt.NDArray[np.uint8]:
        """(size, size) codes that a receiver should hold, in window coordinates."""
        cells = np.roll(self._cells, (-self.corner[1], -self.corner[0]), axis=(0, 1))
        codes = CODES[cells]
        return codes if self.trusted else np.where(codes == 1, 0, codes).astype(np.uint8)

    def window(self) -> ObstacleMap:
        """As the core hands it over."""
        changed = np.array(sorted(self._changed), dtype=np.int32)
        self._changed.clear()
        return ObstacleMap(self._cells, *self.corner, changed, self.epoch, self.trusted)


class FramePort:
    """The sender's port: keeps the frames that it writes, and what comes back until it reads."""

    cause, opened, backlog = "", 1, 0

    def __init__(self, datagrams: bool) -> None:
        self.datagrams = datagrams
        self.frames: list[bytes] = []  # written and not taken yet, without COBS
        self.bytes_written = 0
        self.answers: list[bytes] = []  # as they stand on the wire
        self._splitter = Splitter()

    def fileno(self) -> int:
        """None that the operating system knows."""
        return -1

    def poll(self, now_s: float) -> bool:
        """Always open."""
        return True

    def read(self) -> list[bytes]:
        answers, self.answers = self.answers, []
        return answers

    def write(self, data: bytes) -> None:
        self.bytes_written += len(data)
        whole = [data] if self.datagrams else self._splitter.feed(data)
        self.frames += [frame for frame in whole if frame]

    def give(self, frame: bytes) -> None:
        """An answer, without COBS."""
        self.answers.append(frame if self.datagrams else cobs(frame) + b"\0")

    def close(self) -> None:
        """Nothing is held."""


class Sender:
    """One run of the sender after the other, and all that they have sent."""

    def __init__(self, world: World, datagrams: bool, key: bytes | None, baud: int | None) -> None:
        self.world, self.port = world, FramePort(datagrams)
        self.session = 0
        self.sent: deque[tuple[int, bytes]] = deque()  # number and frame, for `sent_until`
        self._key, self._baud = key, baud

    def start(self, session: int, first_seq: int = 1) -> None:
        """A new run, as after its power was off."""
        self.session = session
        self._link = one_link(
            self.port,
            size=self.world.size,
            session=session,
            tick_s=TICK_S,
            line_baud=self._baud,
            key=self._key,
            first_seq=first_seq,
        )
        self.port.answers.clear()
        self.sent.clear()

    def step(
        self, now_s: float, zone: StopZoneReport | None = None, tiles: AnswerSource | None = None
    ) -> list[bytes]:
        """One tick; gives its frames."""
        self._link.step(now_s, STANDING, self.world.window(), zone, tiles)
        frames, self.port.frames = self.port.frames, []
        self.sent += ((int.from_bytes(frame[2:4], "little"), frame) for frame in frames)
        return frames

    def sent_until(self, last: int) -> Iterator[bytes]:
        """Frames up to that number, each of them once: for a receiver that misses none."""
        while self.sent and int16(last - self.sent[0][0]) >= 0:
            yield self.sent.popleft()[1]

    @property
    def frames_sent(self) -> int:
        """Of this run."""
        return self._link.frames_sent
