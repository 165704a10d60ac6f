"""What a sensor sees of a stepfield on its way ahead, exactly.

A point of the ground lies in a tilted plane of rays at one place of the way only. From there its
line of sight is followed over all blocks. So the sensor's way is taken as continuous: between two
scans of a real one, ground may be missed that is seen here.
"""

import math

from core.records import F64, I8
from jit import kernel
from tools.placement.field import BLOCK_M

OUTSIDE, OCCLUDED, SEEN = -1, 0, 1


@kernel
def is_clear(
    heights: F64, x: float, y: float, h: float, to_x: float, to_y: float, to_z: float
) -> bool:
    """Whether no block stands between a point on top of its block and one that is higher."""
    dx, dy, dz = to_x - x, to_y - y, to_z - h
    i, j = math.floor(x / BLOCK_M), math.floor(y / BLOCK_M)
    step_i, step_j = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    next_x = ((i + (dx > 0)) * BLOCK_M - x) / dx if dx != 0 else math.inf
    next_y = ((j + (dy > 0)) * BLOCK_M - y) / dy if dy != 0 else math.inf
    every_x = BLOCK_M / abs(dx) if dx != 0 else math.inf
    every_y = BLOCK_M / abs(dy) if dy != 0 else math.inf
    while min(next_x, next_y) < 1.0:
        if next_x < next_y:
            share, i, next_x = next_x, i + step_i, next_x + every_x
        else:
            share, j, next_y = next_y, j + step_j, next_y + every_y
        if heights[i % heights.shape[0], j % heights.shape[1]] > h + share * dz + 1e-9:
            return False
    return True


@kernel
def look(heights: F64, xs: F64, ys: F64, sensor: F64, states: I8, sigmas: F64) -> None:
    """Fills states and sigmas [i, j] (1 sigma of the height, m) of points (xs[i], ys[j]).

    Args:
        sensor: (13,) as `Sensor.numbers` has them.
    """
    z, tilt, right, left = sensor[0], sensor[1], sensor[2], sensor[3]
    reach, sigma_m, sigma_share, sigma_rad = sensor[4], sensor[5], sensor[6], sensor[7]
    baseline, angle, focal_px = sensor[8], sensor[9], sensor[10]
    half_high_px, sigma_px = sensor[11], sensor[12]
    plane = tilt + angle
    laser_z = z + baseline * math.cos(tilt)
    for i in range(len(xs)):
        for j in range(len(ys)):
            x, y = xs[i], ys[j]
            h = heights[
                math.floor(x / BLOCK_M) % heights.shape[0],
                math.floor(y / BLOCK_M) % heights.shape[1],
            ]
            states[i, j], sigmas[i, j] = OUTSIDE, math.nan
            if laser_z <= h or z <= h:
                continue
            laser_x = x - (laser_z - h) / math.tan(plane)
            eye_x = laser_x - baseline * math.sin(tilt)
            down, ahead = z - h, x - eye_x
            r = math.sqrt(ahead * ahead + y * y + down * down)
            depth = ahead * math.cos(tilt) + down * math.sin(tilt)
            row = ahead * math.sin(tilt) - down * math.cos(tilt)
            if r > reach or depth <= 0 or not right <= math.atan2(y, depth) <= left:
                continue
            if baseline > 0 and abs(row) * focal_px > half_high_px * depth:
                continue
            along = max(sigma_m, sigma_share * r)
            if baseline > 0:
                along = depth * r * sigma_px / (focal_px * baseline)
            sigmas[i, j] = math.hypot(along * down / r, sigma_rad * math.hypot(ahead, y))
            clear = is_clear(heights, x, y, h, laser_x, 0.0, laser_z)
            if clear and baseline > 0:
                clear = is_clear(heights, x, y, h, eye_x, 0.0, z)
            states[i, j] = SEEN if clear else OCCLUDED
