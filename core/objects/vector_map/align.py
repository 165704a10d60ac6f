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
from core.pose_fix import GATE2
from jit import kernel, releasing_kernel

ROUNDS = 4
CAUCHY = 2.4  # sigmas where a residual weighs half: 95 % efficient without outliers
OF_A_HULL = 4.0  # measurements that a hull is worth, however many pieces it has
LEAST_COSINE = 0.9  # of the angle between a piece and the line that it may belong to


class Sides(NamedTuple):
    """Some sides of a frame, and the lines of the map that they may lie on."""

    pieces: Floats  # (n, >= 4) m: x1, y1, x2, y2, counter-clockwise around a hull
    lines: Floats  # (m, 4) m, the same way round
    sigma_m: float


class Nearest(NamedTuple):
    """A line: how far off it a point is, to its right, and its normal to there."""

    off_m: float
    x: float
    y: float


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
    c, lens = np.zeros(3), (float(origin[0]), float(origin[1]))
    known = [  # all alike, for the kernel
        Sides(np.ascontiguousarray(pieces), np.ascontiguousarray(lines), float(sigma_m))
        for pieces, lines, sigma_m in sides
    ]
    for _ in range(ROUNDS):
        A: Floats = prior.copy()
        b: Floats = -prior @ c
        for side in known:
            _add(side, c, lens, float(s.guard_m), A, b)
        c = c + np.linalg.solve(A, b)
    if float(c @ prior @ c) > GATE2:
        c = np.zeros(3)
    return Correction(float(c[0]), float(c[1]), float(c[2]), origin)


@kernel
def _nearest(x: float, y: float, ux: float, uy: float, lines: Floats, gate_m: float) -> Nearest:
    """How far a piece's middle is off the nearest line that it may lie on, and its normal.

    Along it: within the line's ends, nearly parallel, and not further off than the gate.
    """
    best = Nearest(gate_m, 0.0, 0.0)  # (0, 0): there is none
    for m in range(lines.shape[0]):
        dx, dy = lines[m, 2] - lines[m, 0], lines[m, 3] - lines[m, 1]
        length = max(math.sqrt(dx * dx + dy * dy), 1e-9)
        dx, dy = dx / length, dy / length
        qx, qy = x - lines[m, 0], y - lines[m, 1]
        foot, off = qx * dx + qy * dy, qx * dy - qy * dx
        is_along = 0.0 <= foot <= length and ux * dx + uy * dy > LEAST_COSINE
        if is_along and abs(off) < abs(best.off_m):
            best = Nearest(off, dy, -dx)  # outwards
    return best


@releasing_kernel
def _add(
    sides: Sides, by: Floats, origin: tuple[float, float], gate_m: float, A: Floats, b: Floats
) -> None:
    """One round's sums over some sides, into A (3, 3) and b (3,).

    Args:
        by: (3,) how far the frame has been moved: x and y in m, turn in rad.
    """
    pieces, cos, sin = sides.pieces, math.cos(by[2]), math.sin(by[2])
    each = min(1.0, OF_A_HULL / max(1, pieces.shape[0])) / (sides.sigma_m * sides.sigma_m)
    for k in range(pieces.shape[0]):
        mx, my = 0.5 * (pieces[k, 0] + pieces[k, 2]), 0.5 * (pieces[k, 1] + pieces[k, 3])
        ux, uy = pieces[k, 2] - pieces[k, 0], pieces[k, 3] - pieces[k, 1]
        length = max(math.sqrt(ux * ux + uy * uy), 1e-9)
        ux, uy = (cos * ux - sin * uy) / length, (sin * ux + cos * uy) / length
        mx, my = mx - origin[0], my - origin[1]
        x, y = cos * mx - sin * my + by[0], sin * mx + cos * my + by[1]  # from the lens
        off, nx, ny = _nearest(x + origin[0], y + origin[1], ux, uy, sides.lines, gate_m)
        if nx == 0.0 and ny == 0.0:
            continue
        w = each / (1.0 + (off / (CAUCHY * sides.sigma_m)) ** 2)
        row = nx, ny, ny * x - nx * y  # the last: how much further it goes by a turn of 1
        for i in range(3):
            b[i] -= w * off * row[i]
            for j in range(3):
                A[i, j] += w * row[i] * row[j]
