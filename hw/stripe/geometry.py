"""From a pixel and the plane of the laser to a range, and how uncertain that is.

Sensor frame: the camera's centre, x ahead along its optical axis, y left, z up as the image has it;
so the image's u grows along -y and its v along -z. A pixel (u, v) is freed of the lens's distortion
to slopes (p, q), OpenCV's (x, y), and has the ray e = (1, -p, -q) / sqrt(1 + p^2 + q^2).

The laser sits beside the camera, at b along z (a line across the image: a point in each column), or
at b along y (a line up the image: a point in each row). Its plane holds the other of these axes and
dips by beta to the optical axis, which it meets at x = b / tan(beta). With e_a the part of e along
the axis of b, a point r e of the plane has r e_a = b - r e_x tan(beta), and so

    r = b / D,    D = e_x tan(beta) + e_a,

which is no point unless it is above 0. Without distortion x = b / (tan(beta) - q). From there

    dr/db = r / b,    dr/dbeta = -r^2 e_x / (b cos^2(beta)),    dr/dw = -r^2 / b dD/dw

for w, the pixel across the line: the last two grow with the square of the range, so the variance

    s_r^2 = (r / b)^2 s_b^2 + (r^2 / b)^2 ((e_x / cos^2(beta))^2 s_beta^2 + (dD/dw)^2 s_w^2)

is least near the sensor and falls to a quarter with twice the baseline, for the same beam.

Derived here: the paper of 2011 that the method comes from was not to be had.
"""

import math
from typing import NamedTuple

from core.records import F64
from jit import kernel

NEWTON_STEPS, NEAR_ENOUGH = 20, 1e-12


class Lens(NamedTuple):
    """A pinhole with distortion, as OpenCV's calibration gives it."""

    fx: float  # pixels
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0


class LaserPlane(NamedTuple):
    """Where the laser's plane lies; the module's text says how."""

    baseline_m: float  # b
    beta_rad: float
    axis: int  # of the baseline: 2, along z, for a point in each column; 1, along y, in each row


class Sigmas(NamedTuple):
    """1 sigma of what a range is made of."""

    baseline_m: float
    beta_rad: float
    pixel: float


@kernel
def distorted(lens: Lens, p: float, q: float) -> tuple[float, float, float, float, float, float]:
    """Distorted slopes, and what they change by p and q: dp/dp, dp/dq, dq/dp, dq/dq.

    Source: OpenCV, Camera Calibration and 3D Reconstruction.
    """
    pp, qq, pq = p * p, q * q, p * q
    rr = pp + qq
    scale = 1.0 + rr * (lens.k1 + rr * (lens.k2 + rr * lens.k3))
    slope = 2.0 * (lens.k1 + rr * (2.0 * lens.k2 + rr * 3.0 * lens.k3))  # of scale, by p over p
    x = p * scale + 2.0 * lens.p1 * pq + lens.p2 * (rr + 2.0 * pp)
    y = q * scale + lens.p1 * (rr + 2.0 * qq) + 2.0 * lens.p2 * pq
    cross = pq * slope + 2.0 * lens.p1 * p + 2.0 * lens.p2 * q
    x_by_p = scale + pp * slope + 2.0 * lens.p1 * q + 6.0 * lens.p2 * p
    y_by_q = scale + qq * slope + 6.0 * lens.p1 * q + 2.0 * lens.p2 * p
    return x, y, x_by_p, cross, cross, y_by_q


@kernel
def slopes_from_pixel(lens: Lens, u: float, v: float) -> tuple[float, float]:
    """(p, q) of a pixel, by Newton's method; NaN where the lens has no way back."""
    x, y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
    p, q = x, y
    for _ in range(NEWTON_STEPS):
        at_x, at_y, a, b, c, d = distorted(lens, p, q)
        off_x, off_y, det = at_x - x, at_y - y, a * d - b * c
        if abs(off_x) + abs(off_y) < NEAR_ENOUGH:
            return p, q
        if not det > 0.0:
            return math.nan, math.nan
        p, q = p - (d * off_x - b * off_y) / det, q - (a * off_y - c * off_x) / det
    return math.nan, math.nan


@kernel
def aim(
    lens: Lens, plane: LaserPlane, u: float, v: float
) -> tuple[float, float, float, float, float]:
    """The ray (x, y, z) of a pixel, D of the module's text, and dD/dw of the pixel across."""
    p, q = slopes_from_pixel(lens, u, v)
    _, _, a, b, c, d = distorted(lens, p, q)
    det, length = a * d - b * c, math.sqrt(1.0 + p * p + q * q)
    if plane.axis == 2:
        p_by_w, q_by_w, across = -b / det / lens.fy, a / det / lens.fy, -q
        across_by_w = -q_by_w
    else:
        p_by_w, q_by_w, across = d / det / lens.fx, -c / det / lens.fx, -p
        across_by_w = -p_by_w
    tangent = math.tan(plane.beta_rad)
    meets = (tangent + across) / length
    stretch = (p * p_by_w + q * q_by_w) / (length * length)
    return 1.0 / length, -p / length, -q / length, meets, across_by_w / length - meets * stretch


@kernel
def ranges_from_pixels(
    us: F64,
    vs: F64,
    lens: Lens,
    plane: LaserPlane,
    max_range_m: float,
    directions: F64,
    ranges_m: F64,
) -> None:
    """Fills rays (n, 3) and ranges (n,) of pixels (n,), us and vs.

    A pixel that is NaN, or whose ray meets the plane nowhere within max_range_m, has range NaN; a
    ray that is not known points ahead.
    """
    for i in range(us.size):
        x, y, z, meets, _ = aim(lens, plane, us[i], vs[i])
        range_m = plane.baseline_m / meets if meets != 0.0 else math.nan
        ranges_m[i] = range_m if 0.0 < range_m <= max_range_m else math.nan
        if not math.isfinite(x + y + z):
            x, y, z = 1.0, 0.0, 0.0
        directions[i, 0], directions[i, 1], directions[i, 2] = x, y, z


@kernel
def variance_of_range(
    lens: Lens, plane: LaserPlane, sigmas: Sigmas, u: float, v: float
) -> tuple[float, float, float, float]:
    """Variance (m^2) of a pixel's range, and the range's derivatives by b, beta and the pixel."""
    x, _, _, meets, meets_by_w = aim(lens, plane, u, v)
    b, range_m = plane.baseline_m, plane.baseline_m / meets
    cosine = math.cos(plane.beta_rad)
    by_b = range_m / b
    by_beta = -range_m * range_m * x / (b * cosine * cosine)
    by_w = -range_m * range_m / b * meets_by_w
    variance = (by_b * sigmas.baseline_m) ** 2 + (by_beta * sigmas.beta_rad) ** 2
    return variance + (by_w * sigmas.pixel) ** 2, by_b, by_beta, by_w
