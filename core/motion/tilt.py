"""Roll and pitch of the body: the gyro's from moment to moment, the sensor's own in the long run.

An attitude sensor takes the mean of what it feels for the vertical, so it leans by a degree when
the robot brakes or drives a curve, and comes back within seconds. At the floor line, eight metres
ahead, that is an obstacle of 15 cm that is not there. Its gyro does not lean. Where the gyro and
the sensor's own angles stay far apart, one of them is wrong, and the sensor's angles count alone.
Source: complementary filter of angles and rates; MTi sheet, section 7 (2 deg rms while it moves).
"""

import math
from collections import deque

from core.motion.heading import Rates

FOLLOW_S = 8.0  # in which the sensor's angles are followed
BIAS_S = 4.0  # of standing, in which the gyro's bias is learnt;
PRIOR = 50  # samples, as if so many had said before that there is none;
QUIET_RADPS, QUIET_S = 0.03, 0.5  # of what is felt for so long; more is a robot that rocks,
LATER_S = 0.25  # and what is felt last counts once it still stands so much later: it may set out
MOVING_BIAS_S = 25.0  # while it moves, from what the gyro runs away by, so much more slowly
OFFSET_S, OFFSET_RAD = 30.0, math.radians(0.7)  # the sensor's constant error, which turns with it
GAP_S = 0.25  # between samples: beyond it the gyro tells nothing of what was between
APART_RAD = math.radians(3.0)  # gyro and sensor do not agree any more,
APART_S = 0.5  # over so long,
ALONE_S = 10.0  # and the sensor counts alone for so long,
NOISE_RADPS, NOISE_S = 0.08, 0.4  # as where the gyro jumps by so much from sample to sample
STEEP_RAD = math.radians(60.0)  # there, roll and pitch have no meaning; nor has a robot's map


