"""Attitude at a time, or none: a ring of orientations, interpolated, never guessed.

Refuses to bridge a gap: an instant is covered only where samples before and after it lie close
together. It is within reach, too, where the newest sample is no older than the next one may take to
come, and that sample's rate of turn carries it on: a scan need not wait for the sample behind it.
Roll and pitch are the level filter's, yaw is the heading filter's.
"""

import math

import numpy as np

from core.geometry import R_from_rpy, q_from_R, q_from_rpy, q_product, rpy_from_q
from core.heading import HeadingFilter
from core.jit import kernel
from core.level import LevelFilter
from core.records import F64, Attitude

KEPT = 512  # samples: 4 s and more at 120 Hz
MAX_GAP_S = 0.06  # between neighbours: up to five lost samples at 100 Hz
AHEAD_S = 0.019  # a sample at 100 Hz, its way over the line, and how late a last beam may be
MOST_RADPS = 100.0  # faster no body turns: it is as if no rate was delivered
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


def _carried_on(q: F64, rate_radps: F64, for_s: float) -> F64:
    """An orientation (4,) that turns on at a rate (3,) about its own axes for so long."""
    angle_rad = math.sqrt(rate_radps.dot(rate_radps)) * for_s
    share = 0.5 * for_s * (math.sin(angle_rad / 2) / (angle_rad / 2) if angle_rad > 1e-9 else 1.0)
    x_radps, y_radps, z_radps = rate_radps.tolist()
    turn = (math.cos(angle_rad / 2), share * x_radps, share * y_radps, share * z_radps)
    return q_product(q, np.array(turn))


def _turned(turn_rad: float, q: F64) -> F64:
    """An orientation (4,), turned about the vertical."""
    half_rad = 0.5 * turn_rad
    return q_product(np.array([math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)]), q)


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
        self.level = LevelFilter() if levels else None  # None: the sensor's angles as they are
        self.rate_body_radps = np.zeros(3)  # newest; NaN where the sensor does not deliver it
        self.rejected = 0  # samples out of order or no orientation at all
        self._newest_rpy: tuple[float, float, float] | None = 0.0, 0.0, 0.0  # None: to be found

    @property
    def newest_s(self) -> float:
        """Time of the newest sample; -inf when there is none."""
        last = (self.start + self.count - 1) % KEPT
        return float(self.t_s[last]) if self.count else float("-inf")

    def add(self, attitude: Attitude) -> bool:
        """Take one sample; False (and counted) if it can't be true."""
        q_earth_sensor = np.array(attitude.q_earth_sensor)
        length = math.sqrt(q_earth_sensor.dot(q_earth_sensor))
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
            self.rate_body_radps = self._R_body_sensor @ np.array(attitude.rate_radps)
        else:
            self.rate_body_radps = np.full(3, math.nan)
        q = q_product(q_earth_sensor / length, self._q_sensor_body)
        rpy_rad = rpy_from_q(q)
        yaw_rad = self.heading.step(
            attitude.t_s,
            rpy_rad,
            self.rate_body_radps,
            attitude.q_earth_sensor,
            attitude.magnetic,
        )
        roll_rad, pitch_rad = rpy_rad[:2]
        if self.level is not None:
            roll_rad, pitch_rad = self.level.step(
                attitude.t_s,
                roll_rad,
                pitch_rad,
                self.rate_body_radps,
                stands=self.heading.standing,
            )
        self.t_s[last] = attitude.t_s
        self._turned_rad[last] = self.heading.turned_rad
        self.q_earth_body[last] = q_from_rpy(roll_rad, pitch_rad, yaw_rad)
        self._newest_rpy = None
        self._carry_on(last)
        return True

    def _carry_on(self, last: int) -> None:
        """Put the orientation that the newest sample turns to into the place behind it."""
        ahead = (last + 1) % KEPT
        self.count_ahead = self.count
        if all(map(math.isfinite, self.rate_body_radps.tolist())):
            self.count_ahead += 1
            self.t_s[ahead] = self.t_s[last] + AHEAD_S
            self.q_earth_body[ahead] = _carried_on(
                self.q_earth_body[last], self.rate_body_radps, AHEAD_S
            )

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
        for k in range(self.count_ahead):
            n = (self.start + k) % KEPT
            self.q_earth_body[n] = _turned(turn_rad, self.q_earth_body[n])

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
            return float("inf")
        k = self.start + _index_before(self.t_s, self.start, self.count, at_s)
        return float(self.t_s[(k + 1) % KEPT] - self.t_s[k % KEPT])

    def rpy_at(self, at_s: float) -> tuple[float, float, float]:
        """(roll, pitch, yaw) of the body in the earth frame at an instant within reach."""
        q = np.empty(4)
        count = self.count if at_s <= self.newest_s else self.count_ahead
        q_at(self.t_s, self.q_earth_body, self.start, count, at_s, q)
        return rpy_from_q(q)

    def newest_rpy(self) -> tuple[float, float, float]:
        """(roll, pitch, yaw) of the newest sample; level while there is none."""
        if self._newest_rpy is None:
            newest = self.q_earth_body[(self.start + self.count - 1) % KEPT]
            self._newest_rpy = rpy_from_q(newest)
        return self._newest_rpy
