"""How far a sweep is off: one Kalman filter of its height, pitch and roll.

A return a metres ahead and b metres aside of the axle, after a signed way L, is cast

    z = true + x + p a + r b + s_p (a + L) + s_r b + noise

(p, r): what the orientation's filter leaves, an Ornstein-Uhlenbeck process; (s_p, s_r): what the
attitude is always off by. The odometry's height runs away with the pitch: dx = p dL. Ground is laid
at z - x - p a - r b and keeps its arms (a + L, b). Seen again, with other arms, it differs by

    h (x, p, r, s_p, s_r)',   h = (1, a, b, arm now - arm then, aside now - aside then)

so that a straight way, or a turn on the spot, tells nothing of s, and nothing runs away. What p was
when it was laid is lost, R = 2 S^2 (1 - exp(-age / T)) far^2: one error for all witnesses, however
many there are. Noise and roughness are each cell's own. The wheels know the ground under them:
there h = (1, 0, 0, L - arm, -aside).

Source: docs/method.md, section 3; Kalman filter in information form, Tukey's weights.
"""

import math
from typing import NamedTuple

import numpy as np

from core.mapping.surface.cells import Surface, cell_at, from_centre, ground_of
from core.mapping.surface.constants import (
    ALIKE_S,
    BINS,
    FAST_S,
    FLAT_M,
    GATE,
    ROUNDS,
    SIGMA_FAST_RAD,
    SIGMA_JUMP_RAD,
    SIGMA_STATIC_RAD,
    WITNESSES,
)
from core.motion.orientation import OrientationFilter
from core.records import F64
from jit import Record, Records, kernel

STATES = 5


class Room(NamedTuple):
    """What an estimate is worked out in."""

    M: F64  # (5, 5) information, and (5,) of what
    y: F64
    C: F64  # (5, 5) its root, and (5,) what that tells
    v: F64
    P: F64  # (5, 5) the covariance with it
    gone: F64  # (5,) how far it has moved since the returns were held against the ground
    h: F64  # (5,)
    Ph: F64  # (5,)
    bins: F64  # (BINS,) in which returns over a guess are counted


def new_room() -> Room:
    square, line = (STATES, STATES), STATES
    shapes = (square, line, square, line, square, line, line, line, BINS)
    return Room(*(np.zeros(shape) for shape in shapes))


@kernel
def parted_m2(ahead: float, aside: float, age_s: float) -> float:
    """Variance of what the attitude has wandered between two looks at a place."""
    share = 1.0 - math.exp(-age_s / FAST_S)
    return 2.0 * SIGMA_FAST_RAD**2 * share * (ahead * ahead + aside * aside)


@kernel
def seen_again_m2(
    ahead: float, aside: float, travel_m: float, age_s: float, cell: Record, P: F64
) -> float:
    """Variance of a height against ground seen before: by the fast part, and by other arms."""
    arm, side = ahead + travel_m - cell.arm_m, aside - cell.aside_m
    static = P[3, 3] * arm * arm + 2.0 * P[3, 4] * arm * side + P[4, 4] * side * side
    return parted_m2(ahead, aside, age_s) + float(static)


@kernel
def forget(passed_s: float, driven_m: float, own: F64, P: F64) -> None:
    """What a while and a signed way make of the error `own` (5,) and its covariance P (5, 5)."""
    kept, S2 = math.exp(-passed_s / FAST_S), SIGMA_FAST_RAD**2
    own[0] += own[1] * driven_m
    for k in range(STATES):
        P[0, k] += driven_m * P[1, k]
    for k in range(STATES):
        P[k, 0] += driven_m * P[k, 1]
    for m in range(1, 3):
        own[m] *= kept
        for k in range(STATES):
            P[m, k] *= kept
        for k in range(STATES):
            P[k, m] *= kept
        P[m, m] += (1.0 - kept * kept) * S2


@kernel
def jump(P: F64) -> None:
    """The orientation's filter has gone over to other angles: nothing is known of the fast part."""
    for m in range(1, 3):
        P[m, :] = 0.0
        P[:, m] = 0.0
        P[m, m] = SIGMA_JUMP_RAD**2


