"""Attitude at a time, or none: a ring of orientations, interpolated, never guessed.

Refuses to bridge a gap: an instant is covered only where samples before and after it lie close
together. It is within reach, too, where the newest sample is no older than the next one may take to
come, and that sample's rate of turn carries it on: a scan need not wait for the sample behind it.
The orientations are those of `core.motion.orientation`.
"""

import math

import numpy as np

from core.geometry import (
    Quaternion,
    R_from_rpy,
    Rates,
    Rpy,
    Vector,
    q_from_R,
    q_of_turn,
    rpy_from_q,
    rpy_of,
    turned,
)
from core.motion.error_state import ERRORS, ErrorState
from core.motion.orientation import ORIENTATION, OrientationFilter, orientation_step
from core.records import F64, Attitude
from jit import Record, Records, allocating_kernel, kernel, records

KEPT = 1024  # samples, 8 s and more at 120 Hz: as long as a controller may have been away
MAX_GAP_S = 0.06  # between neighbours: up to five lost samples at 100 Hz
AHEAD_S = 0.019  # a sample at 100 Hz, its way over the line, and how late a last beam may be
MOST_RADPS = 100.0  # faster no body turns: it is as if no rate was delivered
NO_FIELD: Vector = (0.0, 0.0, 0.0)
LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)
NO_RATES: Rates = (math.nan, math.nan, math.nan)
UNIT = 1e-3  # how far a delivered quaternion may be from unit length

MOTION = np.dtype(  # all that a sample changes, so that a kernel is given one thing
    [
        ("t_s", np.float64, KEPT),
        ("q_earth_body", np.float64, (KEPT, 4)),
        ("turned_rad", np.float64, KEPT),  # by the gyro about body z, bias and all
        ("q_sensor_body", np.float64, 4),  # how the sensor is mounted
        ("R_body_sensor", np.float64, (3, 3)),
        ("orientation", ORIENTATION),
        ("errors", ERRORS),
    ],
    align=True,
)


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
    k = start + _index_before(t_s, start, count, at_s)
    a, b = k % t_s.size, (k + 1) % t_s.size
    share = (at_s - t_s[a]) / (t_s[b] - t_s[a])
    dot = 0.0
    for n in range(4):
        dot += q[a, n] * q[b, n]
    sign = 1.0 if dot >= 0 else -1.0
    norm = 0.0
    for n in range(4):
        out[n] = (1 - share) * q[a, n] + share * sign * q[b, n]
        norm += out[n] * out[n]
    norm = math.sqrt(norm)
    for n in range(4):
        out[n] /= norm


@allocating_kernel
def _rpy_at(t_s: F64, q: F64, start: int, count: int, at_s: float) -> Rpy:
    """(roll, pitch, yaw) of the orientation at a covered instant."""
    at = np.empty(4)
    q_at(t_s, q, start, count, at_s, at)
    return rpy_of(at[0], at[1], at[2], at[3])


@kernel
def in_body(v: Vector, R: F64) -> Vector:
    """A vector along the sensor's axes in the body's; R: R_body_sensor (3, 3)."""
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@kernel
def _body_from_sensor(
    q_earth_sensor: Quaternion, q_sensor_body: F64, rate_radps: Rates, R_body_sensor: F64
) -> tuple[float, Quaternion, Rates]:
    """A sample in the body's axes: length of its quaternion, orientation, rates of turn.

    With a length that no orientation has, it is level; rates that no body has are NaN.
    """
    w, x, y, z = q_earth_sensor
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1.0) <= UNIT:
        return length, LEVEL, NO_RATES
    q = turned(
        (w / length, x / length, y / length, z / length),
        (q_sensor_body[0], q_sensor_body[1], q_sensor_body[2], q_sensor_body[3]),
    )
    one, two, three = rate_radps
    if not (abs(one) <= MOST_RADPS and abs(two) <= MOST_RADPS and abs(three) <= MOST_RADPS):
        return length, q, NO_RATES
    return length, q, in_body(rate_radps, R_body_sensor)


@kernel
def _put(q: Quaternion, place: F64) -> None:
    place[0], place[1], place[2], place[3] = q[0], q[1], q[2], q[3]


