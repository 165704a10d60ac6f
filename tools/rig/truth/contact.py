"""Where the robot's footprint is to what truly stands there: gaps, overlaps, edges of drops.

The footprint is a rectangle in the plane on which the robot stands; a thing counts from a height
above that plane on, up to the robot's own height. Upright boxes and cylinders are exact; all other
shapes are looked at where the footprint's outline is, every 2 cm. Soft things do not count.
Map frame, metres.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from fakes.scenes.movers import Mover
from fakes.scenes.scene import Scene
from fakes.scenes.solids import Pillar, Shape, Solid
from jit import kernel

F64 = npt.NDArray[np.float64]
Place = tuple[float, float, float]  # x, y, yaw
FRONT_M, REAR_M, SIDE_M = 0.52, 0.20, 0.30  # of the footprint, about the drive axle
HEIGHT_M = 1.30
REACH_M = math.hypot(FRONT_M, SIDE_M)
POINT_M = 0.02  # between two points of the outline
OVERLAP_M = -1.0  # a gap that is none
STEP_UP_M = 0.10  # between two places beside each other that are both ground
SLOPE = math.tan(math.radians(8.0))  # of ground that is none of an obstacle, at most


class Footprint(NamedTuple):
    """What of the robot must touch nothing, about the drive axle."""

    front_m: float
    rear_m: float
    side_m: float
    height_m: float

    @property
    def rect(self) -> tuple[float, float, float]:
        return self.front_m, self.rear_m, self.side_m

    @property
    def reach_m(self) -> float:
        return math.hypot(self.front_m, self.side_m)


USUAL = Footprint(FRONT_M, REAR_M, SIDE_M, HEIGHT_M)


class Plane(Struct, frozen=True):
    """The ground under the robot, carried on: its height at a place, and how it goes from there."""

    x: float
    y: float
    z: float
    along_x: float
    along_y: float

    def at(self, x: F64, y: F64) -> F64:
        """Heights (n,) over points (n,)."""
        return np.asarray(self.z + self.along_x * (x - self.x) + self.along_y * (y - self.y))


def plane_under(
    place: Place, height_m: float, pitch_rad: float = 0.0, roll_rad: float = 0.0
) -> Plane:
    """The plane of a body: nose down and right side down are positive."""
    x, y, yaw = place
    ahead, left = -math.tan(pitch_rad), math.tan(roll_rad) / math.cos(pitch_rad)
    c, s = math.cos(yaw), math.sin(yaw)
    return Plane(x, y, height_m, c * ahead - s * left, s * ahead + c * left)


class Near(Struct, frozen=True):
    """The thing that is nearest to the footprint; a gap of OVERLAP_M is an overlap."""

    gap_m: float
    what: str


NOTHING = Near(math.inf, "")


@kernel
def _rect_gap(x: float, y: float, rect: tuple[float, float, float]) -> float:
    """From a point of the robot's frame to the footprint; 0 within it."""
    dx = max(x - rect[0], -rect[1] - x, 0.0)
    dy = max(abs(y) - rect[2], 0.0)
    return math.hypot(dx, dy)


@kernel
def box_gap(
    place: tuple[float, float, float],
    rect: tuple[float, float, float],
    span: tuple[float, float, float, float],
) -> float:
    """From the footprint to an upright box (x from, to, y from, to); OVERLAP_M: they overlap."""
    x, y, yaw = place
    c, s = math.cos(yaw), math.sin(yaw)
    x0, x1, y0, y1 = span
    nearest = math.inf
    ahead_low, ahead_high, left_low, left_high = math.inf, -math.inf, math.inf, -math.inf
    for k in range(4):
        px = (x0 if k % 2 == 0 else x1) - x
        py = (y0 if k < 2 else y1) - y
        ahead, left = c * px + s * py, c * py - s * px
        ahead_low, ahead_high = min(ahead_low, ahead), max(ahead_high, ahead)
        left_low, left_high = min(left_low, left), max(left_high, left)
        nearest = min(nearest, _rect_gap(ahead, left, rect))
    low_x, high_x, low_y, high_y = math.inf, -math.inf, math.inf, -math.inf
    for k in range(4):
        ahead = rect[0] if k % 2 == 0 else -rect[1]
        left = rect[2] if k < 2 else -rect[2]
        px, py = x + c * ahead - s * left, y + s * ahead + c * left
        low_x, high_x = min(low_x, px), max(high_x, px)
        low_y, high_y = min(low_y, py), max(high_y, py)
        dx, dy = max(x0 - px, px - x1, 0.0), max(y0 - py, py - y1, 0.0)
        nearest = min(nearest, math.hypot(dx, dy))
    apart = (
        ahead_low >= rect[0]
        or ahead_high <= -rect[1]
        or left_low >= rect[2]
        or left_high <= -rect[2]
        or low_x >= x1
        or high_x <= x0
        or low_y >= y1
        or high_y <= y0
    )
    return nearest if apart else OVERLAP_M


