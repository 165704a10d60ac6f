"""One drive of an experiment: a motion on order in a place, seen by several apps, and measured.

One simulated robot's bytes go to all apps at the same instants, so that their maps compare. The
first app's words go back to the devices. The others must say the same, or the run ends: then they
would not have heard the same either.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from app import App, Ports
from config_file import load_config, with_changes
from core.config import Config
from core.mapping.paper.maps import ReferencePlaneMaps
from core.records import FREE, OBSTACLE
from fakes.scenes.scene import Scene
from fakes.wires.wire import Fake, MemoryPort, Wire
from fakes.world.kinematic import KinematicWorld
from fakes.world.rig import Rig
from fakes.world.trajectory import Trajectory
from tools.experiments import metrics
from tools.experiments.truth import CellTruth, SeenCells, Truth
from tools.experiments.views import MapView, view_of

F64 = npt.NDArray[np.float64]
Span = tuple[float, float]
ROOT = Path(__file__).resolve().parents[2]
START_S = 1000.0
LEAD_S = 4.0  # standing still at first; the devices need a second of it to start
UNCOMPENSATED = "reference_plane, uncompensated"  # the paper's method without its step 6
BOTH = ("reference_plane", "surface")
LANE_M = 0.3  # to either side: half the robot's width
FRONT_M = 0.52  # of the robot, ahead of its axle
AROUND_M = 0.4  # of the span in which an obstacle cell may lie, before and behind
ALONE = list[str]()  # methods that run, where not all shall: then no picture is drawn
LINK_HZ = 5.0  # nobody listens to the planner's wire here


class DisagreementError(Exception):
    """Two apps that got the same bytes wrote different ones to a device."""


class SharedPort(MemoryPort):
    """The first app's end of a wire; what comes in goes to the same port of the others too."""

    def __init__(self) -> None:
        super().__init__()
        self.others: list[MemoryPort] = []

    def give(self, data: bytes) -> None:
        super().give(data)
        for other in self.others:
            other.give(data)

    def take_datagrams(self) -> list[bytes]:
        """What the first host wrote; DisagreementError: another one wrote something else."""
        written = super().take_datagrams()
        said = b"".join(written)
        for other in self.others:
            if (heard := other.take()) != said:
                raise DisagreementError(f"{said[:80]!r} and {heard[:80]!r}")
        return written


