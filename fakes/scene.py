"""A scene, read from a TOML file of fakes/scenes: solids, route, what moves, what upsets sensors.

Everything is in the map frame, metres. A scene is data: what moves in it does so by a timetable.
"""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fakes.movers import Mover, box_from, person_from
from fakes.slip import Slip, slip_from
from fakes.solids import Shape, Solid, bump_from, pillar_from, ramp_from, solid_from
from fakes.steel import Steel, steel_from

__all__ = ["Scene", "Solid", "load_scene", "mjcf_from_solids"]

F64 = npt.NDArray[np.float64]
SCENES = Path(__file__).parent / "scenes"
GROUND_FROM_M = 0.1  # what begins higher hangs in the air, and no wheel rolls on it
NEAR_M = 1.0  # of the body's origin, so that all wheels are nearer
STAY = {"from_s", "until_s"}
KEYS = {  # of a scene's file, and of the tables in it
    "": {"x_axis_east_of_north_deg", "route", "solid", "ramp", "pillar", "bump", "person",
         "moved_box", "steel", "slip"},
    "solid": {"name", "x", "y", "z", "material", "density_per_m"},
    "ramp": {"name", "x", "y", "rise_deg", "along", "from_m", "material"},
    "pillar": {"name", "at", "radius_m", "z", "material"},
    "bump": {"name", "x", "y", "height_m", "along", "profile", "floor_m"},
    "person": {"name", "waypoints", "speed_mps", "start_s", "legs", "height_m", "radius_m",
               "returns", *STAY},
    "moved_box": {"name", "x", "y", "z", *STAY},
    "steel": {"name", "at", "yaw_deg", "reach_m", "strength"},
    "slip": {"left", "right", *STAY},
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Scene:
    """All that is there, and the way that the driver takes through it.

    Args:
        waypoints: (x, y), or (x, y, speed_mps on the way there).
    """

    name: str
    solids: tuple[Shape, ...]
    waypoints: tuple[tuple[float, ...], ...] = ()
    speed_mps: float = 0.6
    x_axis_east_of_north_rad: float = 0.0
    movers: tuple[Mover, ...] = ()
    steels: tuple[Steel, ...] = ()
    slips: tuple[Slip, ...] = ()

    def height_at(
        self, x: npt.ArrayLike, y: npt.ArrayLike, since_begin_s: float | None = None
    ) -> F64:
        """Height (n,) of the highest surface at x (n,), y (n,); NaN where there is none.

        Glass and soft things have a height like all others.

        Args:
            since_begin_s: when; without it only what stands still counts.
        """
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        heights = np.full(np.broadcast(x, y).shape, -np.inf)
        for solid in self.solids:
            np.maximum(heights, solid.tops_m(x, y), out=heights)
        for mover in self.movers if since_begin_s is not None else ():
            assert since_begin_s is not None
            np.maximum(heights, mover.tops_m(x, y, since_begin_s), out=heights)
        heights[np.isneginf(heights)] = np.nan
        return heights

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


def load_scene(name: str | Path) -> Scene:
    """The scene of a file, or of the shipped one with this name.

    Raises:
        FileNotFoundError, KeyError, ValueError: no such scene, or not a scene.
    """
    shipped = SCENES / f"{name}.toml"
    path = shipped if shipped.exists() else Path(name)
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    for kind, known in KEYS.items():
        for entry in table.get(kind, []) if kind else [table]:
            if unknown := sorted(entry.keys() - known):
                raise ValueError(f"{path.name}, {kind or 'scene'}: no key {unknown[0]!r}")
    shapes: list[Shape] = [solid_from(entry) for entry in table["solid"]]
    shapes += [ramp_from(entry) for entry in table.get("ramp", [])]
    shapes += [pillar_from(entry) for entry in table.get("pillar", [])]
    shapes += [bump_from(entry) for entry in table.get("bump", [])]
    people = [person_from(entry) for entry in table.get("person", [])]
    boxes = [box_from(entry) for entry in table.get("moved_box", [])]
    route = table.get("route", {"speed_mps": 0.6, "waypoints": []})
    return Scene(
        name=path.stem,
        solids=tuple(shapes),
        waypoints=tuple(tuple(float(part) for part in point) for point in route["waypoints"]),
        speed_mps=float(route["speed_mps"]),
        x_axis_east_of_north_rad=math.radians(table["x_axis_east_of_north_deg"]),
        movers=(*people, *boxes),
        steels=tuple(steel_from(entry) for entry in table.get("steel", [])),
        slips=tuple(slip_from(entry) for entry in table.get("slip", [])),
    )


def mjcf_from_solids(solids: Sequence[Shape]) -> tuple[str, str]:
    """(assets, geoms) of solids as MuJoCo XML, the k-th one's geom being `solid<k>`."""
    parts = [solid.mjcf(f"solid{k}") for k, solid in enumerate(solids)]
    return "\n".join(asset for asset, _ in parts if asset), "\n".join(geom for _, geom in parts)
