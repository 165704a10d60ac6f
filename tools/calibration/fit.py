"""Least squares behind the mount calibration: the scanner's pose on the body from floor returns.

The floor is a plane that is level but for a slope that is estimated beside the mount, held near
zero by what is known of the floor. A residual is the height of a return over the floor divided by
its distance over ground: an angle, in which the noise of the attitude sensor is the same near and
far. Every return's attitude is noisy and every range nearly exact, so it is the attitude that the
residual compares; the other way round, that noise would pass for motion.
Robust by a hard gate that follows the spread. Refuses nothing: `tools.calibration.mount` judges.
Source: P. J. Huber, Robust Statistics, 1981, chapter 7; clustered covariance: Liang and Zeger,
Biometrika 73, 1986. Range errors: lms111 sheet, section 1;
attitude: mti sheet, section 7.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from core.geometry import R_from_rpy
from core.records import F64, I64

RANGE_NOISE_M = 0.012  # 1 sigma, of each range
RANGE_BIAS_M = 0.03 / math.sqrt(3)  # 1 sigma of an error common to all ranges, within +-30 mm
ATTITUDE_NOISE_RAD = math.radians(0.05)  # 1 sigma, least
ATTITUDE_BIAS_RAD = math.radians(0.05)  # 1 sigma, between two poses (mti sheet: its resolution)
LEAST_ERROR_RAD = math.radians(0.02)  # 1 sigma of a tilt, roll or slope, however many returns
FLOOR_NOISE_M = 0.004  # 1 sigma: joints, waves, wear
GATE = 3.5  # spreads beyond which a return is not of the floor
MOST_SPREAD = 4.0  # times the noise above: more is no flat floor
FIRST_SPREAD = 3.0  # while the mount is still a guess
ROUNDS, SETTLED = 25, 1e-7  # of the iteration; rad and m
BEARING_BIN_RAD, BLOCK_S = math.radians(5.0), 1.0  # errors within are not taken for independent
COLUMNS = ("z", "tilt", "roll", "slope_x", "slope_y")
Mask = npt.NDArray[np.bool_]
Groups = tuple[I64, I64, int]  # bearing bin and block of time (n,) of each return; of both


@dataclass(frozen=True, slots=True)
class Mount:
    """Where the scanner sits on the body: lens (metres, body frame) and R_from_rpy angles."""

    x_m: float
    y_m: float
    z_m: float
    roll_rad: float
    tilt_rad: float
    yaw_rad: float

    @property
    def R_body_sensor(self) -> F64:
        """Rotation (3, 3), sensor to body."""
        return R_from_rpy(self.roll_rad, self.tilt_rad, self.yaw_rad)

    @property
    def t_body_sensor(self) -> F64:
        """Place of the lens (3,), body frame."""
        return np.array([self.x_m, self.y_m, self.z_m])


@dataclass(frozen=True, slots=True, eq=False)
class FloorView:
    """Returns of many scans, each with the attitude of the body at its instant; scans in order."""

    rays_m: F64  # (n, 3) sensor frame: range times direction
    R_earth_body: F64  # (n, 3, 3)
    yaw_rad: F64  # (n,) of the body, unwrapped over the scans
    t_s: F64  # (n,) any clock
    scan: I64  # (n,) which scan, from 0 on, ascending

    def of(self, which: Mask | slice | I64) -> "FloorView":
        return FloorView(
            self.rays_m[which],
            self.R_earth_body[which],
            self.yaw_rad[which],
            self.t_s[which],
            self.scan[which],
        )


def heights_m(view: FloorView, mount: Mount) -> tuple[F64, F64]:
    """Heights (n,) over a level floor, and distances over ground (n,) from the lens."""
    level = level_points_m(view, mount)
    arms = view.R_earth_body @ mount.t_body_sensor
    return level[:, 2], np.hypot(level[:, 0] - arms[:, 0], level[:, 1] - arms[:, 1])


def level_points_m(view: FloorView, mount: Mount) -> F64:
    """Returns (n, 3) from the body's origin, along the axes of the earth frame."""
    points_body = view.rays_m @ mount.R_body_sensor.T + mount.t_body_sensor
    return np.asarray(np.einsum("nij,nj->ni", view.R_earth_body, points_body))


def noise_rad(distances_m: F64, mount: Mount) -> F64:
    """1 sigma (n,) of each residual angle, by distance over ground, if all is as it should be."""
    sine = mount.z_m / np.hypot(mount.z_m, distances_m)
    along_m2 = (RANGE_NOISE_M * sine) ** 2 + FLOOR_NOISE_M**2
    return np.asarray(np.sqrt(ATTITUDE_NOISE_RAD**2 + along_m2 / distances_m**2))


