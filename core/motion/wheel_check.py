"""What wheels and gyro say of each other: slip, the gyro's bias, and wheels of unequal size.

Where the wheels turn the body otherwise than the gyro says, a wheel slips: then their turn is not
believed, and their travel only with a wide error. Both wheels slipping alike turn nothing and are
not seen here, unless they gain speed faster than any floor lets a robot: what a loaded or worn
wheel does steadily is the scale that only a positioning system can tell.

Where the wheels turn on and the gyro sees nothing of it, either it is stuck or the robot is: nobody
knows where the body points, until the gyro is seen to turn.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from msgspec import Struct

from core.motion.error_state import ASYMMETRY, BIAS_Z, SIZE, ErrorState

SHORT_S = 0.25  # slip is looked for in windows of so long
LONG_S = 1.0  # and the bias in those
SLIP_RAD = 0.02  # a turn by the wheels in a short window that the gyro did not see,
SLIP_TURN = 0.08  # beyond this share of the turn: track width, and turning on broad tyres
SLIP_TRAVEL = 0.02  # and this share of the travel over the track: unequal wheels
IGNORED_RAD = 1.0  # turned by the wheels, of which the gyro saw not even
SEEN_SHARE = 0.2  # this share: the heading is not known
GONE_S = 0.5  # so long without a sign, and the slip is over
GRIP_MPS2 = 6.0  # faster no floor moves a robot
GRIP_MPS = 0.1  # and this much is the rounding of two readings
COUNTS = 1.0  # rounding of a counter difference, each wheel
TURN_SHARE = 0.03  # error of the track width
WANDER_RAD = math.radians(0.3)  # of the heading by wheels, in the root of a metre
FLOOR_RAD = math.radians(0.1)
GYRO_RAD = math.radians(0.05)  # of the gyro's turn, in the root of a second
GATE = 4.0  # standard deviations


class Turn(Struct, frozen=True):
    """What an interval between two pairs of counts held."""

    dt_s: float
    travel_m: float  # of the middle, forward
    wheels_rad: float  # turned, by the wheels
    gyro_rad: float  # turned, by the gyro with its bias


@dataclass(slots=True)
class Sums:
    """Of intervals: some turns, one after the other."""

    dt_s: float = 0.0
    travel_m: float = 0.0
    driven_m: float = 0.0  # there and back
    wheels_rad: float = 0.0
    gyro_rad: float = 0.0

    def add(self, turn: Turn) -> None:
        self.dt_s += turn.dt_s
        self.travel_m += turn.travel_m
        self.driven_m += abs(turn.travel_m)
        self.wheels_rad += turn.wheels_rad
        self.gyro_rad += turn.gyro_rad


class WheelCheck:
    """Compares the wheels' turn with the gyro's, interval by interval."""

    def __init__(self, state: ErrorState, track_width_m: float, m_per_count: float) -> None:
        self._state, self._track_width_m = state, track_width_m
        self.round_rad = COUNTS * m_per_count / track_width_m  # how well a turn is told
        self._short: deque[Turn] = deque()
        self._long = Sums()
        self._speed_mps = math.nan
        self._clear_s = math.inf  # since the last sign of slip
        self.slips = 0  # how often it began
        self.unexplained_rad = 0.0  # of the newest short window
        self._ignored_rad = 0.0  # turned by the wheels since the gyro was seen to turn
        self.ignored = False  # that became too much

    @property
    def slipping(self) -> bool:
        """True while there are signs of it, and shortly after."""
        return self._clear_s < GONE_S

    def restart(self) -> None:
        """The interval before the next one is not known."""
        self._short.clear()
        self._long = Sums()
        self._speed_mps = math.nan

    def take(self, turn: Turn) -> bool:
        """The next interval; a gyro turn of NaN: none was delivered.

        Returns:
            Whether it has just become unknown where the body points, or known again.
        """
        was_ignored = self.ignored
        speed_mps = turn.travel_m / turn.dt_s
        leapt = abs(speed_mps - self._speed_mps) > GRIP_MPS2 * turn.dt_s + GRIP_MPS
        self._speed_mps = speed_mps
        if math.isnan(turn.gyro_rad):
            self._short.clear()
            self._long = Sums()
        else:
            self._short.append(turn)
            while len(self._short) > 1 and sum([each.dt_s for each in self._short]) > SHORT_S:
                self._short.popleft()
            self._long.add(turn)
        self._judge(turn.dt_s, leapt)
        if self.slipping:
            self._long = Sums()
        elif self._long.dt_s >= LONG_S:
            self._learn()
            self._long = Sums()
        return self.ignored != was_ignored

    def _judge(self, dt_s: float, leapt: bool) -> None:
        short = Sums()
        for turn in self._short:
            short.add(turn)
        turned_rad = short.gyro_rad - float(self._state.value[BIAS_Z]) * short.dt_s
        bias_rad = GATE * math.sqrt(float(self._state.P[BIAS_Z, BIAS_Z])) * short.dt_s
        allowed_rad = (
            SLIP_RAD
            + bias_rad
            + 2 * self.round_rad
            + SLIP_TURN * abs(turned_rad)
            + SLIP_TRAVEL * short.driven_m / self._track_width_m
        )
        self.unexplained_rad = short.wheels_rad - turned_rad
        is_unexplained = abs(self.unexplained_rad) > allowed_rad
        if abs(turned_rad) > max(SLIP_RAD + bias_rad, SEEN_SHARE * abs(short.wheels_rad)):
            self._ignored_rad, self.ignored = 0.0, False
        elif is_unexplained:
            self._ignored_rad += self._short[-1].wheels_rad
            self.ignored |= abs(self._ignored_rad) >= IGNORED_RAD
        if leapt or is_unexplained:
            self.slips += not self.slipping
            self._clear_s = 0.0
        else:
            self._clear_s += dt_s

    def _learn(self) -> None:
        """Bias and asymmetry from a second in which nothing slipped."""
        long, h, state = self._long, np.zeros(SIZE), self._state
        h[BIAS_Z], h[ASYMMETRY] = long.dt_s, long.travel_m / self._track_width_m
        innovation_rad = long.gyro_rad - long.wheels_rad - float(h @ state.value)
        variance = (
            FLOOR_RAD**2
            + 2 * self.round_rad**2
            + GYRO_RAD**2 * long.dt_s
            + WANDER_RAD**2 * long.driven_m
            + (TURN_SHARE * long.wheels_rad) ** 2
        )
        if innovation_rad**2 <= GATE**2 * (state.spread(h) + variance):
            state.correct(h, innovation_rad, variance)
