"""The whole house in one process on a simulated clock: world, fakes, wires, app, planner's end."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from config_file import load_config
from core.config import Config
from core.mapping.beams.maps import BeamMaps
from core.records import FREE, OBSTACLE, UNKNOWN
from fakes.planner_mcu.receiver import FakePlanner
from fakes.scenes.scene import Scene
from tools.rig.loop import SESSION, SHIPPED, START_S, Loop

F64 = npt.NDArray[np.float64]
__all__ = ["SESSION", "SHIPPED", "START_S", "ClosedLoop", "Comparison", "compare"]


class ClosedLoop(Loop):
    """App and fakes, stepped together; faults are set on the wires and fakes between steps."""

    def __init__(
        self,
        config: Config | None = None,
        scene: Scene | str = "corridor",
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

    @property
    def listening(self) -> bool:
        """Whether the planner hears and answers; settable."""
        return not self.planner.deaf

    @listening.setter
    def listening(self, listening: bool) -> None:
        self.planner.deaf = self.planner.mute = not listening


@dataclass(frozen=True, slots=True)
class Comparison:
    """A map held against the world's truth."""

    seen: int  # cells decided, not within one cell of an edge of the truth
    right: int
    free_on_obstacle: list[
        tuple[float, float]
    ]  # centres of free cells, half of them on a box or in the ditch
    floor_error_m: F64  # height errors of floor cells
    wrong: list[tuple[float, float, int]]  # centre, and what the map holds


SAMPLES = np.linspace(0.02, 0.98, 7)


def compare(loop: ClosedLoop) -> Comparison:
    """The app's maps now against the world; places in the map frame, which begins at the start."""
    mapper = loop.app.mapper
    maps = mapper.maps
    assert isinstance(maps, BeamMaps)
    grid, cell_m = maps.window.grid, maps.window.grid.cell_m
    size = grid.size
    i = grid.corner_i - 1 + np.arange(size + 2)
    j = grid.corner_j - 1 + np.arange(size + 2)
    x = (i[None, :, None, None] + SAMPLES[None, None, None, :]) * cell_m
    y = (j[:, None, None, None] + SAMPLES[None, None, :, None]) * cell_m
    x, y = np.broadcast_arrays(x, y)
    heights = loop.rig.world.height_at(x.ravel(), y.ravel()).reshape(x.shape)
    flat = heights.reshape(size + 2, size + 2, -1)
    beyond = (flat >= 0.10) | (flat <= -0.10)
    truth = np.where(beyond.all(-1), OBSTACLE, np.where(beyond.any(-1), UNKNOWN, FREE))
    low, high = flat.min(-1), flat.max(-1)
    inner = np.s_[1:-1, 1:-1]
    clear = np.ones((size, size), dtype=bool)  # all nine cells around are of one kind and height
    for dj in range(3):
        for di in range(3):
            part = np.s_[dj : dj + size, di : di + size]
            clear &= truth[part] == truth[inner]
            clear &= (high[part] - low[inner] < 0.08) | (truth[inner] == OBSTACLE)
    cells = loop.map_now()
    seen = (cells != UNKNOWN) & clear & (truth[inner] != UNKNOWN)
    right = seen & (cells == truth[inner])
    danger = ((flat >= 0.15) | (flat <= -0.15)).mean(-1)[inner] >= 0.5
    centre = ((i[1:-1] + 0.5) * cell_m, (j[1:-1] + 0.5) * cell_m)

    def places(mask: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
        rows, columns = np.nonzero(mask)
        return [
            (round(float(centre[0][c]), 2), round(float(centre[1][r]), 2))
            for r, c in zip(rows, columns, strict=True)
        ]

    floor = clear & (cells == FREE) & (np.abs(high[inner]) < 1e-3) & (np.abs(low[inner]) < 1e-3)
    source = maps.elevation.grid
    mean = np.roll(maps.elevation.mean_m, (-source.corner_j, -source.corner_i), axis=(0, 1))
    offset_i, offset_j = grid.corner_i - source.corner_i, grid.corner_j - source.corner_j
    mean = mean[offset_j : offset_j + size, offset_i : offset_i + size]
    return Comparison(
        int(seen.sum()),
        int(right.sum()),
        places((cells == FREE) & danger),
        mean[floor],
        [
            (*place, int(cell))
            for place, cell in zip(
                places(seen & ~right), cells[np.nonzero(seen & ~right)], strict=True
            )
        ],
    )