class WatchedRig(Rig):
    """A rig that notes where its scanner's beams truly ended."""

    def __init__(self, seen: SeenCells, *arguments: Any, **named: Any) -> None:
        self.seen = seen
        super().__init__(*arguments, **named)

    def ranges_m_at(self, t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        ranges_m = super().ranges_m_at(t_first_s, times_s, bearings_rad)
        self.seen.note(self.world, times_s, bearings_rad, np.atleast_2d(ranges_m)[0])
        return ranges_m


def shipped() -> Config:
    config = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
    return with_changes(config, planner={"rate_hz": LINK_HZ})


def methods(**sections: dict[str, Any]) -> dict[str, Config]:
    """Settings of both methods, alike but for it."""
    base = with_changes(shipped(), **sections) if sections else shipped()
    return {name: with_changes(base, map={"method": name}) for name in ALONE or BOTH}


class SeenPart(NamedTuple):
    """Per cell of a window: beams that ended in it, lowest and highest end."""

    hits: npt.NDArray[np.int32]
    low_m: F64
    high_m: F64


class Trial:
    """Rig and apps on a simulated clock, with the truth of their place, which must not change."""

    def __init__(
        self,
        scene: Scene,
        motion: Trajectory,
        configs: dict[str, Config],
        *,
        follows: bool = False,  # the body follows the ground under its wheels
        floors_m: Sequence[Span] = ((0.0, 0.0),),  # places that are floor; see Truth
        x_m: Span = (-8.0, 32.0),  # how much of the place is sampled for its truth
        y_m: Span = (-12.0, 12.0),
    ) -> None:
        first = next(iter(configs.values()))
        fan = first.scanner.options.spec.directions[[0, -1]]
        span_rad = (math.atan2(fan[0, 1], fan[0, 0]), math.atan2(fan[1, 1], fan[1, 0]))
        world = KinematicWorld(scene, motion, follows=follows)
        self.rig = WatchedRig(SeenCells(first.map.cell_m, span_rad), world, 1)
        fakes: tuple[Fake, ...] = (self.rig.scanner, self.rig.ahrs, self.rig.drive)
        self._shared = tuple(SharedPort() for _ in fakes)
        self._wires = [Wire(fake, self._shared[k], 1 + k) for k, fake in enumerate(fakes)]
        self._links: list[MemoryPort] = []
        self.apps = {name: self._new_app(name, config) for name, config in configs.items()}
        self.truth = Truth(world, x_m, y_m, floors_m)
        self._rate_hz = first.loop.rate_hz
        self._ticks, self.now_s = 0, START_S

    def _new_app(self, name: str, config: Config) -> App:
        """The first one is at the shared ports itself."""
        own: tuple[MemoryPort, ...] = self._shared
        if self._links:
            own = tuple(MemoryPort() for _ in self._shared)
            for shared, port in zip(self._shared, own, strict=True):
                shared.others.append(port)
        self._links.append(MemoryPort(datagrams=True))
        app = App(config, Ports(own[0], own[1], own[2], self._links[-1]), session=1)
        if config.map.method == "reference_plane":
            app.mapper.maps = ReferencePlaneMaps(config, compensated=name != UNCOMPENSATED)
        return app

    @property
    def elapsed_s(self) -> float:
        return self.now_s - START_S

    def step(self) -> None:
        self._ticks += 1
        self.now_s = START_S + self._ticks / self._rate_hz
        self.rig.step(self.now_s)
        for wire in self._wires:
            wire.step(self.now_s)
        for app in self.apps.values():
            app.step(self.now_s)
        for link in self._links:
            link.take_datagrams()

    def run(
        self, seconds: float, every_s: float = 0.0, each: Callable[[], None] | None = None
    ) -> None:
        apart = max(1, round(every_s * self._rate_hz))
        for tick in range(round(seconds * self._rate_hz)):
            self.step()
            if each and (tick + 1) % apart == 0:
                each()

    def view(self, name: str) -> MapView:
        return view_of(name, self.apps[name])

    def views(self, *names: str) -> list[MapView]:
        return [self.view(name) for name in names or self.apps if name in self.apps]

    def cells(self, view: MapView) -> CellTruth:
        return self.truth.cells(view.corner_i, view.corner_j, view.size, view.cell_m)

    def seen(self, view: MapView) -> SeenPart:
        seen = self.rig.seen
        at = (view.corner_i, view.corner_j, view.size)
        return SeenPart(*(seen.part(x, *at) for x in (seen.hits, seen.low_m, seen.high_m)))

    def per_app(self, measure: Callable[[MapView, CellTruth], float]) -> dict[str, float]:
        return {view.name: float(measure(view, self.cells(view))) for view in self.views()}

    def holes(self) -> dict[str, float]:
        return self.per_app(lambda view, cells: metrics.holes(view, cells, self.seen(view).hits))

    def missed(self) -> dict[str, float]:
        """Per app: cells of 0.15 m and more that beams met and that are not told as obstacle."""

        def count(view: MapView, cells: CellTruth) -> float:
            seen = self.seen(view)
            dangers = metrics.seen_dangers(cells, seen.hits, seen.low_m, seen.high_m)
            return metrics.missed(view, dangers)

        return self.per_app(count)


@dataclass(slots=True)
class Tally:
    """Figures taken again and again during a drive, per app."""

    taken: dict[str, list[float]] = field(default_factory=dict)

    def take(self, figures: dict[str, float]) -> None:
        for name, figure in figures.items():
            self.taken.setdefault(name, []).append(figure)

    def mean(self) -> dict[str, float]:
        return {name: float(np.mean(figures)) for name, figures in self.taken.items()}

    def most(self) -> dict[str, float]:
        return {name: float(np.max(figures)) for name, figures in self.taken.items()}


def barred(view: MapView, span_m: Span) -> bool:
    """Whether each line of cells of the robot's lane has an obstacle cell around a span of x."""
    near = view.part((span_m[0] - AROUND_M, span_m[1] + AROUND_M), (-LANE_M, LANE_M))
    lines = np.nonzero(near.any(axis=1))[0]
    stops = ((view.states == OBSTACLE) & near).any(axis=1)
    return bool(lines.size) and bool(stops[lines].all())


def free_within(view: MapView, span_m: Span, edge_m: float = 0.0) -> int:
    """Free cells of the lane whose centres lie in a span of x, an edge left out at both ends."""
    inside = view.part((span_m[0] + edge_m, span_m[1] - edge_m), (-LANE_M, LANE_M))
    return int(((view.states == FREE) & inside).sum())


class BarWatch:
    """Notes during a drive along x from which place on each app's map bars the way for good."""

    def __init__(self, test: Trial, span_m: Span) -> None:
        self._test, self._span_m = test, span_m
        self._since_m: dict[str, float] = {}
        self.most_free = dict.fromkeys(test.apps, 0.0)

    def look(self) -> None:
        front_m = self._test.rig.world.pose()[0] + FRONT_M
        for view in self._test.views():
            if barred(view, self._span_m):
                self._since_m.setdefault(view.name, front_m)
            else:
                self._since_m.pop(view.name, None)
            free = float(free_within(view, self._span_m, view.cell_m / 2))
            self.most_free[view.name] = max(self.most_free[view.name], free)

    def ahead_m(self) -> dict[str, float]:
        """How far ahead of the robot's front the way was barred, and stayed so; 0: it is not."""
        begin_m = self._span_m[0]
        return {
            name: begin_m - self._since_m[name] if name in self._since_m else 0.0
            for name in self._test.apps
        }
