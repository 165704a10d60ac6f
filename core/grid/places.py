"""Where a place lies: in which cell of a ring, and in which part of that. No meaning."""

import math

from jit import kernel

PART_M, MOST_PARTS = 0.05, 4  # edge of a part of a cell, about, and parts along an edge at most


@kernel
def index_in(i: int, j: int, corner: tuple[int, int], size: int) -> int:
    """Flat index of a world cell, -1 outside of the window."""
    if not (0 <= i - corner[0] < size and 0 <= j - corner[1] < size):
        return -1
    return (j % size) * size + i % size


@kernel
def flat_index(x: float, y: float, cell_m: float, corner: tuple[int, int], size: int) -> int:
    """Flat index of the cell of a point, -1 outside of the window."""
    return index_in(math.floor(x / cell_m), math.floor(y / cell_m), corner, size)


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
