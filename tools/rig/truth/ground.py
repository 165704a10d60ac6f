"""The truth of a run, for its recording: the ground around its way, the way, and who walked there.

`tools/sweep/truth.py` says what is kept, and reads it.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fakes.scenes.movers import Mover
from fakes.scenes.scene import Scene
from tools.floor import SAMPLE_M
from tools.rig.truth.contact import HEIGHT_M, parts_of
from tools.rig.truth.judge import Truth
from tools.sweep.truth import Ground, truth_metadata

F64 = npt.NDArray[np.float64]
LOOK_HZ = 10.0  # of the way
AROUND_M = 12.0  # the way
TILE = 64  # samples along an edge that are worked out together, with what is near them


class TruthLog:
    """Takes each truth of a run; `metadata` at its end."""

    def __init__(self, scene: Scene, seed: int, begin_s: float) -> None:
        """`begin_s`: host clock at which the run began."""
        self._scene, self._seed, self._begin_s = scene, seed, begin_s
        self._path: list[tuple[float, float, float, float]] = []
        self._people: list[F64] = []
        self._due_s = 0.0

    def take(self, truth: Truth) -> None:
        if truth.since_s < self._due_s:
            return
        self._due_s = truth.since_s + 1.0 / LOOK_HZ - 1e-6
        self._path.append((self._begin_s + truth.since_s, *truth.place))
        found = [people_of(mover, truth.since_s) for mover in self._scene.movers]
        if truth.people is not None:
            found.append(truth.people)
        self._people.append(np.vstack(found) if found else np.zeros((0, 3)))

    def metadata(self) -> dict[str, str]:
        path = np.array(self._path, dtype=float).reshape(-1, 4)
        people = self._people if any(len(now) for now in self._people) else []
        ground = ground_of(self._scene, path[:, 1], path[:, 2])
        return truth_metadata(self._scene.name, self._seed, ground, path, people)


def people_of(mover: Mover, since_s: float) -> F64:
    """Discs (n, 3) x, y, radius around the parts of what moves by a timetable."""
    discs: list[tuple[float, ...]] = []
    for part in parts_of(mover, since_s):
        if len(part) == 6:
            x0, x1, y0, y1 = part[:4]
            discs.append(((x0 + x1) / 2, (y0 + y1) / 2, np.hypot(x1 - x0, y1 - y0) / 2))
        else:
            discs.append(part[:3])
    return np.array(discs, dtype=float).reshape(-1, 3)


def ground_of(scene: Scene, x_m: F64, y_m: F64) -> Ground:
    """Heights around a way: firm things that stand still and begin below the robot's height."""
    firm = tuple(solid for solid in scene.firm if solid.bottom_m < HEIGHT_M)
    still = replace(scene, solids=firm, movers=())
    low_x, low_y = (np.floor((way.min() - AROUND_M) / SAMPLE_M) * SAMPLE_M for way in (x_m, y_m))
    x = np.arange(low_x + SAMPLE_M / 2, x_m.max() + AROUND_M, SAMPLE_M)
    y = np.arange(low_y + SAMPLE_M / 2, y_m.max() + AROUND_M, SAMPLE_M)
    heights = np.full((len(y), len(x)), np.nan)
    for row in range(0, len(y), TILE):
        for column in range(0, len(x), TILE):
            at = np.s_[row : row + TILE, column : column + TILE]
            xs, ys = np.meshgrid(x[at[1]], y[at[0]])
            heights[at] = still.height_at(xs.ravel(), ys.ravel()).reshape(xs.shape)
    return Ground(heights, float(low_x), float(low_y))
