"""Where a depth camera sits on the body, estimated from the flat floor that it sees.

The robot stands on that floor, so the floor's normal is the body's z, and the lens's distance from
it the height. With n, the normal in the sensor frame, R_body_sensor' (0, 0, 1) = n gives

    tilt = asin(-n_x)        roll = atan2(n_y, n_z)

x, y and yaw of the mount are not seen. What can't be told is refused with the reason.

Each frame tells the floor with its covariance (core/objects/frame/floor.py), most of which all
frames of one place share: so the mean of many is not better known than one of them but for their
scatter. How level the floor is goes into tilt and roll as well.
Source: design, section 5, for frames and signs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from core.geometry import R_from_rpy
from core.object_settings import FrameSettings
from core.records import F64, DepthImage
from tools.calibration.fit import Mount

# 1 sigma of the guess, in turn until a floor is found: height in m, tilt and roll in degrees
GUESSES = ((0.02, 1.5), (0.06, 3.0), (0.15, 6.0))
NEAR = 0.01, 0.5  # once it is known
MOST_SIGMA_M, MOST_SIGMA_RAD = 0.03, math.radians(1.0)  # beyond it nothing is told
OUTLIER_SIGMAS, LEAST_OFF_M, LEAST_OFF_RAD = 4.0, 0.01, math.radians(0.5)  # of the median
LEAST_SHARE = 0.6  # of the frames that show floor, and of those that agree


class NoFloorError(Exception):
    """Nothing can be told of the mount; the text says why, for a person."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What one frame tells."""

    mount: Mount
    sigmas: F64  # (3,) of z in m, tilt and roll in rad
    points: int  # of the floor, as far as they were looked at
    share: float  # of the points that may be floor


@dataclass(frozen=True, slots=True)
class DepthMount:
    """What all frames tell; errors are 1 sigma."""

    mount: Mount
    z_error_m: float
    tilt_error_rad: float
    roll_error_rad: float
    frames: int
    used: int  # of them
    points: int  # of floor in the median frame
    share: float


def maybe_seen(steps: Any, image: DepthImage, guess: Mount) -> Seen | None:
    """What a frame tells; None: it shows no floor near the guess, or nothing that may be one.

    Args:
        steps: FrameSteps, of the objects' extra.
    """
    for sigma_m, sigma_deg in GUESSES:
        found = _floor(steps, image, guess, sigma_m, math.radians(sigma_deg))
        if found is not None:
            sigma_m, sigma_rad = NEAR[0], math.radians(NEAR[1])
            return _floor(steps, image, found.mount, sigma_m, sigma_rad) or found
    return None


def _floor(
    steps: Any, image: DepthImage, guess: Mount, sigma_m: float, sigma_rad: float
) -> Seen | None:
    from core.objects.frame.steps import CameraPose, level_of

    T = np.eye(4)
    T[:3, :3] = R_from_rpy(guess.roll_rad, guess.tilt_rad, guess.yaw_rad)
    T[:3, 3] = guess.x_m, guess.y_m, guess.z_m
    pose = CameraPose(T, sigma_m, sigma_rad, sigma_rad, sigma_m, sigma_rad)
    level = level_of(pose, image.camera)
    if level is None:
        return None
    found = steps.floor_of(image, level, pose)
    if found is None:
        return None
    floor, _, _ = found
    n = floor.normal_sensor / np.linalg.norm(floor.normal_sensor)
    mount = replace(
        guess,
        z_m=float(floor.height_m - n @ np.array(image.camera.offset_m)),
        tilt_rad=math.asin(max(-1.0, min(1.0, -float(n[0])))),
        roll_rad=math.atan2(float(n[1]), float(n[2])),
    )
    return Seen(mount, np.sqrt(np.diag(floor.covariance)), floor.points, floor.share)


def seen_in(images: Sequence[DepthImage], settings: FrameSettings, guess: Mount) -> list[Seen]:
    """Of all frames that show floor. Raises NoFloorError: too few do."""
    from core.objects.frame.steps import FrameSteps

    steps = FrameSteps(settings)
    seen = [one for image in images if (one := maybe_seen(steps, image, guess)) is not None]
    if not images or len(seen) < LEAST_SHARE * len(images):
        most_m, most_deg = 3 * GUESSES[-1][0], 3 * GUESSES[-1][1]
        raise NoFloorError(
            f"{len(seen)} of {len(images)} frames show a flat floor within {most_m:g} m and "
            f"{most_deg:g} deg of the settings' mount: correct that roughly first, and give the "
            "camera free floor within objects.max_range_m"
        )
    return seen


def mount_of(seen: Sequence[Seen], frames: int, level_rad: float) -> DepthMount:
    """What frames tell together.

    Args:
        level_rad: 1 sigma of the floor's slope before the robot, against that under it.

    Raises:
        NoFloorError: they contradict each other, or it is not known well enough.
    """
    values = np.array([[one.mount.z_m, one.mount.tilt_rad, one.mount.roll_rad] for one in seen])
    sigmas = np.array([one.sigmas for one in seen])
    least = np.array([LEAST_OFF_M, LEAST_OFF_RAD, LEAST_OFF_RAD])
    allowed = np.maximum(OUTLIER_SIGMAS * sigmas, least)
    agree = (np.abs(values - np.median(values, axis=0)) <= allowed).all(axis=1)
    used = int(agree.sum())
    if used < LEAST_SHARE * len(seen):
        raise NoFloorError(
            f"only {used} of {len(seen)} frames agree: let robot and camera stand still, and "
            "nobody walk before it"
        )
    mean = values[agree].mean(axis=0)
    scatter = values[agree].std(axis=0) / math.sqrt(used)
    errors = np.sqrt(np.median(sigmas[agree], axis=0) ** 2 + scatter**2)
    errors[1:] = np.hypot(errors[1:], level_rad)
    if errors[0] > MOST_SIGMA_M or max(errors[1:]) > MOST_SIGMA_RAD:
        raise NoFloorError(
            f"known no better than {1000 * errors[0]:.0f} mm and "
            f"{math.degrees(max(errors[1:])):.1f} deg: give the camera more floor to see"
        )
    mount = replace(
        seen[0].mount, z_m=float(mean[0]), tilt_rad=float(mean[1]), roll_rad=float(mean[2])
    )
    z_error_m, tilt_error_rad, roll_error_rad = errors.tolist()
    return DepthMount(
        mount, z_error_m, tilt_error_rad, roll_error_rad, frames, used,
        int(np.median([one.points for one in seen])),
        float(np.median([one.share for one in seen])),
    )  # fmt: skip