class TiltFilter:
    """Roll and pitch (rad) at each sample of one attitude sensor."""

    def __init__(self) -> None:
        self.roll_rad = self.pitch_rad = 0.0
        self.bias_radps = (0.0, 0.0)  # of the rates about body x and y
        self.doubted = 0  # how often gyro and angles did not agree
        self._t_s, self._alone_until_s = -math.inf, -math.inf
        self._since_s = -math.inf  # since when the gyro counts
        self._rates: tuple[float, float, float] | None = None
        self._apart = (0.0, 0.0)  # sensor less ours, over a while
        self._noise = 0.0  # square of how much the gyro jumps from sample to sample, over a while
        self._offset = (0.0, 0.0)  # of roll and pitch
        self._stood, self._quiet_s = 0, 0.0  # samples that taught the bias; how long it is quiet
        self._felt: deque[tuple[float, float]] = deque()  # rates that are to teach it

    def step(
        self, t_s: float, roll_rad: float, pitch_rad: float, rate_body_radps: Rates, *, stands: bool
    ) -> tuple[float, float]:
        """Roll and pitch (rad) at a sample, which must be later than the one before.

        Args:
            roll_rad, pitch_rad: of the body as the sensor has them.
            rate_body_radps: (3,), NaN where it is not delivered: then the sensor's angles are told.
            stands: the robot does not move.
        """
        x, y, z = map(float, rate_body_radps)
        rates = (x, y, z) if math.isfinite(x + y + z) else None
        dt_s, before = t_s - self._t_s, self._rates
        self._t_s, self._rates = t_s, rates
        known = rates is not None and before is not None and dt_s <= GAP_S
        if rates is not None and before is not None and known:
            self._doubt_noise(
                t_s, dt_s, max(abs(a - b) for a, b in zip(rates[:2], before[:2], strict=True))
            )
        steep = max(abs(roll_rad), abs(pitch_rad)) > STEEP_RAD
        if not known or steep or t_s < self._alone_until_s:
            self._apart, self._since_s = (0.0, 0.0), t_s
            self._offset = _if_small(roll_rad), _if_small(pitch_rad)
            self.roll_rad, self.pitch_rad = roll_rad, pitch_rad
            return roll_rad, pitch_rad
        assert rates is not None
        assert before is not None
        p, q = 0.5 * (rates[0] + before[0]), 0.5 * (rates[1] + before[1])
        r = 0.5 * (rates[2] + before[2])
        self._learn(dt_s, p, q, stands)
        self._turn(dt_s, p - self.bias_radps[0], q - self.bias_radps[1], r)
        return self._towards(t_s, dt_s, roll_rad, pitch_rad)

    def _doubt_noise(self, t_s: float, dt_s: float, jump_radps: float) -> None:
        """A gyro that only makes noise would lead roll and pitch astray, a degree in a second."""
        self._noise += min(1.0, dt_s / NOISE_S) * (jump_radps * jump_radps - self._noise)
        if self._noise > NOISE_RADPS * NOISE_RADPS:
            self.doubted += t_s >= self._alone_until_s
            self._alone_until_s = t_s + ALONE_S

    def _turn(self, dt_s: float, p: float, q: float, r: float) -> None:
        """Go on by the gyro: Euler angles, z-y-x, of the body as it truly stands.

        What the sensor is always off by turns with the body: on level ground that is the mean.
        """
        share = dt_s / OFFSET_S
        x, y = self._offset
        self._offset = (
            _within(OFFSET_RAD, x + share * (self.roll_rad - x)),
            _within(OFFSET_RAD, y + share * (self.pitch_rad - y)),
        )
        roll_rad, pitch_rad = self.roll_rad - x, self.pitch_rad - y
        s, c = math.sin(roll_rad), math.cos(roll_rad)
        across = q * s + r * c
        self.roll_rad += dt_s * (p + math.tan(pitch_rad) * across)
        self.pitch_rad += dt_s * (q * c - r * s)

    def _learn(self, dt_s: float, p: float, q: float, stands: bool) -> None:
        """A body that stands turns about nothing: what the gyro says then is its bias."""
        x, y = self.bias_radps
        if not (stands and max(abs(p - x), abs(q - y)) <= QUIET_RADPS):
            self._quiet_s = 0.0
            self._felt.clear()
            return
        self._quiet_s += dt_s
        if self._quiet_s <= QUIET_S:
            return
        self._felt.append((p, q))
        if len(self._felt) * dt_s <= LATER_S:
            return
        p, q = self._felt.popleft()
        self._stood += 1
        share = max(dt_s / BIAS_S, 1.0 / (self._stood + PRIOR))
        self.bias_radps = x + share * (p - x), y + share * (q - y)

    def _towards(
        self, t_s: float, dt_s: float, roll_rad: float, pitch_rad: float
    ) -> tuple[float, float]:
        """Follow the sensor's angles slowly; go over to them where they stay far off."""
        off = roll_rad - self.roll_rad, pitch_rad - self.pitch_rad
        share = min(1.0, dt_s / APART_S)
        x, y = self._apart
        self._apart = apart = x + share * (off[0] - x), y + share * (off[1] - y)
        if max(abs(apart[0]), abs(apart[1])) > APART_RAD:
            self.doubted += 1
            self._alone_until_s = t_s + ALONE_S
            self._apart = (0.0, 0.0)
            self.roll_rad, self.pitch_rad = roll_rad, pitch_rad
            return roll_rad, pitch_rad
        share = dt_s / min(FOLLOW_S, max(APART_S, t_s - self._since_s))  # at first, the mean
        self.roll_rad += share * off[0]
        self.pitch_rad += share * off[1]
        x, y = self.bias_radps
        slow = dt_s / (FOLLOW_S * MOVING_BIAS_S)
        self.bias_radps = x - slow * off[0], y - slow * off[1]
        return self.roll_rad, self.pitch_rad


def _within(most_rad: float, angle_rad: float) -> float:
    return max(-most_rad, min(most_rad, angle_rad))


def _if_small(angle_rad: float) -> float:
    """An angle that may well be the sensor's error; 0 for one that is a ramp's."""
    return angle_rad if abs(angle_rad) <= OFFSET_RAD else 0.0
