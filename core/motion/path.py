"""The newest positions of the body with their times: kept, interpolated, moved as a whole."""

import math

import numpy as np

from core.records import F64
from jit import kernel

KEPT = 128  # places: 4 s at 30 pairs of counts per second
Place = tuple[float, float, float, float]  # x, y, z, travel


@kernel
def _place_at(t_s: F64, places_m: F64, first: int, used: int, at_s: float) -> Place:
    """Between its neighbours in time; the outermost beyond either end."""
    low, high = 0, used - 1
    while high - low > 1:
        middle = (low + high) // 2
        if t_s[(first + middle) % KEPT] <= at_s:
            low = middle
        else:
            high = middle
    a, b = (first + low) % KEPT, (first + high) % KEPT
    if at_s >= t_s[b]:
        return (places_m[b, 0], places_m[b, 1], places_m[b, 2], places_m[b, 3])
    if at_s <= t_s[a]:
        return (places_m[a, 0], places_m[a, 1], places_m[a, 2], places_m[a, 3])
    since_s, whole_s = at_s - t_s[a], t_s[b] - t_s[a]
    return (
        (places_m[b, 0] - places_m[a, 0]) / whole_s * since_s + places_m[a, 0],
        (places_m[b, 1] - places_m[a, 1]) / whole_s * since_s + places_m[a, 1],
        (places_m[b, 2] - places_m[a, 2]) / whole_s * since_s + places_m[a, 2],
        (places_m[b, 3] - places_m[a, 3]) / whole_s * since_s + places_m[a, 3],
    )


class Path:
    """Places (map frame, m) and travel (m) at host times; the newest KEPT, a ring."""

    def __init__(self) -> None:
        self._t_s = np.zeros(KEPT)
        self._places_m = np.zeros((KEPT, 4))
        self._first = self._used = 0
        self.newest_s = -math.inf  # time of the newest place; -inf when there is none,
        self.newest_m: Place = (0.0, 0.0, 0.0, 0.0)  # which is this

    def __len__(self) -> int:
        return self._used

    @property
    def oldest_s(self) -> float:
        """Time of the oldest place; inf when there is none."""
        return float(self._t_s[self._first]) if self._used else math.inf

    @property
    def travel_m(self) -> float:
        """Of the newest place; 0 when there is none."""
        return self.newest_m[3]

    def append(self, t_s: float, x_m: float, y_m: float, z_m: float, travel_m: float) -> None:
        """A place later than all before; the oldest makes room for it."""
        if self._used == KEPT:
            self._first = (self._first + 1) % KEPT
        else:
            self._used += 1
        last = (self._first + self._used - 1) % KEPT
        self.newest_s, self.newest_m = t_s, (x_m, y_m, z_m, travel_m)
        self._t_s[last], self._places_m[last] = t_s, self.newest_m

    def forget(self) -> None:
        self._first = self._used = 0
        self.newest_s, self.newest_m = -math.inf, (0.0, 0.0, 0.0, 0.0)

    def move(self, dx_m: float, dy_m: float) -> None:
        self._places_m[:, 0] += dx_m
        self._places_m[:, 1] += dy_m
        x_m, y_m, z_m, travel_m = self.newest_m
        self.newest_m = x_m + dx_m, y_m + dy_m, z_m, travel_m

    def at(self, at_s: float) -> Place:
        """Place and travel at an instant; the outermost beyond either end; there must be one."""
        return _place_at(self._t_s, self._places_m, self._first, self._used, at_s)