@kernel
def disc_gap(
    place: tuple[float, float, float],
    rect: tuple[float, float, float],
    x: float,
    y: float,
    radius: float,
) -> float:
    """From the footprint to an upright cylinder; OVERLAP_M: they overlap."""
    c, s = math.cos(place[2]), math.sin(place[2])
    dx, dy = x - place[0], y - place[1]
    gap = _rect_gap(c * dx + s * dy, c * dy - s * dx, rect) - radius
    return gap if gap >= 0.0 else OVERLAP_M


@kernel
def _nearest(
    boxes: F64,
    discs: F64,
    place: tuple[float, float, float],
    rect: tuple[float, float, float],
    plane: tuple[float, float, float, float, float],
    limits: tuple[float, float, float],
) -> tuple[float, int]:
    """(gap, which) of the nearest box or disc (counted behind the boxes) that is in the way.

    boxes: (n, 6) x from, to, y from, to, z from, to. discs: (m, 5) x, y, radius, z from, to.
    limits: a thing's least height above the plane, the robot's own, and how far to look.
    """
    best, which = limits[2], -1
    for k in range(boxes.shape[0]):
        x = min(max(place[0], boxes[k, 0]), boxes[k, 1])
        y = min(max(place[1], boxes[k, 2]), boxes[k, 3])
        far = math.hypot(x - place[0], y - place[1])
        if far > limits[2] + 1.0:
            continue
        ground = plane[2] + plane[3] * (x - plane[0]) + plane[4] * (y - plane[1])
        if boxes[k, 5] - ground < limits[0] or boxes[k, 4] - ground >= limits[1]:
            continue
        gap = box_gap(place, rect, (boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3]))
        if gap < best:
            best, which = gap, k
    for k in range(discs.shape[0]):
        x, y = discs[k, 0], discs[k, 1]
        if math.hypot(x - place[0], y - place[1]) > limits[2] + 1.0 + discs[k, 2]:
            continue
        ground = plane[2] + plane[3] * (x - plane[0]) + plane[4] * (y - plane[1])
        if discs[k, 4] - ground < limits[0] or discs[k, 3] - ground >= limits[1]:
            continue
        gap = disc_gap(place, rect, x, y, discs[k, 2])
        if gap < best:
            best, which = gap, boxes.shape[0] + k
    return best, which


def outline(margin_m: float = 0.0, footprint: Footprint = USUAL) -> F64:
    """Points (n, 2) ahead and left of the axle, all around the footprint grown by a margin."""
    front, rear, side = (part + margin_m for part in footprint.rect)
    along = np.linspace(-rear, front, 2 + int((front + rear) / POINT_M))
    across = np.linspace(-side, side, 2 + int(2 * side / POINT_M))
    sides = [np.column_stack([along, np.full(len(along), y)]) for y in (-side, side)]
    ends = [np.column_stack([np.full(len(across), x), across]) for x in (-rear, front)]
    return np.vstack(sides + ends)


def placed(points: F64, place: Place) -> tuple[F64, F64]:
    """Points (n, 2) of the robot's frame in the map: x (n,) and y (n,)."""
    c, s = math.cos(place[2]), math.sin(place[2])
    return (
        place[0] + c * points[:, 0] - s * points[:, 1],
        place[1] + s * points[:, 0] + c * points[:, 1],
    )


def parts_of(mover: Mover, since_begin_s: float) -> list[tuple[float, ...]]:
    """Boxes (6 numbers) and discs (5) of a mover at an instant; none while it is not there."""
    at_s = np.array([since_begin_s])
    if not mover.is_there(at_s)[0]:
        return []
    found: list[tuple[float, ...]] = []
    for part in mover.parts:
        ((x, y),) = mover.middles_m(part, at_s).tolist()
        if part.half_m is None:
            found.append((x, y, part.radius_m, *part.z))
        else:
            half_x, half_y = part.half_m
            found.append((x - half_x, x + half_x, y - half_y, y + half_y, *part.z))
    return found


