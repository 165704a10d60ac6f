"""Floor that is seen again where something seemed to be: what an attitude that was off has said.

For some scans in a row, floor alone was seen in a cell. Then floor is not missing there; and
something low, in each part of which floor has been seen since, was the floor itself, lifted by an
attitude that leant. Under what is higher than LOW_M floor may well be seen: that stays.
Source: design, section 7 (clearing).
"""

from core.mapping.beams.cells import Cells, forget
from jit import kernel

FLOOR_AGAIN = 4  # scans in a row that see floor alone end what a wrong one has said,
FLOOR_FOR_LONG, LOW_M = 8, 0.20  # and so many that something so low stood where they see floor


@kernel
def _ends_lack(cells: Cells, at: int) -> None:
    """Forget that floor lacked, unless parts still lack it."""
    cell = cells[at]
    if cell.miss_bits & ~cell.floor_bits == 0:
        cell.below, cell.miss, cell.deep, cell.miss_bits = 0, 0, 0, 0
        if cell.above == 0:
            cell.mean_m, cell.count = cell.floor_m, cell.floor_count


@kernel
def _was_floor(cells: Cells, at: int) -> bool:
    """Whether all that stood here was low, and floor has since been seen in each part of it."""
    cell = cells[at]
    return bool(cell.above > 0 and cell.top_m <= LOW_M and cell.high_bits & ~cell.floor_bits == 0)


@kernel
def see_floor_again(cells: Cells, at: int) -> None:
    """Floor alone was seen in a cell in FLOOR_AGAIN scans in a row, or more."""
    cell = cells[at]
    if cell.below + cell.miss > 0:
        _ends_lack(cells, at)
    if cell.floor_run >= FLOOR_FOR_LONG and _was_floor(cells, at):
        forget(cells, at)
