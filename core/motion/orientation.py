"""The orientation of the body: the gyro's from sample to sample, and one error-state filter.

Told is a quaternion q, which takes body axes to earth's. The gyro turns it, less its bias b:

    q <- q exp((w - b) dt)                    w: mean of the sample's rate and the one before
    truth = exp(theta) q,   theta' = -R b + noise of the gyro

and ten times a second the filter hears what the sensor itself takes for its orientation, R_s. That
errs in four ways: it is askew on the body (c), it wanders (u), it leans by a share s of what it
feels of the robot's driving (l: `lean`), and its compass is off (`compass`). With v = R R_s' e_z,
the sensor's vertical as the told orientation sees it,

    (v_y, -v_x) = theta + u + s l + (R c)     about earth's x and y
    yaw_s - yaw = theta_z + offset
    w           = b                           at rest (`rest`)

How noisy gyro and sensor are is measured by how they jump from sample to sample. Until that is
known, for JUMPS_S, the compass does not count, and a tilt beyond its gate is begun anew. Without a
gyro, or with one that makes nothing but noise, the told tilt is the sensor's, less what is known of
its errors (`tilt`).

A tilt is corrected at once, the told yaw at OWED_RADPS: faster, a map is torn.
Source: core.motion.error_state; MTi sheet, section 7.
"""

import math

import numpy as np

from core.geometry import (
    Quaternion,
    Rates,
    Vector,
    matrix_of,
    q_of_turn,
    turned,
    wrapped_in_kernels,
)
from core.motion.compass import (
    COMPASS,
    SENSOR_RAD,
    begin_compass,
    is_believed,
    note_field,
    use_compass,
)
from core.motion.error_state import (
    BIAS,
    BIAS_Z,
    OFFSET,
    OFFSET_RAD,
    OFFSET_S,
    YAW,
    ErrorState,
    pass_time,
)
from core.motion.lean import LEAN, fade, note_speed
from core.motion.rest import REST, begin_rest, has_wheels, hold, set_out, use_rest, wheels_creep
from core.motion.tilt import (
    ALONE_S,
    ANGLE_RAD,
    JUMPS_S,
    begin_tilt,
    compare_tilt,
    doubt,
    is_bias_guessed,
    take_sensors_tilt,
    tell,
    told,
    turn_told,
    use_tilt,
    yaw_of,
)
from core.records import F64
from jit import Record, Records, kernel

STEP_S = 0.1  # of the filter: samples within it err alike
RATE_RADPS = math.radians(0.05)  # least noise of a sample's rate: sheet, in a band of 1 Hz
TURN_VAR = math.radians(0.2) ** 2 / (2 * math.pi)  # per rad turned: the gyro's scale and axes
PER_SIGMA = 2.0 / math.sqrt(math.pi)  # statistics: mean jump of normal noise
NOISE_RADPS = 0.06  # a gyro of more noise leads roll and pitch astray, half a degree in a second
GAP_S = 0.06  # a longer one between samples hides turns from the gyro
LONGEST_S = 10.0  # beyond it, nothing gets less sure than it is
GAP_RADPS = 0.3  # about how fast such a turn may be
OWED_RADPS = math.radians(1.0)  # the told yaw is corrected no faster

ORIENTATION = np.dtype(
    [
        ("q", np.float64, 4),  # told, earth's axes from the body's
        ("t_s", np.float64),  # of the newest sample, its rates (NaN: none) and the sensor's yaw
        ("rates", np.float64, 3),
        ("sensor_rad", np.float64),
        ("turned_rad", np.float64),  # by the gyro about body z, bias and all
        ("gyro_since_s", np.float64),  # since when it tells, without a gap
        ("alone_until_s", np.float64),  # so long it is not believed
        ("jump_radps", np.float64),  # of its rates from sample to sample, mean
        ("angle_var", np.float64),  # rad2, noise of the sensor's own angles, by their jumps
        ("off_rad", np.float64, 2),  # the sensor's tilt less the told one, in the newest sample,
        ("apart_rad", np.float64, 2),  # and without what is known of it, over a while
        ("beyond_s", np.float64),  # so long it was beyond the gate
        ("doubted", np.int64),  # how often gyro and angles did not agree
        ("step_s", np.float64),  # since the filter's last step: time,
        ("samples", np.int64),  # samples,
        ("off_sums", np.float64, 3),  # sums of the sensor's tilt and yaw less ours,
        ("rate_sums", np.float64, 3),
        ("angle_rad", np.float64),  # how far it turned, either way,
        ("base_rad", np.float64),  # and the first yaw of that sum
        ("lean", LEAN),
        ("rest", REST),
        ("compass", COMPASS),
    ],
    align=True,
)


