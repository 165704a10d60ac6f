"""Where the scanner sits on the body, estimated from what it sees of a flat floor.

A level scan line on a flat floor is one straight line: it tells the roll and how far ahead the
floor begins, so only the ratio of height and sine of tilt. Height and tilt come apart where the
height is measured by hand, or where the body nods or rolls against the floor while it is watched.
Yaw, x and y of the mount are not seen at all. What can't be told is refused with the reason.
The attitude sensor counts as true: an error of its mount goes into tilt and roll, where it cancels.
Source: design, section 5, for frames and signs.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from core.geometry import R_from_rpy
from core.motion.attitude import AttitudeRing
from core.records import F64, I64, Scan
from tools.calibration.fit import (
    BEARING_BIN_RAD,
    Fit,
    FloorView,
    Mask,
    Mount,
    fit,
    heights_m,
    noise_rad,
)

NEAREST_M, FARTHEST_M = 0.5, 20.0  # what the scanner measures well (lms111 sheet, section 1)
MOST_RETURNS = 60_000  # of which the estimate is made; evenly left out beyond
ATTITUDES = 5  # instants of a scan, between which the attitude is interpolated
LEAST_SCANS, LEAST_RETURNS = 20, 2000
LEAST_SHARE, LEAST_SCANS_SHARE = 0.12, 0.5  # of returns, and of scans, that have to show floor
TRIES, TRIED_RETURNS = 600, 2000  # of the search, and on how many each is counted
GOOD_SHARE = 0.9  # of returns, that ends the search
SEARCH_SPREAD = 10.0  # times the usual noise, within which a return speaks for a try
MOST_OFF_RAD = math.radians(10.0)  # from the guess, in tilt and in roll
LEAST_TILT_RAD = math.radians(1.0)  # below it the floor is nowhere near
MOST_OFF_M = 0.5  # from the guess, in height
MOST_ROUGH_M, MOST_BENT_M = 0.03, 0.02  # rms height; mean height of any bearing
MOST_Z_ERROR_M, MOST_ANGLE_ERROR_RAD = 0.05, math.radians(0.5)  # beyond it nothing is told
CONTRADICTS = 3.0  # times the error of a difference
PROOF_TURN_RAD = math.radians(10.0)  # of yaw: a wall would not stay where the floor does,
PROOF_MOTION_RAD = math.radians(0.5)  # nor move as the floor does


class NoFloorError(Exception):
    """Nothing can be told of the mount; the text says why, for a person."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """What the floor tells of the mount. Errors are 1 sigma, all that is known of included."""

    mount: Mount
    z_error_m: float
    tilt_error_rad: float
    roll_error_rad: float
    z_is_separate: bool  # False: height and tilt only hold together, and neither is known
    ahead_m: float  # where the middle of the scan meets the floor, from the lens over ground
    rms_m: float  # height of the floor returns over the floor
    within_m: float  # 95 of 100 of them are within
    returns: int  # in range
    floor_returns: int
    scans: int
    floor_scans: int
    turned_rad: float  # yaw, while floor was in view
    motion_rad: float  # 1 sigma of the body's change of attitude against the floor
    slope_rad: float  # of the floor: steepest,
    slope_error_rad: float

    @property
    def is_proven(self) -> bool:
        """Whether the body moved so that a wall can't have been taken for floor."""
        return self.turned_rad >= PROOF_TURN_RAD or self.motion_rad >= PROOF_MOTION_RAD


