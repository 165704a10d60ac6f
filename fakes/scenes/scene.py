"""A scene, read from a TOML file of fakes/scenes: solids, route, what moves, what upsets sensors.

Everything is in the map frame, metres. A scene is data: what moves in it does so by a timetable,
but for walkers, who see where they go. What a file leaves to chance (see chance.py) is drawn from a
seed.
"""

import math
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fakes.scenes.chance import has_chance, maybe_drawn
from fakes.scenes.entries import check_keys, made
from fakes.scenes.mixed import MIXED, mixed_table
from fakes.scenes.movers import Mover
from fakes.scenes.reach import check_place
from fakes.scenes.solids import Shape, Solid
from fakes.world.crowd import Walker
from fakes.world.error_models import NONE, ErrorModels, Patch
from fakes.world.magnetic import MagneticDisturbance
from fakes.world.slip import Slip

__all__ = ["Scene", "Solid", "campaign_scenes", "load_scene", "problems"]

F64 = npt.NDArray[np.float64]
SCENES = Path(__file__).parent
GROUND_FROM_M = 0.1  # what begins higher hangs in the air, and no wheel rolls on it
NEAR_M = 1.0  # of the body's origin, so that all wheels are nearer
START_CLEAR_M = 9.0  # where the file says nothing else
ATTEMPTS = 200  # to draw a scene in which all goals can be reached
MIXED_ATTEMPTS = 20  # with one choice of things


@dataclass(frozen=True, slots=True)
class Scene:
    """All that is there, and the way that the driver takes through it.

    Args:
        waypoints: (x, y), or (x, y, speed_mps on the way there).
        walks: the robot has legs, and goes along the waypoints by itself; no driver, no physics.
        goals: (x, y) for a planner, in the order to be visited.
        start_clear_m: how far around the origin the operator vouches for the ground.
        campaign: belongs to the mix of scenes that campaigns are made of.
        friction: of all ground under the wheels, but for `patches`.
        walkers: people who give way; `movers` do not.
    """

    name: str
    solids: tuple[Shape, ...]
    waypoints: tuple[tuple[float, ...], ...] = ()
    speed_mps: float = 0.6
    x_axis_east_of_north_rad: float = 0.0
    movers: tuple[Mover, ...] = ()
    steels: tuple[MagneticDisturbance, ...] = ()
    slips: tuple[Slip, ...] = ()
    goals: tuple[tuple[float, float], ...] = ()
    start_clear_m: float = 9.0
    campaign: bool = False
    friction: float = 1.0
    patches: tuple[Patch, ...] = ()
    errors: ErrorModels = NONE
    walkers: tuple[Walker, ...] = ()
    description: str = ""
    walks: bool = False
    _bounds: F64 = field(init=False, repr=False, compare=False)  # of the solids, see _near

    def __post_init__(self) -> None:
        spans = [(*solid.x, *solid.y) for solid in self.solids]
        object.__setattr__(self, "_bounds", np.array(spans, dtype=float).reshape(-1, 4))

    def _near(self, x: F64, y: F64) -> list[Shape]:
        """The solids over whose bounds any of the points (n,) may lie."""
        if not x.size:
            return []
        low_x, high_x, low_y, high_y = self._bounds.T
        near = (low_x <= x.max()) & (high_x >= x.min()) & (low_y <= y.max()) & (high_y >= y.min())
        return [self.solids[k] for k in np.flatnonzero(near)]

    def height_at(
        self, x: npt.ArrayLike, y: npt.ArrayLike, since_begin_s: float | None = None
    ) -> F64:
        """Height (n,) of the highest surface at x (n,), y (n,); NaN where there is none.

        Glass and soft things have a height like all others.

        Args:
            since_begin_s: when; without it only what stands still counts.
        """
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        heights = np.full(x.shape, -np.inf)
        for solid in self._near(x, y):
            np.maximum(heights, solid.tops_m(x, y), out=heights)
        if since_begin_s is not None:
            for mover in self.movers:
                np.maximum(heights, mover.tops_m(x, y, since_begin_s), out=heights)
        heights[np.isneginf(heights)] = np.nan
        return heights

    def blocks(
        self,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        z_low_m: npt.ArrayLike,
        z_high_m: npt.ArrayLike,
    ) -> npt.NDArray[np.bool_]:
        """Whether something firm that stands still fills any height between two (one, or (n,)) over
        points x (n,), y (n,).

        Glass does, soft things do not; what only touches either height does not. Quick where the
        points lie near each other.
        """
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        low, high = np.asarray(z_low_m, dtype=float), np.asarray(z_high_m, dtype=float)
        found = np.zeros(x.shape, dtype=bool)
        for solid in self._near(x, y):
            if solid.material.kind != "soft":
                found |= (solid.tops_m(x, y) > low) & (solid.bottom_m < high)
        return found

    @property
    def firm(self) -> tuple[Shape, ...]:
        """The solids that wheels cannot pass."""
        return tuple(solid for solid in self.solids if solid.material.kind != "soft")

    def ground_near(self, x: F64, y: F64) -> "Scene":
        """What bodies with their origins over x (n,), y (n,) stand on; without what hangs above."""
        low_x, high_x = x.min() - NEAR_M, x.max() + NEAR_M
        low_y, high_y = y.min() - NEAR_M, y.max() + NEAR_M
        ground = tuple(
            solid
            for solid in self.firm
            if solid.bottom_m <= GROUND_FROM_M
            and not (solid.x[1] < low_x or solid.x[0] > high_x)
            and not (solid.y[1] < low_y or solid.y[0] > high_y)
        )
        return replace(self, solids=ground, movers=())


