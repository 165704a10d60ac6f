"""`RingGrid`: storage and index arithmetic of a window of cells that follows the robot. No meaning.

World cell (i, j) covers [i, i + 1) * cell_m along map x and [j, j + 1) * cell_m along y. It lives
at [j % size, i % size] of every layer for as long as the window covers it: moving the window clears
what enters and copies nothing; turning the robot changes nothing at all.
Source: two-dimensional circular buffer, Fankhauser and Hutter, grid map library, 2016.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from core.grid.places import Ring
from jit import kernel

LINE_BYTES = 64
HYSTERESIS_CELLS = 2  # off centre before the window moves (link, section 4)


@kernel
def cells_about(x: float, y: float, reach: float, cell_m: float) -> tuple[int, int, int]:
    """Lowest i and j of the square of cells that holds all within reach, and how many along it."""
    i, j = math.floor((x - reach) / cell_m), math.floor((y - reach) / cell_m)
    return i, j, math.ceil(2 * reach / cell_m) + 1


def _in_words(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Records (..., ) of whole 8 bytes as numbers (..., n), which NumPy copies much faster."""
    return array.view(np.int64).reshape(*array.shape, -1) if array.dtype.names else array


def _aligned(count: int, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """Room (count,) that begins where a line of the cache does: a record of one lies in no two."""
    room = np.empty(count * dtype.itemsize + LINE_BYTES, np.uint8)
    begin = -room.ctypes.data % LINE_BYTES
    return room[begin : begin + count * dtype.itemsize].view(dtype)


class RingGrid:
    """A square window of cells with as many layers as its owner asks for."""

    def __init__(self, size: int, cell_m: float) -> None:
        self.size, self.cell_m = size, cell_m
        self.corner_i = self.corner_j = -(size // 2)  # world cell with the lowest i and j
        self._layers: list[tuple[npt.NDArray[Any], npt.NDArray[Any]]] = []  # each with its blank

    @property
    def ring(self) -> Ring:
        """Where it is now, for kernels."""
        i, j, size = self.corner_i, self.corner_j, self.size
        return Ring(i, j, i % size, j % size, size, self.cell_m)

    def layer(self, dtype: npt.DTypeLike, blank: Any) -> npt.NDArray[Any]:
        """A new (size, size) array that is `blank` wherever cells enter the window."""
        array = _aligned(self.size * self.size, np.dtype(dtype)).reshape(self.size, self.size)
        array[...] = blank
        self._layers.append((_in_words(array), _in_words(np.full(1, blank, dtype=dtype))[0]))
        return array

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """World cell (i, j) of a point in the map frame."""
        return math.floor(x_m / self.cell_m), math.floor(y_m / self.cell_m)

    def follow(self, x_m: float, y_m: float) -> bool:
        """Centre on a point of the map frame once it is off centre by more than the hysteresis."""
        i, j = self.cell_of(x_m, y_m)
        half = self.size // 2
        off = max(abs(i - half - self.corner_i), abs(j - half - self.corner_j))
        if off <= HYSTERESIS_CELLS:
            return False
        self._enter(1, self.corner_i, i - half)
        self._enter(0, self.corner_j, j - half)
        self.corner_i, self.corner_j = i - half, j - half
        return True

    def _enter(self, axis: int, old: int, new: int) -> None:
        """Blank the columns (axis 1) or rows (axis 0) that come in between two corners."""
        if abs(new - old) >= self.size:
            self.erase()
            return
        entered = range(old + self.size, new + self.size) if new > old else range(new, old)
        for index in entered:
            line = index % self.size
            for array, blank in self._layers:
                (array[:, line] if axis == 1 else array[line, :])[...] = blank

    def erase(self) -> None:
        for array, blank in self._layers:
            array[...] = blank
