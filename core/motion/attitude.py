"""Attitude at a time, or none: a ring of orientations, interpolated, never guessed.

Refuses to bridge a gap: an instant is covered only where samples before and after it lie close
together. It is within reach, too, where the newest sample is no older than the next one may take to
come, and that sample's rate of turn carries it on: a scan need not wait for the sample behind it.
Roll and pitch are the level filter's, yaw is the heading filter's.
"""

import math

import numpy as np

from core.geometry import R_from_rpy, Rpy, q_from_R, q_from_rpy, q_product, rpy_from_q, rpy_of
from core.motion.heading import HeadingFilter
from core.motion.magnetic import Quaternion
from core.motion.tilt import TiltFilter
from core.records import F64, Attitude
from jit import kernel

KEPT = 512  # samples: 4 s and more at 120 Hz
MAX_GAP_S = 0.06  # between neighbours: up to five lost samples at 100 Hz
AHEAD_S = 0.019  # a sample at 100 Hz, its way over the line, and how late a last beam may be
MOST_RADPS = 100.0  # faster no body turns: it is as if no rate was delivered
Rates = tuple[float, float, float]  # about x, y, z, rad/s
UNIT = 1e-3  # how far a delivered quaternion may be from unit length


@kernel
def _index_before(t_s: F64, start: int, count: int, at_s: float) -> int:
    """The k-th oldest sample that is the last one at or before `at_s`, within 0..count - 2."""
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if t_s[(start + middle) % t_s.size] <= at_s:
            low = middle
        else:
            high = middle
    return low


@kernel
def q_at(t_s: F64, q: F64, start: int, count: int, at_s: float, out: F64) -> None:
    """Orientation at a covered instant, interpolated along the shorter arc, into `out` (4,)."""
    k = _index_before(t_s, start, count, at_s)
    a, b = (start + k) % t_s.size, (start + k + 1) % t_s.size
    share = (at_s - t_s[a]) / (t_s[b] - t_s[a])
    dot = 0.0
    for n in range(4):
        dot += q[a, n] * q[b, n]
    sign = 1.0 if dot >= 0 else -1.0
    norm = 0.0
    for n in range(4):
        out[n] = (1 - share) * q[a, n] + share * sign * q[b, n]
        norm += out[n] * out[n]
    for n in range(4):
        out[n] /= np.sqrt(norm)


@kernel
def _rpy_at(t_s: F64, q: F64, start: int, count: int, at_s: float) -> Rpy:
    """(roll, pitch, yaw) of the orientation at a covered instant."""
    at = np.empty(4)
    q_at(t_s, q, start, count, at_s, at)
    return rpy_of(at[0], at[1], at[2], at[3])


@kernel
def _body_from_sensor(
    q_earth_sensor: Quaternion, q_sensor_body: F64, rate_radps: Rates, R_body_sensor: F64
) -> tuple[float, Rpy, Rates]:
    """A sample in the body's axes: length of its quaternion, (roll, pitch, yaw), rates of turn.

    With a length that no orientation has, the others are zero.
    """
    w, x, y, z = q_earth_sensor
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1.0) <= UNIT:
        return length, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    q = q_product(np.array([w / length, x / length, y / length, z / length]), q_sensor_body)
    one, two, three = rate_radps
    R = R_body_sensor
    rates = (
        R[0, 0] * one + R[0, 1] * two + R[0, 2] * three,
        R[1, 0] * one + R[1, 1] * two + R[1, 2] * three,
        R[2, 0] * one + R[2, 1] * two + R[2, 2] * three,
    )
    return length, rpy_of(q[0], q[1], q[2], q[3]), rates


@kernel
def _put(q: F64, place: F64) -> None:
    """Copy an orientation (4,); an assignment of slices takes Numba two seconds to compile."""
    for k in range(4):
        place[k] = q[k]


@kernel
def _keep(q: F64, last: int, rpy: Rpy, rate_radps: Rates, for_s: float) -> None:
    """Put a sample into its place of `q` (KEPT, 4), and what it turns to in the one behind it.

    It turns on at a rate about its own axes for so long; not at one that is not known.
    """
    newest, ahead = q[last], q[(last + 1) % len(q)]
    _put(q_from_rpy(rpy[0], rpy[1], rpy[2]), newest)
    x, y, z = rate_radps
    if not math.isfinite(x + y + z):
        return
    angle = math.sqrt(x * x + y * y + z * z) * for_s
    share = 0.5 * for_s * (math.sin(angle / 2) / (angle / 2) if angle > 1e-9 else 1.0)
    turn = np.array([math.cos(angle / 2), share * x, share * y, share * z])
    _put(q_product(newest, turn), ahead)


