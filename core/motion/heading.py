"""The yaw of the body: gyro first, the sensor's own (magnetic) heading where it can be believed.

Yaw follows the gyro, less its bias; the sensor's own yaw draws it back slowly, for as long as the
magnetic field looks as it did and that yaw moves as the gyro says. After a disturbance it has to
behave for a while before it counts again. While the wheels stand and the gyro is quiet, the yaw
stands, and the gyro tells its bias.
Source: design, section 5; for the estimates, core.motion.error_state.
"""

import math

import numpy as np

from core.geometry import Rates, Rpy, wrapped_in_kernels
from core.motion.error_state import (
    BIAS,
    OFFSET,
    SIZE,
    YAW,
    ErrorState,
    correct,
    define,
    forget,
    spread_of_sum,
    turn,
)
from core.motion.magnetic import Quaternion, Vector, adopt_field, is_plain
from jit import Record, Records, allocating_kernel, kernel

SENSOR_RAD = math.radians(0.3)  # noise of the sensor's own yaw,
SENSOR_S = 0.1  # of which samples nearer than that share most
OFFSET_RAD = math.radians(1.0)  # how far that yaw wanders from place to place,
OFFSET_S = 200.0  # and the time constant of that
GYRO_VAR = math.radians(0.04) ** 2  # rad2/s: random walk of an integrated rate
GYRO_TURN_VAR = math.radians(0.2) ** 2 / (2 * math.pi)  # per rad turned: its scale and axes
BIAS_VAR = math.radians(0.003) ** 2  # (rad/s)2/s: random walk of the bias
RATE_RADPS = math.radians(0.4)  # noise of one sample of the rate
GATE = 3.0  # standard deviations
MOST_OFFSET_RAD = math.radians(3.0)  # a yaw that is found to be off by more is being drawn away
HOLD_S = 5.0  # after a disturbance the sensor takes seconds to find back
ADOPT_S = 30.0  # so long a new offset must have stood, while moving, to be the usual one
ADOPT_RAD = math.radians(2.0)  # and within this
GAP_S = 0.06  # a longer one between samples hides turns from the gyro
LONGEST_S = 10.0  # beyond it, nothing gets less sure than it is
GAP_RADPS = 0.3  # about how fast such a turn may be
OWED_RADPS = math.radians(1.0)  # the told yaw is corrected no faster
STILL_S = 0.5  # so long without a count, and the wheels stand
WHEELS_S = 0.4  # for so long the newest counts speak of now
CALM_S = 0.5  # time constant of what the quiet rate is judged by
CALM_RAD = math.radians(0.1)  # turned within it, at most
SUDDEN_RADPS = math.radians(2.5)  # one sample beyond that is no quiet rate
LEAST_COS = 0.1  # nearer to upright, there is no yaw

HEADING = np.dtype(
    [
        ("told_rad", np.float64),  # unwrapped
        ("turned_rad", np.float64),  # integrated rate, bias and all; where none, the sensor's turn
        ("gyro_since_s", np.float64),  # since when that has been the gyro's, without a gap
        ("trusted", np.bool_),  # whether the sensor's own yaw counts just now,
        ("trust_from_s", np.float64),  # and from when on it may again
        ("standing", np.bool_),
        ("disturbed", np.int64),  # how often the sensor's yaw was found not to be believed
        ("adopted", np.int64),  # how often a new usual offset was taken
        ("usual_rad", np.float64),  # offset of the sensor's yaw that counts as none
        ("t_s", np.float64),  # of the newest sample, its rate and the sensor's yaw
        ("rate_radps", np.float64),
        ("sensor_rad", np.float64),
        ("steady_rad", np.float64),  # an offset that may become usual, and since when it stands
        ("steady_from_s", np.float64),
        ("wheels_s", np.float64),  # newest counts, and what they turn
        ("wheel_radps", np.float64),
        ("wheels_still_s", np.float64),  # since when there was no count; inf while they move
        ("calm_rad", np.float64),  # turned of late, beyond the bias
        ("held_rad", np.float64),  # the same, kept back while it stands
        ("stood_at_rad", np.float64),  # the sensor's yaw when that began
    ],
    align=True,
)


