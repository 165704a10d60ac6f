"""How far the pose has slid along its way, by upright faces that the robot drives towards.

Wheels that slip alike count more than the robot travels, and no gyro sees it. But the front of a
pillar, a box or a wall stays where it is: returns from it that come to lie before or behind those
that made it known tell how far the pose is off along the way. Only faces that look along the way
are used, and many returns of a scan must agree in their middle. `core.motion.slip` judges whether
what they say over a while is slip.
Source: point-to-line matching, Censi, ICRA 2008, in one direction.
"""

import math
from bisect import bisect

import numpy as np

from core.grid.places import Ring, cell_at
from core.grid.ring import RingGrid
from core.mapping.body import BodyPose
from core.mapping.rays import MIN_RANGE_M, Sweep
from core.motion.slip import SlipEstimator
from core.motion.track import Track
from core.records import F64
from jit import Records, Settled, kernel, with_fields

FACE = np.dtype(
    [
        ("x_m", np.float64),  # middle of the returns that made it known, map frame
        ("y_m", np.float64),
        ("low_m", np.float64),  # lowest and highest return in the cell, over the ground
        ("high_m", np.float64),
        ("n", np.int32),  # of so many returns,
        ("segment", np.int32),  # on this segment of the path
    ],
    align=True,
)
LOW_M = 0.25  # above the ground: lower returns may be of the top of a thing, or of a slope
APART = 2  # beams to either side that tell how a face runs
ALONG_M = 0.3  # and how far off they may be
UPRIGHT_M = 0.1  # between its lowest and its highest return: a floor or the top of a thing has not
FACING = 0.95  # cosine between a face's normal and the way
KNOWN = 14  # returns that make a face known, and tell where it is
MOST_M = 0.25
LEAST = 12  # returns that agree
AGREE_M = 0.05  # about their middle
SAME_SEGMENT = math.cos(math.radians(20.0))  # a robot that has turned by more makes its faces anew
STRAIGHT_RADPS = 0.1  # one that turns faster does not see how far it offsets along its way


@kernel
def _normal(
    origins: F64, rays: F64, ranges_m: F64, b: int, hx: float, hy: float
) -> tuple[float, float]:
    """Normal of the surface that a beam meets, along the way; NaN if it looks elsewhere."""
    one, other = b - APART, b + APART
    if one < 0 or other >= rays.shape[0]:
        return math.nan, math.nan
    r, ra, rb = ranges_m[0, b], ranges_m[0, one], ranges_m[0, other]
    if not (abs(ra - r) < ALONG_M and abs(rb - r) < ALONG_M and ra > MIN_RANGE_M):
        return math.nan, math.nan
    dx = origins[other, 0] + rb * rays[other, 0] - origins[one, 0] - ra * rays[one, 0]
    dy = origins[other, 1] + rb * rays[other, 1] - origins[one, 1] - ra * rays[one, 1]
    length = math.sqrt(dx * dx + dy * dy)
    facing = dy * hx - dx * hy
    if length < 1e-3 or abs(facing) < FACING * length:
        return math.nan, math.nan
    length = math.copysign(length, facing)
    return dy / length, -dx / length


@kernel
def _off(
    x: float, y: float, normal: tuple[float, float], segment: int,
    ring: Ring, faces: Records,
) -> float:  # fmt: skip
    """How far a return lies ahead of the nearest known face; inf: there is none near."""
    best = math.inf
    for step in range(-1, 2):
        away = step * ring.cell_m
        at = cell_at(x + away * normal[0], y + away * normal[1], ring)
        if at < 0 or faces[at].segment != segment or faces[at].n < KNOWN:
            continue
        face = faces[at]
        off = (x - face.x_m) * normal[0] + (y - face.y_m) * normal[1]
        if face.high_m - face.low_m >= UPRIGHT_M and abs(off) < abs(best):
            best = off
    return best if abs(best) <= MOST_M else math.inf


