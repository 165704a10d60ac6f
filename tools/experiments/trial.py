"""One drive of an experiment: a motion on order in a place, seen by several apps, and measured."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from core.config import Config
from fakes.scenes.scene import Scene
from fakes.world.kinematic import KinematicWorld
from fakes.world.trajectory import Trajectory
from tools.experiments import metrics
from tools.experiments.harness import Run, run_of
from tools.experiments.truth import CellTruth, Truth
from tools.experiments.views import MapView, view_of

LEAD_S = 4.0  # standing still at first; the devices need a second of it to start


@dataclass(slots=True)
class Trial:
    """A run, with the truth of its place; the place must not change while it is measured."""

    run: Run
    truth: Truth

    def view(self, name: str) -> MapView:
        return view_of(name, self.run.apps[name])

    def views(self, *names: str) -> list[MapView]:
        """The maps of these apps now, all of them without names."""
        return [self.view(name) for name in names or self.run.apps]

    def cells(self, view: MapView) -> CellTruth:
        return self.truth.cells(view.corner_i, view.corner_j, view.size, view.cell_m)

    def seen(self, view: MapView) -> "SeenPart":
        """What the scanner's beams truly met in the cells of a view."""
        seen = self.run.rig.seen
        at = (view.corner_i, view.corner_j, view.size)
        return SeenPart(*(seen.part(x, *at) for x in (seen.hits, seen.low_m, seen.high_m)))

    def per_app(self, measure: Callable[[MapView, CellTruth], float]) -> dict[str, float]:
        """One figure of each app's maps now."""
        return {view.name: float(measure(view, self.cells(view))) for view in self.views()}

    def holes(self) -> dict[str, float]:
        """Per app: floor cells that beams met, empty in the midst of cells that are not."""
        return self.per_app(lambda view, cells: metrics.holes(view, cells, self.seen(view).hits))

    def missed(self) -> dict[str, float]:
        """Per app: cells of 0.15 m and more that beams met and that are not told as obstacle."""

        def count(view: MapView, cells: CellTruth) -> float:
            seen = self.seen(view)
            dangers = metrics.seen_dangers(cells, seen.hits, seen.low_m, seen.high_m)
            return metrics.missed(view, dangers)

        return self.per_app(count)


@dataclass(frozen=True, slots=True)
class SeenPart:
    """Per cell of a window: beams that ended in it, lowest and highest end."""

    hits: npt.NDArray[np.int32]
    low_m: npt.NDArray[np.float64]
    high_m: npt.NDArray[np.float64]


def trial(
    scene: Scene,
    motion: Trajectory,
    configs: dict[str, Config],
    *,
    follows: bool = False,
    floors_m: Sequence[tuple[float, float]] = ((0.0, 0.0),),
    x_m: tuple[float, float] = (-8.0, 32.0),
    y_m: tuple[float, float] = (-12.0, 12.0),
) -> Trial:
    """A trial ready to be run.

    Args:
        follows: the body follows the ground under its wheels.
        floors_m: places that are floor; see Truth.
        x_m, y_m: how much of the place is sampled for its truth.
    """
    run = run_of(KinematicWorld(scene, motion, follows=follows), configs)
    return Trial(run, Truth(run.rig.world, x_m, y_m, floors_m))


@dataclass(slots=True)
class Tally:
    """Figures taken again and again during a drive, per app."""

    taken: dict[str, list[float]] = field(default_factory=dict)

    def take(self, figures: dict[str, float]) -> None:
        for name, figure in figures.items():
            self.taken.setdefault(name, []).append(figure)

    def mean(self) -> dict[str, float]:
        """Of what was taken; nothing taken: none."""
        return {name: float(np.mean(figures)) for name, figures in self.taken.items()}

    def most(self) -> dict[str, float]:
        return {name: float(np.max(figures)) for name, figures in self.taken.items()}