class HeadingFilter:
    """What `heading_step` knows; the first sample's yaw is its zero error.

    Args:
        record: (1,) of HEADING, all zero.
    """

    def __init__(self, record: Records, state: ErrorState) -> None:
        self.record, self.state = record, state
        state.P[OFFSET, OFFSET] = SENSOR_RAD**2
        record["trusted"] = True
        record["rate_radps"] = math.nan
        for never in ("t_s", "trust_from_s", "wheels_s"):
            record[never] = -math.inf
        for never in ("gyro_since_s", "steady_from_s", "wheels_still_s"):
            record[never] = math.inf

    @property
    def told_rad(self) -> float:
        """The yaw that is told, unwrapped."""
        return float(self.record["told_rad"][0])

    @property
    def yaw_rad(self) -> float:
        """The best estimate, which the told yaw is on its way to."""
        return self.told_rad + float(self.state.value[YAW])

    @property
    def bias_radps(self) -> float:
        """Of the gyro's rate about the vertical, as estimated."""
        return float(self.state.value[BIAS])

    @property
    def gyro_since_s(self) -> float:
        """Since when the ring's turns are the gyro's, without a gap; inf while they are not."""
        return float(self.record["gyro_since_s"][0])

    @property
    def trusted(self) -> bool:
        """Whether the sensor's own yaw counts just now."""
        return bool(self.record["trusted"][0])

    @property
    def standing(self) -> bool:
        return bool(self.record["standing"][0])

    @property
    def disturbed(self) -> int:
        """How often the sensor's yaw was found not to be believed."""
        return int(self.record["disturbed"][0])

    @property
    def adopted(self) -> int:
        """How often a new usual offset was taken."""
        return int(self.record["adopted"][0])

    def note_wheels(self, from_s: float, to_s: float, turn_rad: float, *, moved: bool) -> None:
        """What the wheels did in an interval, before the attitudes of it are all used."""
        record = self.record[0]
        record["wheels_s"] = to_s
        record["wheel_radps"] = turn_rad / (to_s - from_s)
        if moved:
            record["wheels_still_s"] = math.inf
        elif record["wheels_still_s"] == math.inf:
            record["wheels_still_s"] = from_s

    def pay_all(self) -> float:
        """Tell the estimate at once; returns the jump (rad)."""
        owed_rad = float(self.state.value[YAW])
        self.record["told_rad"] += owed_rad
        self.state.value[YAW] = 0.0
        return owed_rad


@kernel
def yaw_rate(roll_rad: float, pitch_rad: float, rates: Rates) -> float:
    """How fast yaw grows (rad/s) at a rate of turn about the body's axes; NaN: not known."""
    cos_pitch = math.cos(pitch_rad)
    if cos_pitch < LEAST_COS:
        return math.nan
    return (rates[1] * math.sin(roll_rad) + rates[2] * math.cos(roll_rad)) / cos_pitch


@allocating_kernel
def _correct_bias(errors: Record, off_radps: float) -> None:
    """While it stands, the gyro tells its bias."""
    h = np.zeros(SIZE)
    h[BIAS] = 1.0
    correct(errors.P, errors.value, h, off_radps, RATE_RADPS**2)


@allocating_kernel
def _correct_yaw(errors: Record, off_rad: float, variance: float) -> None:
    """The sensor's own yaw tells that of the body and its offset."""
    h = np.zeros(SIZE)
    h[YAW] = h[OFFSET] = 1.0
    correct(errors.P, errors.value, h, off_rad, variance)


@kernel
def _pass_time(errors: Record, dt_s: float, yaw_var: float, turns: bool) -> None:
    """`turns`: the yaw was moved by the gyro less its bias, so its error grows with that's."""
    kept = math.exp(-dt_s / OFFSET_S)
    offset_var = OFFSET_RAD**2 * (1 - kept * kept)
    turn(errors.P, errors.value, dt_s if turns else 0.0, yaw_var, BIAS_VAR * dt_s, kept, offset_var)


@kernel
def _distrust(heading: Record, errors: Record, t_s: float) -> None:
    if heading.trusted:
        heading.disturbed += 1
        forget(errors.P, OFFSET, OFFSET_RAD**2)
        errors.value[OFFSET] = 0.0
    heading.trusted = False
    heading.trust_from_s = t_s + HOLD_S