class Ground:
    """All that stands still in a scene, ready to be asked often by a robot of this size."""

    def __init__(self, scene: Scene, footprint: Footprint = USUAL) -> None:
        self.footprint = footprint
        boxes = [solid for solid in scene.firm if _is_box(solid)]
        discs = [solid for solid in scene.firm if isinstance(solid, Pillar)]
        self.others = tuple(
            solid for solid in scene.firm if not (_is_box(solid) or isinstance(solid, Pillar))
        )
        self.names = [solid.name for solid in (*boxes, *discs)]
        self.boxes = np.array([(*s.x, *s.y, *s.z) for s in boxes if isinstance(s, Solid)])
        self.boxes = self.boxes.reshape(-1, 6)
        self.discs = np.array([(*disc.at, disc.radius_m, *disc.z) for disc in discs])
        self.discs = self.discs.reshape(-1, 5)
        self._outlines = {0.0: outline(0.0, footprint)}
        self._floor: Sequence[float] = (math.inf, -math.inf, 0.0, 0.0, 0.0, 0.0)  # asked first

    def nearest(self, place: Place, plane: Plane, from_m: float, within_m: float) -> Near:
        """The nearest thing of a height from `from_m` above the plane, less than a way off."""
        flat = (plane.x, plane.y, plane.z, plane.along_x, plane.along_y)
        limits = (from_m, self.footprint.height_m, within_m)
        gap_m, which = _nearest(self.boxes, self.discs, place, self.footprint.rect, flat, limits)
        return Near(gap_m, self.names[which]) if which >= 0 else NOTHING

    def level_at(self, place: Place, before_z: float) -> Plane:
        """The ground at a place on the way, as if level; a step before, it was so high."""
        x, y = np.array([place[0]]), np.array([place[1]])
        tops = [float(shape.tops_m(x, y)[0]) for shape in self.others]
        x0, x1, y0, y1, _, top = self.boxes.T
        tops += top[(x0 <= x) & (x <= x1) & (y0 <= y) & (y <= y1)].tolist()
        near = [z for z in tops if abs(z - before_z) <= STEP_UP_M]
        return plane_under(place, max(near, default=before_z))

    def slack_m(self, place: Place, margin_m: float) -> float:
        """How far the ground may rise or fall under the outline, where it is not all level."""
        return (
            SLOPE * (self.footprint.front_m + margin_m) if self._others_at(place, margin_m) else 0.0
        )

    def at_outline(self, place: Place, plane: Plane, beyond_m: float, margin_m: float = 0.0) -> str:
        """What is under the outline of the footprint, grown by a margin, in words; "": ground.

        Args:
            beyond_m: ground so much lower is a drop, and what rises so much an obstacle.
        """
        others = self._others_at(place, margin_m)
        if not others and self._is_level(place, plane, self.footprint.reach_m + margin_m):
            return ""
        points = self._outlines.setdefault(margin_m, outline(margin_m, self.footprint))
        x, y = placed(points, place)
        base = plane.at(x, y)
        highest = np.full(len(x), -np.inf)
        for shape in others:
            tops = shape.tops_m(x, y)
            if (
                shape.bottom_m < base.min() + self.footprint.height_m
                and (tops - base >= beyond_m).any()
            ):
                return shape.name
            np.maximum(highest, np.where(tops - base < beyond_m, tops, -np.inf), out=highest)
        x0, x1, y0, y1, _, top = self.boxes.T
        near = (x0 < x.max()) & (x1 > x.min()) & (y0 < y.max()) & (y1 > y.min())
        for k in np.flatnonzero(near):
            inside = (x >= x0[k]) & (x <= x1[k]) & (y >= y0[k]) & (y <= y1[k])
            under = inside & (top[k] - base < beyond_m)
            highest[under] = np.maximum(highest[under], top[k])
        return "a drop" if (highest - base < -beyond_m).any() else ""

    def _others_at(self, place: Place, margin_m: float) -> list[Shape]:
        """What is no box and no cylinder, and near enough to be under the footprint."""
        reach_m, (x, y, _) = self.footprint.reach_m + margin_m, place
        return [
            shape
            for shape in self.others
            if shape.x[0] - reach_m <= x <= shape.x[1] + reach_m
            and shape.y[0] - reach_m <= y <= shape.y[1] + reach_m
        ]

    def _is_level(self, place: Place, plane: Plane, reach_m: float) -> bool:
        """One box's top is the ground all around."""
        if _carries(self._floor, place, plane, reach_m):
            return True
        for box in self.boxes.tolist():
            if _carries(box, place, plane, reach_m):
                self._floor = box
                return True
        return False


def _carries(box: Sequence[float], place: Place, plane: Plane, reach_m: float) -> bool:
    """Whether a box's top is the ground for so far around a place."""
    x, y, _ = place
    x0, x1, y0, y1, _, top = box
    if not (x0 <= x - reach_m and x + reach_m <= x1 and y0 <= y - reach_m and y + reach_m <= y1):
        return False
    height_m = plane.z + plane.along_x * (x - plane.x) + plane.along_y * (y - plane.y)
    return abs(top - height_m) < 0.10 - reach_m * (abs(plane.along_x) + abs(plane.along_y))


def _is_box(solid: Shape) -> bool:
    return isinstance(solid, Solid) and not solid.rise_rad and not solid.rise_x_rad
