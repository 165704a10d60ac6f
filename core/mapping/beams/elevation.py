"""What a cell's height is, and what speaks against it being free ground.

The height is the average of all heights that fell into the cell (`mean`), or is filtered by the
beams' own error model (`kalman`): variance of range, attitude and place, drift added when the cell
is next touched, returns that do not fit left out until several in a row say the same. Either would
hide the edge of a box or the mouth of a ditch behind the floor that shares its cell. So each cell
also counts the scans that contradict "floor": returns beyond the height bounds, and floor that was
due there by the beam's direction and did not show, because the beam went on below the ground or did
not come back at all. Beams that end before the ground say nothing about it.
Source: the paper, section 4.2.2 (average); design, section 7.
"""

import math

from core.grid.places import flat_index, part_bit
from core.mapping.beams.carving import FLOOR_AGAIN, see_floor_again
from core.mapping.beams.cells import GONE_JUDGED, CellGrid, Cells, known, touch, touch_around
from core.mapping.beams.ground_plane import DUE_M, Ground, due_m, ground_m
from core.mapping.beams.isolated import IsolatedReturns
from core.mapping.beams.negative import MAX_EVIDENCE, missed, missing
from core.mapping.rays import MIN_RANGE_M, Sweep
from core.records import F64, I32, U8
from jit import kernel

RISING_M = 0.03  # a return so far off the ground may belong to the foot of something,
RELIEF_M = 0.012  # and so may heights in one cell of one scan, which no wrong attitude sets apart
MAX_COUNT = 1_000_000_000

SURE_M, UNSURE_SLOPE = 3.0, 0.05  # so far behind the line, the ground may rise or fall by this
GUESS_M, GUESS_FROM_M = 0.25, 4.0  # lower and farther, a return over ground that is a guess is none
SIGMA_RANGE_M = 0.012  # of a return, along the beam
SIGMA_ANGLE_RAD = 0.0025  # of attitude and mount, across it
SIGMA_PLACE_M = 0.005  # of the lens' height over the ground
DRIFT_M2_PER_S = 4e-6  # what a cell's height loses of its worth in time
GATE_SIGMA = 3.0
NEW_HEIGHT = 4  # returns in a row that the filter did not believe, and then does
SCATTER_M = 0.06  # a return so far from both its neighbours' middle scatters
TOGETHER_M = 0.6  # neighbours that are farther apart belong to different things
DOUBLE_M = 0.10  # between two echoes of one beam

Limits = tuple[float, float, float]  # h_pos, h_neg, height of the robot
# what lies low is low; a few centimetres tell of a hole; and the ground ahead is not a mere guess
Trust = tuple[bool, bool, bool]


@kernel
def octant(dx: float, dy: float) -> int:
    """Which of the eight neighbours a direction points to: 0 is +x, counter-clockwise."""
    return round(math.atan2(dy, dx) / (math.pi / 4)) % 8


@kernel
def _filter(cells: Cells, at: int, h: float, r: float, fall: float, t_s: float) -> None:
    """One height into a cell by its error model; `fall` is how steeply the beam comes down."""
    cell = cells[at]
    level = math.sqrt(max(0.0, 1.0 - fall * fall))
    noise = (SIGMA_RANGE_M * fall) ** 2 + (SIGMA_ANGLE_RAD * r * level) ** 2 + SIGMA_PLACE_M**2
    if cell.count == 1:
        cell.mean_m, cell.var_m2 = h, noise
        return
    var = cell.var_m2 + DRIFT_M2_PER_S * max(0.0, t_s - cell.t_s)
    step = h - cell.mean_m
    if step * step > GATE_SIGMA**2 * (var + noise):
        cell.outliers += 1
        if cell.outliers >= NEW_HEIGHT:
            cell.mean_m, cell.var_m2, cell.outliers = h, noise, 0
        return
    cell.outliers = 0
    gain = var / (var + noise)
    cell.mean_m += gain * step
    cell.var_m2 = (1.0 - gain) * var


@kernel
def _average(cells: Cells, at: int, h: float) -> None:
    """One height into a cell's average, and the variance of what fell in."""
    cell = cells[at]
    step = h - cell.mean_m
    cell.mean_m += step / cell.count
    cell.var_m2 += (step * (h - cell.mean_m) - cell.var_m2) / cell.count


@kernel
def _new_look(cells: Cells, at: int, h: float, z: float, serial: int) -> None:
    """The first return of a scan in a cell."""
    cell = cells[at]
    cell.hit_scan = serial
    cell.looks += 1
    cell.floor_run += 1
    cell.span_low_m = cell.span_high_m = h
    if cell.count == 0:
        cell.z_low_m = cell.z_high_m = z
        cell.low_m = math.inf
        cell.top_m = -math.inf