@kernel
def _offsets_of(
    origins: F64, rays: F64, ranges_m: F64, heights_m: F64, heading: tuple[float, float],
    segment: int, ring: Ring, faces: Records, offsets_m: F64,
) -> int:  # fmt: skip
    """How far (k,) along the way returns lie ahead of the faces they belong to; learns new ones."""
    n, (hx, hy) = 0, heading
    for b in range(rays.shape[0]):
        r = ranges_m[0, b]
        if not r >= MIN_RANGE_M:
            continue
        x, y = origins[b, 0] + r * rays[b, 0], origins[b, 1] + r * rays[b, 1]
        at, height = cell_at(x, y, ring), heights_m[b]
        if at < 0:
            continue
        face = faces[at]
        if face.segment != segment:
            face.segment, face.n, face.low_m, face.high_m = segment, 0, height, height
        face.low_m, face.high_m = min(face.low_m, height), max(face.high_m, height)
        if height < LOW_M:
            continue
        normal = _normal(origins, rays, ranges_m, b, hx, hy)
        if math.isnan(normal[0]):
            continue
        off_m = _off(x, y, normal, segment, ring, faces)
        if off_m < math.inf:
            offsets_m[n] = off_m / (normal[0] * hx + normal[1] * hy)
            n += 1
        if face.n < KNOWN and (off_m == math.inf or face.n > 0):
            face.n += 1
            face.x_m += (x - face.x_m) / face.n
            face.y_m += (y - face.y_m) / face.n
    return n


class FaceMatcher:
    """What stands across the way, in the cells of a grid, and what it says of the pose."""

    def __init__(self, grid: RingGrid, max_beams: int) -> None:
        self._grid = grid
        self._faces = with_fields(grid.layer(FACE, np.zeros((), FACE)).reshape(-1))
        self._offsets_m = np.zeros(max_beams)
        self._slip = SlipEstimator()
        self._segment, self._heading = 1, (math.nan, math.nan)
        self._match = Settled(_offsets_of)

    def erase(self) -> None:
        """Forget what they told; the grid forgets the faces."""
        self._slip.restart()

    def set_right(self, sweep: Sweep, heights_m: F64, body: BodyPose, odometry: Track) -> None:
        """Take slip along the way out of the place, if enough of a sweep has shown it for a while.

        The sweep adds to the faces. heights_m (n,): of its first returns, over the ground.
        """
        offset_m = self.maybe_offset_m(sweep, heights_m, body)
        if offset_m is None:
            return
        (hx, hy), (x_m, y_m) = body.heading, odometry.corrected_m.tolist()
        corrected_m = hx * x_m + hy * y_m
        slipped_m = self._slip.maybe_slipped_m(body.travel_m, offset_m, corrected_m)
        if slipped_m is not None and abs(odometry.w_radps) < STRAIGHT_RADPS:
            odometry.correct_slip(body.heading, slipped_m)

    def maybe_offset_m(self, sweep: Sweep, heights_m: F64, body: BodyPose) -> float | None:
        """How far ahead of its faces a sweep sees them, if enough of its returns agree."""
        hx, hy = body.heading
        if not self._heading[0] * hx + self._heading[1] * hy >= SAME_SEGMENT:
            self._segment, self._heading = self._segment + 1, body.heading
            self._slip.restart()
        n = self._match(
            sweep.origins, sweep.rays, sweep.ranges_m, heights_m, body.heading, self._segment,
            self._grid.ring, self._faces, self._offsets_m,
        )  # fmt: skip
        if n < LEAST:
            return None
        offsets_m: list[float] = sorted(self._offsets_m[:n].tolist())
        middle_m = 0.5 * (offsets_m[n // 2] + offsets_m[(n - 1) // 2])
        first, last = bisect(offsets_m, middle_m - AGREE_M), bisect(offsets_m, middle_m + AGREE_M)
        if last - first < max(LEAST, 0.5 * n):
            return None
        return sum(offsets_m[first:last]) / (last - first)
