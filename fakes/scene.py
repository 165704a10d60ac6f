"""A scene, read from a TOML file of fakes/scenes: its solids and route, heights and MuJoCo model.

Everything is in the map frame, metres. A scene is data and does not move.
"""

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
SCENES = Path(__file__).parent / "scenes"
RAMP_FOOT_M = 0.5  # how far a ramp reaches below the ground, so that no beam passes under it


@dataclass(frozen=True, slots=True)
class Solid:
    """An upright box; from z[1] at its lowest y, its top rises along y by `rise_rad` (0: flat)."""

    name: str
    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]
    rise_rad: float = 0.0

    def tops_m(self, x: F64, y: F64) -> F64:
        """Height of its top over the points (n,); -inf beside it."""
        inside = (x >= self.x[0]) & (x <= self.x[1]) & (y >= self.y[0]) & (y <= self.y[1])
        return np.where(inside, self.z[1] + math.tan(self.rise_rad) * (y - self.y[0]), -np.inf)

    def corners(self) -> list[tuple[float, float, float]]:
        """Its eight corners."""
        rise_m = math.tan(self.rise_rad) * (self.y[1] - self.y[0])
        tops_m = zip(self.y, (self.z[1], self.z[1] + rise_m), strict=True)
        return [(x, y, z) for y, top in tops_m for x in self.x for z in (self.z[0], top)]


@dataclass(frozen=True, slots=True)
class Scene:
    """All that stands still, and the way that the driver takes through it."""

    name: str
    solids: tuple[Solid, ...]
    waypoints: tuple[tuple[float, float], ...] = ()
    speed_mps: float = 0.6
    x_axis_east_of_north_rad: float = 0.0

    def height_at(self, x: npt.ArrayLike, y: npt.ArrayLike) -> F64:
        """Height (n,) of the highest surface at x (n,), y (n,); NaN where there is none."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        heights = np.full(np.broadcast(x, y).shape, -np.inf)
        for solid in self.solids:
            np.maximum(heights, solid.tops_m(x, y), out=heights)
        heights[np.isneginf(heights)] = np.nan
        return heights


def load_scene(name: str | Path) -> Scene:
    """The scene of a file, or of the shipped one with this name.

    Raises:
        FileNotFoundError, KeyError, ValueError: no such scene, or not a scene.
    """
    shipped = SCENES / f"{name}.toml"
    path = shipped if shipped.exists() else Path(name)
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    boxes = [Solid(s["name"], _span(s["x"]), _span(s["y"]), _span(s["z"])) for s in table["solid"]]
    ramps = [_ramp(entry) for entry in table.get("ramp", [])]
    route = table.get("route", {"speed_mps": 0.6, "waypoints": []})
    return Scene(
        name=path.stem,
        solids=(*boxes, *ramps),
        waypoints=tuple((float(x), float(y)) for x, y in route["waypoints"]),
        speed_mps=float(route["speed_mps"]),
        x_axis_east_of_north_rad=math.radians(table["x_axis_east_of_north_deg"]),
    )


def _span(pair: list[float]) -> tuple[float, float]:
    low, high = float(pair[0]), float(pair[1])
    if not low < high:
        raise ValueError(f"a solid needs [from, to] with from < to, is {pair}")
    return low, high


def _ramp(entry: dict[str, Any]) -> Solid:
    foot = (-RAMP_FOOT_M, 0.0)
    rise_rad = math.radians(entry["rise_deg"])
    return Solid(entry["name"], _span(entry["x"]), _span(entry["y"]), foot, rise_rad)


def mjcf_from_scene(scene: Scene) -> tuple[str, str]:
    """(assets, geoms) of the scene as MuJoCo XML; all in geom group 0."""
    assets, geoms = [], []
    for k, solid in enumerate(scene.solids):
        if solid.rise_rad:
            vertices = " ".join(f"{part!r}" for corner in solid.corners() for part in corner)
            assets.append(f'<mesh name="mesh{k}" vertex="{vertices}"/>')
            geoms.append(f'<geom name="solid{k}" type="mesh" mesh="mesh{k}" class="scene"/>')
        else:
            spans = (solid.x, solid.y, solid.z)
            middle = " ".join(f"{(low + high) / 2!r}" for low, high in spans)
            half = " ".join(f"{(high - low) / 2!r}" for low, high in spans)
            geoms.append(
                f'<geom name="solid{k}" type="box" pos="{middle}" size="{half}" class="scene"/>'
            )
    return "\n".join(assets), "\n".join(geoms)