# With a gyro


@kernel
def _stand(
    heading: Record, errors: Record, t_s: float, dt_s: float, sensor_rad: float, excess_radps: float
) -> None:
    """Find out whether the body stands: wheels without a count, a gyro quiet but for its bias."""
    unsure_radps = GATE * math.sqrt(errors.P[BIAS, BIAS])
    heading.calm_rad += excess_radps * dt_s - heading.calm_rad * dt_s / CALM_S
    # the first is never true while they move: then it is minus infinity
    wheels_stand = t_s - heading.wheels_still_s >= STILL_S and t_s - heading.wheels_s <= WHEELS_S
    if heading.wheels_still_s == math.inf:
        heading.calm_rad = 0.0
    quiet = (
        abs(excess_radps) <= SUDDEN_RADPS + unsure_radps
        and abs(heading.calm_rad) <= CALM_RAD + CALM_S * unsure_radps
        and (
            not heading.standing
            or not heading.trusted
            or abs(wrapped_in_kernels(sensor_rad - heading.stood_at_rad)) <= OFFSET_RAD
        )
    )
    stands = wheels_stand and quiet
    if stands and not heading.standing:
        heading.held_rad, heading.stood_at_rad = 0.0, sensor_rad
    if heading.standing and not stands:
        heading.told_rad += heading.held_rad  # the turn had begun before it was noticed
    heading.standing = stands


@kernel
def _turn_by_gyro(heading: Record, errors: Record, dt_s: float, mean_radps: float) -> None:
    turn_rad = (mean_radps - errors.value[BIAS]) * dt_s
    if heading.standing:
        heading.held_rad += turn_rad - heading.held_rad * dt_s / CALM_S
        _pass_time(errors, dt_s, 0.0, False)
        _correct_bias(errors, mean_radps - errors.value[BIAS])
        return
    heading.told_rad += turn_rad
    _pass_time(errors, dt_s, GYRO_VAR * dt_s + GYRO_TURN_VAR * abs(turn_rad), True)


@kernel
def _look_for_offset(
    heading: Record,
    field: Record,
    errors: Record,
    t_s: float,
    dt_s: float,
    off_rad: float,
) -> None:
    """Its yaw is off for long, but moves as the gyro says: then it is off by a constant."""
    first_rad = GATE * math.sqrt(errors.P[YAW, YAW] + OFFSET_RAD**2 + SENSOR_RAD**2)
    if heading.usual_rad != 0.0 and abs(off_rad) <= first_rad:
        heading.usual_rad = 0.0  # as it was at the start
        return
    if heading.standing:
        heading.steady_from_s += dt_s  # nothing is learnt about a place by standing there
    away_rad = wrapped_in_kernels(off_rad - heading.steady_rad)
    if not abs(away_rad) <= ADOPT_RAD or math.isinf(heading.steady_from_s):
        heading.steady_rad, heading.steady_from_s = off_rad, t_s
    if t_s - heading.steady_from_s >= ADOPT_S:
        heading.usual_rad, heading.steady_from_s = off_rad, math.inf
        define(errors.P, OFFSET, YAW, -1.0, OFFSET_RAD**2)
        errors.value[OFFSET] = 0.0
        adopt_field(field)
        heading.trust_from_s = t_s
        heading.adopted += 1


@kernel
def _use_sensor(
    heading: Record,
    field: Record,
    errors: Record,
    t_s: float,
    dt_s: float,
    sensor_rad: float,
    plain: bool,
) -> None:
    """Correct by the sensor's own yaw, where nothing speaks against it."""
    yaw_rad = heading.told_rad + errors.value[YAW]
    off_rad = wrapped_in_kernels(sensor_rad - yaw_rad - heading.usual_rad)
    innovation_rad = off_rad - errors.value[OFFSET]
    spread = spread_of_sum(errors.P, YAW, OFFSET) + SENSOR_RAD**2
    fits = (
        plain
        and innovation_rad**2 <= GATE**2 * spread
        and abs(errors.value[OFFSET]) <= MOST_OFFSET_RAD
    )
    if not fits:
        _distrust(heading, errors, t_s)
        _look_for_offset(
            heading, field, errors, t_s, dt_s, wrapped_in_kernels(sensor_rad - yaw_rad)
        )
        return
    heading.trusted = t_s >= heading.trust_from_s
    if heading.trusted and not heading.standing:
        heading.steady_from_s = math.inf
        _correct_yaw(errors, innovation_rad, SENSOR_RAD**2 * max(1.0, SENSOR_S / dt_s))