class OrientationFilter:
    """What `orientation_step` knows; the first sample's yaw is its zero error.

    Args:
        record: (1,) of ORIENTATION, all zero.
    """

    def __init__(self, record: Records, state: ErrorState) -> None:
        self.record, self.state = record, state
        state.P[OFFSET, OFFSET] = SENSOR_RAD**2
        record["q"] = (1.0, 0.0, 0.0, 0.0)
        record["rates"] = math.nan
        record["t_s"] = record["alone_until_s"] = -math.inf
        record["gyro_since_s"] = math.inf
        begin_compass(record["compass"])
        begin_rest(record["rest"])

    @property
    def bias_radps(self) -> F64:
        """(3,) of the gyro's rates about the body's axes, as estimated."""
        return self.state.value[BIAS : BIAS + 3]

    @property
    def trusted(self) -> bool:
        """Whether the sensor's own yaw counts just now."""
        return bool(self.record["compass"]["trusted"][0])

    @property
    def standing(self) -> bool:
        return bool(self.record["rest"]["standing"][0])

    @property
    def disturbed(self) -> int:
        """How often the sensor's yaw was found not to be believed."""
        return int(self.record["compass"]["disturbed"][0])

    @property
    def adopted(self) -> int:
        """How often a new usual offset was taken."""
        return int(self.record["compass"]["adopted"][0])

    @property
    def doubted(self) -> int:
        """How often gyro and angles did not agree."""
        return int(self.record["doubted"][0])

    def note_wheels(
        self, from_s: float, to_s: float, turn_rad: float, round_rad: float, *, moved: bool
    ) -> None:
        """What the wheels did in an interval, before the attitudes of it are all used.

        round_rad: by a count. moved: by more than a wheel that rests on an edge counts.
        """
        _note_wheels(self.record, from_s, to_s, turn_rad, round_rad, moved)

    def note_speed(self, dt_s: float, v_mps: float, yaw_rad: float) -> None:
        """The wheels went at such a speed along such a yaw, for so long."""
        note_speed(self.record["lean"], dt_s, v_mps, yaw_rad)

    def pay_all(self) -> float:
        """Tell the estimated yaw at once; returns the jump (rad)."""
        return _pay_all(self.record, self.state.value)


@kernel
def _note_wheels(
    all_of: Records, from_s: float, to_s: float, turn_rad: float, round_rad: float, moved: bool
) -> None:
    of = all_of[0]
    turn_told(of, 0.0, 0.0, wheels_creep(of.rest, from_s, to_s, turn_rad, round_rad, moved))


@kernel
def _pay_all(all_of: Records, value: F64) -> float:
    owed_rad = float(value[YAW])
    value[YAW] = 0.0
    turn_told(all_of[0], 0.0, 0.0, owed_rad)
    return owed_rad


# From sample to sample


@kernel
def _note_jumps(of: Record, t_s: float, dt_s: float, rates: Rates) -> None:
    """How much the gyro jumps; one that only makes noise is not believed."""
    jump = abs(rates[0] - of.rates[0]) + abs(rates[1] - of.rates[1]) + abs(rates[2] - of.rates[2])
    of.jump_radps += min(1.0, dt_s / JUMPS_S) * (jump / 3.0 - of.jump_radps)
    if of.jump_radps / PER_SIGMA > NOISE_RADPS:
        of.doubted += t_s >= of.alone_until_s
        of.alone_until_s = t_s + ALONE_S


@kernel
def _rate_var(of: Record) -> float:
    """Variance of a sample's rate, as it jumps."""
    noise_radps = max(RATE_RADPS, of.jump_radps / PER_SIGMA)
    return float(noise_radps * noise_radps)


@kernel
def _pay(errors: Record, dt_s: float) -> float:
    """What is paid of the yaw that is owed."""
    most_rad = OWED_RADPS * dt_s
    paid_rad = max(-most_rad, min(most_rad, errors.value[YAW]))
    errors.value[YAW] -= paid_rad
    return float(paid_rad)


@kernel
def _turn_by_gyro(of: Record, errors: Record, dt_s: float, w: Vector) -> None:
    """The told orientation goes on by the rates, less their bias; its yaw not while it stands."""
    b, q = errors.value, told(of)
    x, y, z = dt_s * (w[0] - b[BIAS]), dt_s * (w[1] - b[BIAS + 1]), dt_s * (w[2] - b[BIAS_Z])
    of.turned_rad += w[2] * dt_s
    of.angle_rad += math.sqrt(x * x + y * y + z * z)
    up = matrix_of(q)[2]
    about_up = up[0] * x + up[1] * y + up[2] * z
    held_rad = hold(of.rest, dt_s, about_up, _rate_var(of) + errors.P[BIAS_Z, BIAS_Z])
    tell(of, turned(q, q_of_turn(x, y, z)))
    turn_told(of, 0.0, 0.0, held_rad - about_up + _pay(errors, dt_s))


