"""Where a place lies: in which cell of a ring, and in which part of that. No meaning."""

import math
from typing import NamedTuple

from jit import kernel

PART_M, MOST_PARTS = 0.05, 4  # edge of a part of a cell, about, and parts along an edge at most


class Ring(NamedTuple):
    """A ring where it is now, as kernels are given it, so that they divide nothing for an index."""

    corner_i: int  # world cell with the lowest i and j,
    corner_j: int
    turn_i: int  # and its column and row
    turn_j: int
    size: int
    cell_m: float


@kernel
def index_of(i: int, j: int, ring: Ring) -> int:
    """Flat index of a world cell; -1 outside of the window."""
    size, column, row = ring.size, i - ring.corner_i, j - ring.corner_j
    if not (0 <= column < size and 0 <= row < size):
        return -1
    column, row = column + ring.turn_i, row + ring.turn_j
    column = column - size if column >= size else column
    row = row - size if row >= size else row
    return row * size + column


@kernel
def cell_at(x: float, y: float, ring: Ring) -> int:
    """Flat index of the cell of a point; -1 outside of the window."""
    return index_of(math.floor(x / ring.cell_m), math.floor(y / ring.cell_m), ring)


@kernel
def world_cell(at: int, ring: Ring) -> tuple[int, int]:
    """The world cell of a flat index."""
    size = ring.size
    row = at // size
    i, j = at - row * size - ring.turn_i, row - ring.turn_j
    i, j = i + size if i < 0 else i, j + size if j < 0 else j
    return ring.corner_i + i, ring.corner_j + j


@kernel
def from_centre(x: float, cell_m: float) -> float:
    """How far a point lies from the middle of its cell along an axis."""
    return x - (math.floor(x / cell_m) + 0.5) * cell_m


def parts_of(cell_m: float) -> int:
    """Into how many parts along an edge a cell is divided, 1 to 4: each some 5 cm."""
    return max(1, min(MOST_PARTS, round(cell_m / PART_M)))


@kernel
def part_bit(x: float, y: float, cell_m: float, parts: int) -> int:
    """The bit of the part of its cell in which a point lies."""
    u, v = x / cell_m, y / cell_m
    column = min(parts - 1, int((u - math.floor(u)) * parts))
    row = min(parts - 1, int((v - math.floor(v)) * parts))
    return 1 << (row * parts + column)


@kernel
def ones(bits: int) -> int:
    """How many of 16 bits are set: summed in pairs, in fours, in eights, in all."""
    bits = (bits & 0x5555) + (bits >> 1 & 0x5555)
    bits = (bits & 0x3333) + (bits >> 2 & 0x3333)
    bits = (bits & 0x0F0F) + (bits >> 4 & 0x0F0F)
    return (bits & 0xFF) + (bits >> 8)