@dataclass(slots=True, eq=False)
class Fit:
    """A mount, and all that is known of how well the returns tell it."""

    mount: Mount
    slope: F64  # (2,) rise of the floor along the earth frame's x and y
    is_floor: Mask  # (n,)
    heights_m: F64  # (n,) over the floor, slope included
    cov: F64  # (3, 3) of z_m, tilt_rad, roll_rad
    slope_cov: F64  # (2, 2)
    rms_rad: float  # of the floor's residuals
    motion_rad: float  # how much the attitude changed against the floor, in what tells the height


@dataclass(slots=True, eq=False)
class _Linear:
    """One linearisation: residuals and their derivatives, of all returns."""

    e_rad: F64  # (n,)
    noise_rad: F64  # (n,)
    heights_m: F64  # (n,)
    J: F64  # (n, 5) by COLUMNS; that the slope lowers the lens a little is left out
    J_bias: F64  # (n,) by an error common to all ranges


def _linear(view: FloorView, mount: Mount, slope: F64) -> _Linear:
    level = level_points_m(view, mount)
    arms = view.R_earth_body @ mount.t_body_sensor
    distances_m = np.maximum(np.hypot(*(level - arms)[:, :2].T), 0.1)
    up = view.R_earth_body[:, 2, :]
    over_m = level[:, 2] - level[:, :2] @ slope
    d = 1e-6
    turns = [
        R_from_rpy(mount.roll_rad + d * (k == 1), mount.tilt_rad + d * (k == 0), mount.yaw_rad)
        - R_from_rpy(mount.roll_rad - d * (k == 1), mount.tilt_rad - d * (k == 0), mount.yaw_rad)
        for k in (0, 1)
    ]
    by_turn = [np.einsum("ni,ni->n", up, view.rays_m @ turn.T) / (2 * d) for turn in turns]
    J = np.column_stack([up[:, 2], *by_turn, -level[:, 0], -level[:, 1]])
    ranges_m = np.linalg.norm(view.rays_m, axis=1)
    J_bias = (level - arms)[:, 2] / ranges_m / distances_m
    noise = noise_rad(distances_m, mount)
    return _Linear(over_m / distances_m, noise, over_m, J / distances_m[:, None], J_bias)


def _gated(linear: _Linear, spread: float) -> tuple[Mask, float]:
    """The returns within the gate of a spread, and the spread that they show themselves."""
    off = np.abs(linear.e_rad) / linear.noise_rad
    inside = off < GATE * spread
    if not inside.any():
        return inside, spread
    shown = 1.4826 * float(np.median(off[inside]))
    return inside, min(max(shown, 1.0), MOST_SPREAD)


def _groups(view: FloorView) -> Groups:
    """Bearing bin and block of time (n,) of each return, and how many there are of both."""
    bearings = np.arctan2(view.rays_m[:, 1], view.rays_m[:, 0])
    bins = np.unique(np.floor(bearings / BEARING_BIN_RAD), return_inverse=True)[1]
    blocks = np.unique(np.floor(view.t_s / BLOCK_S), return_inverse=True)[1]
    return bins, blocks, int(bins.max(initial=0) + blocks.max(initial=0) + 2)


def _scatter(scores: F64, group: I64) -> F64:
    """Covariance (k, k) of the sum of scores (n, k), those of a group being bound together."""
    sums = np.stack([np.bincount(group, column) for column in scores.T])
    count = sums.shape[1]
    return np.asarray(sums @ sums.T * (count / max(count - 1, 1)))


