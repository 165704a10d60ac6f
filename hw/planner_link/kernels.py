"""Kernels of the planner's map: mark cells, encode them as operations, pack them for a digest.

All arrays are rings of (size, size) cells, flat, cell (i, j) at [(j % size) * size + i % size].
Source: planner link, sections 3 (operations) and 4.
"""

from typing import NamedTuple

from core.records import I8, I32, U8
from jit import kernel

UNKNOWN, FREE, OBSTACLE, KEEP = 0, 1, 2, 3
# A mark's bits: why it is there (AGAIN: a new obstacle, published once), and what to publish
CHANGED, LOST, AGAIN, NEW, GONE = 1, 2, 4, 8, 16
ANY, HOT, MISSED = 0, 1, 2  # levels at which marks are counted: all; NEW, GONE; LOST, AGAIN
LOST_CELLS = 3  # where `Ring.counts` has these

# Which cells a pass writes: those with any of these marks; with NEAR only those near the robot
EVERY, MISSING, NEAR, REFRESH = CHANGED | LOST | AGAIN | NEW | GONE, LOST | AGAIN, 32, 64
URGENT = NEW | GONE | MISSING  # REFRESH: all cells, whatever their marks
NEAR_SHARE = 3  # near is within a third of the half-width
BLOCK = 32  # cells of a ring's row that are skipped as one while none of them is marked
LONGEST_OP = 4  # bytes: a run of up to 64 + 2^21 cells

Span = tuple[int, int, int, int]  # lowest and highest corner i, lowest and highest corner j
NO_SPAN: Span = (0, -(2**40), 0, -(2**40))  # holds no cell


class Ring(NamedTuple):
    """The published state of each cell, which are marked, and how many of them where."""

    published: U8  # (size * size,)
    marks: U8  # (size * size,) bits
    rows: I32  # (3, size) marked cells of a ring's row, by level
    blocks: I32  # (3, size * blocks) of each BLOCK cells of a row, by level
    counts: I32  # (4,) of all, by level; and the LOST ones alone
    once: I32  # (size * size + 1,) new obstacles published since they were listed: number, cells
    cleared: I32  # (size * size,) raster indices of the cells that a frame took the mark off


@kernel
def _code(cell: int, trusted: bool) -> int:
    """The state to publish for a cell of the obstacle map: 1 obstacle, 0 unknown, -1 free."""
    if cell == 1:
        return OBSTACLE
    return FREE if cell == -1 and trusted else UNKNOWN


@kernel
def _level(mark: int, level: int) -> int:
    """1 if a mark counts at a level, else 0."""
    if level == ANY:
        return int(mark != 0)
    return int(mark & (NEW | GONE if level == HOT else LOST | AGAIN) != 0)