@kernel
def _row(ahead: float, aside: float, travel_m: float, cell: Record, h: F64) -> None:
    """How a place seen again differs by each state; travel_m: L, the way driven so far."""
    h[0], h[1], h[2] = 1.0, ahead, aside
    h[3], h[4] = ahead + travel_m - cell.arm_m, aside - cell.aside_m


@kernel
def _spread(h: F64, P: F64) -> float:
    """h P h': variance of what h (5,) tells of the states."""
    total = 0.0
    for i in range(STATES):
        for k in range(STATES):
            total += h[i] * P[i, k] * h[k]
    return total


@kernel
def _copy(P: F64, to: F64) -> None:
    """A covariance; an assignment of slices would make an array."""
    for i in range(STATES):
        for k in range(STATES):
            to[i, k] = P[i, k]


@kernel
def _measure(h: F64, off: float, var: float, own: F64, P: F64, Ph: F64) -> None:
    """Kalman's update by one measurement: h (5,) times the states is more than told by `off`."""
    S = var
    for i in range(STATES):
        Ph[i] = 0.0
        for k in range(STATES):
            Ph[i] += P[i, k] * h[k]
        S += h[i] * Ph[i]
    for i in range(STATES):
        own[i] += Ph[i] * off / S
        for k in range(STATES):
            P[i, k] -= Ph[i] * Ph[k] / S


@kernel
def _join(own: F64, P: F64, room: Room) -> None:
    """Information `room.M` (5, 5) and `room.y` (5,) into the filter.

    M = C C' by Cholesky: each column c of C is a measurement of its own, v = c own, of variance 1,
    where C v = y.
    """
    M, y, C, v = room.M, room.y, room.C, room.v
    C[:] = 0.0
    v[:] = 0.0
    for k in range(STATES):
        left, rest = M[k, k], y[k]
        for m in range(k):
            left, rest = left - C[k, m] * C[k, m], rest - C[k, m] * v[m]
        if left <= 1e-12 * M[k, k]:
            continue  # nothing is said of this state that was not said of those before
        C[k, k] = math.sqrt(left)
        v[k] = rest / C[k, k]
        for i in range(k + 1, STATES):
            C[i, k] = M[i, k]
            for m in range(k):
                C[i, k] -= C[i, m] * C[k, m]
            C[i, k] /= C[k, k]
    for k in range(STATES):
        off = v[k]
        for i in range(k, STATES):
            off -= C[i, k] * own[i]
        _measure(C[:, k], off, 1.0, own, P, room.Ph)


@kernel
def roll_on(
    x: float, y: float, z: float, travel_m: float, passed_s: float, far_m: float,
    surface: Surface, P: F64, room: Room,
) -> None:  # fmt: skip
    """The wheels on a cell: its ground is under them.

    Args:
        z: of the odometry. passed_s: since the last scan; 0 while the robot stands.
        far_m: how far ahead ground is seen first, where what p was then is lost.
    """
    at, own = cell_at(x, y, surface), surface.own
    if at < 0 or surface.cells[at].looks == 0 or passed_s <= 0.0:
        return
    cell, h, cell_m = surface.cells[at], room.h, surface.cell_m
    _row(0.0, 0.0, travel_m, cell, h)
    off = z - own[0] - own[3] * travel_m - ground_of(cell, own)
    off -= cell.slope_x * from_centre(x, cell_m) + cell.slope_y * from_centre(y, cell_m)
    var = cell.var_m2 + FLAT_M * FLAT_M + (SIGMA_FAST_RAD * far_m) ** 2
    if off * off > GATE * GATE * (var + _spread(h, P)):
        return
    # cells one behind the other were laid with one error
    _measure(h, off, 2.0 * FAST_S * var / passed_s, own, P, room.Ph)


