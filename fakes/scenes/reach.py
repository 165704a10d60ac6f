"""Whether a robot can do what a scene asks of it: come to all goals, over ground that it can see.

It knows the truth, and the laser's geometry: the line on the floor 8.45 m ahead, the shadows
behind what stands there. It does not drive: it takes the shortest way that is wide enough, then
detours, and asks whether the laser could have looked at all of it before, turning a little to
either side. What passes can be done by a driver who takes care; what fails perhaps by a better one.
Map frame, metres.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fakes.scenes.reach_kernels import flood, grown, is_clear, seen, ways_to
from fakes.scenes.solids import Pillar, Shape
from fakes.world.crowd import Walker

F64 = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Point = tuple[float, float]

CELL_M = 0.1
AROUND_M = 12.0  # of the start and the goals
STEP_M = 0.03  # what wheels take from one cell to the next, and what is ground
ROBOT_M = 0.45  # half its width, and its margin
WAY_M = 0.8  # half of a way that is wide enough in a map of cells of 0.2 m
BEYOND_M = 0.45  # of where the robot can be, things must be easy to see
GOAL_M = 1.0  # that must be free around a goal
TALL_M = 1.15  # higher than the lens: seen from everywhere
LEVEL_M = 0.2  # what the ground within the clear start may differ from the start's
HIGH_M = 1.5  # what hangs higher bars nobody's way
LOOK_ASIDE_RAD = math.radians(35.0)  # what a robot that drives can look aside
ROUND_M = 1.0  # of known ground that it needs to turn round where it stands
DETOUR_M, DETOUR_EVERY_M = 8.0, 2.0  # how much longer a way may be, and where it may lead through
DETOURS = 25  # that are tried: what needs more looking for is no fair task
EVERY_M = 0.25
BESIDE_M = 0.35  # of the way's middle: what the wheels roll over
MISSED = 0.04  # share of the ground beside the middle that may stay unseen


@dataclass(frozen=True, slots=True)
class Raster:
    """Heights over a rectangle; arrays are (rows along y, columns along x)."""

    low: Point
    tops_m: F64
    odd: Flags  # glass, black or soft: nobody should go there
    hangs: Flags  # with room below it

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a place; the nearest one of a place outside."""
        rows, columns = self.tops_m.shape
        i, j = int((x - self.low[0]) / CELL_M), int((y - self.low[1]) / CELL_M)
        return min(rows - 1, max(0, j)), min(columns - 1, max(0, i))

    def height_m(self, x: float, y: float) -> float:
        return float(self.tops_m[self.cell(x, y)])


def raster_from(solids: Sequence[Shape], low: Point, high: Point) -> Raster:
    """Of all that stands between two corners; what is thinner than a cell fills it."""
    shape = tuple(round((high[k] - low[k]) / CELL_M) for k in (1, 0))
    tops, odd = np.full(shape, -9.0), np.zeros(shape, dtype=bool)
    hangs = np.zeros(shape, dtype=bool)
    for solid in solids:
        if solid.bottom_m > HIGH_M:
            continue
        spans = []
        for (first, last), begin, count in zip((solid.y, solid.x), low[::-1], shape, strict=True):
            a = max(0, math.floor((first - begin) / CELL_M))
            spans.append(slice(a, max(a, min(count, math.ceil((last - begin) / CELL_M)))))
        some = spans[0], spans[1]
        ys = low[1] + (np.arange(spans[0].start, spans[0].stop) + 0.5) * CELL_M
        xs = low[0] + (np.arange(spans[1].start, spans[1].stop) + 0.5) * CELL_M
        if not len(xs) or not len(ys):
            continue
        x, y = np.meshgrid(np.clip(xs, *solid.x), np.clip(ys, *solid.y))
        if isinstance(solid, Pillar):
            away = np.hypot(xs[None, :] - solid.at[0], ys[:, None] - solid.at[1])
            top = np.where(away <= solid.radius_m + CELL_M / 2, solid.z[1], -9.0)
        else:
            top = np.maximum(solid.tops_m(x, y), -9.0)
        higher = top > tops[some]
        tops[some] = np.where(higher, top, tops[some])
        odd[some] = np.where(higher, solid.material.kind != "plain", odd[some])
        hangs[some] |= (top > -9.0) & (solid.bottom_m > 0.1)
    return Raster(low, tops, odd, hangs)