class FloorWatch:
    """Collects the returns of scans with the attitude at each beam's instant."""

    def __init__(self) -> None:
        self.scans = 0
        self._parts: list[tuple[F64, F64, F64]] = []  # rays (k, 3), roll pitch yaw (k, 3), t (k,)

    def add(self, scan: Scan, attitudes: AttitudeRing) -> None:
        """One scan, first echo; attitudes must cover it from its first to its last beam."""
        n = scan.ranges_m.shape[1]
        times_s = scan.t_s + np.arange(n) * scan.beam_dt_s
        known_s = np.linspace(times_s[0], times_s[-1], ATTITUDES)
        known = np.unwrap([attitudes.rpy_at(float(t_s)) for t_s in known_s], axis=0)
        if self._parts and len(self._parts[-1][1]):  # yaw runs on from the scan before
            before = self._parts[-1][1][-1, 2]
            known[:, 2] += math.tau * np.round((before - known[0, 2]) / math.tau)
        ranges_m = scan.ranges_m[0]
        good = (ranges_m >= NEAREST_M) & (ranges_m <= FARTHEST_M)
        bearings = scan.first_rad + np.flatnonzero(good) * scan.step_rad
        unit = np.column_stack([np.cos(bearings), np.sin(bearings), np.zeros_like(bearings)])
        rpy = np.column_stack([np.interp(times_s[good], known_s, part) for part in known.T])
        self._parts.append((unit * ranges_m[good, None], rpy, times_s[good]))
        self.scans += 1

    def view(self) -> FloorView:
        counts = [len(t_s) for _, _, t_s in self._parts]
        if not sum(counts):
            nothing = np.zeros(0)
            empty = np.zeros((0, 3)), np.zeros((0, 3, 3)), nothing, nothing
            return FloorView(*empty, np.zeros(0, dtype=np.int64))
        rays, rpy, t_s = (np.concatenate(column) for column in zip(*self._parts, strict=True))
        scan = np.repeat(np.arange(len(counts)), counts)
        stride = math.ceil(len(t_s) / MOST_RETURNS)
        kept = slice(None, None, stride + 1 - stride % 2)  # odd: not in step with a scan's beams
        R = _rotations(rpy[kept])
        return FloorView(rays[kept], R, rpy[kept, 2], t_s[kept], scan[kept])


def _rotations(rpy: F64) -> F64:
    """R_from_rpy of each row: (n, 3, 3) of (n, 3)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy).T, np.cos(rpy).T
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def calibrate(
    view: FloorView, guess: Mount, maybe_z_sigma_m: float | None, level_rad: float
) -> Calibration:
    """The mount, from a view in which at least a fair part is flat floor.

    Args:
        guess: of the settings; its x, y and yaw are taken for true.
        maybe_z_sigma_m: 1 sigma of the guess's height, if it was measured by hand.
        level_rad: 1 sigma of the floor's slope, in each direction.

    Raises:
        NoFloorError: too little floor, none that is flat, or a mount beyond all expectation.
    """
    scans = int(view.scan.max(initial=-1)) + 1
    if scans < LEAST_SCANS or len(view.t_s) < LEAST_RETURNS:
        raise NoFloorError(
            f"only {len(view.t_s)} returns within {NEAREST_M:g} to {FARTHEST_M:g} m "
            f"in {scans} scans: does the scanner look at the floor?"
        )
    start = _found(view, guess)
    z_sigma_m = MOST_OFF_M if maybe_z_sigma_m is None else maybe_z_sigma_m
    found = fit(view, start, z_sigma_m, level_rad)
    if found.motion_rad >= PROOF_MOTION_RAD:
        freed = fit(view, found.mount, None, level_rad)
        if freed.cov[0, 0] <= MOST_Z_ERROR_M**2:
            found = freed if maybe_z_sigma_m is None else _agreeing(found, freed)
    _check_floor(view, found, scans)
    if why := _maybe_implausible(found.mount, guess):
        raise NoFloorError(f"{why}: that is not believed; correct the settings by hand first")
    return _told(view, found, scans)


def _agreeing(by_hand: Fit, by_motion: Fit) -> Fit:
    apart_m = by_hand.mount.z_m - by_motion.mount.z_m
    if apart_m**2 > CONTRADICTS**2 * (by_hand.cov[0, 0] + by_motion.cov[0, 0]):
        raise NoFloorError(
            f"the height was measured as {by_hand.mount.z_m:.2f} m, but what was seen while the "
            f"robot nodded says {by_motion.mount.z_m:.2f} +- {by_motion.cov[0, 0] ** 0.5:.2f} m"
        )
    return by_hand


def _told(view: FloorView, found: Fit, scans: int) -> Calibration:
    heights = found.heights_m[found.is_floor]
    z_error_m, tilt_error_rad, roll_error_rad = np.sqrt(np.diag(found.cov))
    good = _floor_scans(view, found.is_floor)
    yaws_rad = view.yaw_rad[found.is_floor & np.isin(view.scan, good)]
    steepest = float(np.hypot(*found.slope))
    return Calibration(
        mount=found.mount,
        z_error_m=float(z_error_m),
        tilt_error_rad=float(tilt_error_rad),
        roll_error_rad=float(roll_error_rad),
        z_is_separate=bool(z_error_m <= MOST_Z_ERROR_M),
        ahead_m=found.mount.z_m / math.tan(found.mount.tilt_rad),
        rms_m=float(np.sqrt(np.mean(heights**2))),
        within_m=float(np.quantile(np.abs(heights), 0.95)),
        returns=len(view.t_s),
        floor_returns=int(found.is_floor.sum()),
        scans=scans,
        floor_scans=len(good),
        turned_rad=float(np.ptp(np.quantile(yaws_rad, [0.05, 0.95]))),
        motion_rad=found.motion_rad,
        slope_rad=steepest,
        slope_error_rad=float(np.sqrt(np.diag(found.slope_cov).max())),
    )


class _Line(NamedTuple):
    """Two returns of one scan, sensor frame, and the earth's up in the body frame then."""

    one: F64
    other: F64
    up: F64