@kernel
def _take(
    motions: Records,
    last: int,
    levels: bool,
    newest_s: float,
    t_s: float,
    q_earth_sensor: Quaternion,
    rate_radps: Rates,
    magnetic: Vector,
    has_magnetic: bool,
) -> tuple[int, Rpy, Rates]:
    """One sample through the filter, into place `last` of the ring, and carried on behind it.

    Args:
        motions: (1,) of MOTION.
        levels: roll and pitch are the filter's, not the sensor's.
        newest_s: time of the sample before.

    Returns:
        How many places it has taken: none where it can't be true, one where no rate carries it on;
        then roll, pitch and yaw as told, and the rates about the body's axes.
    """
    motion = motions[0]
    length, q_sensor, rates = _body_from_sensor(
        q_earth_sensor, motion.q_sensor_body, rate_radps, motion.R_body_sensor
    )
    if not (abs(length - 1) <= UNIT and newest_s < t_s < math.inf):
        return 0, rpy_of(q_sensor[0], q_sensor[1], q_sensor[2], q_sensor[3]), rates
    of, field = motion.orientation, in_body(magnetic, motion.R_body_sensor)
    orientation_step(of, motion.errors, t_s, q_sensor, rates, field, has_magnetic)
    q = (of.q[0], of.q[1], of.q[2], of.q[3])
    told_rad = rpy_of(q[0], q[1], q[2], q[3])
    if not levels:
        roll_rad, pitch_rad, yaw_rad = rpy_of(q_sensor[0], q_sensor[1], q_sensor[2], q_sensor[3])
        q = turned(q_of_turn(0.0, 0.0, told_rad[2] - yaw_rad), q_sensor)
        told_rad = (roll_rad, pitch_rad, told_rad[2])
    motion.t_s[last], motion.turned_rad[last] = t_s, of.turned_rad
    _put(q, motion.q_earth_body[last])
    x, y, z = rates
    if not math.isfinite(x):  # all are, or none
        return 1, told_rad, rates
    ahead = (last + 1) % KEPT
    motion.t_s[ahead] = t_s + AHEAD_S
    _put(turned(q, q_of_turn(AHEAD_S * x, AHEAD_S * y, AHEAD_S * z)), motion.q_earth_body[ahead])
    return 2, told_rad, rates


@kernel
def _turn_all(q_earth_body: F64, start: int, count: int, turn_rad: float) -> None:
    """Turn so many kept orientations about the vertical."""
    turn = q_of_turn(0.0, 0.0, turn_rad)
    for k in range(count):
        q = q_earth_body[(start + k) % KEPT]
        _put(turned(turn, (q[0], q[1], q[2], q[3])), q)


@kernel
def _is_close(t_s: F64, start: int, count: int, from_s: float, to_s: float) -> bool:
    """Whether a spanned from..to lies between samples that are close together throughout."""
    k = _index_before(t_s, start, count, from_s)
    while True:
        before_s, after_s = t_s[(start + k) % KEPT], t_s[(start + k + 1) % KEPT]
        if before_s >= to_s:
            return True
        if not after_s - before_s <= MAX_GAP_S:
            return False
        k += 1


@kernel
def _turned_at(motion: Record, start: int, count: int, at_s: float) -> float:
    """How far the gyro has turned about body z since the start, at a spanned instant."""
    k = _index_before(motion.t_s, start, count, at_s)
    a, b = (start + k) % KEPT, (start + k + 1) % KEPT
    share = (at_s - motion.t_s[a]) / (motion.t_s[b] - motion.t_s[a])
    return float((1 - share) * motion.turned_rad[a] + share * motion.turned_rad[b])


