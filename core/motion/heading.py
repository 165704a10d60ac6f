"""The yaw of the body: gyro first, the sensor's own (magnetic) heading where it can be believed.

Yaw follows the gyro, less its bias; the sensor's own yaw draws it back slowly, for as long as the
magnetic field looks as it did and that yaw moves as the gyro says. After a disturbance it has to
behave for a while before it counts again. While the wheels stand and the gyro is quiet, the yaw
stands, and the gyro tells its bias.
Source: design, section 5; for the estimates, core.motion.error_state.
"""

import math
from collections.abc import Sequence

import numpy as np

from core.geometry import wrapped
from core.motion.error_state import BIAS, OFFSET, SIZE, YAW, ErrorState
from core.motion.magnetic import FieldReference, Quaternion, Vector
from core.records import F64

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
Rates = Sequence[float] | F64


def yaw_rate(roll_rad: float, pitch_rad: float, rate_body_radps: Rates) -> float:
    """How fast yaw grows (rad/s) at a rate of turn (3,) about the body's axes; NaN: not known."""
    cos_pitch = math.cos(pitch_rad)
    if cos_pitch < LEAST_COS:
        return math.nan
    about_y, about_z = float(rate_body_radps[1]), float(rate_body_radps[2])
    return (about_y * math.sin(roll_rad) + about_z * math.cos(roll_rad)) / cos_pitch


UNIT = np.eye(SIZE)
H_SENSOR, H_BIAS = UNIT[YAW] + UNIT[OFFSET], UNIT[BIAS]  # what is observed, (10,)