@kernel
def _add_up(of: Record, errors: Record, dt_s: float, sensor_rad: float, w: Vector) -> None:
    """Add to the sums of a step."""
    off_rad = sensor_rad - yaw_of(told(of)) - errors.value[YAW]
    if of.samples == 0:
        of.base_rad, of.step_s = off_rad, 0.0
        for k in range(3):
            of.off_sums[k] = of.rate_sums[k] = 0.0
    of.off_sums[2] += wrapped_in_kernels(off_rad - of.base_rad)
    for k in range(2):
        of.off_sums[k] += of.off_rad[k]
    for k in range(3):
        of.rate_sums[k] += w[k]
    of.samples += 1
    of.step_s += dt_s


@kernel
def _turn_by_sensor(of: Record, errors: Record, t_s: float, dt_s: float, sensor_rad: float) -> None:
    """No gyro, or a gap in it: the sensor's turn, or the wheels' where its compass is disturbed."""
    turn_rad, var = wrapped_in_kernels(sensor_rad - of.sensor_rad), (GAP_RADPS * dt_s) ** 2
    if is_believed(of.compass, errors, t_s):
        var = 2 * OFFSET_RAD**2 / OFFSET_S * dt_s
    elif has_wheels(of.rest, t_s):
        turn_rad = of.rest.wheel_radps * dt_s
    pass_time(errors.P, errors.value, matrix_of(told(of)), dt_s, 0.0, True)
    errors.P[YAW, YAW] += var
    turn_told(of, 0.0, 0.0, set_out(of.rest) + turn_rad + _pay(errors, dt_s))


# The filter


@kernel
def _step(of: Record, errors: Record, t_s: float, q_sensor: Quaternion) -> None:
    """One step of the filter, over the samples since the one before."""
    dt_s, n, R, rate_var = of.step_s, of.samples, matrix_of(told(of)), _rate_var(of)
    turn_var = rate_var / n * dt_s * dt_s + TURN_VAR * of.angle_rad
    pass_time(errors.P, errors.value, R, dt_s, turn_var, of.rest.standing)
    turn_rad = use_rest(of.rest, errors, t_s, dt_s, n, of.rate_sums, rate_var)
    angle_var, off_rad = of.angle_var / n, of.base_rad + of.off_sums[2] / n
    begins = t_s - of.gyro_since_s < JUMPS_S  # nobody knows yet how noisy the sensor is
    if not begins:
        use_compass(of.compass, errors, t_s, dt_s, off_rad, angle_var, of.rest.standing)
    if t_s >= of.alone_until_s:
        tilt_rad = (of.off_sums[0] / n, of.off_sums[1] / n)
        good = use_tilt(of, errors, R, tilt_rad, dt_s, max(ANGLE_RAD**2, angle_var))
        of.beyond_s = 0.0 if good else of.beyond_s + dt_s
        if not good and (begins or is_bias_guessed(errors.P)):
            begin_tilt(of, errors, q_sensor)
        doubt(of, errors, t_s, q_sensor)
    turn_told(of, 0.0, 0.0, turn_rad)
    of.samples, of.angle_rad = 0, 0.0


@kernel
def orientation_step(
    of: Record,
    errors: Record,
    t_s: float,
    q_sensor: Quaternion,
    rates: Rates,
    magnetic: Vector,
    has_magnetic: bool,
) -> None:
    """Take a sample, which must be later than the one before, into `of.q`.

    Args:
        of, errors: an ORIENTATION and ERRORS.
        q_sensor: the body's orientation as the sensor has it.
        rates: about the body's axes; NaN where they are not delivered.
        magnetic: field along the body's axes, 1 = the field at calibration.
    """
    b, before_s, sensor_rad = of.rates, of.t_s, yaw_of(q_sensor)
    is_first = before_s == -math.inf
    dt_s = 0.0 if is_first else min(t_s - before_s, LONGEST_S)
    w = (0.5 * (rates[0] + b[0]), 0.5 * (rates[1] + b[1]), 0.5 * (rates[2] + b[2]))
    known = math.isfinite(w[0] + w[1] + w[2]) and dt_s <= GAP_S
    fade(of.lean, dt_s)
    if has_magnetic:  # without a field, there is nothing to judge by
        note_field(of.compass, dt_s, told(of) if not is_first else q_sensor, magnetic)
    if is_first:
        tell(of, q_sensor)
    elif known:
        of.gyro_since_s = min(of.gyro_since_s, before_s)
        _note_jumps(of, t_s, dt_s, rates)
        _turn_by_gyro(of, errors, dt_s, w)
        compare_tilt(of, dt_s, q_sensor)
    else:
        of.gyro_since_s, of.samples = math.inf, 0
        _turn_by_sensor(of, errors, t_s, dt_s, sensor_rad)
    if not known or t_s < of.alone_until_s:
        take_sensors_tilt(of, errors, q_sensor)
    if known:
        _add_up(of, errors, dt_s, sensor_rad, w)
        if of.step_s > STEP_S - 0.5 * dt_s:
            _step(of, errors, t_s, q_sensor)
    of.t_s, of.sensor_rad = t_s, sensor_rad
    for k in range(3):
        of.rates[k] = rates[k]