@kernel
def _between(
    motions: Records, start: int, count: int, from_s: float, to_s: float
) -> tuple[float, float, float, float]:
    """As `AttitudeRing.between`."""
    motion = motions[0]
    t_s, oldest_s, newest_s = motion.t_s, motion.t_s[start], motion.t_s[(start + count - 1) % KEPT]
    middle_s = 0.5 * (from_s + to_s)
    gap_s = math.inf
    if oldest_s <= middle_s <= newest_s:
        k = start + _index_before(t_s, start, count, middle_s)
        gap_s = t_s[(k + 1) % KEPT] - t_s[k % KEPT]
    _, pitch_rad, yaw_rad = _rpy_at(t_s, motion.q_earth_body, start, count, middle_s)
    if motion.orientation.gyro_since_s > from_s or not (oldest_s <= from_s and to_s <= newest_s):
        return pitch_rad, yaw_rad, gap_s, math.nan
    turned_rad = _turned_at(motion, start, count, to_s) - _turned_at(motion, start, count, from_s)
    return pitch_rad, yaw_rad, gap_s, turned_rad


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
        self._motion = motion = records(MOTION)
        motion["q_sensor_body"], motion["R_body_sensor"] = q_from_R(R_body_sensor.T), R_body_sensor
        self.t_s: F64 = motion["t_s"][0]
        self.q_earth_body: F64 = motion["q_earth_body"][0]
        self.start = self.count = 0
        self.count_ahead = 0  # samples, and the place behind them where the newest is carried on
        self.orientation = OrientationFilter(motion["orientation"], ErrorState(motion["errors"]))
        self._levels = levels  # False: roll and pitch are the sensor's
        self.rate_body_radps: Rates = (0.0, 0.0, 0.0)  # newest; NaN where it is not delivered
        self.newest_s = -math.inf  # time of the newest sample; -inf when there is none
        self.rejected = 0  # samples out of order or no orientation at all
        self._newest_rpy: Rpy = (0.0, 0.0, 0.0)

    def add(self, attitude: Attitude) -> bool:
        """Take one sample; False (and counted) if it can't be true."""
        magnetic = attitude.magnetic
        places, rpy_rad, rates = _take(
            self._motion,
            (self.start + self.count) % KEPT,
            self._levels,
            self.newest_s,
            attitude.t_s,
            attitude.q_earth_sensor,
            attitude.rate_radps,
            magnetic or NO_FIELD,
            magnetic is not None,
        )
        if not places:
            self.rejected += 1
            return False
        if self.count == KEPT - 1:  # one place is left for what is carried on
            self.start = (self.start + 1) % KEPT
        else:
            self.count += 1
        self.count_ahead = self.count + places - 1
        self.newest_s, self.rate_body_radps, self._newest_rpy = attitude.t_s, rates, rpy_rad
        return True

    def between(self, from_s: float, to_s: float) -> tuple[float, float, float, float]:
        """An interval, of which `to_s` is spanned.

        Returns:
            Pitch and yaw of the body in its middle, the time between the samples there (inf where
            they do not span it), and how far the gyro turned about body z, bias and all: NaN
            where it did not tell throughout.
        """
        return _between(self._motion, self.start, self.count, from_s, to_s)

    def turn_all(self, turn_rad: float) -> None:
        """Turn every kept orientation about the vertical: the heading was found to be off."""
        _turn_all(self.q_earth_body, self.start, self.count_ahead, turn_rad)
        if self.count:
            newest = self.q_earth_body[(self.start + self.count - 1) % KEPT]
            self._newest_rpy = rpy_from_q(newest)

    def reaches(self, from_s: float, to_s: float) -> bool:
        """True if from..to is covered, or would be with the newest sample carried on."""
        newest_s = self.newest_s
        if to_s <= newest_s:
            return self.covers(from_s, to_s)
        is_ahead = self.count_ahead > self.count and to_s <= newest_s + AHEAD_S
        return is_ahead and self.covers(min(from_s, newest_s), newest_s)

    def covers(self, from_s: float, to_s: float) -> bool:
        """True if every instant from..to lies between two samples that are close together."""
        return self.spans(from_s, to_s) and _is_close(
            self.t_s, self.start, self.count, from_s, to_s
        )

    def spans(self, from_s: float, to_s: float) -> bool:
        """True if from..to lies between the oldest and the newest sample, gaps or not."""
        return self.count > 1 and to_s <= self.newest_s and bool(self.t_s[self.start] <= from_s)

    def rpy_at(self, at_s: float) -> tuple[float, float, float]:
        """(roll, pitch, yaw) of the body in the earth frame at an instant within reach."""
        count = self.count if at_s <= self.newest_s else self.count_ahead
        return _rpy_at(self.t_s, self.q_earth_body, self.start, count, at_s)

    def newest_rpy(self) -> tuple[float, float, float]:
        """(roll, pitch, yaw) of the newest sample; level while there is none."""
        return self._newest_rpy
