"""How far a sweep is off: one Kalman filter of its height, pitch and roll.

Its states are (x, p, r, s_p, s_r): the odometry's height, what the orientation's filter leaves, and
what the attitude is always off by. A place that is a metres ahead and b metres aside, and was seen
before with other arms, differs by

    h (x, p, r, s_p, s_r)',   h = (1, a, b, arm now - arm then, aside now - aside then)

and by what p and r were then (`parted_m2`): one error for all witnesses, however many there are.

Source: docs/method.md, section 3; Kalman filter in information form, Tukey's weights.
"""

import math

import numpy as np

from core.grid.places import cell_at
from core.mapping.body import BodyPose
from core.mapping.surface.cells import STATES, Surface, height_over
from core.mapping.surface.constants import *
from core.motion.kalman import begin, clear, correct, fade, follow, join, note, spread
from core.records import F64
from jit import Record, Records, kernel


@kernel
def parted_m2(ahead: float, aside: float, age_s: float) -> float:
    """Variance of what the attitude has wandered between two looks at a place."""
    share = 1.0 - math.exp(-age_s / FAST_S)
    return 2.0 * SIGMA_FAST_RAD**2 * share * (ahead * ahead + aside * aside)


@kernel
def arms_of(ahead: float, aside: float, cell: Record, surface: Surface) -> tuple[float, float]:
    """The arms of a place now, less those with which its cell was seen: how s differs."""
    return ahead + surface.stand.travel_m - cell.arm_m, aside - cell.aside_m


@kernel
def arms_m2(ahead: float, aside: float, cell: Record, surface: Surface) -> float:
    """Variance of what the attitude is always off by, in a height seen before with other arms."""
    (arm, side), P = arms_of(ahead, aside, cell, surface), surface.P
    return float(P[3, 3] * arm * arm + 2.0 * P[3, 4] * arm * side + P[4, 4] * side * side)


@kernel
def forget(passed_s: float, driven_m: float, jumps: bool, own: F64, P: F64) -> None:
    """What a while and a signed way make of the error `own` (5,) and its covariance P (5, 5).

    jumps: the orientation's filter has gone over to other angles: the fast part is not known.
    """
    kept = math.exp(-passed_s / FAST_S)
    follow(P, own, 0, 1, driven_m)
    for fast in range(1, 3):
        fade(P, own, fast, kept, (1.0 - kept * kept) * SIGMA_FAST_RAD**2)
        if jumps:
            begin(P, fast, SIGMA_JUMP_RAD**2)


@kernel
def roll_on(passed_s: float, surface: Surface) -> None:
    """The wheels on a cell: its ground is under them. Where it was laid, what p was is lost.

    passed_s: since the last scan; 0 while the robot stands.
    """
    stand, own, h = surface.stand, surface.own, surface.room.h
    at = cell_at(stand.x_m, stand.y_m, surface.ring)
    cell = surface.cells[max(0, at)]
    if at >= 0 and cell.looks > 0 and passed_s > 0.0:
        h[0], h[1], h[2] = 1.0, 0.0, 0.0
        h[3], h[4] = arms_of(0.0, 0.0, cell, surface)
        z = stand.z_m - own[0] - own[3] * stand.travel_m
        off = height_over(cell, stand.x_m, stand.y_m, z, surface)
        var = cell.var_m2 + FLAT_M * FLAT_M + (SIGMA_FAST_RAD * surface.limits.far_m) ** 2
        if off * off <= GATE * GATE * (var + spread(h, surface.P)):
            # cells one behind the other were laid with one error
            alike = 2.0 * FAST_S * var / passed_s
            correct(surface.P, own, h, off, alike, surface.room.told.Ph)
    surface.now[0].wheels_m = stand.z_m - own[0] - own[3] * stand.travel_m


