"""What is taken out of a scan before it is mapped: small groups, and what stands in one alone.

A reading that goes is NaN in the ranges, or 0 in `kept`. None of these steps makes anything up.
Source: docs/certainty.md. The wording of (12) was not to be had.
"""

import math
from typing import NamedTuple

from core.mapping.rays import MIN_RANGE_M
from core.mapping.shadows import NOTHING_M
from core.records import F64, U8
from jit import kernel

BESIDE = 1  # a beam of another scan may be so many beside the one that looks the same way


class Look(NamedTuple):
    """One scan, as kernels are given it: which way its beams went, and what they met."""

    ranges_m: F64  # (n,); NaN: nothing, or it was taken out
    shift: float  # beams that lie between it and the scan that is judged; NaN: not comparable


@kernel
def take(given_m: F64, ranges_m: F64) -> None:
    """Fill `ranges_m` (n,) with what was measured and is not the scanner's own housing."""
    for k in range(given_m.size):
        ranges_m[k] = given_m[k] if given_m[k] >= MIN_RANGE_M else math.nan


@kernel
def drop_small_groups(given_m: F64, ranges_m: F64, gap_m: float, least: int) -> None:
    """Range clustering: neighbours whose ranges differ by more than a gap are of two groups.

    A group of fewer readings than `least` goes. A beam that met nothing ends a group; one that the
    shadow filter took out (`NOTHING_M` in `given_m`) does not, and counts: it hides what was there.
    """
    first = 0
    for k in range(1, ranges_m.size + 1):
        if k < ranges_m.size:
            is_hidden = given_m[k] == NOTHING_M or given_m[k - 1] == NOTHING_M
            if is_hidden or abs(ranges_m[k] - ranges_m[k - 1]) <= gap_m:
                continue
        if k - first < least:
            ranges_m[first:k] = math.nan
        first = k


@kernel
def _supports(range_m: float, beam: int, other: Look, within_m: float) -> bool:
    """Whether another scan met something as far away, the same way."""
    if math.isnan(other.shift):
        return False
    middle = math.floor(beam + other.shift + 0.5)
    for j in range(max(0, middle - BESIDE), min(other.ranges_m.size, middle + BESIDE + 1)):
        if abs(other.ranges_m[j] - range_m) <= within_m:
            return True
    return False


@kernel
def keep_all(ranges_m: F64, kept: U8) -> None:
    """Fill `kept` (n,): 1 where there is a reading."""
    for k in range(ranges_m.size):
        kept[k] = 0 if math.isnan(ranges_m[k]) else 1


@kernel
def keep_supported(ranges_m: F64, before: Look, after: Look, within_m: float, kept: U8) -> None:
    """(12) Fill `kept` (n,): 1 where the scan before or the one after supports a reading."""
    for k in range(ranges_m.size):
        kept[k] = 0
        if math.isnan(ranges_m[k]):
            continue
        if _supports(ranges_m[k], k, before, within_m) or _supports(
            ranges_m[k], k, after, within_m
        ):
            kept[k] = 1
