"""Which things are near: a hash of square cells over boxes. A change costs the same in any map."""

import math
from collections.abc import Iterator
from itertools import product

Box = tuple[float, float, float, float]  # x and y of the lowest corner, then of the highest, m
CELL_M = 2.0  # a view of some metres has tens of cells; most objects lie in one to four
MOST_CELLS = 1000  # of a box: larger ones are few, and looked at each time


class BoxIndex:
    """Boxes by id; asked for all that may touch a box."""

    def __init__(self) -> None:
        self._cells: dict[tuple[int, int], set[int]] = {}
        self._boxes: dict[int, Box] = {}
        self._large = set[int]()

    def put(self, number: int, box: Box) -> None:
        """A new box, or another one for an id that is there."""
        before = self._boxes.get(number)
        if before is not None and _ends_of(before) == _ends_of(box):
            self._boxes[number] = box
            return
        self.remove(number)
        self._boxes[number] = box
        if _is_large(box):
            self._large.add(number)
            return
        for cell in _cells_of(box):
            self._cells.setdefault(cell, set()).add(number)

    def remove(self, number: int) -> None:
        box = self._boxes.pop(number, None)
        if box is None:
            return
        if _is_large(box):
            self._large.remove(number)
            return
        for cell in _cells_of(box):
            self._cells[cell].discard(number)
            if not self._cells[cell]:
                del self._cells[cell]

    def near(self, box: Box) -> list[int]:
        """Ids, ascending, of all boxes that touch this one."""
        (x0, y0, x1, y1), boxes = box, self._boxes
        cells = () if _is_large(box) else _cells_of(box)
        near = self._large.union(*(self._cells.get(cell, ()) for cell in cells))
        return sorted(
            n
            for n in (boxes if _is_large(box) else near)
            if boxes[n][0] <= x1 and boxes[n][2] >= x0 and boxes[n][1] <= y1 and boxes[n][3] >= y0
        )


def _ends_of(box: Box) -> tuple[int, int, int, int]:
    """Its first cell along x and y, and its last."""
    i, j, k, m = (math.floor(value / CELL_M) for value in box)
    return i, j, k, m


def _is_large(box: Box) -> bool:
    i, j, k, m = _ends_of(box)
    return (k + 1 - i) * (m + 1 - j) > MOST_CELLS


def _cells_of(box: Box) -> Iterator[tuple[int, int]]:
    i, j, k, m = _ends_of(box)
    return product(range(i, k + 1), range(j, m + 1))
