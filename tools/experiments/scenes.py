"""The places of the experiments: floors, walls and what stands on them, in the map frame.

The robot starts at the origin and looks along x. No edge lies on a multiple of a cell, so that none
coincides with the map's cells.
"""

import math
from collections.abc import Sequence

from fakes.scenes.scene import Scene
from fakes.scenes.solids import Shape, Solid

DEEP_M = -1.0  # how far floors reach down
WALL_M = 2.5  # how high walls are
THICK_M = 0.2
COMPASS_RAD = 0.35  # map x axis, east of north

Span = tuple[float, float]


def floor(x: Span, y: Span, z_m: float = 0.0, name: str = "floor") -> Solid:
    return Solid(name, x, y, (DEEP_M, z_m))


def box(name: str, x: Span, y: Span, high_m: float, from_m: float = 0.0) -> Solid:
    return Solid(name, x, y, (from_m, high_m))


def walls(x: Span, y: Span, ends: bool = True) -> list[Solid]:
    out = (x[0] - THICK_M, x[1] + THICK_M)
    high = (DEEP_M, WALL_M)
    solids = [
        Solid("right wall", out, (y[0] - THICK_M, y[0]), high),
        Solid("left wall", out, (y[1], y[1] + THICK_M), high),
    ]
    if ends:
        solids.append(Solid("wall behind", (out[0], x[0]), y, high))
        solids.append(Solid("wall ahead", (x[1], out[1]), y, high))
    return solids


def scene(name: str, solids: Sequence[Shape]) -> Scene:
    return Scene(name, tuple(solids), x_axis_east_of_north_rad=COMPASS_RAD)


def corridor(length_m: float, wide_m: float = 4.12, behind_m: float = 4.33) -> list[Solid]:
    """Level floor between two walls, closed at both ends; the robot stands in the middle."""
    x, y = (-behind_m, length_m), (-wide_m / 2 - 0.01, wide_m / 2 - 0.01)
    return [floor(x, y), *walls(x, y)]


def gap_in_floor(x: Span, wide_m: float, length_m: float, depth_m: float) -> list[Solid]:
    y = (-wide_m / 2 - 0.01, wide_m / 2 - 0.01)
    return [
        floor((-4.33, x[0]), y, name="floor before"),
        floor(x, y, -depth_m, name="floor of the ditch"),
        floor((x[1], length_m), y, name="floor beyond"),
        *walls((-4.33, length_m), y),
    ]


def step_in_floor(at_m: float, height_m: float, wide_m: float, length_m: float) -> list[Solid]:
    """A corridor that goes on higher, or lower where the height is negative."""
    y = (-wide_m / 2 - 0.01, wide_m / 2 - 0.01)
    return [
        floor((-4.33, at_m), y, name="floor before"),
        floor((at_m, length_m), y, height_m, name="floor beyond"),
        *walls((-4.33, length_m), y),
    ]


def slope(at_m: float, long_m: float, rise_rad: float, y: Span, from_m: float = 0.0) -> Solid:
    """A ramp along x, up where the rise is positive, that begins at a height."""
    foot_m = min(from_m, from_m + math.tan(rise_rad) * long_m) + DEEP_M
    return Solid("ramp", (at_m, at_m + long_m), y, (foot_m, from_m), rise_x_rad=rise_rad)


def ramp_corridor(
    at_m: float, long_m: float, rise_rad: float, length_m: float, wide_m: float = 4.12
) -> list[Solid]:
    """A corridor that is level, rises or falls for a while, and is level again."""
    y = (-wide_m / 2 - 0.01, wide_m / 2 - 0.01)
    end_m = math.tan(rise_rad) * long_m
    deep = (DEEP_M + min(0.0, end_m), WALL_M + max(0.0, end_m))
    out = (-4.53, length_m + THICK_M)
    return [
        floor((-4.33, at_m), y, name="floor before"),
        slope(at_m, long_m, rise_rad, y),
        Solid("floor after", (at_m + long_m, length_m), y, (end_m + DEEP_M, end_m)),
        Solid("right wall", out, (y[0] - THICK_M, y[0]), deep),
        Solid("left wall", out, (y[1], y[1] + THICK_M), deep),
        Solid("wall behind", (out[0], -4.33), y, deep),
        Solid("wall ahead", (length_m, out[1]), y, deep),
    ]


FIRST_PILLAR_GAP_M = 1.7  # the paper's: from the left wall to the first pillar
PILLAR_M = 0.4
PILLARS_X_M = (6.07, 9.17, 12.27)
HALL_X, HALL_Y = (-4.33, 14.67), (-4.93, 4.07)


def hall() -> list[Solid]:
    solids = [floor(HALL_X, HALL_Y), *walls(HALL_X, HALL_Y)]
    near = HALL_Y[1] - FIRST_PILLAR_GAP_M
    for k, x in enumerate(PILLARS_X_M):
        along = (x, x + PILLAR_M)
        solids.append(Solid(f"left pillar {k}", along, (near - PILLAR_M, near), (0.0, WALL_M)))
        solids.append(Solid(f"right pillar {k}", along, (-3.13, -3.13 + PILLAR_M), (0.0, WALL_M)))
    return solids