class HeadingFilter:
    """Yaw (rad) at each sample of the attitude sensor; the first sample's yaw is its zero error."""

    def __init__(self) -> None:
        self.state = ErrorState()
        self.state.P[OFFSET, OFFSET] = SENSOR_RAD**2
        self.field = FieldReference()
        self.told_rad = 0.0  # unwrapped
        self.gyro_since_s = math.inf  # since when `turned_rad` has been the gyro's, without a gap
        self.turned_rad = 0.0  # integrated rate, bias and all; the sensor's turn where none is
        self.trusted = True  # whether the sensor's own yaw counts just now
        self.standing = False
        self.disturbed = 0  # how often its yaw was found not to be believed
        self.adopted = 0  # how often a new usual offset was taken
        self._usual_rad = 0.0  # offset of the sensor's yaw that counts as none
        self._t_s, self._rate_radps, self._sensor_rad = -math.inf, math.nan, 0.0
        self._trust_from_s = -math.inf
        self._steady_rad, self._steady_from_s = 0.0, math.inf
        self._wheels_still_s, self._wheels_s, self._wheel_radps = math.inf, -math.inf, 0.0
        self._calm_rad = self._held_rad = self._stood_at_rad = 0.0

    @property
    def yaw_rad(self) -> float:
        """The best estimate, which the told yaw is on its way to."""
        return self.told_rad + float(self.state.value[YAW])

    @property
    def bias_radps(self) -> float:
        """Of the gyro's rate about the vertical, as estimated."""
        return float(self.state.value[BIAS])

    def note_wheels(self, from_s: float, to_s: float, turn_rad: float, *, moved: bool) -> None:
        """What the wheels did in an interval, before the attitudes of it are all used."""
        self._wheels_s = to_s
        self._wheel_radps = turn_rad / (to_s - from_s)
        if moved:
            self._wheels_still_s = math.inf
        elif self._wheels_still_s == math.inf:
            self._wheels_still_s = from_s

    def step(
        self,
        t_s: float,
        rpy_rad: tuple[float, float, float],
        rate_body_radps: Rates,
        q_earth_sensor: Quaternion = (1.0, 0.0, 0.0, 0.0),
        magnetic: Vector | None = None,
    ) -> float:
        """The yaw to be told (rad) at a sample, which must be later than the one before.

        Args:
            rpy_rad: roll, pitch and yaw of the body as the sensor has them.
            rate_body_radps: (3,), NaN where it is not delivered.
            q_earth_sensor: the sensor's own, which `magnetic` is turned level by.
            magnetic: field in the sensor's axes, 1 = the field at calibration; None: not delivered.
        """
        roll_rad, pitch_rad, sensor_rad = rpy_rad
        rate_radps = yaw_rate(roll_rad, pitch_rad, rate_body_radps)
        dt_s = t_s - self._t_s
        if self._t_s == -math.inf:
            self.field.is_plain(0.0, q_earth_sensor, magnetic, agrees=True)
            self.told_rad = sensor_rad
        else:
            dt_s = min(dt_s, LONGEST_S)
            plain = self.field.is_plain(dt_s, q_earth_sensor, magnetic, agrees=self.trusted)
            self._go_on(t_s, dt_s, sensor_rad, rate_radps, plain)
        self._t_s, self._rate_radps, self._sensor_rad = t_s, rate_radps, sensor_rad
        return self.told_rad

    def _go_on(
        self, t_s: float, dt_s: float, sensor_rad: float, rate_radps: float, plain: bool
    ) -> None:
        mean_radps = 0.5 * (rate_radps + self._rate_radps)
        sensor_turn_rad = wrapped(sensor_rad - self._sensor_rad)
        has_gyro = math.isfinite(mean_radps) and dt_s <= GAP_S
        if has_gyro:
            self.gyro_since_s = min(self.gyro_since_s, self._t_s)
            self.turned_rad += mean_radps * dt_s
            self._stand(t_s, dt_s, sensor_rad, mean_radps)
            self._turn_by_gyro(dt_s, mean_radps)
            self._use_sensor(t_s, dt_s, sensor_rad, plain)
        else:
            self.gyro_since_s, self.standing = math.inf, False
            self.turned_rad += sensor_turn_rad
            self._turn_by_sensor(t_s, dt_s, sensor_turn_rad, mean_radps, plain)
        self._pay(dt_s)

    def _turn_by_gyro(self, dt_s: float, mean_radps: float) -> None:
        turn_rad = (mean_radps - self.bias_radps) * dt_s
        if self.standing:
            self._held_rad += turn_rad - self._held_rad * dt_s / CALM_S
            self._pass_time(dt_s, 0.0, turns=False)
            self.state.correct(H_BIAS, mean_radps - self.bias_radps, RATE_RADPS**2)
            return
        self.told_rad += turn_rad
        self._pass_time(dt_s, GYRO_VAR * dt_s + GYRO_TURN_VAR * abs(turn_rad))

    def _turn_by_sensor(
        self, t_s: float, dt_s: float, turn_rad: float, mean_radps: float, plain: bool
    ) -> None:
        """No gyro, or a gap in it: the sensor's turn, or the wheels' where that is disturbed."""
        believed = plain and self.trusted
        if believed:
            self.told_rad += turn_rad
            self._pass_time(dt_s, 2 * OFFSET_RAD**2 / OFFSET_S * dt_s, turns=False)
            return
        if not plain:
            self._distrust(t_s)
        elif t_s >= self._trust_from_s:
            self.trusted = True
        if t_s - self._wheels_s <= WHEELS_S:
            self.told_rad += self._wheel_radps * dt_s
        elif math.isfinite(mean_radps):
            self.told_rad += (mean_radps - self.bias_radps) * min(dt_s, WHEELS_S)
        else:
            self.told_rad += turn_rad
        self._pass_time(dt_s, (GAP_RADPS * dt_s) ** 2, turns=False)

    def _pass_time(self, dt_s: float, yaw_var: float, *, turns: bool = True) -> None:
        """`turns`: the yaw was moved by the gyro less its bias, so its error grows with that's."""
        kept = math.exp(-dt_s / OFFSET_S)
        offset_var = OFFSET_RAD**2 * (1 - kept * kept)
        self.state.turn(dt_s if turns else 0.0, yaw_var, BIAS_VAR * dt_s, kept, offset_var)

    def _pay(self, dt_s: float) -> None:
        """Bring what is owed to the told yaw, but not so fast that a map is torn."""
        owed_rad, most_rad = float(self.state.value[YAW]), OWED_RADPS * dt_s
        paid_rad = max(-most_rad, min(most_rad, owed_rad))
        self.told_rad += paid_rad
        self.state.value[YAW] -= paid_rad

    def pay_all(self) -> float:
        """Tell the estimate at once; returns the jump (rad)."""
        owed_rad = float(self.state.value[YAW])
        self.told_rad += owed_rad
        self.state.value[YAW] = 0.0
        return owed_rad

    # Standing still

    def _stand(self, t_s: float, dt_s: float, sensor_rad: float, mean_radps: float) -> None:
        """Find out whether the body stands: wheels without a count, a quiet gyro."""
        excess_radps = mean_radps - self.bias_radps
        unsure_radps = GATE * math.sqrt(float(self.state.P[BIAS, BIAS]))
        self._calm_rad += excess_radps * dt_s - self._calm_rad * dt_s / CALM_S
        # the first is never true while they move: then it is minus infinity
        wheels_stand = t_s - self._wheels_still_s >= STILL_S and t_s - self._wheels_s <= WHEELS_S
        if self._wheels_still_s == math.inf:
            self._calm_rad = 0.0
        quiet = (
            abs(excess_radps) <= SUDDEN_RADPS + unsure_radps
            and abs(self._calm_rad) <= CALM_RAD + CALM_S * unsure_radps
            and (
                not self.standing
                or not self.trusted
                or abs(wrapped(sensor_rad - self._stood_at_rad)) <= OFFSET_RAD
            )
        )
        stands = wheels_stand and quiet
        if stands and not self.standing:
            self._held_rad, self._stood_at_rad = 0.0, sensor_rad
        if self.standing and not stands:
            self.told_rad += self._held_rad  # the turn had begun before it was noticed
        self.standing = stands

    # The sensor's own yaw

    def _use_sensor(self, t_s: float, dt_s: float, sensor_rad: float, plain: bool) -> None:
        """Correct by it, where nothing speaks against it."""
        off_rad = wrapped(sensor_rad - self.yaw_rad - self._usual_rad)
        innovation_rad = off_rad - float(self.state.value[OFFSET])
        spread = self.state.spread_of_sum(YAW, OFFSET) + SENSOR_RAD**2
        fits = (
            plain
            and innovation_rad**2 <= GATE**2 * spread
            and abs(float(self.state.value[OFFSET])) <= MOST_OFFSET_RAD
        )
        if not fits:
            self._distrust(t_s)
            self._look_for_offset(t_s, dt_s, wrapped(sensor_rad - self.yaw_rad))
            return
        self.trusted = t_s >= self._trust_from_s
        if self.trusted and not self.standing:
            self._steady_from_s = math.inf
            self.state.correct(H_SENSOR, innovation_rad, SENSOR_RAD**2 * max(1.0, SENSOR_S / dt_s))

    def _distrust(self, t_s: float) -> None:
        if self.trusted:
            self.disturbed += 1
            self.state.forget(OFFSET, OFFSET_RAD**2)
            self.state.value[OFFSET] = 0.0
        self.trusted, self._trust_from_s = False, t_s + HOLD_S

    def _look_for_offset(self, t_s: float, dt_s: float, off_rad: float) -> None:
        """Its yaw is off for long, but moves as the gyro says: then it is off by a constant."""
        state = self.state
        first_rad = GATE * math.sqrt(float(state.P[YAW, YAW]) + OFFSET_RAD**2 + SENSOR_RAD**2)
        if self._usual_rad != 0.0 and abs(off_rad) <= first_rad:
            self._usual_rad = 0.0  # as it was at the start
            return
        if self.standing:
            self._steady_from_s += dt_s  # nothing is learnt about a place by standing there
        if not abs(wrapped(off_rad - self._steady_rad)) <= ADOPT_RAD or math.isinf(
            self._steady_from_s
        ):
            self._steady_rad, self._steady_from_s = off_rad, t_s
        if t_s - self._steady_from_s >= ADOPT_S:
            self._usual_rad, self._steady_from_s = off_rad, math.inf
            state.define(OFFSET, YAW, -1.0, OFFSET_RAD**2)
            state.value[OFFSET] = 0.0
            self.field.adopt()
            self._trust_from_s = t_s
            self.adopted += 1
