"""Rooms in a row along x, of random sizes, with a doorway from each to the next. Metres.

The robot starts in the first one, which is long enough for the ground that the operator vouches
for; goals lie in the others.
"""

from dataclasses import dataclass
from typing import Any

from fakes.scenes.scatter import Rect
from fakes.scenes.solids import Shape, Solid, Span
from fakes.scenes.things import Random

WALL_M, HIGH_M, DEEP_M = 0.2, 2.5, -1.0
BEHIND_M = 4.0  # of the start
FIRST_M = 10.0  # from the start to the first doorway, at least
GOAL_M = 1.4  # of goals from walls
GOAL_X_M = (3.0, 8.0)  # from the wall that the doorway is in
CORNER_M = 1.0  # of doorways from walls


@dataclass(frozen=True, slots=True)
class Rooms:
    """Floor and walls; where things may be put; where goals may lie, a room each."""

    walls: tuple[Shape, ...]
    areas: tuple[Rect, ...]
    goal_areas: tuple[Rect, ...]


def rooms_from(entry: dict[str, Any], random: Random) -> Rooms:
    """[rooms]: count, wide_m, long_m and door_m, each [from, to]; long_m not of the first room."""
    least, most = entry["count"]
    count = int(random.integers(least, most + 1))
    begin = -BEHIND_M
    rooms: list[Rect] = []
    doors: list[Span] = []
    door_y = 0.0
    for k in range(count):
        wide = float(random.uniform(*entry["wide_m"]))
        long_m = float(random.uniform(*entry["long_m"])) if k else BEHIND_M + FIRST_M
        long_m += float(random.uniform(0.0, 1.5)) if k == 0 else 0.0
        # the doorway that leads in lies somewhere in the middle half
        low = door_y - wide / 2 + float(random.uniform(-0.25, 0.25)) * wide
        room = (begin, begin + long_m), (low, low + wide)
        rooms.append(room)
        half = float(random.uniform(*entry["door_m"])) / 2
        reach = half + CORNER_M
        door_y += float(random.uniform(-3.0, 3.0))
        door_y = min(room[1][1] - reach, max(room[1][0] + reach, door_y))
        doors.append((door_y - half, door_y + half))
        begin = room[0][1] + WALL_M
    return Rooms(
        tuple(_built(rooms, doors)),
        tuple(rooms[1:]),
        tuple(_goal_area(*room) for room in rooms[1:]),
    )


def _goal_area(x: Span, y: Span) -> Rect:
    near, far = (x[0] + way for way in GOAL_X_M)
    return (near, min(far, x[1] - GOAL_M)), (y[0] + GOAL_M, y[1] - GOAL_M)


def _built(rooms: list[Rect], doors: list[Span]) -> list[Shape]:
    """Floor and walls; the last room's doorway is left out."""
    low_y, high_y = min(y[0] for _, y in rooms) - WALL_M, max(y[1] for _, y in rooms) + WALL_M
    all_x = (rooms[0][0][0] - WALL_M, rooms[-1][0][1] + WALL_M)
    shapes: list[Shape] = [Solid("floor", all_x, (low_y, high_y), (DEEP_M, 0.0))]
    up = (DEEP_M, HIGH_M)
    for k, (x, y) in enumerate(rooms):
        along = (x[0] - WALL_M, x[1] + WALL_M)
        shapes.append(Solid(f"room {k + 1}, right wall", along, (y[0] - WALL_M, y[0]), up))
        shapes.append(Solid(f"room {k + 1}, left wall", along, (y[1], y[1] + WALL_M), up))
    shapes.append(Solid("wall behind", (all_x[0], all_x[0] + WALL_M), (low_y, high_y), up))
    shapes.append(Solid("wall at the end", (all_x[1] - WALL_M, all_x[1]), (low_y, high_y), up))
    for (x, _), door in zip(rooms[:-1], doors[:-1], strict=True):
        wall = (x[1], x[1] + WALL_M)
        shapes.append(Solid("wall right of a doorway", wall, (low_y, door[0]), up))
        shapes.append(Solid("wall left of a doorway", wall, (door[1], high_y), up))
    return shapes
