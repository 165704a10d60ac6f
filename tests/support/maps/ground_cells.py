"""Cells of method `surface`, laid by hand in a window: for tests of its kernels."""

import math
from typing import Any

import numpy as np

from core.grid.places import Ring, index_of
from core.grid.touched import Touched
from core.mapping.body import BodyPose
from core.mapping.heights.upper import BLANK_UPPER, NO_UPPERS, UPPER, see_uppers
from core.mapping.surface.cells import (
    BLANK,
    CELL,
    NOW,
    PART_BITS,
    TIED,
    Limits,
    Plane,
    Room,
    Surface,
    plane_at,
)
from core.mapping.surface.evidence import end_beams
from core.mapping.surface.sweep import RETURN, Beams
from core.records import F64
from jit import Records, records

FAR_M = 8.2  # where a level sweep meets the ground
RISES = 0.06  # half the tilt of the scan plane
NOISE_M2 = 1e-4  # of a return
LIMITS = Limits(
    h_pos_m=0.10,
    h_neg_m=-0.10,
    height_m=1.30,
    soft_m=0.0,
    guess_m2=0.04**2,
    sure_m2=0.04**2,
    wheels_m2=math.inf,
    floor_says=0.0,
    sigma_m=0.012,
    sigma_share=0.0,
    noise_m2=NOISE_M2,
    far_m=FAR_M,
    is_plane=True,
    rises=RISES,
    parts=4,
    row=4,
    block=1,
)


def standing(x_m: float = 0.0, y_m: float = 0.0, t_s: float = 0.0, way_m: float = 0.0) -> BodyPose:
    """A robot that looks along x, on level ground of height 0."""
    return BodyPose(x_m, y_m, 0.0, (1.0, 0.0), (0.0, 0.0), way_m, t_s)


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
        count = size * size
        self.touched = Touched.none(count)
        self.surface = Surface(
            cells=self.cells,
            tall=np.zeros(count, np.uint8),
            seen_s=np.full(count, -math.inf),
            oldest_s=-math.inf,
            ring=Ring(low_i, low_j, low_i % size, low_j % size, size, cell_m),
            limits=LIMITS,
            stand=standing(),
            own=self.own,
            P=np.zeros((5, 5)),
            touched=self.touched,
            now=records(NOW),
            uppers=NO_UPPERS,
            room=Room.none(),
        )

    def filter_heights(self) -> Records:
        """Keep upper surfaces from now on: one for each cell."""
        uppers = records(UPPER, self.cells.size)
        uppers[:] = BLANK_UPPER
        self.surface = self.surface._replace(uppers=uppers)
        return uppers

    def at(self, i: int, j: int) -> int:
        """Flat index of a world cell."""
        return index_of(i, j, self.surface.ring)

    def lay(self, i: int, j: int, z_m: float, **more: Any) -> int:
        """Floor that was seen at a world cell; its flat index."""
        at = self.at(i, j)
        usual = {"var_m2": 1e-5, "looks": 4, "floor_s": 0.0, "stands": -3.0, "tied": TIED}
        for name, value in packed({"ground_m": z_m} | usual | more).items():
            self.cells[name][at] = value
        return at

    def plane(self, i: int, j: int, x_m: float, y_m: float) -> Plane:
        """The ground at a world cell by that around it, for a robot that stands there."""
        self.surface.now["held"] += 1  # what was worked out before holds no more
        return plane_at(i, j, self.surface._replace(stand=standing(x_m, y_m)))


def met(
    ground: GroundCells, t_s: float, x_m: float, z_m: float, limits: Limits = LIMITS
) -> Records:
    """A scan whose one beam ends 5 m ahead of the robot at a height; what became of it."""
    returns = records(RETURN)
    one, stand = returns[0], standing(x_m - 5.0, 0.1, t_s)
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
    surface = ground.surface._replace(stand=stand, limits=limits)
    end_beams(Beams(lens, beam, np.full((1, 1), 5.0), returns, 1e-5), surface)
    see_uppers(returns, surface)
    return returns