# Without one


@kernel
def _turn_by_sensor(
    heading: Record,
    errors: Record,
    t_s: float,
    dt_s: float,
    turn_rad: float,
    mean_radps: float,
    plain: bool,
) -> None:
    """No gyro, or a gap in it: the sensor's turn, or the wheels' where that is disturbed."""
    if plain and heading.trusted:
        heading.told_rad += turn_rad
        _pass_time(errors, dt_s, 2 * OFFSET_RAD**2 / OFFSET_S * dt_s, False)
        return
    if not plain:
        _distrust(heading, errors, t_s)
    elif t_s >= heading.trust_from_s:
        heading.trusted = True
    if t_s - heading.wheels_s <= WHEELS_S:
        heading.told_rad += heading.wheel_radps * dt_s
    elif math.isfinite(mean_radps):
        heading.told_rad += (mean_radps - errors.value[BIAS]) * min(dt_s, WHEELS_S)
    else:
        heading.told_rad += turn_rad
    _pass_time(errors, dt_s, (GAP_RADPS * dt_s) ** 2, False)


@kernel
def _pay(heading: Record, errors: Record, dt_s: float) -> None:
    """Bring what is owed to the told yaw, but not so fast that a map is torn."""
    most_rad = OWED_RADPS * dt_s
    paid_rad = max(-most_rad, min(most_rad, errors.value[YAW]))
    heading.told_rad += paid_rad
    errors.value[YAW] -= paid_rad


@kernel
def heading_step(
    heading: Record,
    field: Record,
    errors: Record,
    t_s: float,
    rpy_rad: Rpy,
    rates: Rates,
    q_earth_sensor: Quaternion,
    magnetic: Vector,
    has_magnetic: bool,
) -> float:
    """The yaw to be told (rad) at a sample, which must be later than the one before.

    Args:
        heading, field, errors: a HEADING, a FIELD and ERRORS.
        rpy_rad: roll, pitch and yaw of the body as the sensor has them.
        rates: about the body's axes, NaN where they are not delivered.
        q_earth_sensor: the sensor's own, which `magnetic` is turned level by.
        magnetic: field in the sensor's axes, 1 = the field at calibration.
    """
    sensor_rad = rpy_rad[2]
    rate_radps = yaw_rate(rpy_rad[0], rpy_rad[1], rates)
    before_s, before_radps, before_rad = heading.t_s, heading.rate_radps, heading.sensor_rad
    heading.t_s, heading.rate_radps, heading.sensor_rad = t_s, rate_radps, sensor_rad
    is_first = before_s == -math.inf
    dt_s = 0.0 if is_first else min(t_s - before_s, LONGEST_S)
    plain = True  # without a field, there is nothing to judge by
    if has_magnetic:
        plain = is_plain(field, dt_s, q_earth_sensor, magnetic, heading.trusted)
    if is_first:
        heading.told_rad = sensor_rad
        return sensor_rad
    mean_radps = 0.5 * (rate_radps + before_radps)
    turn_rad = wrapped_in_kernels(sensor_rad - before_rad)
    if math.isfinite(mean_radps) and dt_s <= GAP_S:
        heading.gyro_since_s = min(heading.gyro_since_s, before_s)
        heading.turned_rad += mean_radps * dt_s
        _stand(heading, errors, t_s, dt_s, sensor_rad, mean_radps - errors.value[BIAS])
        _turn_by_gyro(heading, errors, dt_s, mean_radps)
        _use_sensor(heading, field, errors, t_s, dt_s, sensor_rad, plain)
    else:
        heading.gyro_since_s, heading.standing = math.inf, False
        heading.turned_rad += turn_rad
        _turn_by_sensor(heading, errors, t_s, dt_s, turn_rad, mean_radps, plain)
    _pay(heading, errors, dt_s)
    return float(heading.told_rad)