@kernel
def _stands(
    cells: Cells, at: int, h: float, bit: int, soft: int, limits: Limits, serial: int
) -> None:
    """A return that rises off the floor."""
    cell = cells[at]
    cell.low_m, cell.top_m = min(cell.low_m, h), max(cell.top_m, h)
    if soft > 0:
        cell.soft += 1
        cell.doubles += soft - 1
    else:
        cell.hard += 1
    if h >= limits[0]:
        cell.high_bits |= bit
        cell.floor_bits &= ~bit
        cell.through, cell.floor_run, cell.gone = 0, 0, 0
        if cell.above_scan != serial and cell.above < MAX_EVIDENCE:
            cell.above_scan = serial
            cell.above += 1


@kernel
def _fall_in(
    cells: Cells,
    at: int,
    h: float,
    z: float,
    beam: tuple[float, float, float],
    bit: int,
    soft: int,
    limits: Limits,
    serial: int,
    filters: bool,
) -> None:
    """One return of height h (z in the map frame) falls into a cell.

    beam: range, its z direction, instant. soft: 0, or 1 for a return that scatters, 2 for one that
    echoes twice.
    """
    cell = cells[at]
    if cell.hit_scan != serial or cell.count == 0:
        _new_look(cells, at, h, z, serial)
    cell.span_low_m, cell.span_high_m = min(cell.span_low_m, h), max(cell.span_high_m, h)
    cell.z_low_m, cell.z_high_m = min(cell.z_low_m, z), max(cell.z_high_m, z)
    if abs(h) > RISING_M or cell.span_high_m - cell.span_low_m > RELIEF_M:
        cell.rising = 1
    if cell.count < MAX_COUNT:
        cell.count += 1
    cell.z_m += (z - cell.z_m) / cell.count
    if filters:
        _filter(cells, at, h, beam[0], beam[1], beam[2])
    else:
        _average(cells, at, h)
    cell.t_s = beam[2]
    if h > RISING_M:
        _stands(cells, at, h, bit, soft, limits, serial)
    if limits[1] < h < limits[0]:
        cell.floor_bits |= bit
        cell.floor_count += 1
        cell.floor_m += (h - cell.floor_m) / cell.floor_count
        if cell.floor_run >= FLOOR_AGAIN:
            see_floor_again(cells, at)
    elif h <= limits[1]:
        cell.floor_run = 0
        if cell.below_scan != serial and cell.below < MAX_EVIDENCE:
            cell.below_scan = serial
            cell.below += 1


@kernel
def _is_double(ranges_m: F64, i: int) -> bool:
    """Whether a beam echoed twice."""
    return bool(ranges_m.shape[0] > 1 and ranges_m[1, i] - ranges_m[0, i] > DOUBLE_M)


@kernel
def _softness(ranges_m: F64, i: int) -> int:
    """Whether the first return of a beam is of a thing that beams go into: see `_fall_in`.

    A beam that is split by an edge echoes twice as well: there one neighbour goes far past, and the
    other one meets a plain surface.
    """
    if not 0 < i < ranges_m.shape[1] - 1:
        return 0
    r, before, after = ranges_m[0, i], ranges_m[0, i - 1], ranges_m[0, i + 1]
    if not (abs(before - r) < TOGETHER_M and abs(after - r) < TOGETHER_M):
        return 0
    scatters = abs(r - 0.5 * (before + after)) > SCATTER_M
    if _is_double(ranges_m, i):
        inside = _is_double(ranges_m, i - 1) or _is_double(ranges_m, i + 1)
        return 2 if inside or scatters else 0
    return int(scatters)


@kernel
def _is_unsure(h: float, behind: float, limits: Limits) -> bool:
    """Whether a return so far behind the line may be floor: its slope there is not known."""
    unsure = UNSURE_SLOPE * max(0.0, behind - SURE_M)
    return bool(limits[0] <= h < limits[0] + unsure or limits[1] - unsure < h <= limits[1])


@kernel
def _take_returns(
    i: int,
    t_s: float,
    origin: F64,
    ray: F64,
    ranges_m: F64,
    ground: Ground,
    limits: Limits,
    trust: Trust,
    window: tuple[int, int, int, float],
    sub: int,
    cells: Cells,
    serial: int,
    filters: bool,
    touched: I32,
    used: int,
) -> tuple[int, int, float]:
    """Take the returns of one beam; cells in `touched`, returns, and the nearest (inf: none)."""
    returns, nearest = 0, math.inf
    for e in range(ranges_m.shape[0]):
        r = ranges_m[e, i]
        if not r >= MIN_RANGE_M:
            continue
        returns += 1
        nearest = min(nearest, r)
        x, y, z = origin[0] + r * ray[0], origin[1] + r * ray[1], origin[2] + r * ray[2]
        h = z - ground_m(ground, x, y)
        at = flat_index(x, y, window[3], (window[0], window[1]), window[2])
        if at < 0 or h > limits[2] or (h <= limits[1] and not trust[0]):
            continue
        if h < GUESS_M and r > GUESS_FROM_M and not trust[2]:
            continue
        if _is_unsure(h, ground.hx * x + ground.hy * y - ground.from_m, limits):
            continue
        if not known(cells, at):
            used = touch_around(at, window[2], cells, serial, touched, used)
        cells[at].far_sides |= 1 << octant(ray[0], ray[1])
        bit = part_bit(x, y, window[3], sub)
        soft = _softness(ranges_m, i) if e == 0 else 0
        _fall_in(cells, at, h, z, (r, ray[2], t_s), bit, soft, limits, serial, filters)
        used = touch(at, cells, serial, touched, used)
    return used, returns, nearest


