"""When the body stands, and what the gyro says then.

It rests while no wheel has counted of late and the gyro is quiet but for its bias. Wheels that rest
may creep, a count now and then, and the body turns with them. What the gyro says besides, in the
mean of REST_S, is its bias; of a rest that lasts T so far the turn is known to a count q on either
side,

    w = b + noise,   R = RATE^2 / n + (q^2 / 3) / (T^2 - (T - REST_S)^2)

where the second part, of body z alone, makes that of all means together (q^2 / 3) / T^2. Once it
has rested for STILL_S it stands: the told yaw turns as the wheels creep and no more.
"""

import math

import numpy as np

from core.motion.error_state import BIAS, SIZE, correct
from core.records import F64
from jit import Record, Records, allocating_kernel, kernel

GATE = 4.0  # sigmas of quiet, asked 30 times a second: by chance beyond it once in ten minutes
STILL_S = 0.5  # so long without a count, and the wheels stand
WHEELS_S = 0.5  # for so long the newest counts speak of now
REST_S = 1.0  # of rest, of which the mean rate is the bias
HELD_S = 0.5  # a turn that has begun so lately is made up for when it is noticed

REST = np.dtype(
    [
        ("wheels_s", np.float64),  # newest counts, and what they turn
        ("wheel_radps", np.float64),
        ("still_s", np.float64),  # since when there was no count; inf while they move
        ("round_rad", np.float64),  # a count
        ("crept_rad", np.float64),  # a turn of the wheels that may be to and fro on an edge
        ("standing", np.bool_),
        ("held_rad", np.float64),  # a turn that is kept back while it stands
        ("rests_s", np.float64),  # how long it rests in all,
        ("since_s", np.float64),  # and since its rates told the last time: so many samples,
        ("samples", np.int64),
        ("rate_sums", np.float64, 3),  # sums of their rates, and what the wheels creep
        ("turn_rad", np.float64),
    ],
    align=True,
)


def begin_rest(rest: Records) -> None:
    """Nothing is known yet. rest: (1,) of REST."""
    rest["wheels_s"], rest["still_s"] = -math.inf, math.inf


@kernel
def wheels_creep(
    rest: Record, from_s: float, to_s: float, turn_rad: float, round_rad: float, moved: bool
) -> float:
    """What the wheels did in an interval; what of it turns a body that stands."""
    rest.wheels_s, rest.wheel_radps, rest.round_rad = to_s, turn_rad / (to_s - from_s), round_rad
    if moved:
        rest.still_s = math.inf
    elif rest.still_s == math.inf:
        rest.still_s = from_s
    rest.crept_rad += turn_rad
    creep_rad = rest.crept_rad - max(-round_rad, min(round_rad, rest.crept_rad))
    rest.crept_rad -= creep_rad
    rest.turn_rad += creep_rad
    if not rest.standing:
        return 0.0
    rest.held_rad -= creep_rad
    return float(creep_rad)


@kernel
def has_wheels(rest: Record, t_s: float) -> bool:
    """Whether the wheels' rate of turn is that of now."""
    return bool(t_s - rest.wheels_s <= WHEELS_S)


@kernel
def set_out(rest: Record) -> float:
    """It stands no more; the turn that had begun before this was noticed."""
    turn_rad = rest.held_rad if rest.standing else 0.0
    rest.standing, rest.held_rad = False, 0.0
    return float(turn_rad)


@kernel
def hold(rest: Record, dt_s: float, turn_rad: float, var: float) -> float:
    """What the told yaw turns by, of what the gyro says in a sample: none while it stands.

    var: of a rate; one that is beyond the gate is no quiet one.
    """
    if not rest.standing:
        return turn_rad
    rest.held_rad += turn_rad - rest.held_rad * min(1.0, dt_s / HELD_S)
    return set_out(rest) if turn_rad * turn_rad > GATE * GATE * var * dt_s * dt_s else 0.0


@kernel
def _teach(rest: Record, dt_s: float, samples: int, rate_sums: F64) -> bool:
    """Add to the sums; whether they are those of REST_S."""
    if rest.since_s == 0.0:
        rest.samples, rest.turn_rad = 0, 0.0
        for k in range(3):
            rest.rate_sums[k] = 0.0
    rest.since_s += dt_s
    rest.rests_s += dt_s
    rest.samples += samples
    for k in range(3):
        rest.rate_sums[k] += rate_sums[k]
    return bool(rest.since_s >= REST_S)


@allocating_kernel
def use_rest(
    rest: Record, errors: Record, t_s: float, dt_s: float, samples: int, rate_sums: F64, var: float
) -> float:
    """Find out whether it rests, and learn the bias.

    Args:
        rate_sums: (3,) of the samples within dt_s. var: of one of their rates.

    Returns:
        A turn to be made up for.
    """
    P, value = errors.P, errors.value
    rests = t_s >= rest.still_s and has_wheels(rest, t_s)
    for k in range(3):
        off = rate_sums[k] / samples - value[BIAS + k]
        rests = rests and off * off <= GATE * GATE * (var / samples + P[BIAS + k, BIAS + k])
    if not rests:
        rest.since_s = rest.rests_s = rest.crept_rad = 0.0
        return set_out(rest)
    turn_rad = 0.0
    if t_s - rest.still_s >= STILL_S:
        rest.standing = True
    else:
        turn_rad = set_out(rest)
    if _teach(rest, dt_s, samples, rate_sums):
        count2 = rest.rests_s**2 - (rest.rests_s - rest.since_s) ** 2
        for k in range(3):
            h, off, R = np.zeros(SIZE), rest.rate_sums[k] / rest.samples, var / rest.samples
            h[BIAS + k] = 1.0
            if k == 2:
                off -= rest.turn_rad / rest.since_s
                R += rest.round_rad**2 / 3.0 / count2
            correct(P, value, h, off - value[BIAS + k], R)
        rest.since_s = 0.0
    return turn_rad
