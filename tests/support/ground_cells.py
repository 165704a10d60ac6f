"""Cells of method `surface`, laid by hand in a window: for tests of its kernels."""

import math
from typing import Any

import numpy as np

from core.mapping.surface.cells import BLANK, CELL, PART_BITS, TIED, Ground, Surface
from core.mapping.surface.evidence import end_beams
from core.mapping.surface.sweep import RETURN, Beams, Stand
from core.mapping.surface.touched import Limits, none_touched
from core.records import F64
from jit import Records, records

LIMITS = Limits(0.10, -0.10, 1.30, 0.04**2, 11.6, 4)
RISES = 0.06  # half the tilt of the scan plane
NOISE_M2 = 1e-4  # of a return


def packed(fields: dict[str, Any]) -> dict[str, Any]:
    """Fields of a cell, in which parts with floor and parts under which beams were are one."""
    rest = dict(fields)
    floor, under = rest.pop("floor_parts", 0), rest.pop("under_parts", 0)
    return rest | {"parts": floor | under << PART_BITS}


class GroundCells:
    """A window whose lowest cell is `corner`, and what one scan touches in it."""

    def __init__(
        self, size: int = 41, cell_m: float = 0.2, corner: tuple[int, int] | None = None
    ) -> None:
        self.cells = records(CELL, size * size)
        self.cells[:] = BLANK
        self.own: F64 = np.zeros(5)
        low_i, low_j = corner or (-(size // 2), -(size // 2))
        self.surface: Surface = Ground(self.cells, size, cell_m, RISES, self.own).surface(
            low_i, low_j
        )
        count = size * size
        self.touched = none_touched(np.zeros(count, np.uint8), np.full(count, -math.inf))

    def at(self, i: int, j: int) -> int:
        """Flat index of a world cell."""
        return (j % self.surface.size) * self.surface.size + i % self.surface.size

    def lay(self, i: int, j: int, z_m: float, **more: Any) -> int:
        """Floor that was seen at a world cell; its flat index."""
        at = self.at(i, j)
        usual = {"var_m2": 1e-5, "looks": 4, "floor_s": 0.0, "stands": -3.0, "tied": TIED}
        for name, value in packed({"ground_m": z_m} | usual | more).items():
            self.cells[name][at] = value
        return at


def met(
    ground: GroundCells, t_s: float, x_m: float, z_m: float, limits: Limits = LIMITS
) -> Records:
    """A scan whose one beam ends 5 m ahead of the robot at a height; what became of it."""
    returns = records(RETURN)
    one, stand = returns[0], Stand(x_m - 5.0, 0.1, 0.0, 0.0, 0.0, 1.0, 0.0, t_s, 0.0)
    one["at"] = at = ground.at(int(x_m // 0.2), 0)
    one["x_m"], one["y_m"], one["z_m"], one["ahead_m"] = x_m, 0.1, z_m, 5.0
    cell = ground.cells[at]
    one["from_x"], one["from_y"] = x_m - (x_m // 0.2 + 0.5) * 0.2, 0.0
    one["height_m"] = one["near_m"] = z_m - cell["ground_m"]
    one["var_m2"] = one["near_var_m2"] = cell["var_m2"]
    one["noise_m2"], one["wander_m2"], one["is_before"] = NOISE_M2, 1e-3, 1
    one["age_s"] = t_s - cell["floor_s"]
    beam = np.array([[1.0, 0.0, -0.14]])
    lens = np.array([[x_m - 5.0, 0.1, 0.7]])
    ground.touched.used[0] = 0
    end_beams(
        Beams(lens, beam, np.full((1, 1), 5.0), returns, 1e-5),
        stand, limits, ground.surface, ground.touched,
    )  # fmt: skip
    return returns