def fit(view: FloorView, guess: Mount, z_sigma_m: float | None, level_rad: float) -> Fit:
    """The mount that puts the floor returns on the floor.

    Args:
        guess: near enough that the floor is within the gate.
        z_sigma_m: 1 sigma of the guess's height, which is kept; None: the height is sought, too.
        level_rad: 1 sigma of the floor's slope, in each direction.
    """
    first = 0 if z_sigma_m is None else 1
    prior = np.diag([0.0, 0.0, 0.0, level_rad**-2, level_rad**-2])
    groups = _groups(view)
    mount, slope, spread = guess, np.zeros(2), FIRST_SPREAD
    for _ in range(ROUNDS):
        linear = _linear(view, mount, slope)
        inside, spread = _gated(linear, spread)
        weights = _weights(linear, inside, spread, groups)
        A = (linear.J.T * weights) @ linear.J + prior
        pull = (linear.J.T * weights) @ linear.e_rad
        pull[3:] += slope / level_rad**2
        step = np.zeros(len(COLUMNS))
        # standing, tilt and slope are one to the returns: the prior alone tells them apart
        step[first:] = -np.linalg.lstsq(A[first:, first:], pull[first:], rcond=None)[0]
        mount, slope = _moved(mount, step), slope + step[3:]
        if np.abs(step).max() < SETTLED:
            break
    linear = _linear(view, mount, slope)
    inside, spread = _gated(linear, spread)
    weights = _weights(linear, inside, spread, groups)
    rms_rad = math.sqrt(float(weights @ linear.e_rad**2) / max(float(weights.sum()), 1e-300))
    motion_rad = _motion_rad(linear, weights, prior, mount)
    cov = _covariance(linear, weights, prior, groups, first)
    by_z = _by_z(linear, weights, prior)
    if z_sigma_m is None:
        cov += np.outer(by_z, by_z) * _height_bias_m(mount, rms_rad, motion_rad) ** 2
    else:
        cov += np.outer(by_z, by_z) * z_sigma_m**2
    cov[range(1, 5), range(1, 5)] += LEAST_ERROR_RAD**2
    over_m, z_tilt_roll, slopes = linear.heights_m, cov[:3, :3], cov[3:, 3:]
    return Fit(mount, slope, inside, over_m, z_tilt_roll, slopes, rms_rad, motion_rad)


def _height_bias_m(mount: Mount, rms_rad: float, motion_rad: float) -> float:
    """Error of a height that was told by motion, beyond what the residuals show.

    An error of the attitude between two poses is one of their motion; and noise in what the ranges
    say of the motion makes it look larger than it is.
    """
    motion_rad = max(motion_rad, 1e-9)
    return mount.z_m * (ATTITUDE_BIAS_RAD / motion_rad + (rms_rad / motion_rad) ** 2)


def _weights(linear: _Linear, inside: Mask, spread: float, groups: Groups) -> F64:
    """Weights (n,): as many independent returns as there are groups, however many beams."""
    share = groups[2] / max(int(inside.sum()), 1)
    return np.where(inside, share / (linear.noise_rad * spread) ** 2, 0.0)


def _moved(mount: Mount, step: F64) -> Mount:
    z_m, tilt_rad, roll_rad = (float(part) for part in step[:3])
    return replace(
        mount,
        z_m=mount.z_m + z_m,
        tilt_rad=mount.tilt_rad + tilt_rad,
        roll_rad=mount.roll_rad + roll_rad,
    )


def _motion_rad(linear: _Linear, weights: F64, prior: F64, mount: Mount) -> float:
    """Change of attitude against the floor (1 sigma) that no other unknown explains."""
    A = (linear.J.T * weights) @ linear.J + prior
    left = A[0, 0] - A[0, 1:] @ np.linalg.lstsq(A[1:, 1:], A[1:, 0], rcond=None)[0]
    return mount.z_m * math.sqrt(max(float(left), 0.0) / max(float(weights.sum()), 1e-300))


def _by_z(linear: _Linear, weights: F64, prior: F64) -> F64:
    """How all unknowns (5,) move with the height, the others being fitted anew."""
    others = linear.J[:, 1:]
    A = (others.T * weights) @ others + prior[1:, 1:]
    pull = (others.T * weights) @ linear.J[:, 0]
    return np.concatenate([[1.0], -np.linalg.lstsq(A, pull, rcond=None)[0]])


def _covariance(linear: _Linear, weights: F64, prior: F64, groups: Groups, first: int) -> F64:
    """Covariance (5, 5) of the unknowns from `first` on, by what the residuals show themselves.

    The errors of one bearing may be the same in all scans (the floor's), and those of one block of
    time the same on all bearings (the attitude's).
    """
    J, kept = linear.J[:, first:], prior[first:, first:]
    A_inverse = np.linalg.pinv((J.T * weights) @ J + kept, hermitian=True)
    scores = J * (weights * linear.e_rad)[:, None]
    scattered = _scatter(scores, groups[0]) + _scatter(scores, groups[1]) + kept
    by_bias = A_inverse @ ((J.T * weights) @ linear.J_bias)
    cov = np.zeros((len(COLUMNS), len(COLUMNS)))
    cov[first:, first:] = A_inverse @ scattered @ A_inverse
    cov[first:, first:] += np.outer(by_bias, by_bias) * RANGE_BIAS_M**2
    return cov
