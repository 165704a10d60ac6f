"""The synthetic drive that the figures of the planner link are measured with.

Forty seconds through a building (`drive_building.py`): 541 beams over 270 degrees at 50 Hz with
15 mm noise, cells of 5 cm. "tilted" is a scanner 0.6 m high, nose-down by 20 degrees, that marks
only where it touches the floor or an obstacle; "level" looks straight ahead, 18 m far, and marks
what its beams pass as well. A beam caster of its own and the plainest mapper there is: what the
link is measured with doesn't change when mapod's mapper does.
Source: planner link, section 10.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

from core.grid.window import ObstacleWindow
from core.records import F64, FREE, I8, I32, OBSTACLE, UNKNOWN, ObstacleMap
from jit import kernel
from tools.bench.drive_building import Place, building, people, way

SCAN_HZ, SCANS_S = 50, 40.0
BEAMS, SWEEP_RAD, NOISE_M, FARTHEST_M = 541, math.radians(270.0), 0.015, 18.0
SCANNER_HEIGHT_M, TILT_RAD = 0.6, math.radians(20.0)
TILTED_FARTHEST_M = 5.0  # beyond it the beams meet the floor three cells apart: not used
FLOOR_M, ROBOT_HEIGHT_M = 0.05, 1.5  # obstacles are what stands between the two
CELL_M = 0.05
POSE_NOISE_M, POSE_NOISE_RAD = 0.001, 0.0005  # of what the mapper believes, each scan
CLEAR_AFTER = 5  # scans in a row that see an obstacle's cell free, before it is
SEED = 1


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One sweep as the mapper gets it."""

    place: Place
    sensor_m: tuple[float, float]  # where the mapper believes the scanner was
    ends_m: F64  # (n, 2) where each beam ended, map frame
    kinds: I8  # (n,) OBSTACLE, FREE (the floor) or UNKNOWN (nothing within range)


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What one scan changes: the window follows the place first, then cells are put."""

    place: Place
    at: I32  # (k,) flat indices into the ring
    states: I8  # (k,)


@kernel
def _cast(
    x: float,
    y: float,
    z: float,
    bearings: F64,
    drops: F64,
    walls: F64,
    posts: F64,
    far_m: float,
    level_m: F64,
) -> None:
    """Horizontal distance at which each beam ends: floor, wall or post; inf beyond `far_m`.

    `drops` is how far a beam sinks per metre of horizontal way, `posts` are x, y, radius, height.
    """
    for n in range(bearings.size):
        c, s = math.cos(bearings[n]), math.sin(bearings[n])
        best = z / drops[n] if drops[n] > 0.0 else math.inf
        for k in range(walls.shape[0]):
            ax, ay = walls[k, 0] - x, walls[k, 1] - y
            ex, ey = walls[k, 2] - walls[k, 0], walls[k, 3] - walls[k, 1]
            across = c * ey - s * ex
            if abs(across) < 1e-12:
                continue
            r, part = (ax * ey - ay * ex) / across, (ax * s - ay * c) / across
            if 0.0 < r < best and 0.0 <= part <= 1.0:
                best = r
        for k in range(posts.shape[0]):
            px, py = posts[k, 0] - x, posts[k, 1] - y
            along, aside = px * c + py * s, py * c - px * s
            if along <= 0.0 or abs(aside) >= posts[k, 2]:
                continue
            r = along - math.sqrt(posts[k, 2] ** 2 - aside**2)
            if 0.0 < r < best and z - drops[n] * r <= posts[k, 3]:
                best = r
        level_m[n] = best if best * math.sqrt(1.0 + drops[n] ** 2) <= far_m else math.inf


@kernel
def _see(at: int, kind: int, cells: I8, misses: I8, at_put: I32, put: I8, used: int) -> int:
    """One cell in one scan: an obstacle counts at once, its absence after some scans in a row."""
    state = kind
    if kind == OBSTACLE:
        misses[at] = 0
    elif cells[at] == OBSTACLE:
        misses[at] += 1
        state = OBSTACLE if misses[at] < CLEAR_AFTER else FREE
    if state == cells[at]:
        return used
    cells[at] = state
    at_put[used], put[used] = at, state
    return used + 1


@kernel
def _mark(
    scan: int,
    carve: bool,
    sensor: tuple[float, float],
    ends: F64,
    kinds: I8,
    corner: tuple[int, int],
    cells: I8,
    misses: I8,
    seen: I32,
    at_put: I32,
    put: I8,
    size: int,
) -> int:
    """Bring one scan in; obstacles first, so that no beam beside clears what one has hit.

    Returns how many cells changed. `seen` tells the scan in which a cell was looked at last.
    """
    used = 0
    for kind in (OBSTACLE, FREE):
        for n in range(kinds.size):
            i, j = math.floor(ends[n, 0] / CELL_M), math.floor(ends[n, 1] / CELL_M)
            inside = 0 <= i - corner[0] < size and 0 <= j - corner[1] < size
            at = (j % size) * size + i % size
            if kinds[n] == kind and inside and seen[at] != scan:
                seen[at] = scan
                used = _see(at, kind, cells, misses, at_put, put, used)
    if not carve:
        return used
    for n in range(kinds.size):
        dx, dy = ends[n, 0] - sensor[0], ends[n, 1] - sensor[1]
        length = math.hypot(dx, dy)
        steps = int((length - CELL_M) / (CELL_M / 2))
        for k in range(steps):
            part = k * (CELL_M / 2) / length
            i = math.floor((sensor[0] + part * dx) / CELL_M)
            j = math.floor((sensor[1] + part * dy) / CELL_M)
            if not (0 <= i - corner[0] < size and 0 <= j - corner[1] < size):
                break
            at = (j % size) * size + i % size
            if seen[at] != scan:
                seen[at] = scan
                used = _see(at, FREE, cells, misses, at_put, put, used)
    return used


def _pair(point: F64) -> tuple[float, float]:
    return float(point[0]), float(point[1])


@functools.cache
def scans(scanner: str, seconds: float = SCANS_S, seed: int = SEED) -> tuple[Scan, ...]:
    """What the "tilted" or the "level" scanner sees along the way."""
    random = np.random.default_rng(seed)
    house, tilt_rad = building(seed), TILT_RAD if scanner == "tilted" else 0.0
    beams = np.linspace(-SWEEP_RAD / 2, SWEEP_RAD / 2, BEAMS)
    level = np.hypot(np.cos(beams) * math.cos(tilt_rad), np.sin(beams))
    drops = np.cos(beams) * math.sin(tilt_rad) / level
    aside = np.arctan2(np.sin(beams), np.cos(beams) * math.cos(tilt_rad))
    far = TILTED_FARTHEST_M if scanner == "tilted" else FARTHEST_M
    found: list[Scan] = []
    distance_m = np.empty(BEAMS)
    for place in way(seconds, 1 / SCAN_HZ):
        posts = np.vstack([house.legs, people(place.t_s)])
        start = (place.x_m, place.y_m, SCANNER_HEIGHT_M)
        _cast(*start, place.yaw_rad + aside, drops, house.walls, posts, far, distance_m)
        nothing = np.isinf(distance_m)
        measured = (
            np.where(nothing, far * level, distance_m)
            + random.normal(0.0, NOISE_M, BEAMS) * level * ~nothing
        )
        z = SCANNER_HEIGHT_M - drops * measured
        kinds = np.where((z > FLOOR_M) & (z < ROBOT_HEIGHT_M), OBSTACLE, UNKNOWN)
        kinds[z <= FLOOR_M], kinds[nothing] = FREE, UNKNOWN
        sensor = random.normal((place.x_m, place.y_m), POSE_NOISE_M)
        bearings = place.yaw_rad + aside + random.normal(0.0, POSE_NOISE_RAD)
        ends = np.column_stack([np.cos(bearings), np.sin(bearings)]) * measured[:, None]
        found.append(Scan(place, _pair(sensor), ends + sensor, kinds.astype(np.int8)))
    return tuple(found)


@functools.cache
def drive(scanner: str, size: int, seconds: float = SCANS_S, seed: int = SEED) -> tuple[Step, ...]:
    """The drive as changes of a window of (size, size) cells, one step a scan."""
    window = ObstacleWindow(size, CELL_M)
    misses = window.grid.layer(np.int8, 0)
    seen = np.full(size * size, -1, dtype=np.int32)
    at_put, put = np.zeros(size * size, dtype=np.int32), np.zeros(size * size, dtype=np.int8)
    steps: list[Step] = []
    for k, scan in enumerate(scans(scanner, seconds, seed)):
        window.follow(scan.place.x_m, scan.place.y_m)
        used = _mark(
            k,
            scanner == "level",
            scan.sensor_m,
            scan.ends_m,
            scan.kinds,
            (window.grid.corner_i, window.grid.corner_j),
            window.cells.ravel(),
            misses.ravel(),
            seen,
            at_put,
            put,
            size,
        )
        steps.append(Step(scan.place, at_put[:used].copy(), put[:used].copy()))
    return tuple(steps)


class Playback:
    """The drive again, as the windows that the core would hand to the link at its own rate."""

    def __init__(self, steps: tuple[Step, ...], size: int) -> None:
        self._steps, self._window, self._next = steps, ObstacleWindow(size, CELL_M), 0
        self.place = steps[0].place

    def until(self, t_s: float) -> ObstacleMap:
        """The window with every scan up to a time of the drive in it.

        Its `cells` are the playback's own: copy them to keep them.
        """
        while self._next < len(self._steps) and self._steps[self._next].place.t_s <= t_s + 1e-9:
            step = self._steps[self._next]
            self._next, self.place = self._next + 1, step.place
            self._window.follow(step.place.x_m, step.place.y_m)
            self._window.put(step.at, step.states)
        grid = self._window.grid
        changed = self._window.take_changed()
        return ObstacleMap(
            self._window.cells, grid.corner_i, grid.corner_j, changed, self._window.epoch, True
        )
