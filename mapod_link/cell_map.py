"""The map at the receiver's end: a window of cells that stands still in the world as it moves.

Source: planner link, section 4.
"""

import zlib

import numpy as np
import numpy.typing as npt

from mapod_link.bodies import KEEP, UNKNOWN, MapUpdate
from mapod_link.frames import int16

U8 = npt.NDArray[np.uint8]
QUAD_SHIFTS = np.array([0, 2, 4, 6], np.uint8)  # four cells a byte, the first lowest


class CellMap:
    """`width` cells along map x by `height` along map y.

    Attributes:
        cells: (height, width) read-only view, row-major from the window's origin: 0 unknown,
            1 free, 2 obstacle. It shows each later change as well; copy what is to stay.
        origin: world cell (column, row) of cells[0, 0]; None until a map has arrived.
    """

    def __init__(self, width: int, height: int) -> None:
        self._cells: U8 = np.zeros((height, width), np.uint8)
        self._flat = self._cells.reshape(-1)
        self.cells = self._cells.view()
        self.cells.flags.writeable = False
        self.origin: tuple[int, int] | None = None

    @property
    def size(self) -> int:
        return self._flat.size

    def cell(self, col: int, row: int) -> int:
        height, width = self._cells.shape
        return int(self._cells[row, col]) if 0 <= row < height and 0 <= col < width else UNKNOWN

    def move(self, ox: int, oy: int, near: tuple[int, int] | None = None) -> bool:
        """Window to the place that a MAP frame tells; True if no cell was kept.

        Args:
            ox, oy: modulo 65 536.
            near: a world cell near which the origin lies, for the place is told modulo; None: it
                lies near the one before, the first near (0, 0).
        """
        height, width = self._cells.shape
        known = self.origin is not None
        old_x, old_y = self.origin or near or (0, 0)
        dx, dy = int16(ox - old_x), int16(oy - old_y)
        near_x, near_y = near or (old_x, old_y)
        self.origin = near_x + int16(ox - near_x), near_y + int16(oy - near_y)
        if not known or abs(dx) >= width or abs(dy) >= height:
            self._cells[:] = UNKNOWN
            return True
        if dx or dy:
            rows, cols = _overlap(dy, height), _overlap(dx, width)
            kept = self._cells[rows[0], cols[0]].copy()
            self._cells[:] = UNKNOWN
            self._cells[rows[1], cols[1]] = kept
        return False

    def forget(self) -> None:
        self._cells[:] = UNKNOWN

    def apply(self, update: MapUpdate) -> None:
        """The operations of a frame whose window has been moved to."""
        flat = self._flat
        for state, first, end in update.runs:
            if state != KEEP:
                flat[first:end] = state

    def digest(self) -> int:
        """CRC-32 of the window, four cells a byte, as a DIGEST frame tells it."""
        quads = np.zeros((-(-self.size // 4), 4), np.uint8)
        quads.reshape(-1)[: self.size] = self._flat
        return zlib.crc32(np.bitwise_or.reduce(quads << QUAD_SHIFTS, axis=1).tobytes())


def _overlap(step: int, length: int) -> tuple[slice, slice]:
    """Where what stays lies before and after a move by `step` cells."""
    before, after = max(step, 0), max(-step, 0)
    return slice(before, length - after), slice(after, length - before)
