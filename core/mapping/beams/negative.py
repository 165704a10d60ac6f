"""Floor that was due by a beam's direction and did not show: a ditch, a drop, a black floor.

Such a beam went on below the ground, or never came back. The parts of cells between where it should
have met the floor and where it was seen are marked; parts that show floor to another beam count no
more (core/mapping/beams/classifier.py).
Source: design, section 7.
"""

import math

from core.grid.places import flat_index, part_bit
from core.mapping.beams.cells import Cells, known, touch, touch_around
from core.mapping.beams.ground_plane import Ground, ground_m
from core.mapping.rays import MIN_RANGE_M
from core.records import F64, I32
from jit import kernel

LOWER_M = 0.012  # below the ground by less, a return is floor;
BELOW_M, BELOW_SLOPE = 0.015, 0.0006  # by so much below the floor before it, and by range, a hole,
NODDING_M = 0.065  # or by so much while the robot nods, turns or stands;
SHALLOW_M = 9.5  # floor that is due farther off shows none: the attitude's noise is as large
MAX_EVIDENCE = 60_000  # scans that say the same; more say no more
BEFORE_M = 0.12  # steps back from where a beam should meet the floor
NEAR_BACK, LOOKS_BACK = 3, 8  # in which there must be floor, and what it rises from is looked for
RAISED_M = 0.03
LEAST_LEVEL = 1e-6  # of a beam's direction
MAX_HOLE_STEPS = 256  # along one beam below the ground, a part of a cell each


@kernel
def no_floor(
    x: float,
    y: float,
    skip: int,
    is_sure: bool,
    window: tuple[int, int, int, float],
    sub: int,
    cells: Cells,
    serial: int,
    touched: I32,
    used: int,
) -> int:
    """Floor was due at a place and did not show; the cell `skip` is left out."""
    at = flat_index(x, y, window[3], (window[0], window[1]), window[2])
    if at < 0 or at == skip:
        return used
    if not known(cells, at):
        used = touch_around(at, window[2], cells, serial, touched, used)
    cell = cells[at]
    cell.miss_bits |= part_bit(x, y, window[3], sub)
    if cell.miss_scan != serial and cell.miss < MAX_EVIDENCE:
        cell.miss_scan = serial
        cell.miss += 1
    if is_sure and cell.miss_sure_scan != serial:
        cell.miss_sure_scan = serial
        cell.miss_sure += 1
    return touch(at, cells, serial, touched, used)


@kernel
def missed(
    origin: F64,
    ray: F64,
    due: float,
    seen: float,
    is_sure: bool,
    window: tuple[int, int, int, float],
    sub: int,
    cells: Cells,
    serial: int,
    touched: I32,
    used: int,
) -> int:
    """A beam went on where floor was due: from there to where it was seen (inf: never) is none."""
    corner = (window[0], window[1])
    if math.isinf(seen):
        x, y = origin[0] + due * ray[0], origin[1] + due * ray[1]
        return no_floor(x, y, -1, is_sure, window, sub, cells, serial, touched, used)
    step = window[3] / sub
    level = math.hypot(ray[0], ray[1])
    last = flat_index(
        origin[0] + seen * ray[0], origin[1] + seen * ray[1], window[3], corner, window[2]
    )
    steps = min(math.ceil((seen - due) * level / step), MAX_HOLE_STEPS)
    for s in range(steps):
        r = due + (seen - due) * s / steps
        x, y = origin[0] + r * ray[0], origin[1] + r * ray[1]
        skip = last if (seen - r) * level <= step else -1  # where it was seen, there is something
        used = no_floor(x, y, skip, is_sure, window, sub, cells, serial, touched, used)
    return used


@kernel
def floor_before(
    origin: F64,
    ray: F64,
    due: float,
    x: float,
    y: float,
    ground: Ground,
    window: tuple[int, int, int, float],
    cells: Cells,
) -> float:
    """How high floor at (x, y) would lie, by the floor just before where the beam should meet it.

    In the map frame; NaN: none was seen there. A few centimetres below the ground mean a hole only
    beside floor that lies higher, and that has not risen itself just before: it casts a shadow.
    """
    corner, level = (window[0], window[1]), math.hypot(ray[0], ray[1])
    before = math.nan
    if level < LEAST_LEVEL:  # straight down, nothing lies before
        return before
    for back in range(1, LOOKS_BACK + 1):
        r = due - BEFORE_M * back / level
        bx, by = origin[0] + r * ray[0], origin[1] + r * ray[1]
        at = flat_index(bx, by, window[3], corner, window[2])
        if at < 0 or cells[at].floor_count == 0 or cells[at].above > 0:
            continue
        z = float(cells[at].z_m + ground.far_x * (x - bx) + ground.far_y * (y - by))
        if math.isnan(before):
            if back > NEAR_BACK:
                return math.nan
            before = z
        elif before - z > RAISED_M:
            return math.nan
    return before


@kernel
def _is_dark(ranges_m: F64, i: int) -> bool:
    """Whether a beam is one of three in a row that did not come back: single ones get lost."""
    run = 0
    for k in range(max(0, i - 2), min(ranges_m.shape[1], i + 3)):
        run += 1
        for e in range(ranges_m.shape[0]):
            if ranges_m[e, k] >= MIN_RANGE_M:
                run = 0
        if run >= 3:
            return True
    return False


@kernel
def missing(
    i: int,
    origin: F64,
    ray: F64,
    due: float,
    nearest: float,
    ranges_m: F64,
    ground: Ground,
    limits: tuple[float, float, float],
    is_calm: bool,
    window: tuple[int, int, int, float],
    cells: Cells,
) -> int:
    """Whether floor was missed where it was due: 0 no, 1 by a few centimetres, 2 clearly.

    limits: h_pos, h_neg, height of the robot.
    """
    if math.isinf(nearest):
        return 2 if _is_dark(ranges_m, i) else 0
    x, y, z = (
        origin[0] + nearest * ray[0],
        origin[1] + nearest * ray[1],
        origin[2] + nearest * ray[2],
    )
    h = z - ground_m(ground, x, y)
    if h <= limits[1]:
        return 2
    if h > -LOWER_M or due > SHALLOW_M:
        return 0
    h = z - ground.jitter_m - floor_before(origin, ray, due, x, y, ground, window, cells)
    return int(h <= -(BELOW_M + BELOW_SLOPE * nearest if is_calm else NODDING_M))
