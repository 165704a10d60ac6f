"""What is measured on a map: each a number that a person can check by eye on the picture.

All take a view of a map and the truth of the same cells, (size, size) arrays [j, i].
"""

import numpy as np
import numpy.typing as npt

from core.records import FREE, OBSTACLE
from tools.experiments.truth import Bools, CellTruth, grown
from tools.experiments.views import MapView

F64 = npt.NDArray[np.float64]
NEAR_CELLS = 2  # an obstacle may be told so far from where it is
BAND_M = 0.06  # the paper's band of flat floor
STANDS_M = 0.15  # what rises or falls so much off the floor and was seen is not to be missed
DANGER_SHARE = 0.5  # of a cell
ENOUGH_HITS = 3  # beams
ENCLOSED_CELLS = 2  # a hole has information within so many cells on all four sides


def false_obstacles(view: MapView, truth: CellTruth) -> int:
    """Cells told as obstacle although there is none in them nor in the 5 x 5 cells around."""
    return int(((view.states == OBSTACLE) & ~grown(truth.obstacle, NEAR_CELLS)).sum())


def share_within(view: MapView, truth: CellTruth, band_m: float = BAND_M) -> float:
    """Of the floor cells with a height, the share whose height is within the band, 0..1."""
    heights_m = _floor_heights(view, truth)
    return float((np.abs(heights_m) <= band_m).mean()) if heights_m.size else float("nan")


def floor_error_m(view: MapView, truth: CellTruth) -> float:
    """Root mean square of the heights of floor cells, which should be 0."""
    heights_m = _floor_heights(view, truth)
    return float(np.sqrt(np.mean(heights_m**2))) if heights_m.size else float("nan")


def _floor_heights(view: MapView, truth: CellTruth) -> F64:
    """Heights (k,) of cells that lie on level floor with no obstacle within two cells."""
    level = (truth.high_m - truth.low_m < 0.01) & ~grown(truth.obstacle, NEAR_CELLS)
    return view.heights_m[level & np.isfinite(view.heights_m)]


def enclosed(known: Bools) -> Bools:
    """Cells that are not known but have known ones near on all four sides."""
    rows, columns = known.shape
    wide = np.pad(known, ENCLOSED_CELLS)
    sides = []
    for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        side = np.zeros_like(known)
        for k in range(1, ENCLOSED_CELLS + 1):
            j, i = ENCLOSED_CELLS + dj * k, ENCLOSED_CELLS + di * k
            side |= wide[j : j + rows, i : i + columns]
        sides.append(side)
    return np.asarray(~known & np.logical_and.reduce(sides))


def holes(view: MapView, truth: CellTruth, hits: npt.NDArray[np.int32]) -> int:
    """Floor cells that beams met, without a height in the midst of cells that have one."""
    floor = ~grown(truth.obstacle, 1) & (hits > 0)
    return int((enclosed(np.isfinite(view.heights_m)) & floor).sum())


def seen_dangers(truth: CellTruth, hits: npt.NDArray[np.int32], low_m: F64, high_m: F64) -> Bools:
    """Cells with something of 0.15 m or more that beams hit there, as much above or below floor."""
    floor_m = np.where(np.isfinite(truth.floor_m), truth.floor_m, np.inf)
    wide = np.pad(floor_m, NEAR_CELLS, constant_values=np.inf)
    size = floor_m.shape[0]
    span = range(2 * NEAR_CELLS + 1)
    near_m = np.min([wide[j : j + size, i : i + size] for j in span for i in span], axis=0)
    near_m = np.where(np.isfinite(near_m), near_m, 0.0)
    shown = (high_m - near_m >= STANDS_M) | (low_m - near_m <= -STANDS_M)
    return (truth.danger >= DANGER_SHARE) & (hits >= ENOUGH_HITS) & shown


def missed(view: MapView, dangers: Bools) -> int:
    """Cells of the dangers that are not told as obstacle, nor is one of the eight around."""
    near = grown(view.states == OBSTACLE, 1)
    return int((dangers & ~near).sum())


def free_on_danger(view: MapView, truth: CellTruth) -> int:
    """Cells told as free half of which, or more, are 0.15 m or more above or below the floor."""
    return int(((view.states == FREE) & (truth.danger >= DANGER_SHARE)).sum())


def wall_error_m(view: MapView, truth: CellTruth) -> float:
    """Mean distance of obstacle cells from the nearest true obstacle, 1 m at most."""
    away_m = truth.wall_m[view.states == OBSTACLE]
    return float(away_m.mean()) if away_m.size else float("nan")


def area_growth(known: Bools, seen: Bools) -> float:
    """By which share more cells are known than were truly seen, -1..; 0 is right."""
    return float(known.sum() / seen.sum() - 1.0) if seen.any() else float("nan")


def extent_m(cells: Bools, cell_m: float, axis: int) -> float:
    """Mean thickness along map x (axis 1) or y (axis 0), over lines that have any."""
    thick = cells.sum(axis=axis)
    return float(thick[thick > 0].mean() * cell_m) if thick.any() else 0.0
