"""The newest positions of the body with their times: kept, interpolated, moved as a whole."""

import math

import numpy as np

from core.records import F64

KEPT = 128  # places: 4 s at 30 pairs of counts per second


class Path:
    """Places `xyz_m` (map frame) and travel (m) at host times, oldest first; KEPT at most."""

    def __init__(self) -> None:
        self._t_s = np.zeros(KEPT)
        self._places_m = np.zeros((KEPT, 4))  # x, y, z, travel
        self._used = 0
        self._newest = (-math.inf, 0.0, 0.0)  # time, x, y

    def __len__(self) -> int:
        return self._used

    @property
    def oldest_s(self) -> float:
        """Time of the oldest place; inf when there is none."""
        return float(self._t_s[0]) if self._used else math.inf

    @property
    def newest_s(self) -> float:
        """Time of the newest place; -inf when there is none."""
        return self._newest[0]

    @property
    def newest_xy_m(self) -> tuple[float, float]:
        """x, y of the newest; there must be one."""
        return self._newest[1:]

    @property
    def newest_m(self) -> F64:
        """Place (3,) of the newest; there must be one."""
        return self._places_m[self._used - 1, :3].copy()

    @property
    def travel_m(self) -> float:
        """Of the newest place; 0 when there is none."""
        return float(self._places_m[self._used - 1, 3]) if self._used else 0.0

    def append(self, t_s: float, xyz_m: F64, travel_m: float) -> None:
        """A place later than all before; the oldest makes room for it."""
        if self._used == KEPT:
            self._t_s[:-1] = self._t_s[1:].copy()
            self._places_m[:-1] = self._places_m[1:].copy()
            self._used -= 1
        self._t_s[self._used] = t_s
        self._places_m[self._used, :3] = xyz_m
        self._places_m[self._used, 3] = travel_m
        self._used += 1
        self._newest = (float(t_s), float(xyz_m[0]), float(xyz_m[1]))

    def forget(self) -> None:
        self._used, self._newest = 0, (-math.inf, 0.0, 0.0)

    def move(self, dx_m: float, dy_m: float) -> None:
        self._places_m[: self._used, 0] += dx_m
        self._places_m[: self._used, 1] += dy_m
        t_s, x_m, y_m = self._newest
        self._newest = (t_s, x_m + dx_m, y_m + dy_m)

    def at(self, at_s: float) -> F64:
        """Place and travel (4,) at an instant; the outermost beyond either end."""
        times_s = self._t_s[: self._used]
        return np.array(
            [np.interp(at_s, times_s, self._places_m[: self._used, n]) for n in range(4)]
        )
