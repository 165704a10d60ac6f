"""Where the robot stands, and on which plane, at the instant of a scan: map frame."""

import math
from typing import NamedTuple

from core.motion.attitude import AttitudeRing
from core.motion.track import Track
from jit import kernel


class BodyPose(NamedTuple):
    """Where the robot stands, map frame: the body's origin, its heading, and its own plane."""

    x_m: float
    y_m: float
    z_m: float
    heading: tuple[float, float]  # unit vector
    slopes: tuple[float, float]  # of the body's x-y plane along map x and y
    travel_m: float  # since the start, signed
    t_s: float = math.nan


AT_START = BodyPose(0.0, 0.0, 0.0, (1.0, 0.0), (0.0, 0.0), 0.0)


@kernel
def in_body(x: float, y: float, body: BodyPose) -> tuple[float, float]:
    """How far a point of the map lies ahead and aside of the robot."""
    dx, dy, (hx, hy) = x - body.x_m, y - body.y_m, body.heading
    return dx * hx + dy * hy, dy * hx - dx * hy


def body_pose_at(t_s: float, attitudes: AttitudeRing, odometry: Track) -> BodyPose:
    """Where and how the robot stands at a covered instant, map frame."""
    roll, pitch, yaw = attitudes.rpy_at(t_s)
    yaw -= odometry.yaw_start_rad
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    nx, ny, nz = cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr  # the body's z axis
    x_m, y_m, z_m, travel_m = odometry.place_at(t_s)
    return BodyPose(x_m, y_m, z_m, (cy, sy), (-nx / nz, -ny / nz), travel_m, t_s)


class Sway:
    """How the plane on which the robot stands differs from its mean of late, `slopes` along x, y.

    A body that leant otherwise over what is uneven was lifted by it.
    """

    def __init__(self, late_s: float, arm_m: float) -> None:
        """arm_m: the lever by which it is lifted."""
        self.slopes, self._off = (math.nan, math.nan), 0.0
        self._late_s, self._arm_m = late_s, arm_m

    def follow(self, passed_s: float, slopes: tuple[float, float]) -> float:
        """The body's own slopes now; how far it is lifted as they are off, or were lately."""
        share = 1.0 - math.exp(-passed_s / self._late_s)
        (ax, ay), (bx, by) = slopes if math.isnan(self.slopes[0]) else self.slopes, slopes
        self.slopes = (ax + share * (bx - ax), ay + share * (by - ay))
        off = math.hypot(bx - self.slopes[0], by - self.slopes[1])
        self._off = max(off, (1.0 - share) * self._off)
        return self._arm_m * self._off
