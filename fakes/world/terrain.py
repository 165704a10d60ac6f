"""How a body stands on uneven ground: height, pitch and roll from what is under its wheels.

A wheel is a disc that rolls over the ground without digging into it: the height of its middle is
the highest that any point under its rim asks for. The casters' springs are taken as stiff and as
sharing their load: the axle decides the roll, the casters' middle the pitch.
"""

from collections.abc import Callable

import numpy as np

from fakes.world import robot
from fakes.world.rotations import F64, R_from_angles

Heights = Callable[[F64, F64], F64]  # x (n,), y (n,) to heights (n,), NaN where no ground is

RIM = 0.95 * np.linspace(-1.0, 1.0, 31)  # where under a wheel the ground is asked, in radii
ROUNDS = 4  # of the solution for the tilt: each takes away all but a hundredth of the error


def stance(heights: Heights, x: F64, y: F64, yaw: F64) -> tuple[F64, F64, F64]:
    """(pitch, roll, z), (n,) each, of bodies whose origins lie over x, y (n,) at a yaw (n,).

    Where there is no ground under a wheel it hangs at z = 0.
    """
    half_m, r = robot.TRACK_WIDTH_M / 2, robot.WHEEL_RADIUS_M
    ahead_m, up_m = robot.CASTER_BODY_M[0], robot.CASTER_RADIUS_M
    pitch, roll = np.zeros_like(x), np.zeros_like(x)
    z = np.zeros_like(x)
    for _ in range(ROUNDS):
        R = R_from_angles(yaw, pitch, roll)
        asked = []
        for place, radius_m in (
            ((0.0, half_m, r), r),
            ((0.0, -half_m, r), r),
            ((ahead_m, robot.CASTER_BODY_M[1], up_m), up_m),
            ((ahead_m, -robot.CASTER_BODY_M[1], up_m), up_m),
        ):
            offset = R @ np.array(place)
            middle = x + offset[:, 0], y + offset[:, 1]
            asked.append(_carried(heights, *middle, yaw, roll, radius_m))
        left, right, axle, front = *asked[:2], (asked[0] + asked[1]) / 2, (asked[2] + asked[3]) / 2
        roll = np.arcsin(np.clip((left - right) / (2 * half_m * np.cos(pitch)), -0.9, 0.9))
        level = np.cos(pitch) * np.cos(roll)
        rise = front - axle - (up_m - r) * level
        pitch = -np.arcsin(np.clip(rise / ahead_m, -0.9, 0.9))
        z = axle - r * np.cos(pitch) * np.cos(roll)
    return pitch, roll, z


def _carried(heights: Heights, x: F64, y: F64, yaw: F64, roll: F64, radius_m: float) -> F64:
    """Heights (n,) of the middles, over x, y (n,), of wheels that stand and lean with the body."""
    along_m = RIM * radius_m
    rim_m = np.sqrt(radius_m**2 - along_m**2)
    c, s, aside_m = np.cos(yaw)[:, None], np.sin(yaw)[:, None], np.sin(roll)[:, None] * rim_m
    under_x = x[:, None] + along_m * c - aside_m * s
    under_y = y[:, None] + along_m * s + aside_m * c
    ground = heights(under_x.ravel(), under_y.ravel()).reshape(under_x.shape)
    asked = np.nan_to_num(ground, nan=0.0) + rim_m * np.cos(roll)[:, None]
    best = np.clip(np.argmax(asked, axis=1), 1, len(RIM) - 2)
    rows = np.arange(len(x))
    low, mid, high = (asked[rows, best + k] for k in (-1, 0, 1))
    # the top of the parabola through the three highest: else the height comes in small steps
    bend = np.minimum(low - 2 * mid + high, -1e-9)
    most = (along_m[1] - along_m[0]) ** 2 / radius_m
    top = mid + np.clip(-((high - low) ** 2) / (8 * bend), 0.0, most)
    return np.asarray(np.maximum(top, asked.max(axis=1)))