@kernel
def _remark(at: int, reasons: int, code: int, ring: Ring) -> None:
    """Mark a cell for these reasons (CHANGED, LOST, AGAIN, or none); `code` is what is meant."""
    old, new = int(ring.marks[at]), reasons
    if reasons & (CHANGED | LOST) != 0 and code == OBSTACLE:
        new = reasons | NEW
    elif reasons & (CHANGED | LOST) != 0 and ring.published[at] == OBSTACLE:
        new = reasons | GONE
    if new == old:
        return
    ring.marks[at] = new
    size = ring.rows.shape[1]
    row = at // size
    block = row * ((size + BLOCK - 1) // BLOCK) + (at - row * size) // BLOCK
    for level in range(3):
        change = _level(new, level) - _level(old, level)
        if change != 0:
            ring.rows[level, row] += change
            ring.blocks[level, block] += change
            ring.counts[level] += change
    ring.counts[LOST_CELLS] += int(new & LOST != 0) - int(old & LOST != 0)


@kernel
def note_cells(cells: I8, trusted: bool, changed: I32, ring: Ring) -> None:
    """Mark those of the listed cells (flat indices) that differ from what was published."""
    for at in changed:
        code = _code(cells[at], trusted)
        reasons = int(ring.marks[at]) & (LOST | AGAIN if code == OBSTACLE else LOST)
        _remark(at, reasons | CHANGED if code != ring.published[at] else reasons, code, ring)


@kernel
def mark_cells(cells: I8, trusted: bool, listed: I32, kept: int, reason: int, ring: Ring) -> None:
    """Mark the listed cells (flat indices) for a reason besides those that are kept."""
    for at in listed:
        _remark(at, int(ring.marks[at]) & kept | reason, _code(cells[at], trusted), ring)


@kernel
def mark_again(cells: I8, ring: Ring) -> None:
    """Mark the listed new obstacles that still are, and were published so; they are listed no more.

    A reason that they have besides stays.
    """
    for k in range(1, ring.once[0] + 1):
        at = ring.once[k]
        if cells[at] == 1 and ring.published[at] == OBSTACLE:
            _remark(at, int(ring.marks[at]) & (CHANGED | LOST) | AGAIN, OBSTACLE, ring)
    ring.once[0] = 0


@kernel
def enter_cells(
    cells: I8,
    trusted: bool,
    old: tuple[int, int],
    new: tuple[int, int],
    span: Span,
    ring: Ring,
) -> None:
    """The window moves from corner `old` to `new`: cells that come in are unknown on both ends.

    Those that a window within `span` had are published all the same: a planner that missed the move
    by which they left has not forgotten them.
    """
    size = ring.rows.shape[1]
    end = new[0] + size
    first_in, end_in = new[0], min(old[0], end)  # columns that come in, when moving to lower i
    if new[0] > old[0]:
        first_in, end_in = max(new[0], old[0] + size), end
    for j in range(new[1], new[1] + size):
        row_in = not old[1] <= j < old[1] + size
        row_spanned = span[2] <= j < span[3] + size
        for i in range(new[0] if row_in else first_in, end if row_in else end_in):
            at = (j % size) * size + i % size
            ring.published[at] = UNKNOWN
            code = _code(cells[at], trusted)
            reasons = CHANGED if code != UNKNOWN else 0
            if row_spanned and span[0] <= i < span[1] + size:
                reasons |= LOST
            _remark(at, reasons, code, ring)


@kernel
def _op_bytes(run: int) -> int:
    """Bytes of the operation for a run; 0 for none."""
    if run <= 63:
        return int(run > 0)
    return 2 if run < 64 + 2**7 else (3 if run < 64 + 2**14 else LONGEST_OP)


@kernel
def _put(state: int, run: int, ops: U8, used: int) -> int:
    """Append one operation, or none for no run; returns the new length."""
    if run == 0:
        return used
    if run <= 63:
        ops[used] = state << 6 | run - 1
        return used + 1
    ops[used] = state << 6 | 63
    rest, used = run - 64, used + 1
    while rest >= 128:
        ops[used] = rest % 128 | 128
        rest, used = rest // 128, used + 1
    ops[used] = rest
    return used + 1


@kernel
def _has_marks(wanted: int, counts: I32, at: int) -> bool:
    """Whether of `counts` (3, n) any at `at` is of a level that a pass wants."""
    if wanted & CHANGED != 0:
        return bool(counts[ANY, at] != 0)
    hot = wanted & (NEW | GONE) != 0 and counts[HOT, at] != 0
    return bool(hot or (wanted & MISSING != 0 and counts[MISSED, at] != 0))


@kernel
def _left_out(
    wanted: int, row: int, column: int, ring_row: int, ring_column: int, ring: Ring
) -> int:
    """How many cells from this one of the window, to its row's end at most, a pass leaves out."""
    size = int(ring.rows.shape[1])
    if wanted & NEAR != 0:
        half, third = size // 2, max(1, size // 2 // NEAR_SHARE)
        if abs(row - half) > third or column > half + third:
            return size - column
        if column < half - third:
            return half - third - column
    if not _has_marks(wanted, ring.rows, ring_row):
        return size - column
    blocks, block = (size + BLOCK - 1) // BLOCK, ring_column // BLOCK
    if not _has_marks(wanted, ring.blocks, ring_row * blocks + block):
        return min(min((block + 1) * BLOCK, size) - ring_column, size - column)
    return int(ring.marks[ring_row * size + ring_column] & wanted == 0)


@kernel
def _same(at: int, most: int, code: int, ring: Ring) -> int:
    """How many cells from this one on, `most` at most, hold no mark and were published so."""
    count = 1
    while count < most and ring.marks[at + count] == 0 and ring.published[at + count] == code:
        count += 1
    return count


@kernel
def _publish(at: int, at_cell: int, code: int, ring: Ring, count: int) -> int:
    """A marked cell is published; returns how many cells `ring.cleared` lists now."""
    mark, once = int(ring.marks[at]), ring.once
    if mark != AGAIN:
        ring.cleared[count] = at_cell
        count += 1
    if mark & NEW != 0 and once[0] + 1 < once.size:
        once[0] += 1
        once[once[0]] = at
    _remark(at, 0, code, ring)
    ring.published[at] = code
    return count


@kernel
def encode_cells(
    wanted: int,
    first: int,
    end: int,
    room: int,
    for_good: bool,
    cells: I8,
    trusted: bool,
    corner: tuple[int, int],
    ring: Ring,
    ops: U8,
) -> tuple[int, int, int, int]:
    """Write wanted cells of first..end (window raster) into `ops`, at most `room` bytes.

    Only if it is for good, they count as published, marks are cleared, `once` and `cleared` grow.
    Returns the first cell written (-1: none), bytes, marks cleared, and where to go on.
    """
    size = int(ring.rows.shape[1])
    start, used, count, state, run, gap = -1, 0, 0, KEEP, 0, 0
    at_cell, row, column = first, first // size, first % size
    ring_row, ring_column = (corner[1] + row) % size, (corner[0] + column) % size
    is_refresh = is_checked = wanted == REFRESH  # checked: this cell's block is not left out
    while at_cell < end:
        at, step = ring_row * size + ring_column, 1
        left_out = int((ring.marks[at] | REFRESH) & wanted == 0)
        if not is_checked:
            left_out = _left_out(wanted, row, column, ring_row, ring_column, ring)
        if left_out > 0:
            step = min(left_out, end - at_cell)
            gap += step
        else:
            code = _code(cells[at], trusted)
            if run == 0 or gap > 0 or code != state:
                if used + _op_bytes(run) + (_op_bytes(gap) if run > 0 else 0) + LONGEST_OP > room:
                    break
                used = _put(KEEP, gap, ops, _put(state, run, ops, used)) if run > 0 else used
                start = at_cell if run == 0 else start
                state, run, gap = code, 0, 0
            if for_good and ring.marks[at] != 0:
                count = _publish(at, at_cell, code, ring, count)
            elif is_refresh and ring.marks[at] == 0:
                step = _same(at, min(size - column, size - ring_column, end - at_cell), code, ring)
            run += step
        at_cell, column, ring_column = at_cell + step, column + step, ring_column + step
        ring_column = ring_column if ring_column < size else ring_column - size
        is_checked = is_refresh or (step == 1 and ring_column % BLOCK > 0 and wanted & NEAR == 0)
        if column == size:
            row, column, ring_column, is_checked = row + 1, 0, corner[0] % size, is_refresh
            ring_row = ring_row + 1 if ring_row + 1 < size else 0
    return start, _put(state, run, ops, used), count, min(at_cell, end)


@kernel
def pack_published(corner: tuple[int, int], ring: Ring, packed: U8) -> None:
    """Window in raster order, four cells a byte, first cell in bits 1..0, into ceil(cells / 4)."""
    size = ring.rows.shape[1]
    packed[-1] = 0
    for row in range(size):
        base = ((corner[1] + row) % size) * size
        at, cell = corner[0] % size, row * size
        for k in range(cell, cell + size):
            bits = ring.published[base + at] << 2 * (k % 4)
            packed[k // 4] = bits if k % 4 == 0 else packed[k // 4] | bits
            at = at + 1 if at + 1 < size else 0