@kernel
def _gather(
    returns: Records, cells: int, t_s: float, travel_m: float, surface: Surface, P: F64, room: Room
) -> float:
    """Sum what the witnesses say into `room.M`, `room.y`; how many of them are of one mind."""
    h, M, y, gone, total = room.h, room.M, room.y, room.gone, 0.0
    M[:] = 0.0
    y[:] = 0.0
    for b in range(returns.size):
        one = returns[b]
        if one.witness < 0:
            continue
        cell = surface.cells[one.witness]
        a, s = one.witness_ahead_m, one.witness_aside_m
        _row(a, s, travel_m, cell, h)
        age_s = t_s - cell.floor_s
        if age_s < FAST_S:  # what differs so soon is the fast part
            h[3] = h[4] = 0.0
        off = one.off_m
        for k in range(STATES):
            off -= h[k] * gone[k]
        var, wandered = cell.var_m2 + FLAT_M * FLAT_M + one.noise_m2, parted_m2(a, s, age_s)
        share = 1.0 - off * off / (GATE * GATE * (var + wandered + _spread(h, P)))
        if share <= 0.0:
            continue
        w = share * share / (ALIKE_S * var / cells + 2.0 * min(age_s, FAST_S) * wandered)
        total += share * share
        for i in range(STATES):
            y[i] += w * h[i] * one.off_m
            for k in range(STATES):
                M[i, k] += w * h[i] * h[k]
    return total


@kernel
def set_right(
    returns: Records, t_s: float, passed_s: float, travel_m: float, surface: Surface, P: F64,
    room: Room,
) -> None:  # fmt: skip
    """Take the sweep's error out of its returns, and note it in `surface.own`, P."""
    M, y, gone, now = room.M, room.y, room.gone, room.P
    cells, last = 0, -1
    _copy(P, now)
    gone[:] = 0.0
    for b in range(returns.size):
        witness = returns[b].witness
        cells += witness >= 0 and witness != last
        last = witness
    for _ in range(ROUNDS):
        total = _gather(returns, cells, t_s, travel_m, surface, P, room)
        if total < WITNESSES:
            _copy(P, now)
            gone[:] = 0.0
            break
        _copy(P, now)
        gone[:] = 0.0
        for i in range(STATES):
            y[i] *= passed_s / total
            for k in range(STATES):
                M[i, k] *= passed_s / total
        _join(gone, now, room)
    own = surface.own
    for k in range(STATES):
        own[k] += gone[k]
    _copy(now, P)
    for b in range(returns.size):
        one = returns[b]
        if one.at < 0:
            continue
        a, s, cell = one.ahead_m, one.aside_m, surface.cells[one.at]
        error = gone[0] + gone[1] * a + gone[2] * s
        one.z_m -= error + gone[3] * (a + travel_m) + gone[4] * s
        if cell.looks > 0:
            error += gone[3] * (a + travel_m - cell.arm_m) + gone[4] * (s - cell.aside_m)
        one.height_m -= error
        one.near_m -= error
        if cell.looks > 0:
            one.wander_m2 = seen_again_m2(a, s, travel_m, one.age_s, cell, P)
        else:
            one.wander_m2 = parted_m2(a, s, one.age_s)


class SweepFilter:
    """The error of the newest sweep, `own` (5,) and its covariance `P` (5, 5), scan by scan."""

    def __init__(self, far_m: float) -> None:
        self.far_m = far_m  # where level ground is met
        self.own: F64 = np.zeros(STATES)
        self.P: F64 = np.zeros((STATES, STATES))
        self.room = new_room()
        self._doubted = 0
        self.restart()

    def restart(self) -> None:
        """Nothing is known but what the sensor is good for."""
        fast, static = SIGMA_FAST_RAD**2, SIGMA_STATIC_RAD**2
        self._last_s = self._travel_m = math.nan
        self.own[:] = 0.0
        self.P[:] = np.diag([FLAT_M**2, fast, fast, static, static])

    def warm(self) -> None:
        """Run the kernels that the first scan does not need."""
        forget(0.0, 0.0, self.own, self.P)
        jump(self.P)
        self.restart()

    def follow(
        self, t_s: float, travel_m: float, orientation: OrientationFilter
    ) -> tuple[float, float]:
        """Time has passed, and way: how much of both since the scan before."""
        passed_s, driven_m = t_s - self._last_s, travel_m - self._travel_m
        self._last_s, self._travel_m = t_s, travel_m
        if math.isnan(passed_s):
            return 0.0, 0.0
        forget(passed_s, driven_m, self.own, self.P)
        if orientation.doubted != self._doubted:
            self._doubted = orientation.doubted
            jump(self.P)
        return passed_s, driven_m
