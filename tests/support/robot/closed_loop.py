"""The whole robot in one process on a simulated clock: world, fakes, wires, app, planner's end."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from config_file import load_config
from core.config import Config
from core.mapping.surface.maps import SurfaceMaps
from core.records import FREE, OBSTACLE, UNKNOWN
from fakes.planner_mcu.receiver import FakePlanner
from fakes.scenes.scene import Scene
from fakes.world.rig import AnyWorld
from tools.rig.runs.loop import SESSION, SHIPPED, START_S, Loop

F64 = npt.NDArray[np.float64]
__all__ = ["SESSION", "SHIPPED", "START_S", "ClosedLoop", "Comparison", "compare"]


class ClosedLoop(Loop):
    """App and fakes, stepped together; faults are set on the wires and fakes between steps."""

    def __init__(
        self,
        config: Config | None = None,
        scene: Scene | str | AnyWorld = "corridor",
        seed: int = 1,
        drives: bool = True,
        key: bytes | None = None,
    ) -> None:
        self.planner = FakePlanner(key=key)
        shipped = config or load_config(SHIPPED.read_text(encoding="utf-8"))
        super().__init__(scene, seed, shipped, self.planner, drives=drives, key=key)
        self.sent = bytearray()  # all link bytes, for comparing two runs
        self.link_port.taps.append(self._note)

    def _note(self, wire: str, way: str, data: bytes) -> None:
        if way == "h2d":
            self.sent += data


@dataclass(frozen=True, slots=True)
class Comparison:
    """A map held against the world's truth. Places are centres of cells."""

    seen: int  # cells decided, not within one cell of an edge of the truth
    right: int
    free_on_obstacle: list[tuple[float, float]]  # free cells, half of them on a box or in the ditch
    floor_error_m: F64  # height errors of floor cells
    wrong: list[tuple[float, float, int]]  # place, and what the map holds


SAMPLES = np.linspace(0.02, 0.98, 7)
INNER = np.s_[1:-1, 1:-1]


def heights_of(loop: ClosedLoop) -> F64:
    """The world's heights at 49 places in each cell of the window and of a rim of one cell."""
    grid = loop.app.mapper.maps.window.grid
    cells = np.arange(-1, grid.size + 1)
    x = (grid.corner_i + cells)[None, :, None, None] + SAMPLES[None, None, None, :]
    y = (grid.corner_j + cells)[:, None, None, None] + SAMPLES[None, None, :, None]
    x, y = np.broadcast_arrays(x * grid.cell_m, y * grid.cell_m)
    heights = loop.rig.world.height_at(x.ravel(), y.ravel())
    return np.asarray(heights.reshape(grid.size + 2, grid.size + 2, -1))


def are_ramps(loop: ClosedLoop) -> npt.NDArray[np.bool_]:
    """Which cells of the window lie on a ramp or beside one: floor, whatever its height."""
    grid = loop.app.mapper.maps.window.grid
    found = np.zeros((grid.size, grid.size), dtype=bool)
    x_m, y_m = (
        (low + np.arange(grid.size) + 0.5) * grid.cell_m for low in (grid.corner_i, grid.corner_j)
    )
    for solid in loop.rig.world.scene.solids:
        if getattr(solid, "rise_rad", 0.0) != 0.0:
            in_x, in_y = (
                (at > span[0] - grid.cell_m) & (at < span[1] + grid.cell_m)
                for at, span in ((x_m, solid.x), (y_m, solid.y))
            )
            found |= in_y[:, None] & in_x[None, :]
    return found


def told_heights(maps: SurfaceMaps) -> F64:
    """The map's own heights of the window's cells, from its corner on."""
    grid, source = maps.window.grid, maps.grid
    heights_m = np.roll(maps.heights_m(), (-source.corner_j, -source.corner_i), axis=(0, 1))
    i, j = grid.corner_i - source.corner_i, grid.corner_j - source.corner_j
    return heights_m[j : j + grid.size, i : i + grid.size]


def compare(loop: ClosedLoop) -> Comparison:
    """The app's maps now against the world; places in the map frame, which begins at the start."""
    maps = loop.app.mapper.maps
    assert isinstance(maps, SurfaceMaps)
    grid, cells, heights = maps.window.grid, loop.map_now(), heights_of(loop)
    beyond = np.abs(heights) >= 0.10
    truth = np.where(beyond.all(-1), OBSTACLE, np.where(beyond.any(-1), UNKNOWN, FREE))
    low, high = heights.min(-1), heights.max(-1)
    clear = np.ones(cells.shape, dtype=bool)  # all nine cells around are of one kind and height
    for dj in range(3):
        for di in range(3):
            part = np.s_[dj : dj + grid.size, di : di + grid.size]
            clear &= truth[part] == truth[INNER]
            clear &= (high[part] - low[INNER] < 0.08) | (truth[INNER] == OBSTACLE)
    clear &= ~are_ramps(loop)
    seen = (cells != UNKNOWN) & clear & (truth[INNER] != UNKNOWN)
    right = seen & (cells == truth[INNER])
    danger = ((np.abs(heights) >= 0.15).mean(-1)[INNER] >= 0.5) & ~are_ramps(loop)
    flat = (np.abs(high[INNER]) < 1e-3) & (np.abs(low[INNER]) < 1e-3)

    def places(mask: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
        corner = np.array([grid.corner_i, grid.corner_j])
        centres_m = (np.argwhere(mask)[:, ::-1] + corner + 0.5) * grid.cell_m
        return [(round(float(x), 2), round(float(y), 2)) for x, y in centres_m]

    wrong = seen & ~right
    held = zip(places(wrong), cells[wrong].tolist(), strict=True)
    return Comparison(
        int(seen.sum()),
        int(right.sum()),
        places((cells == FREE) & danger),
        told_heights(maps)[clear & (cells == FREE) & flat],
        [(*place, cell) for place, cell in held],
    )
