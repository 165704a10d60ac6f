"""What a map of method `surface` tells of heights: layers by name, and ground for feet.

It reads cells when somebody asks, and decides nothing. Heights are of the map frame, as `cells.py`
has them: what is always wrong with the attitude is taken out as they are read.
Source: docs/method.md, section 5.
"""

from typing import NamedTuple

import numpy as np

from core.grid.ring import RingGrid
from core.mapping.footing import FOOTING, Ground
from core.mapping.heights.fill import WAYS, fill, is_soft
from core.mapping.heights.upper import Uppers
from core.mapping.layers import FILL, UNITS, RingLayer
from core.mapping.surface.cells import Cells
from core.mapping.surface.constants import LIKELY
from core.mapping.terrain import JUDGED, around, terrain_of
from core.records import F64, I64
from jit import with_fields

LAYERS = UNITS.keys() - {"state", *FOOTING, *FILL}  # the rest is made of these


class Heights(NamedTuple):
    """Of a map, as it is when asked; `at` (n,) are flat indices of its grid."""

    grid: RingGrid
    cells: Cells  # (size, size)
    uppers: Uppers  # (cells,), or of none
    static_rad: F64  # (2,) what pitch and roll are always wrong by
    h_pos_m: float

    def _tilt_m(self, of: Cells | Uppers) -> F64:
        """By how much heights err for that."""
        return np.asarray(self.static_rad[0] * of["arm_m"] + self.static_rad[1] * of["aside_m"])

    def _ground_m(self, of: Cells) -> F64:
        return np.asarray(of["ground_m"] - self._tilt_m(of))

    def _tops_m(self, of: Cells) -> F64:
        """The highest return of what stands in cells, else their ground; NaN: not measured."""
        is_top, seen = (of["stands"] > 0.0) & np.isfinite(of["top_m"]), of["looks"] > 0
        return self._ground_m(of) + np.where(is_top, of["top_m"], np.where(seen, 0.0, np.nan))

    def told_at(self, at: I64) -> tuple[F64, F64]:
        """Heights (n,) and their variances, of what stands, else of the ground; NaN: none.

        A cell that shows both is as high as what ends more of its beams. Without filters, or where
        nothing is in them, the highest return is what stands.
        """
        of = self.cells.reshape(-1)[at]
        height_m, var_m2 = self._tops_m(of), of["var_m2"].astype(float)
        if self.uppers.size > 0:
            uppers, stands, seen = self.uppers[at], of["stands"] > 0.0, of["looks"] > 0
            is_upper = np.isfinite(uppers["var_m2"]) & (stands | ~seen)
            is_floor = is_upper & seen & (uppers["balance"] < 0)  # in more than half of it
            is_single = (uppers["below_m"] == 0.0) & ~seen
            is_sure = (uppers["agreed"] > 0) | (of["stands"] >= LIKELY) | is_single
            upper_m = np.where(is_sure, uppers["z_m"] - self._tilt_m(uppers), np.nan)
            height_m = np.where(is_upper, upper_m, height_m)
            height_m = np.where(is_floor, self._ground_m(of), height_m)
            var_m2 = np.where(is_upper & ~is_floor, uppers["var_m2"], var_m2)
        return height_m, np.where(np.isnan(height_m), np.nan, var_m2)

    def ground_at(self, at: I64) -> Ground:
        """What feet may stand on: the highest return; NaN where it is soft, and elsewhere."""
        of, (z_m, low_m) = self.cells.reshape(-1)[at], np.full((2, *self.cells.shape), np.nan)
        z_m.ravel()[at] = np.where(is_soft(of), np.nan, self._tops_m(of))
        low_m.ravel()[at] = z_m.ravel()[at] + np.minimum(0.0, of["under_m"])
        return Ground(self.grid, z_m, low_m, np.zeros(self.cells.shape))

    def filled_at(self, at: I64) -> Ground:
        """The same, and of cells that were not measured what lies around tells, by `fill`."""
        ground, cells = self.ground_at(at), with_fields(self.cells.reshape(-1))
        told = ground.z_m.ravel(), ground.low_m.ravel(), ground.sigma_m.ravel()
        ways = np.zeros((WAYS, 3))
        fill(at, cells, self.static_rad, self.grid.ring, self.h_pos_m, ways, *told)
        return ground

    def maybe_ring(self, name: str) -> RingLayer | None:
        """A layer by its name, worked out where asked; none: no such one."""
        return (self.grid, lambda at: self._layer_at(name, at)) if name in LAYERS else None

    def _layer_at(self, name: str, at: I64) -> F64:
        of = self.cells.reshape(-1)[at]
        if name == "slope":
            steep = np.arctan(np.hypot(of["slope_x"], of["slope_y"]))
            return np.where(of["looks"] > 0, steep, np.nan)
        if name == "soft":  # whatever its height is
            return np.where(np.isnan(self._tops_m(of)), np.nan, is_soft(of))
        if name in JUDGED:
            near = around(self.grid, at)
            z_m = np.where(near >= 0, self.told_at(np.maximum(near, 0))[0], np.nan)
            judged = terrain_of(z_m, _relief_m(of, self.grid.cell_m), self.grid.cell_m)
            return np.asarray(judged[JUDGED.index(name)], float)
        z_m, var_m2 = self.told_at(at)
        if name == "height":
            is_guess = (of["looks"] == 0) & ~(of["stands"] > 0.0)  # of the ground below
            return np.where(is_guess, np.nan, z_m - self._ground_m(of))
        return z_m if name == "z" else var_m2


def _relief_m(cells: Cells, cell_m: float) -> F64:
    """Between the lowest and the highest in each cell: slopes, what stands, what lacks."""
    stands_m = np.where(cells["stands"] > 0.0, np.maximum(0.0, cells["top_m"]), 0.0)
    steep = np.abs(cells["slope_x"]) + np.abs(cells["slope_y"])
    return np.asarray(stands_m - np.minimum(0.0, cells["under_m"]) + cell_m * steep, float)
