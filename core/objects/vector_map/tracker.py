"""What moves, or may: each thing that the map does not explain, with its velocity.

A Kalman filter of constant velocity for each, gates by Mahalanobis distance, and the assignment of
least total cost. Positions in the map frame, metres; time is each frame's own.

A place is the middle of a hull's box. Of a thing that is seen in part, as at the image's border, it
is off by up to half of what the box lacks. So where the size differs by D from the last one, D / 2
is let pass before the gate, and counts as one more sigma of the place.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with applications to tracking and navigation,
2001, sections 5.2.2 and 6.2 (white noise acceleration); Kuhn, The Hungarian method, 1955.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from core.objects.records import Floats
from core.objects.vector_map.settings import ObjectMapSettings

GATE2 = 13.8  # chi-square, 2 degrees of freedom, 0.1 %
FIRST_SPEED_MPS = 1.5  # 1 sigma of what is seen for the first time: a person walks so fast
OUT = 1e6  # cost of what is outside a gate
T = TypeVar("T")


class Measured(NamedTuple):
    """A hull's box."""

    place: Floats  # (2,) m, its middle
    size: Floats  # (2,) m, along x and y


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

    def wait(self, at_s: float) -> None:
        """To a later time, standing still."""
        self.at_s = max(at_s, self.at_s)

    def distance2(self, place: Floats, bias_m: Floats) -> tuple[float, float]:
        """Of a measured place (2,) m, off by a bias of up to (2,) m: for the gate, and its cost.

        The first is the squared Mahalanobis distance beyond the bias, the second twice the negative
        logarithm of its likelihood, but for a constant.
        """
        off, S = place - self.x[:2], self._innovation(bias_m)
        beyond = np.sign(off) * np.maximum(0.0, np.abs(off) - bias_m)
        gated = float(beyond @ np.linalg.solve(self._innovation(np.zeros(2)), beyond))
        return gated, float(off @ np.linalg.solve(S, off) + np.log(np.linalg.det(S)))

    def correct(self, place: Floats, bias_m: Floats) -> None:
        """A measured place (2,) m; Joseph's form, so that P stays what it is."""
        K = np.linalg.solve(self._innovation(bias_m), self.P[:2]).T
        self.x = self.x + K @ (place - self.x[:2])
        left = np.eye(4)
        left[:, :2] -= K
        self.P = left @ self.P @ left.T + K @ self._noise(bias_m) @ K.T

    def _noise(self, bias_m: Floats) -> Floats:
        return np.diag(self._s.track_sigma_m**2 + np.square(bias_m))

    def _innovation(self, bias_m: Floats) -> Floats:
        return np.asarray(self.P[:2, :2] + self._noise(bias_m))

    @property
    def place_sigma_m(self) -> float:
        return math.sqrt(float(max(self.P[0, 0], self.P[1, 1])))

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

    def __init__(self, number: int, at_s: float, by: Measured, about: T, s: ObjectMapSettings):
        self.id, self.about, self.size = number, about, by.size
        self.filter = Kalman(at_s, by.place, s)
        self.first_s = self.seen_s = at_s
        self.is_fixed = False  # it cannot move

    def bias_m(self, by: Measured) -> Floats:
        """(2,) by how much a place may be off, for more or less of the thing is seen."""
        return np.asarray(0.5 * np.abs(by.size - self.size))


class Tracker(Generic[T]):
    """All tracks. Ids count up and are never used again."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._s, self._next_id = settings, 1
        self.tracks: list[Track[T]] = []

    def predict(self, at_s: float) -> None:
        """All tracks, to a frame's time."""
        for track in self.tracks:
            go_on = track.filter.wait if track.is_fixed else track.filter.predict
            go_on(at_s)

    def assign(self, found: Sequence[Measured]) -> list[Track[T] | None]:
        """The track of each box, None for a new one; all are predicted.

        Where a track may be anywhere within a person's width, it might as well be another's.
        """
        given: list[Track[T] | None] = [None] * len(found)
        tracks = [
            one for one in self.tracks if one.filter.place_sigma_m <= 0.5 * self._s.person_width_m
        ]
        if not tracks or not found:
            return given
        both = np.array(
            [[one.filter.distance2(by.place, one.bias_m(by)) for one in tracks] for by in found]
        )
        for row, column in assignment(np.where(both[:, :, 0] < GATE2, both[:, :, 1], OUT)):
            if both[row, column, 0] < GATE2:
                given[row] = tracks[column]
        return given

    def follow(self, track: Track[T], at_s: float, by: Measured) -> None:
        track.filter.correct(by.place, track.bias_m(by))
        track.seen_s, track.size = at_s, by.size

    def start(self, at_s: float, by: Measured, about: T) -> Track[T]:
        track = Track(self._next_id, at_s, by, about, self._s)
        self._next_id += 1
        self.tracks.append(track)
        return track

    def drop(self, track: Track[T]) -> None:
        self.tracks.remove(track)

    def unseen(self, at_s: float) -> Iterator[Track[T]]:
        """Those that this frame did not show."""
        return iter([track for track in self.tracks if track.seen_s < at_s])
