"""The way of the rolling refresh round the window, again and again, while the window moves.

A receiver that lost a frame is whole again, even if it never answers, as soon as the refresh has
come round to where it was when the frame after that one was sent: every cell has then either been
sent again, or entered the window since, and is unknown to all who have heard of that.
Source: planner link, section 6.
"""

from collections import deque
from dataclasses import dataclass

MARKS = 64  # places of a round that are remembered


@dataclass(slots=True)
class Mark:
    """A slice of the refresh began here."""

    seq: int  # of its frame, unwrapped
    lap: int
    row: int  # of the window; may lie outside it
    column: int


class RefreshCursor:
    """Cell by cell in raster order; `cell` is the next one to send."""

    def __init__(self, size: int) -> None:
        self._size = size
        self.cell, self._lap = 0, 0
        self._marks: deque[Mark] = deque()
        self._marked_cell = -1  # where the newest mark was set, as `cell` then was

    def begin(self) -> None:
        """A new epoch: nothing of it was sent."""
        self.cell, self._lap, self._marked_cell = 0, 0, -1
        self._marks.clear()

    def note_slice(self, seq: int) -> None:
        """The next cells go out in frame `seq`."""
        apart = self.cell - self._marked_cell
        if self._marked_cell < 0 or apart < 0 or apart >= self._size**2 // MARKS:
            self._marks.append(Mark(seq, self._lap, *divmod(self.cell, self._size)))
            self._marked_cell = self.cell

    def advance(self, cell: int) -> int:
        """Cells before `cell` have been sent; the frame of the newest mark passed again, or 0."""
        self.cell = cell
        if cell >= self._size**2:
            self.cell, self._lap = 0, self._lap + 1
        newest = 0
        while self._marks and self._is_round(self._marks[0]):
            newest = self._marks.popleft().seq
        return newest

    def _is_round(self, mark: Mark) -> bool:
        row, column = divmod(self.cell, self._size)
        at = (mark.row, mark.column) if mark.row >= 0 else (0, 0)
        return self._lap > mark.lap + 1 or (self._lap == mark.lap + 1 and (row, column) >= at)

    def follow(self, di: int, dj: int) -> None:
        """The window moved by (di, dj) cells: all places stay where they are in the world."""
        most = self._size - 1
        row, column = divmod(self.cell, self._size)
        if self.cell > 0:
            row, column = row - dj, max(0, min(most, column - di))
            self.cell = max(0, min(most, row)) * self._size + (column if row >= 0 else 0)
        for mark in self._marks:
            mark.row, mark.column = mark.row - dj, mark.column - di
        self._marked_cell = -1