@kernel
def _gather(returns: Records, cells: int, surface: Surface) -> float:
    """Sum what the witnesses say into `told` of the room; how many of them are of one mind."""
    told, h, gone = surface.room.told, surface.room.h, surface.room.gone
    total, stand = 0.0, surface.stand
    clear(told)
    for b in range(returns.size):
        one = returns[b]
        if one.witness < 0:
            continue
        cell = surface.cells[one.witness]
        a, s = one.witness_ahead_m, one.witness_aside_m
        h[0], h[1], h[2] = 1.0, a, s
        h[3], h[4] = arms_of(a, s, cell, surface)
        age_s = stand.t_s - cell.floor_s
        if age_s < FAST_S:  # what differs so soon is the fast part
            h[3] = h[4] = 0.0
        off = one.off_m
        for k in range(STATES):
            off -= h[k] * gone[k]
        var, wander = cell.var_m2 + FLAT_M * FLAT_M + one.noise_m2, parted_m2(a, s, age_s)
        share = 1.0 - off * off / (GATE * GATE * (var + wander + spread(h, surface.P)))
        if share > 0.0:
            alike = ALIKE_S * var / cells + 2.0 * min(age_s, FAST_S) * wander
            note(told, h, one.off_m, share * share / alike)
            total += share * share
    return total


@kernel
def set_right(returns: Records, passed_s: float, surface: Surface) -> None:
    """Take the sweep's error out of its returns, and note it in `surface.own` and `surface.P`."""
    gone, now, travel_m = surface.room.gone, surface.room.P, surface.stand.travel_m
    cells, last = 0, -1
    for b in range(returns.size):
        witness = returns[b].witness
        cells += witness >= 0 and witness != last
        last = witness
    gone[:] = 0.0
    for _ in range(ROUNDS):
        total = _gather(returns, cells, surface)
        for k in range(now.size):
            now.flat[k] = surface.P.flat[k]
        gone[:] = 0.0
        if total < WITNESSES:
            break
        join(now, gone, surface.room.told, passed_s / total)
    for k in range(STATES):
        surface.own[k] += gone[k]
    for k in range(now.size):
        surface.P.flat[k] = now.flat[k]
    for b in range(returns.size):
        one = returns[b]
        if one.at < 0:
            continue
        a, s, cell = one.ahead_m, one.aside_m, surface.cells[one.at]
        error = gone[0] + gone[1] * a + gone[2] * s
        one.z_m -= error + gone[3] * (a + travel_m) + gone[4] * s
        wander = parted_m2(a, s, one.age_s)
        if cell.looks > 0:
            arm, side = arms_of(a, s, cell, surface)
            error += gone[3] * arm + gone[4] * side
            wander += arms_m2(a, s, cell, surface)
        one.wander_m2 = wander
        one.height_m -= error
        one.near_m -= error


class SweepFilter:
    """The error of the newest sweep, `own` (5,) and its covariance `P` (5, 5), scan by scan."""

    def __init__(self) -> None:
        self.own: F64 = np.zeros(STATES)
        self.P: F64 = np.zeros((STATES, STATES))
        self._doubted = 0
        self.restart()

    def restart(self) -> None:
        """Nothing is known but what the sensor is good for."""
        fast, static = SIGMA_FAST_RAD**2, SIGMA_STATIC_RAD**2
        self._last_s = self._travel_m = math.nan
        self.own[:] = 0.0
        self.P[:] = np.diag([FLAT_M**2, fast, fast, static, static])

    def follow(self, body: BodyPose, doubted: int) -> tuple[float, float]:
        """Time has passed, and way: how much of both since the scan before; 0 at the first one.

        doubted: how often the orientation's filter has gone over to other angles.
        """
        passed_s, driven_m = body.t_s - self._last_s, body.travel_m - self._travel_m
        if math.isnan(passed_s):
            passed_s, driven_m, doubted = 0.0, 0.0, self._doubted
        forget(passed_s, driven_m, doubted != self._doubted, self.own, self.P)
        self._last_s, self._travel_m, self._doubted = body.t_s, body.travel_m, doubted
        return passed_s, driven_m
