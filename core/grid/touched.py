"""The cells that a scan has met, once each, and what it has said of them."""

from typing import NamedTuple

import numpy as np

from core.records import F64, I8, I32
from jit import kernel


class Touched(NamedTuple):
    """Cells of a ring; the meaning of what is said of them is their owner's."""

    slots: I32  # (cells,) where in the rest a cell is, if it is there
    at: I32  # (n,) flat indices
    bits: I8  # (n,)
    said: F64  # (n,)
    used: I32  # (1,) so many of them

    @classmethod
    def none(cls, cells: int) -> "Touched":
        """Room for as many."""
        slots, at = np.zeros((2, cells), np.int32)
        return cls(slots, at, np.zeros(cells, np.int8), np.zeros(cells), np.zeros(1, np.int32))


@kernel
def touch(at: int, touched: Touched) -> int:
    """Note a cell once per scan, which begins with none used; where what is said of it is kept."""
    used, slot = touched.used[0], touched.slots[at]
    if slot < used and touched.at[slot] == at:
        return int(slot)
    touched.slots[at], touched.at[used], touched.bits[used], touched.said[used] = used, at, 0, 0.0
    touched.used[0] = used + 1
    return int(used)