class AttitudeRing:
    """The newest orientations of the body: `q_earth_body` (KEPT, 4) at host times `t_s` (KEPT,)."""

    def __init__(
        self,
        mount_roll_rad: float,
        mount_pitch_rad: float,
        mount_yaw_rad: float,
        *,
        levels: bool = False,
    ) -> None:
        R_body_sensor = R_from_rpy(mount_roll_rad, mount_pitch_rad, mount_yaw_rad)
        self._q_sensor_body = q_from_R(R_body_sensor.T)
        self._R_body_sensor = R_body_sensor
        self.t_s = np.zeros(KEPT)
        self.q_earth_body = np.zeros((KEPT, 4))
        self._turned_rad = np.zeros(KEPT)
        self.start = self.count = 0
        self.count_ahead = 0  # samples, and the place behind them where the newest is carried on
        self.heading = HeadingFilter()
        self.level = TiltFilter() if levels else None  # None: the sensor's angles as they are
        self.rate_body_radps: Rates = (0.0, 0.0, 0.0)  # newest; NaN where it is not delivered
        self.newest_s = -math.inf  # time of the newest sample; -inf when there is none
        self.rejected = 0  # samples out of order or no orientation at all
        self._newest_rpy: tuple[float, float, float] | None = 0.0, 0.0, 0.0  # None: to be found

    def add(self, attitude: Attitude) -> bool:
        """Take one sample; False (and counted) if it can't be true."""
        length, rpy_rad, rates = _body_from_sensor(
            attitude.q_earth_sensor, self._q_sensor_body, attitude.rate_radps, self._R_body_sensor
        )
        if not (abs(length - 1) <= UNIT and self.newest_s < attitude.t_s < math.inf):
            self.rejected += 1
            return False
        if self.count == KEPT - 1:  # one place is left for what is carried on
            self.start = (self.start + 1) % KEPT
        else:
            self.count += 1
        last = (self.start + self.count - 1) % KEPT
        x_radps, y_radps, z_radps = attitude.rate_radps
        if abs(x_radps) <= MOST_RADPS and abs(y_radps) <= MOST_RADPS and abs(z_radps) <= MOST_RADPS:
            self.rate_body_radps = rates
        else:
            self.rate_body_radps = (math.nan, math.nan, math.nan)
        t_s, rates = attitude.t_s, self.rate_body_radps
        yaw_rad = self.heading.step(t_s, rpy_rad, rates, attitude.q_earth_sensor, attitude.magnetic)
        roll_rad, pitch_rad = rpy_rad[:2]
        if self.level is not None:
            roll_rad, pitch_rad = self.level.step(
                t_s, roll_rad, pitch_rad, rates, stands=self.heading.standing
            )
        self.newest_s = self.t_s[last] = t_s
        self._turned_rad[last] = self.heading.turned_rad
        rpy_rad = (roll_rad, pitch_rad, yaw_rad)
        _keep(self.q_earth_body, last, rpy_rad, rates, AHEAD_S)
        self._newest_rpy, self.count_ahead = None, self.count
        if math.isfinite(rates[0]):  # all are, or none
            self.count_ahead += 1
            self.t_s[(last + 1) % KEPT] = t_s + AHEAD_S
        return True

    def turned_rad_at(self, at_s: float) -> float:
        """How far the gyro has turned about the vertical since the start, at a spanned instant.

        Its bias is in it; where no gyro was delivered, it is the sensor's own yaw.
        """
        k = _index_before(self.t_s, self.start, self.count, at_s)
        a, b = (self.start + k) % KEPT, (self.start + k + 1) % KEPT
        share = (at_s - float(self.t_s[a])) / float(self.t_s[b] - self.t_s[a])
        return float((1 - share) * self._turned_rad[a] + share * self._turned_rad[b])

    def turn_all(self, turn_rad: float) -> None:
        """Turn every kept orientation about the vertical: the heading was found to be off."""
        self._newest_rpy = None if self.count else self._newest_rpy
        turn = np.array([math.cos(0.5 * turn_rad), 0.0, 0.0, math.sin(0.5 * turn_rad)])
        for k in range(self.count_ahead):
            n = (self.start + k) % KEPT
            self.q_earth_body[n] = q_product(turn, self.q_earth_body[n])

    def reaches(self, from_s: float, to_s: float) -> bool:
        """True if from..to is covered, or would be with the newest sample carried on."""
        newest_s = self.newest_s
        if to_s <= newest_s:
            return self.covers(from_s, to_s)
        is_ahead = self.count_ahead > self.count and to_s <= newest_s + AHEAD_S
        return is_ahead and self.covers(min(from_s, newest_s), newest_s)

    def covers(self, from_s: float, to_s: float) -> bool:
        """True if every instant from..to lies between two samples that are close together."""
        if not self.spans(from_s, to_s):
            return False
        first = _index_before(self.t_s, self.start, self.count, from_s)
        last = _index_before(self.t_s, self.start, self.count, to_s)
        if self.t_s[(self.start + last) % KEPT] < to_s:
            last += 1
        times_s = self.t_s[(self.start + np.arange(first, last + 1)) % KEPT]
        return bool(np.diff(times_s).max(initial=0.0) <= MAX_GAP_S)

    def spans(self, from_s: float, to_s: float) -> bool:
        """True if from..to lies between the oldest and the newest sample, gaps or not."""
        return self.count > 1 and bool(self.t_s[self.start] <= from_s and to_s <= self.newest_s)

    def gap_s_at(self, at_s: float) -> float:
        """Time between the samples on either side of an instant; inf where it is not spanned."""
        if not self.spans(at_s, at_s):
            return math.inf
        k = self.start + _index_before(self.t_s, self.start, self.count, at_s)
        return float(self.t_s[(k + 1) % KEPT] - self.t_s[k % KEPT])

    def rpy_at(self, at_s: float) -> tuple[float, float, float]:
        """(roll, pitch, yaw) of the body in the earth frame at an instant within reach."""
        count = self.count if at_s <= self.newest_s else self.count_ahead
        return _rpy_at(self.t_s, self.q_earth_body, self.start, count, at_s)

    def newest_rpy(self) -> tuple[float, float, float]:
        """(roll, pitch, yaw) of the newest sample; level while there is none."""
        if self._newest_rpy is None:
            newest = self.q_earth_body[(self.start + self.count - 1) % KEPT]
            self._newest_rpy = rpy_from_q(newest)
        return self._newest_rpy