def load_scene(name: str | Path, seed: int = 1) -> Scene:
    """The scene of a file, or of the shipped one with this name; "mixed": things of all of them.

    Args:
        seed: of what the file leaves to chance; the same seed gives the same scene, everywhere.

    Raises:
        FileNotFoundError, KeyError, ValueError: no such scene, not a scene, or nothing that this
            seed draws lets a robot reach its goals; `fair = false` in the file allows that.
    """
    if name == MIXED:
        return _mixed(seed)
    shipped = SCENES / f"{name}.toml"
    path = shipped if shipped.exists() else Path(name)
    if not path.exists():
        names = ", ".join(sorted(known.stem for known in SCENES.glob("*.toml")))
        raise FileNotFoundError(f"no scene '{name}': neither a file nor one of {names}")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError(f"{path.name}: lists or tables are nested too deeply") from None
    check_keys(table, path.name)
    if "x_axis_east_of_north_deg" not in table:
        raise ValueError(f"{path.name}: x_axis_east_of_north_deg is missing")
    wrong = ["no place for what it scatters"]
    for attempt in range(ATTEMPTS if has_chance(table) else 1):
        scene = _scene_from(path.stem, table, seed, attempt)
        if scene is None:
            continue
        wrong = problems(scene) if scene.goals and table.get("fair", True) else []
        if not wrong:
            return scene
    raise ValueError(f"{path.name}: seed {seed} draws no scene without problems: {wrong[0]}")


def _mixed(seed: int) -> Scene:
    """Raises ValueError: nothing that this seed draws lets a robot reach its goals."""
    for attempt in range(ATTEMPTS):
        table = mixed_table(seed, attempt // MIXED_ATTEMPTS)
        check_keys(table, MIXED)
        scene = _scene_from(MIXED, table, seed, attempt)
        if scene is not None and scene.goals and not problems(scene):
            return scene
    raise ValueError(f"{MIXED}: seed {seed} draws no scene without problems")


def campaign_scenes() -> tuple[str, ...]:
    """Names of the shipped scenes that campaigns are made of, in the order of the alphabet."""
    tables = {path.stem: tomllib.loads(path.read_text("utf-8")) for path in SCENES.glob("*.toml")}
    return tuple(sorted(name for name, table in tables.items() if table.get("campaign", False)))


def problems(scene: Scene) -> list[str]:
    return check_place(scene.solids, scene.goals, scene.walkers, scene.start_clear_m)


def _scene_from(name: str, table: dict[str, Any], seed: int, attempt: int) -> Scene | None:
    """A scene of a file's table; None where this attempt finds no place for a thing."""
    drawn = maybe_drawn(table, name, seed, attempt)
    if drawn is None:
        return None
    route = table.get("route", {})
    return Scene(
        **drawn,
        name=name,
        speed_mps=float(route.get("speed_mps", 0.6)),
        walks=bool(route.get("walks", False)),
        x_axis_east_of_north_rad=math.radians(table["x_axis_east_of_north_deg"]),
        start_clear_m=float(table.get("start_clear_m", START_CLEAR_M)),
        campaign=bool(table.get("campaign", False)),
        friction=float(table.get("friction", 1.0)),
        errors=made("upsets", table.get("upsets", {})),
        description=str(table.get("description", "")),
    )