class Ground:
    """Where a robot can be in a place, and which ways lead there."""

    def __init__(self, solids: Sequence[Shape], around: Sequence[Point]) -> None:
        points = np.array([(0.0, 0.0), *around])
        low, high = points.min(axis=0) - AROUND_M, points.max(axis=0) + AROUND_M
        ends = [(float(x), float(y)) for x, y in (low, high)]
        self.raster = raster_from(solids, ends[0], ends[1])
        self.start = self.raster.cell(0.0, 0.0)
        ground = flood(self.raster.tops_m, *self.start, STEP_M)
        self.bars = ~ground | self.raster.odd  # what no wheel may come to
        self.closed = grown(self.bars, WAY_M / CELL_M)

    def ways(self, begin: Point, end: Point) -> Iterator[list[Point]]:
        """Corners of wide ways between two places: the shortest, then detours, shorter ones first.

        None comes where no wide way leads.
        """
        to_end = ways_to(self.closed, *self.raster.cell(*end))
        first = self.raster.cell(*begin)
        if self.closed[first] or not math.isfinite(to_end[first]):
            return
        yield self._corners(self._descent(first, to_end))
        to_begin = ways_to(self.closed, *first)
        every, most = round(DETOUR_EVERY_M / CELL_M), to_end[first] + DETOUR_M / CELL_M
        rows, columns = self.closed.shape
        spots = [(j, i) for j in range(0, rows, every) for i in range(0, columns, every)]
        nearest = sorted(spots, key=lambda cell: (to_begin[cell] + to_end[cell], cell))
        for spot in nearest[:DETOURS]:
            if to_begin[spot] + to_end[spot] > most:
                return
            there = self._corners(self._descent(spot, to_begin))[::-1]
            yield there + self._corners(self._descent(spot, to_end))[1:]

    def _descent(self, begin: tuple[int, int], lengths: F64) -> list[tuple[int, int]]:
        """Cells from one to where the lengths end, each nearer than the one before."""
        rows, columns = lengths.shape
        cells, (j, i) = [begin], begin
        while lengths[j, i] > 0.0:
            near = [(b, a) for b in (j - 1, j, j + 1) for a in (i - 1, i, i + 1)]
            inside = [(b, a) for b, a in near if 0 <= b < rows and 0 <= a < columns]
            j, i = min(inside, key=lambda cell: lengths[cell])
            cells.append((j, i))
        return cells

    def _corners(self, cells: list[tuple[int, int]]) -> list[Point]:
        """Places where a way bends that is drawn tight along cells."""
        spots = [(i + 0.5, j + 0.5) for j, i in cells]
        corners, at = [spots[0]], 0
        while at < len(spots) - 1:
            ahead = range(len(spots) - 1, at, -1)
            at = next((k for k in ahead if is_clear(self.closed, *spots[at], *spots[k])), at + 1)
            corners.append(spots[at])
        low_x, low_y = self.raster.low
        return [(low_x + x * CELL_M, low_y + y * CELL_M) for x, y in corners]


def check_place(
    solids: Sequence[Shape],
    goals: Sequence[Point],
    walkers: Sequence[Walker],
    start_clear_m: float,
) -> list[str]:
    """What keeps a robot from its goals, or makes its start less clear than is said; in words."""
    ground = Ground(solids, goals)
    if ground.closed[ground.start]:
        return ["the start is not free"]
    found = _start_problems(ground, start_clear_m) + _walker_problems(ground, walkers)
    near = grown(ground.bars, GOAL_M / CELL_M - 0.01)  # what is so far away is not near
    for x, y in goals:
        if near[ground.raster.cell(x, y)]:
            found.append(f"goal {x:.2f}, {y:.2f}: not free for {GOAL_M} m")
    return found or _way_problems(ground, goals, start_clear_m)


def _start_problems(ground: Ground, start_clear_m: float) -> list[str]:
    """Things within the clear start that the robot can come near to and that are hard to see."""
    raster = ground.raster
    free = flood(np.where(grown(ground.bars, ROBOT_M / CELL_M), -9.0, 0.0), *ground.start, 0.5)
    level_m = raster.tops_m[ground.start]
    tall = (raster.tops_m > level_m + TALL_M) & ~raster.hangs & ~raster.odd
    same = (abs(raster.tops_m - level_m) < LEVEL_M) & ~ground.bars
    rows, columns = np.indices(free.shape)
    away_m = np.hypot(rows - ground.start[0], columns - ground.start[1]) * CELL_M
    hard = ~tall & ~same & (away_m <= start_clear_m)
    reach = free
    for _ in range(round((ROBOT_M + BEYOND_M) / CELL_M)):  # not through walls
        reach = grown(reach, 1.0) & ~tall
    near = np.argwhere(hard & reach)
    if not len(near):
        return []
    j, i = near[0]
    x, y = raster.low[0] + (i + 0.5) * CELL_M, raster.low[1] + (j + 0.5) * CELL_M
    return [f"{x:.1f}, {y:.1f}: hard to see, and within the clear start"]


