"""A map that changes and moves at random, as the obstacle map does, for mapod's own sender."""

import random

import numpy as np
import numpy.typing as npt

from core.records import FREE, OBSTACLE, ObstacleMap, PoseReport

I8 = npt.NDArray[np.int8]
CODES = np.array([0, 2, 1], dtype=np.uint8)  # by cell value: unknown 0, obstacle 1, free -1
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
        (old_i, old_j), size = self.corner, self.size
        self.corner = old_i + di, old_j + dj
        for i in range(self.corner[0], self.corner[0] + size):
            if not old_i <= i < old_i + size:
                self._cells[:, i % size] = 0
        for j in range(self.corner[1], self.corner[1] + size):
            if not old_j <= j < old_j + size:
                self._cells[j % size, :] = 0

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
