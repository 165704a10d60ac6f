"""What moves, or may: each thing that the map does not explain, with its velocity.

A Kalman filter of constant velocity for each, gates by Mahalanobis distance, and the assignment of
least total cost. Positions in the map frame, metres; time is each frame's own.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with applications to tracking and navigation,
2001, sections 5.2.2 and 6.2 (white noise acceleration); Kuhn, The Hungarian method, 1955.
"""

import math
from collections.abc import Iterator
from typing import Generic, TypeVar

import numpy as np

from core.objects.records import Floats
from core.objects.vector_map.settings import ObjectMapSettings

GATE2 = 13.8  # chi-square, 2 degrees of freedom, 0.1 %
FIRST_SPEED_MPS = 1.5  # 1 sigma of what is seen for the first time: a person walks so fast
OUT = 1e6  # cost of what is outside a gate
T = TypeVar("T")


class Kalman:
    """Position and velocity of one thing: `x` (4,) m and m/s, `P` (4, 4) its covariance."""

    def __init__(self, at_s: float, place: Floats, s: ObjectMapSettings) -> None:
        self._s, self.at_s = s, at_s
        self.x = np.array([place[0], place[1], 0.0, 0.0])
        self.P = np.diag([s.track_sigma_m**2] * 2 + [FIRST_SPEED_MPS**2] * 2)

    def predict(self, at_s: float) -> None:
        """To a later time."""
        dt = max(0.0, at_s - self.at_s)
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        G = np.array([[0.5 * dt * dt, 0.0], [0.0, 0.5 * dt * dt], [dt, 0.0], [0.0, dt]])
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + self._s.acceleration_mps2**2 * (G @ G.T)
        self.at_s = max(at_s, self.at_s)

    def distance2(self, place: Floats) -> float:
        """Squared Mahalanobis distance of a measured place (2,) m."""
        off = place - self.x[:2]
        return float(off @ np.linalg.solve(self._innovation(), off))

    def correct(self, place: Floats) -> None:
        """A measured place (2,) m; Joseph's form, so that P stays what it is."""
        K = np.linalg.solve(self._innovation(), self.P[:2]).T
        self.x = self.x + K @ (place - self.x[:2])
        left = np.eye(4)
        left[:, :2] -= K
        self.P = left @ self.P @ left.T + self._s.track_sigma_m**2 * (K @ K.T)

    def _innovation(self) -> Floats:
        return np.asarray(self.P[:2, :2] + self._s.track_sigma_m**2 * np.eye(2))

    @property
    def speed_sigma_mps(self) -> float:
        return math.sqrt(float(max(self.P[2, 2], self.P[3, 3])))


def assignment(cost: Floats) -> list[tuple[int, int]]:
    """Pairs (row, column) of least total cost; of a matrix (n, m), min(n, m) of them.

    >>> assignment(np.array([[4.0, 1.0, 3.0], [2.0, 0.0, 5.0]]))
    [(0, 1), (1, 0)]
    """
    if cost.size == 0:
        return []
    if cost.shape[0] > cost.shape[1]:
        return sorted((row, column) for column, row in assignment(cost.T))
    n, m = cost.shape
    u, v = np.zeros(n + 1), np.zeros(m + 1)
    row_of = np.zeros(m + 1, dtype=np.int64)  # 1-based; 0: free
    for row in range(1, n + 1):
        way, best = np.zeros(m + 1, dtype=np.int64), np.full(m + 1, np.inf)
        used = np.zeros(m + 1, dtype=bool)
        row_of[0], at = row, 0
        while True:
            used[at] = True
            here = int(row_of[at])
            reduced = cost[here - 1] - u[here] - v[1:]
            nearer = ~used[1:] & (reduced < best[1:])
            best[1:][nearer], way[1:][nearer] = reduced[nearer], at
            free = np.where(used, np.inf, best)
            free[0] = np.inf
            following = int(np.argmin(free))
            step = free[following]
            u[row_of[used]] += step
            v[used] -= step
            best[~used] -= step
            at = following
            if row_of[at] == 0:
                break
        while at:
            row_of[at] = row_of[way[at]]
            at = int(way[at])
    return sorted((int(row_of[k]) - 1, k - 1) for k in range(1, m + 1) if row_of[k])


class Track(Generic[T]):
    """One thing that is followed; what else is known of it is its owner's."""

    def __init__(self, number: int, at_s: float, place: Floats, about: T, s: ObjectMapSettings):
        self.id, self.about = number, about
        self.filter = Kalman(at_s, place, s)
        self.first_s = self.seen_s = at_s


class Tracker(Generic[T]):
    """All tracks. Ids count up and are never used again."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._s, self._next_id = settings, 1
        self.tracks: list[Track[T]] = []

    def assign(self, at_s: float, places: list[Floats]) -> list[Track[T] | None]:
        """The track of each measured place (2,) m, None for a new one; tracks are predicted."""
        for track in self.tracks:
            track.filter.predict(at_s)
        cost = np.array([[track.filter.distance2(p) for track in self.tracks] for p in places])
        found: list[Track[T] | None] = [None] * len(places)
        for row, column in assignment(np.where(cost < GATE2, cost, OUT)):
            if cost[row, column] < GATE2:
                found[row] = self.tracks[column]
        return found

    def follow(self, track: Track[T], at_s: float, place: Floats) -> None:
        track.filter.correct(place)
        track.seen_s = at_s

    def start(self, at_s: float, place: Floats, about: T) -> Track[T]:
        track = Track(self._next_id, at_s, place, about, self._s)
        self._next_id += 1
        self.tracks.append(track)
        return track

    def drop(self, track: Track[T]) -> None:
        self.tracks.remove(track)

    def unseen(self, at_s: float) -> Iterator[Track[T]]:
        """Those that this frame did not show."""
        return iter([track for track in self.tracks if track.seen_s < at_s])
