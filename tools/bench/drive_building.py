"""The building of the synthetic drive: walls, furniture, people who walk, and the robot's way.

A floor of 24 m x 32 m: three by four rooms of 8 m, with a door in every wall between two of them.
Frame: x along the short side, y along the long one, metres, origin in a corner.
Source: planner link, section 10 (docs/protocols/planner-link.md), which tells the drive in words.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from core.records import F64

ROOM_M, ROOMS_X, ROOMS_Y = 8.0, 3, 4
DOOR_M = 1.0
SPEED_MPS, TURN_RADPS, AIM_M = 0.7, 0.9, 0.5  # the robot's, and how far ahead it aims
WALKING_MPS, PERSON_M, PERSON_HEIGHT_M = 1.1, 0.18, 1.75
LEG_M, LEG_HEIGHT_M = 0.03, 0.72
LEAST_M = 1.3  # from the robot's way to the middle of a table

TABLES, CUPBOARDS = 2, 2  # in each room, as far as they are not in the robot's way
ROUTE_M = (
    (3.0, 3.0),
    (4.0, 8.0),  # a door
    (4.6, 12.0),
    (8.0, 12.0),  # a door
    (12.6, 12.6),
    (12.0, 16.0),  # a door
    (11.4, 20.2),
    (16.0, 20.0),  # a door
    (20.2, 20.6),
    (20.0, 24.0),  # a door
    (19.6, 28.0),
)
WALKS_M = (  # from, to: back and forth
    ((1.5, 12.0), (10.5, 12.2)),
    ((9.4, 18.0), (14.4, 21.6)),
    ((18.4, 17.4), (21.0, 27.0)),
)


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """What stands still, metres."""

    walls: F64  # (m, 4): x, y, x, y of their ends; higher than any beam
    legs: F64  # (k, 4): x, y, radius, height


def _wall(x: float, y: float, along_x: bool, length_m: float, doors: list[float]) -> list[F64]:
    """A straight wall from a point, with doors at those distances (their middles)."""
    edges = [0.0, *(e for door in sorted(doors) for e in (door - DOOR_M / 2, door + DOOR_M / 2))]
    edges.append(length_m)
    ends = zip(edges[::2], edges[1::2], strict=True)
    if along_x:
        return [np.array([x + a, y, x + b, y]) for a, b in ends]
    return [np.array([x, y + a, x, y + b]) for a, b in ends]


def _box(x: float, y: float, wide_m: float, deep_m: float) -> list[F64]:
    """The four sides of a cupboard whose lowest corner is (x, y)."""
    corners = [(x, y), (x + wide_m, y), (x + wide_m, y + deep_m), (x, y + deep_m), (x, y)]
    return [np.array([*a, *b]) for a, b in pairwise(corners)]


def _four_legs(x: float, y: float, wide_m: float, deep_m: float, yaw_rad: float) -> list[F64]:
    """A table or a chair about (x, y)."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return [
        np.array([x + c * dx - s * dy, y + s * dx + c * dy, LEG_M, LEG_HEIGHT_M])
        for dx in (-wide_m / 2, wide_m / 2)
        for dy in (-deep_m / 2, deep_m / 2)
    ]


def building(seed: int) -> Building:
    """Rooms as section 10 has them; the seed places the furniture."""
    random = np.random.default_rng(seed)
    walls: list[F64] = []
    for line in range(ROOMS_X + 1):
        doors = [ROOM_M * (k + 0.5) for k in range(ROOMS_Y) if 0 < line < ROOMS_X]
        walls += _wall(ROOM_M * line, 0.0, False, ROOM_M * ROOMS_Y, doors)
    for line in range(ROOMS_Y + 1):
        doors = [ROOM_M * (k + 0.5) for k in range(ROOMS_X) if 0 < line < ROOMS_Y]
        walls += _wall(0.0, ROOM_M * line, True, ROOM_M * ROOMS_X, doors)
    legs: list[F64] = []
    for room in range(ROOMS_X * ROOMS_Y):
        column, row = room % ROOMS_X, room // ROOMS_X
        _furnish(random, ROOM_M * column, ROOM_M * row, walls, legs)
    return Building(np.array(walls), np.array(legs))


def _furnish(
    random: np.random.Generator, x0: float, y0: float, walls: list[F64], legs: list[F64]
) -> None:
    """Cupboards along two walls, tables with a chair, none of it in the robot's way."""
    for k in range(CUPBOARDS):
        along_m = random.uniform(0.3, 2.0)
        walls += _box(x0 + along_m, y0 + (0.05 if k % 2 == 0 else ROOM_M - 0.5), 1.2, 0.45)
    for _ in range(TABLES):
        x, y = x0 + random.uniform(1.2, ROOM_M - 1.2), y0 + random.uniform(1.2, ROOM_M - 1.2)
        turn_rad = random.uniform(0.0, math.pi)
        if way_m(x, y) < LEAST_M:
            continue
        legs += _four_legs(x, y, 1.2, 0.7, turn_rad)
        legs += _four_legs(x - 0.6 * math.sin(turn_rad), y + 0.6 * math.cos(turn_rad), 0.4, 0.4, 0)


def way_m(x: float, y: float) -> float:
    """How far a point is from the robot's way."""
    nearest = math.inf
    for (ax, ay), (bx, by) in pairwise(ROUTE_M):
        along = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2)
        part = min(1.0, max(0.0, along))
        nearest = min(nearest, math.hypot(ax + part * (bx - ax) - x, ay + part * (by - ay) - y))
    return nearest


def people(t_s: float) -> F64:
    """(3, 4) x, y, radius, height of those who walk, at a time of the drive."""
    rows = []
    for (ax, ay), (bx, by) in WALKS_M:
        length_m = math.hypot(bx - ax, by - ay)
        gone = t_s * WALKING_MPS / length_m % 2.0
        part = gone if gone <= 1.0 else 2.0 - gone
        at = (ax + part * (bx - ax), ay + part * (by - ay))
        rows.append([*at, PERSON_M, PERSON_HEIGHT_M])
    return np.array(rows)


@dataclass(frozen=True, slots=True)
class Place:
    """Where the robot is, and how it moves."""

    t_s: float
    x_m: float
    y_m: float
    yaw_rad: float  # counter-clockwise from x
    v_mps: float
    w_radps: float


def way(seconds: float, period_s: float) -> list[Place]:
    """The robot's places, one a period, aiming at its way a little ahead of it."""
    (x, y), goal = ROUTE_M[0], 1
    yaw, places = math.pi / 2, []
    for k in range(round(seconds / period_s)):
        if goal + 1 < len(ROUTE_M) and math.dist((x, y), ROUTE_M[goal]) < AIM_M:
            goal += 1
        gx, gy = ROUTE_M[goal]
        error = (math.atan2(gy - y, gx - x) - yaw + math.pi) % (2 * math.pi) - math.pi
        w = max(-TURN_RADPS, min(TURN_RADPS, 2.5 * error))
        v = SPEED_MPS * max(0.15, math.cos(error)) if math.dist((x, y), (gx, gy)) > 0.05 else 0.0
        places.append(Place(k * period_s, x, y, yaw, v, w))
        yaw += w * period_s
        x, y = x + v * math.cos(yaw) * period_s, y + v * math.sin(yaw) * period_s
    return places
