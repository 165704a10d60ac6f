"""The cells that a scan has met, once each, and what it has said of them."""

import math
from typing import NamedTuple

import numpy as np

from core.mapping.along import MOST_PLACES
from core.records import F64, I8, I32, U8
from jit import kernel

VOTED, SAW_FLOOR, WENT_UNDER, NEWLY_TIED = 1, 2, 4, 8  # bits of what a scan has said


class Limits(NamedTuple):
    """From the settings."""

    h_pos_m: float
    h_neg_m: float
    height_m: float  # of the robot
    guess_m2: float  # variance of ground that is a guess
    due_m: float  # from level ground so near a beam comes back
    parts: int  # of a cell, along its edge
    soft_m: float = 0.0  # so high, soft things may be free; 0: never


class Touched(NamedTuple):
    """The cells that a scan has met, and what it has said of each."""

    slots: I32  # (cells,) where in the rest a cell is, if it is there
    at: I32  # (n,) flat indices
    bits: I8  # (n,)
    said: F64  # (n,) what was added to the log-odds
    used: I32  # (1,) so many of them
    tall: U8  # (cells,) whether something stands in a cell: few bytes for beams to look at
    seen_s: F64  # (cells,) when a beam met or passed one last
    places: I32  # (MOST_PLACES,) room for those of a beam
    oldest_s: float  # what was seen before is too old to be passed: floor must be met again


def none_touched(tall: U8, seen_s: F64) -> Touched:
    """Room for the cells of a map; `tall` and `seen_s` (cells,) are of it."""
    slots, at = np.zeros(tall.size, np.int32), np.zeros(tall.size, np.int32)
    bits, said = np.zeros(tall.size, np.int8), np.zeros(tall.size)
    used, places = np.zeros(1, np.int32), np.zeros(MOST_PLACES, np.int32)
    return Touched(slots, at, bits, said, used, tall, seen_s, places, -math.inf)


@kernel
def touch(at: int, touched: Touched) -> int:
    """Note a cell once per scan; where what is said of it is kept."""
    used, slot = touched.used[0], touched.slots[at]
    if slot < used and touched.at[slot] == at:
        return int(slot)
    touched.slots[at], touched.at[used], touched.bits[used] = used, at, 0
    touched.used[0] = used + 1
    return int(used)