@kernel
def _add(
    t_s: float,
    origins: F64,
    rays: F64,
    ranges_m: F64,
    skipped: U8,
    ground: Ground,
    limits: Limits,
    trust: Trust,
    window: tuple[int, int, int, float],
    sub: int,
    cells: Cells,
    serial: int,
    filters: bool,
    touched: I32,
    used: int,
) -> tuple[int, int]:
    """Take the beams of a scan but the skipped; how many cells are touched, and returns taken."""
    returns = 0
    for i in range(rays.shape[0]):
        if skipped[i]:
            continue
        origin, ray = origins[i], rays[i]
        used, n, nearest = _take_returns(
            i, t_s, origin, ray, ranges_m, ground, limits, trust, window, sub, cells, serial,
            filters, touched, used,
        )  # fmt: skip
        returns += n
        due = due_m(origin, ray, ground)
        if due > DUE_M or nearest <= due or not trust[0]:
            continue
        depth = missing(
            i, origin, ray, due, nearest, ranges_m, ground, limits, trust[1], window, cells
        )
        if depth > 0:
            used = missed(
                origin, ray, due, nearest, depth > 1, window, sub, cells, serial, touched, used
            )
    return used, returns


@kernel
def _judge_again(
    ground: Ground,
    before: Ground,
    since_s: float,
    limits: Limits,
    window: tuple[int, int, int, float],
    cells: Cells,
    serial: int,
    touched: I32,
    used: int,
) -> int:
    """Cells that were hit since an instant, and that lie on the ground after all, are floor.

    And floor that was missed where the ground in truth falls away was not due there.
    """
    size, cell_m = window[2], window[3]
    for at in range(cells.size):
        cell = cells[at]
        if cell.count == 0 and cell.miss == 0:
            continue
        i = window[0] + (at % size - window[0]) % size
        j = window[1] + (at // size - window[1]) % size
        x, y = (i + 0.5) * cell_m, (j + 0.5) * cell_m
        z = ground_m(ground, x, y)
        if cell.miss > 0 and z < ground_m(before, x, y) + 0.5 * limits[1]:
            cell.miss, cell.miss_sure, cell.miss_bits = 0, 0, 0
            cell.gone = GONE_JUDGED
            used = touch(at, cells, serial, touched, used)
        if cell.count == 0 or cell.t_s < since_s:
            continue
        if cell.z_high_m - z >= limits[0] or cell.z_low_m - z <= limits[1]:
            continue
        if cell.above + cell.below + cell.miss > 0:
            cell.gone = GONE_JUDGED
        cell.above, cell.below, cell.miss, cell.miss_sure = 0, 0, 0, 0
        cell.floor_bits |= cell.high_bits
        cell.high_bits, cell.miss_bits, cell.rising, cell.outliers = 0, 0, 0, 0
        cell.low_m, cell.top_m = math.inf, -math.inf
        cell.mean_m = cell.floor_m = cell.z_m - z
        cell.floor_count = cell.count
        used = touch(at, cells, serial, touched, used)
    return used


class Elevation:
    """Heights and evidence in the cells of a `CellGrid`, taken from sweeps."""

    def __init__(
        self,
        cells: CellGrid,
        h_pos_m: float,
        h_neg_m: float,
        height_m: float,
        filters: bool,
        max_beams: int,
    ) -> None:
        self.cells, self.grid = cells, cells.grid
        self._limits: Limits = (h_pos_m, h_neg_m, height_m)
        self._filters, self._isolated = filters, IsolatedReturns(cells, h_pos_m, max_beams)

    def add(self, sweep: Sweep, ground: Ground, trust: Trust) -> int:
        """Take the returns of a sweep over the ground (10,); how many there were."""
        cells = self.cells
        cells.used, returns = _add(
            sweep.t_s,
            sweep.origins,
            sweep.rays,
            sweep.ranges_m,
            self._isolated.find(sweep, ground),
            ground,
            self._limits,
            trust,
            cells.window,
            cells.sub,
            cells.flat,
            cells.scan,
            self._filters,
            cells.touched,
            cells.used,
        )
        return int(returns)

    def judge_again(self, ground: Ground, before: Ground, since_s: float) -> None:
        """The ground (10,) was found anew, after it was lost at since_s with (10,) before."""
        cells = self.cells
        cells.used = _judge_again(
            ground,
            before,
            since_s,
            self._limits,
            cells.window,
            cells.flat,
            cells.scan,
            cells.touched,
            cells.used,
        )

    @property
    def mean_m(self) -> F64:
        """Heights (size, size) above the ground; only where `count` is not 0."""
        return self.cells.cells["mean_m"]

    @property
    def count(self) -> I32:
        """Returns (size, size) that fell in."""
        return self.cells.cells["count"]
