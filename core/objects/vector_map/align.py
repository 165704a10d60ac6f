"""Where a frame really was: its sides against what the map has of them, its pose as the prior.

One Gauss-Newton fit of shift and turn over all things at once. Residuals are distances from what
the frame saw to the map's finished sides and walls. What has moved does not fit, weighs little
(Cauchy), and drags the frame no further than the pose's own sigma lets it.

Source: Chen and Medioni, Object modeling by registration of multiple range images, 1992 (distances
to lines); Cauchy's M-estimator.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from core.objects.records import Floats, FrameObjects
from core.objects.vector_map.settings import ObjectMapSettings

ROUNDS = 4
CAUCHY = 2.4  # sigmas where a residual weighs half: 95 % efficient without outliers
GATE2 = 11.3  # chi-square, 3 degrees of freedom, 1 %: further the pose itself is not believed
OF_A_HULL = 4.0  # measurements that a hull is worth, however many pieces it has
LEAST_COSINE = 0.9  # of the angle between a piece and the line that it may belong to


class Sides(NamedTuple):
    """Some sides of a frame, and the lines of the map that they may lie on."""

    pieces: Floats  # (n, >= 4) m: x1, y1, x2, y2, counter-clockwise around a hull
    lines: Floats  # (m, 4) m, the same way round
    sigma_m: float


class Correction(NamedTuple):
    """A rigid motion of a frame about its lens: what to add so that it fits the map."""

    x_m: float
    y_m: float
    turn_rad: float
    origin: tuple[float, float]

    def points(self, points: Floats) -> Floats:
        """Points (n, 2) m of the frame as the map has them."""
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        off = points - np.array(self.origin)
        x, y = off[:, 0], off[:, 1]
        moved = np.column_stack([c * x - s * y, s * x + c * y])
        return np.asarray(moved + np.array(self.origin) + np.array([self.x_m, self.y_m]))

    def pieces(self, pieces: Floats) -> Floats:
        """Pieces (k, >= 4) of a hull, moved; what else is in their rows stays."""
        ends = self.points(pieces[:, :4].reshape(-1, 2)).reshape(-1, 4)
        return np.hstack([ends, pieces[:, 4:]])

    def frame(self, frame: FrameObjects) -> FrameObjects:
        """A whole frame, moved."""
        if self.x_m == self.y_m == self.turn_rad == 0.0:
            return frame
        found = tuple(one._replace(polygon=self.points(one.polygon)) for one in frame.detections)
        walls = self.points(frame.walls.reshape(-1, 2)).reshape(-1, 4)
        origin = (frame.origin[0] + self.x_m, frame.origin[1] + self.y_m)
        view = self.points(frame.view)
        return frame._replace(origin=origin, view=view, detections=found, walls=walls)

    def shift_at(self, point: Floats) -> Floats:
        """How far (2,) it moves a point (2,), m."""
        return np.asarray(self.points(point[None])[0] - point)


def correction_of(
    sides: Sequence[Sides], origin: tuple[float, float], s: ObjectMapSettings
) -> Correction:
    """The most likely motion of a frame onto the map; none where the map does not know."""
    prior = np.diag([1.0 / s.pose_sigma_m**2] * 2 + [1.0 / math.radians(s.pose_sigma_deg) ** 2])
    c = np.zeros(3)
    for _ in range(ROUNDS):
        A: Floats = prior.copy()
        b: Floats = -prior @ c
        for side in sides:
            if len(side.pieces) == 0 or len(side.lines) == 0:
                continue
            by = Correction(c[0], c[1], c[2], origin)
            points, r, normals = _residuals(by.pieces(side.pieces), side.lines, s.guard_m)
            J = np.column_stack([normals, _turning(normals, points - np.array(origin))])
            each = min(1.0, OF_A_HULL / len(side.pieces)) / side.sigma_m**2
            w = each / (1.0 + (r / (CAUCHY * side.sigma_m)) ** 2)
            A += J.T @ (w[:, None] * J)
            b -= J.T @ (w * r)
        c = c + np.linalg.solve(A, b)
    if float(c @ prior @ c) > GATE2:
        c = np.zeros(3)
    return Correction(float(c[0]), float(c[1]), float(c[2]), origin)


def _turning(normals: Floats, off: Floats) -> Floats:
    """How much further (k,) along its normal a point (k, 2) from the lens goes by a turn of 1."""
    return np.asarray(normals[:, 1] * off[:, 0] - normals[:, 0] * off[:, 1])


def _residuals(pieces: Floats, lines: Floats, gate_m: float) -> tuple[Floats, Floats, Floats]:
    """Middles (k, 2) of pieces that lie along a line, how far off it they are, its normals (k, 2).

    Along it: within the line's ends, nearly parallel, and not further off than the gate.
    """
    points = 0.5 * (pieces[:, :2] + pieces[:, 2:4])
    steps = pieces[:, 2:4] - pieces[:, :2]
    steps = steps / np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    along = lines[:, 2:] - lines[:, :2]
    lengths = np.maximum(np.hypot(*along.T), 1e-9)
    along = along / lengths[:, None]
    normals = np.column_stack([along[:, 1], -along[:, 0]])  # outwards
    off = points[:, None] - lines[None, :, :2]
    foot, r = (off * along).sum(axis=2), (off * normals).sum(axis=2)
    fits = (foot >= 0.0) & (foot <= lengths) & (np.abs(r) < gate_m)
    fits &= steps @ along.T > LEAST_COSINE
    apart = np.where(fits, np.abs(r), np.inf)
    line = apart.argmin(axis=1)
    known = np.flatnonzero(np.isfinite(apart.min(axis=1)))
    return points[known], r[known, line[known]], normals[line[known]]