def _found(view: FloorView, guess: Mount) -> Mount:
    """The mount of the guess's height that puts the most returns on a level floor."""
    some = view.of(slice(None, None, max(1, len(view.t_s) // TRIED_RETURNS)))
    best, most = guess, 0
    for line in _lines(view):
        for tried in _maybe_mounts(line, guess):
            heights, distances_m = heights_m(some, tried)
            gate_m = SEARCH_SPREAD * noise_rad(distances_m, tried) * distances_m
            count = int((np.abs(heights) < gate_m).sum())
            if count > most:
                best, most = tried, count
        if most > GOOD_SHARE * len(some.t_s):
            break
    if most < LEAST_SHARE * len(some.t_s):
        raise NoFloorError(
            f"no more than {most / len(some.t_s):.0%} of the returns lie on one level floor, for "
            f"any tilt and roll within {math.degrees(MOST_OFF_RAD):.0f} deg of the settings'"
        )
    return best


def _lines(view: FloorView) -> Iterator[_Line]:
    random = np.random.default_rng(0)
    starts = np.searchsorted(view.scan, np.arange(view.scan[-1] + 2))
    for _ in range(TRIES):
        k = int(random.integers(len(starts) - 1))
        if starts[k + 1] - starts[k] < 2:
            continue
        a, b = random.integers(starts[k], starts[k + 1], 2)
        if np.linalg.norm(view.rays_m[a] - view.rays_m[b]) > 0.5:
            yield _Line(view.rays_m[a], view.rays_m[b], view.R_earth_body[a, 2])


def _maybe_mounts(line: _Line, guess: Mount) -> Iterator[Mount]:
    """The mount that makes both returns floor, at the guess's height; none if beyond reason.

    The floor's normal in the sensor frame, n, has n . p = -h at both; turned back by roll and tilt
    it is the earth's up.
    """
    height_m = float(line.up @ guess.t_body_sensor)
    corners = np.array([line.one[:2], line.other[:2]])
    if abs(float(np.linalg.det(corners))) < 1e-3:
        return
    n_x, n_y = np.linalg.solve(corners, [-height_m, -height_m])
    x, y, z = R_from_rpy(0.0, 0.0, guess.yaw_rad).T @ line.up
    if abs(n_x) >= math.hypot(x, z):
        return
    swing = math.acos(n_x / math.hypot(x, z))
    for tilt_rad in (swing - math.atan2(z, x), -swing - math.atan2(z, x)):
        after_z = math.sin(tilt_rad) * x + math.cos(tilt_rad) * z
        if abs(n_y) >= math.hypot(y, after_z):
            continue
        lean = math.asin(n_y / math.hypot(y, after_z))
        for roll_rad in (lean, math.pi - lean):
            mount = replace(
                guess,
                tilt_rad=math.remainder(tilt_rad, math.tau),
                roll_rad=math.remainder(roll_rad - math.atan2(y, after_z), math.tau),
            )
            if _maybe_implausible(mount, guess) is None:
                yield mount


def _maybe_implausible(mount: Mount, guess: Mount) -> str | None:
    tilt_off_rad = mount.tilt_rad - guess.tilt_rad
    roll_off_rad = math.remainder(mount.roll_rad - guess.roll_rad, math.tau)
    if mount.tilt_rad < LEAST_TILT_RAD:
        return f"a tilt of {math.degrees(mount.tilt_rad):.1f} deg does not look down"
    for name, off_rad in (("tilt", tilt_off_rad), ("roll", roll_off_rad)):
        if abs(off_rad) > MOST_OFF_RAD:
            return f"the {name} would be {math.degrees(off_rad):+.1f} deg off the settings'"
    if abs(mount.z_m - guess.z_m) > MOST_OFF_M or mount.z_m <= 0:
        return f"the height would be {mount.z_m:.2f} m"
    return None


def _floor_scans(view: FloorView, is_floor: Mask) -> I64:
    """The scans that show about as much floor as the better ones do."""
    counts = np.bincount(view.scan[is_floor], minlength=1)
    return np.flatnonzero(counts >= max(1.0, 0.5 * float(np.quantile(counts, 0.75))))


def _check_floor(view: FloorView, found: Fit, scans: int) -> None:
    """Raises NoFloorError unless there is enough floor, often enough, and flat."""
    share = float(found.is_floor.mean())
    if share < LEAST_SHARE or found.is_floor.sum() < LEAST_RETURNS / 4:
        raise NoFloorError(f"only {share:.0%} of the returns lie on one flat floor")
    if len(_floor_scans(view, found.is_floor)) < LEAST_SCANS_SHARE * scans:
        raise NoFloorError(
            "most scans do not show the floor that the others show: walls or people in the way, "
            "a floor that is not flat, or an attitude that is not true"
        )
    heights = found.heights_m[found.is_floor]
    rms_m = float(np.sqrt(np.mean(heights**2)))
    bent_m = _bent_m(view.rays_m[found.is_floor], heights)
    if rms_m > MOST_ROUGH_M or bent_m > MOST_BENT_M:
        raise NoFloorError(
            f"the floor is not flat, or the attitude not steady, enough: returns lie "
            f"{rms_m * 1000:.0f} mm rms about a plane, up to {bent_m * 1000:.0f} mm in the mean of "
            f"one bearing"
        )


def _bent_m(rays_m: F64, heights: F64) -> float:
    """Largest mean height of a bearing bin that has its share of the returns."""
    bearings = np.arctan2(rays_m[:, 1], rays_m[:, 0])
    bins = np.unique(np.floor(bearings / BEARING_BIN_RAD), return_inverse=True)[1]
    counts = np.bincount(bins)
    means = np.bincount(bins, heights) / counts
    return float(np.abs(means[counts >= 0.25 * counts.mean()]).max())


def reads_m(mount: Mount, other: Mount, place_m: tuple[float, float]) -> float:
    """Height that `other` gives to floor which `mount` sees at a place (x, y) of the body frame."""
    place = np.array([*place_m, 0.0])
    seen = mount.R_body_sensor.T @ (place - mount.t_body_sensor)
    return float((other.R_body_sensor @ seen + other.t_body_sensor)[2])