def _walker_problems(ground: Ground, walkers: Sequence[Walker]) -> list[str]:
    found = []
    for walker in walkers:
        if math.hypot(*walker.waypoints[0]) < 2.0:
            found.append(f"{walker.name} stands on the start")
        barred = grown(ground.bars, (walker.radius_m + walker.aside_m) / CELL_M)
        cells = [ground.raster.cell(*point)[::-1] for point in walker.waypoints]
        for begin, end in pairwise(cells):
            if not is_clear(barred, *map(float, begin), *map(float, end)):
                found.append(f"{walker.name} has something in the way")
                break
    return found


def _way_problems(ground: Ground, goals: Sequence[Point], start_clear_m: float) -> list[str]:
    """Whether a wide way leads to each goal in turn, and the laser sees its ground before."""
    begin: Point = (0.0, 0.0)
    eyes, turns = np.array([[0.0, 0.0, 0.0, *_footing(ground, 0.0, 0.0, 0.0)]]), np.array([math.pi])
    for goal in goals:
        missed: Point | None = None
        for corners in ground.ways(begin, goal):
            places = _places(ground, corners)
            looks = _looks(places, start_clear_m)
            seen_from, turned = np.concatenate([eyes, places]), np.concatenate([turns, looks])
            hidden = _maybe_unseen(ground, seen_from, turned, len(eyes), start_clear_m)
            if hidden is None:
                eyes, turns = seen_from, turned
                break
            missed = missed or hidden
        else:
            if missed is None:
                return [f"no way to goal {goal[0]:.2f}, {goal[1]:.2f}"]
            return [f"the laser does not see {missed[0]:.1f}, {missed[1]:.1f} before"]
        begin = goal
    return []


def _looks(places: F64, start_clear_m: float) -> F64:
    """How far (n,) the robot can look aside at places (n, 5) of its way, rad."""
    is_vouched = np.hypot(places[:, 0], places[:, 1]) < start_clear_m - ROUND_M
    looks = np.where(is_vouched, math.pi, LOOK_ASIDE_RAD)
    looks[[0, -1]] = math.pi
    return looks


def _footing(ground: Ground, x: float, y: float, heading_rad: float) -> tuple[float, float]:
    """Height of the ground at a place, and its slope that way, up positive, rad."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    ahead, behind = (ground.raster.height_m(x + k * c, y + k * s) for k in (0.4, -0.1))
    return ground.raster.height_m(x, y), math.atan2(ahead - behind, 0.5)


def _places(ground: Ground, corners: list[Point]) -> F64:
    """The way, every so far: (n, 5) x, y, heading, height of the ground, slope; n >= 2."""
    rows = []
    for (x0, y0), (x1, y1) in pairwise(corners):
        heading = math.atan2(y1 - y0, x1 - x0)
        count = max(1, math.ceil(math.hypot(x1 - x0, y1 - y0) / EVERY_M))
        for k in range(count + 1):
            x, y = x0 + (x1 - x0) * k / count, y0 + (y1 - y0) * k / count
            rows.append((x, y, heading, *_footing(ground, x, y, heading)))
    rows = rows or [(*corners[0], 0.0, *_footing(ground, *corners[0], 0.0))]
    return np.array(rows if len(rows) > 1 else rows * 2)


def _maybe_unseen(
    ground: Ground, eyes: F64, turns_rad: F64, first: int, start_clear_m: float
) -> Point | None:
    """A place on the way from the `first` on that was not seen before; None where all was."""
    raster = ground.raster
    corner = (raster.low[0], raster.low[1], CELL_M)
    for aside_m, may_miss in ((0.0, 0.0), (BESIDE_M, MISSED), (-BESIDE_M, MISSED)):
        way = eyes[first:]
        x = way[:, 0] - aside_m * np.sin(way[:, 2])
        y = way[:, 1] + aside_m * np.cos(way[:, 2])
        untils = np.arange(first, len(eyes))
        asked = np.hypot(x, y) > start_clear_m
        heights = np.array([raster.height_m(*point) for point in zip(x, y, strict=True)])
        targets = np.column_stack([x, y, heights])[asked]
        found = seen(raster.tops_m, corner, eyes, targets, turns_rad, untils[asked])
        if len(found) and (~found).mean() > may_miss:
            missed = targets[np.flatnonzero(~found)[0]]
            return float(missed[0]), float(missed[1])
    return None
