"""Plausibility limit: by how much the elevation of one cell can change between two scans.

What a scanner of one plane, or a camera beside a plane of laser light, can meet over a place (x, y)
lies in that plane of light, whatever stands there. With its normal n, a point p of it, and q from
the origin of the body to p:

    dz/dx = n_x / n_z    dz/dy = n_y / n_z    dz/dd_z = 1     of the body's motion
    dz/da = n . (axis_a x q) / n_z            a: yaw, pitch, roll, each about its own axis
    dz/dr = u_z          dz/dphi = r (n x u)_z                of a reading: u is its beam

The first two lines hold the cell and let range and beam angle follow, so that a turn of the robot
counts, though it changes the height of no point of a beam. The limit is the sum of all, each by its
magnitude times its largest change, and what the plane rises within a cell.

It is of first order in the changes. The equations (6) to (8) of the paper were not to be had: this
is our reading of what is told of them.
Source: docs/certainty.md.
"""

import math
from typing import NamedTuple

import numpy as np

from core.config import Config
from core.geometry import R_from_rpy
from core.records import F64
from jit import kernel

LEAST_NZ = 1e-9  # a plane of light as steep as that meets any height in a cell
RANGE_SIGMAS = 3.0  # the largest error of a range


class Changes(NamedTuple):
    """The largest from one scan to the next, and within one."""

    travel_m: float  # along the ground, in whatever direction
    lift_m: float
    yaw_rad: float
    pitch_rad: float
    roll_rad: float
    sigma_m: float  # of a range: 1 sigma near,
    sigma_share: float  # and far, as a share of it
    beam_rad: float  # beam angle: half a step
    cell_m: float


class Frame(NamedTuple):
    """How body and sensor lie in the map, at one instant; flat, for kernels."""

    normal: tuple[float, float, float]  # unit, of the plane of light
    pitch_axis: tuple[float, float, float]  # unit: about which the body pitches,
    roll_axis: tuple[float, float, float]  # and rolls
    origin: tuple[float, float, float]  # of the body, metres


def changes_of(config: Config, step_rad: float) -> Changes:
    """As the settings have it, for a scanner whose beams are a step apart."""
    robot, spec, body = config.robot, config.scanner.options.spec, config.certainty
    assert body is not None  # as the settings were checked
    period_s = spec.period_s
    return Changes(
        travel_m=robot.max_speed_mps * period_s,
        lift_m=body.lift_mps * period_s,
        yaw_rad=robot.max_turn_radps * period_s,
        pitch_rad=math.radians(body.pitch_degps) * period_s,
        roll_rad=math.radians(body.roll_degps) * period_s,
        sigma_m=spec.sigma_m,
        sigma_share=spec.sigma_share,
        beam_rad=0.5 * abs(step_rad),
        cell_m=config.map.cell_m,
    )


def _vector(of: F64) -> tuple[float, float, float]:
    return float(of[0]), float(of[1]), float(of[2])


def frame_of(rpy_rad: tuple[float, float, float], origin_map: F64, normal_body: F64) -> Frame:
    """Of a body with these angles at (3,) metres, map frame; normal_body (3,): of the light."""
    roll, pitch, yaw = rpy_rad
    R_map_body = R_from_rpy(roll, pitch, yaw)
    return Frame(
        normal=_vector(R_map_body @ normal_body),
        pitch_axis=(-math.sin(yaw), math.cos(yaw), 0.0),
        roll_axis=_vector(R_map_body[:, 0]),
        origin=_vector(np.asarray(origin_map)),
    )


@kernel
def turned(
    axis: tuple[float, float, float],
    q: tuple[float, float, float],
    normal: tuple[float, float, float],
) -> float:
    """n . (axis x q) / n_z: metres a radian that the plane of light rises over a place."""
    x, y = axis[1] * q[2] - axis[2] * q[1], axis[2] * q[0] - axis[0] * q[2]
    z = axis[0] * q[1] - axis[1] * q[0]
    n_x, n_y, n_z = normal
    return (n_x * x + n_y * y + n_z * z) / math.copysign(max(abs(n_z), LEAST_NZ), n_z)


@kernel
def limit_m(point: F64, ray: F64, range_m: float, frame: Frame, changes: Changes) -> float:
    """The limit at a reading: point (3,) and its unit ray (3,), map frame."""
    n_x, n_y, n_z = frame.normal
    steep = max(abs(n_z), LEAST_NZ)
    o = frame.origin
    q = point[0] - o[0], point[1] - o[1], point[2] - o[2]
    moved_m = (
        math.hypot(n_x, n_y) / steep * changes.travel_m
        + changes.lift_m
        + abs(turned((0.0, 0.0, 1.0), q, frame.normal)) * changes.yaw_rad
        + abs(turned(frame.pitch_axis, q, frame.normal)) * changes.pitch_rad
        + abs(turned(frame.roll_axis, q, frame.normal)) * changes.roll_rad
    )
    sigma_m = max(changes.sigma_m, changes.sigma_share * range_m)
    across = abs(range_m * (n_x * ray[1] - n_y * ray[0]))
    read_m = abs(ray[2]) * RANGE_SIGMAS * sigma_m + across * changes.beam_rad
    return float(moved_m + read_m + (abs(n_x) + abs(n_y)) / steep * changes.cell_m)


@kernel
def limits_of(
    points: F64, rays: F64, ranges_m: F64, frame: Frame, changes: Changes, limits_m: F64
) -> None:
    """Fill `limits_m` (n,) of readings with points and rays (n, 3) and ranges (n,); NaN: none."""
    for k in range(ranges_m.size):
        limits_m[k] = math.nan
        if not math.isnan(ranges_m[k]):
            limits_m[k] = limit_m(points[k], rays[k], ranges_m[k], frame, changes)
