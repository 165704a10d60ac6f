"""The CAS filter (certainty assisted spatial) and the fill, over the eight neighbours of a cell.

    m        lower weighted median of the neighbours' heights, weights their certainties: the
             smallest height at which the summed weight reaches half of all
    corrupt  c <= C and |h - m| > H, and no neighbour with c > C lies within H of h
    (11)     h of a cell without certainty: m of its neighbours that are not corrupt, if 3 are known

A corrupt cell is told as unknown; its height and certainty are kept and may grow, for else what
newly comes in sight would be thrown away scan after scan. All are judged by the heights and
certainties as they are, so that no order of the cells matters. A filled height is a guess for who
asks for heights: it makes no cell free. The rule is ours: that of Ye and Borenstein, on whom the
paper stands, was not to be had.
Source: docs/certainty.md.
"""

import math

from core.grid.places import index_of, world_cell
from core.grid.touched import Touched
from core.mapping.certainty.cells import CORRUPT, Cells, Rules
from core.records import F64, I64
from jit import kernel

LEAST_KNOWN = 3  # neighbours, for a fill


@kernel
def _weight(at: int, cells: Cells, marks: int) -> int:
    """Certainty of a cell; 0 where it is outside of the map, or has one of these marks."""
    if at < 0 or cells.marks[at] & marks != 0:
        return 0
    return int(cells.certainty[at])


@kernel
def median_about(i: int, j: int, cells: Cells, marks: int) -> tuple[float, int]:
    """Of the neighbours of a world cell without these marks; and how many are known. NaN: none."""
    known, total, median = 0, 0, math.nan
    for n in range(9):
        at = index_of(i + n % 3 - 1, j + n // 3 - 1, cells.ring)
        weight = _weight(at, cells, marks) if n != 4 else 0
        total += weight
        known += 1 if weight > 0 else 0
    for n in range(9):
        at = index_of(i + n % 3 - 1, j + n // 3 - 1, cells.ring)
        if n == 4 or _weight(at, cells, marks) == 0:
            continue
        summed, height = 0, cells.height_m[at]
        for m in range(9):
            other = index_of(i + m % 3 - 1, j + m // 3 - 1, cells.ring)
            weight = _weight(other, cells, marks) if m != 4 else 0
            if weight > 0 and cells.height_m[other] <= height:
                summed += weight
        if 2 * summed >= total and not median <= height:
            median = height
    return median, known


@kernel
def _is_borne_out(i: int, j: int, height: float, cells: Cells, rules: Rules) -> bool:
    """Whether a certain neighbour of a world cell lies as high."""
    for n in range(9):
        at = index_of(i + n % 3 - 1, j + n // 3 - 1, cells.ring)
        if n == 4 or at < 0 or cells.certainty[at] <= rules.cas_certainty:
            continue
        if abs(cells.height_m[at] - height) <= rules.cas_height_m:
            return True
    return False


@kernel
def is_corrupt(at: int, cells: Cells, rules: Rules) -> bool:
    """Whether the filter takes a cell (flat index) for a mixed pixel or another artefact."""
    if not 0 < cells.certainty[at] <= rules.cas_certainty:
        return False
    i, j = world_cell(at, cells.ring)
    median, known = median_about(i, j, cells, 0)
    if known == 0 or abs(cells.height_m[at] - median) <= rules.cas_height_m:
        return False
    return not _is_borne_out(i, j, cells.height_m[at], cells, rules)


@kernel
def mark(listed: Touched, cells: Cells, rules: Rules) -> None:
    """Mark those of the listed cells that are corrupt, and unmark the others."""
    for k in range(listed.used[0]):
        at = listed.at[k]
        cells.marks[at] &= ~CORRUPT & 0xFF
        if rules.cas and is_corrupt(at, cells, rules):
            cells.marks[at] |= CORRUPT


@kernel
def heights_at(at: I64, cells: Cells, fills: bool, out: F64) -> None:
    """Fill `out` (n,) with the heights of cells (flat), map frame; NaN: not known."""
    for k in range(at.size):
        out[k] = math.nan
        if _weight(at[k], cells, CORRUPT) > 0:
            out[k] = cells.height_m[at[k]]
        elif fills:
            i, j = world_cell(at[k], cells.ring)
            median, known = median_about(i, j, cells, CORRUPT)
            if known >= LEAST_KNOWN:
                out[k] = median
