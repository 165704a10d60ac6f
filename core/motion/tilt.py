"""Roll and pitch of the body: the gyro's from moment to moment, the sensor's own in the long run.

An attitude sensor takes the mean of what it feels for the vertical, so it leans by a degree when
the robot brakes or drives a curve, and comes back within seconds. At the floor line, eight metres
ahead, that is an obstacle of 15 cm that is not there. Its gyro does not lean, and what the wheels
explain of it (`lean`) is taken out. Where the gyro and the sensor's own angles stay far apart, one
of them is wrong, and the sensor's angles count alone.
Source: complementary filter of angles and rates; MTi sheet, section 7 (2 deg rms while it moves).
"""

import math

import numpy as np

from core.geometry import Rates
from core.motion.lean import LEAN, lean_of, lean_step, note_wheels, start
from jit import Record, Records, kernel, records

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

FELT = 128  # samples of LATER_S, at most: of a sensor beyond 500 Hz the oldest teach sooner

TILT = np.dtype(
    [
        ("roll_rad", np.float64),
        ("pitch_rad", np.float64),
        ("bias_x_radps", np.float64),  # of the rates about body x and y
        ("bias_y_radps", np.float64),
        ("doubted", np.int64),  # how often gyro and angles did not agree
        ("t_s", np.float64),
        ("alone_until_s", np.float64),
        ("since_s", np.float64),  # since when the gyro counts
        ("x_radps", np.float64),  # rates of the sample before; NaN: none
        ("y_radps", np.float64),
        ("z_radps", np.float64),
        ("apart_roll_rad", np.float64),  # sensor less ours, over a while
        ("apart_pitch_rad", np.float64),
        ("noise", np.float64),  # square of how much the gyro jumps from sample to sample
        ("offset_roll_rad", np.float64),
        ("offset_pitch_rad", np.float64),
        ("stood", np.int64),  # samples that taught the bias
        ("quiet_s", np.float64),  # how long it is quiet
        ("felt_radps", np.float64, (FELT, 2)),  # a ring of rates that are to teach it
        ("felt_first", np.int64),
        ("felt_count", np.int64),
        ("lean", LEAN),
    ],
    align=True,
)


class TiltFilter:
    """What `tilt_step` knows of one attitude sensor: `record` (1,), of TILT."""

    def __init__(self, record: Records | None = None) -> None:
        self.record = record = records(TILT) if record is None else record
        for time in ("t_s", "alone_until_s", "since_s"):
            record[time] = -math.inf
        for rate in ("x_radps", "y_radps", "z_radps"):
            record[rate] = math.nan
        start(record["lean"])

    def note_wheels(self, dt_s: float, v_mps: float, w_radps: float) -> None:
        """The wheels went at such a speed, and turned at such a rate, for so long."""
        note_wheels(self.record[0]["lean"], dt_s, v_mps, w_radps)

    @property
    def doubted(self) -> int:
        """How often gyro and angles did not agree."""
        return int(self.record["doubted"][0])

    @property
    def bias_radps(self) -> tuple[float, float]:
        """Of the rates about body x and y."""
        return float(self.record["bias_x_radps"][0]), float(self.record["bias_y_radps"][0])


@kernel
def _doubt_noise(tilt: Record, t_s: float, dt_s: float, jump_radps: float) -> None:
    """A gyro that only makes noise would lead roll and pitch astray, a degree in a second."""
    tilt.noise += min(1.0, dt_s / NOISE_S) * (jump_radps * jump_radps - tilt.noise)
    if tilt.noise > NOISE_RADPS * NOISE_RADPS:
        if t_s >= tilt.alone_until_s:
            tilt.doubted += 1
        tilt.alone_until_s = t_s + ALONE_S


@kernel
def _learn(tilt: Record, dt_s: float, p: float, q: float, stands: bool) -> None:
    """A body that stands turns about nothing: what the gyro says then is its bias."""
    x, y = tilt.bias_x_radps, tilt.bias_y_radps
    if not (stands and max(abs(p - x), abs(q - y)) <= QUIET_RADPS):
        tilt.quiet_s = 0.0
        tilt.felt_count = 0
        return
    tilt.quiet_s += dt_s
    if tilt.quiet_s <= QUIET_S:
        return
    first, count = tilt.felt_first, tilt.felt_count
    tilt.felt_radps[(first + count) % FELT, 0] = p
    tilt.felt_radps[(first + count) % FELT, 1] = q
    if (count + 1) * dt_s <= LATER_S and count + 1 < FELT:
        tilt.felt_count = count + 1
        return
    tilt.felt_first = (first + 1) % FELT
    tilt.stood += 1
    share = max(dt_s / BIAS_S, 1.0 / (tilt.stood + PRIOR))
    tilt.bias_x_radps = x + share * (tilt.felt_radps[first, 0] - x)
    tilt.bias_y_radps = y + share * (tilt.felt_radps[first, 1] - y)


@kernel
def _within(most_rad: float, angle_rad: float) -> float:
    return max(-most_rad, min(most_rad, angle_rad))


@kernel
def _turn(tilt: Record, dt_s: float, p: float, q: float, r: float) -> None:
    """Go on by the gyro: Euler angles, z-y-x, of the body as it truly stands.

    What the sensor is always off by turns with the body: on level ground that is the mean.
    """
    share = dt_s / OFFSET_S
    x, y = tilt.offset_roll_rad, tilt.offset_pitch_rad
    tilt.offset_roll_rad = _within(OFFSET_RAD, x + share * (tilt.roll_rad - x))
    tilt.offset_pitch_rad = _within(OFFSET_RAD, y + share * (tilt.pitch_rad - y))
    roll_rad, pitch_rad = tilt.roll_rad - x, tilt.pitch_rad - y
    s, c = math.sin(roll_rad), math.cos(roll_rad)
    across = q * s + r * c
    tilt.roll_rad += dt_s * (p + math.tan(pitch_rad) * across)
    tilt.pitch_rad += dt_s * (q * c - r * s)


@kernel
def _towards(tilt: Record, t_s: float, dt_s: float, roll_rad: float, pitch_rad: float) -> None:
    """Follow the sensor's angles slowly; go over to them where they stay far off."""
    off_roll, off_pitch = roll_rad - tilt.roll_rad, pitch_rad - tilt.pitch_rad
    lean_roll, lean_pitch = lean_step(tilt.lean, dt_s, (off_roll, off_pitch))
    off_roll, off_pitch = off_roll - lean_roll, off_pitch - lean_pitch
    share = min(1.0, dt_s / APART_S)
    tilt.apart_roll_rad += share * (off_roll - tilt.apart_roll_rad)
    tilt.apart_pitch_rad += share * (off_pitch - tilt.apart_pitch_rad)
    if max(abs(tilt.apart_roll_rad), abs(tilt.apart_pitch_rad)) > APART_RAD:
        tilt.doubted += 1
        tilt.alone_until_s = t_s + ALONE_S
        tilt.apart_roll_rad = tilt.apart_pitch_rad = 0.0
        tilt.roll_rad, tilt.pitch_rad = roll_rad, pitch_rad
        return
    share = dt_s / min(FOLLOW_S, max(APART_S, t_s - tilt.since_s))  # at first, the mean
    tilt.roll_rad += share * off_roll
    tilt.pitch_rad += share * off_pitch
    slow = dt_s / (FOLLOW_S * MOVING_BIAS_S)
    tilt.bias_x_radps -= slow * off_roll
    tilt.bias_y_radps -= slow * off_pitch


@kernel
def _if_small(angle_rad: float) -> float:
    """An angle that may well be the sensor's error; 0 for one that is a ramp's."""
    return angle_rad if abs(angle_rad) <= OFFSET_RAD else 0.0


@kernel
def tilt_step(
    tilt: Record,
    t_s: float,
    angles_rad: tuple[float, float],
    rates: Rates,
    stands: bool,
) -> tuple[float, float]:
    """Roll and pitch (rad) at a sample, which must be later than the one before.

    Args:
        tilt: a `TILT`, of a `TiltFilter`.
        angles_rad: roll and pitch of the body as the sensor has them.
        rates: about the body's axes; where they are not delivered, the sensor's angles are told.
        stands: the robot does not move.
    """
    roll_rad, pitch_rad = angles_rad
    x, y, z = rates
    dt_s = t_s - tilt.t_s
    before_x, before_y, before_z = tilt.x_radps, tilt.y_radps, tilt.z_radps
    known = math.isfinite(x + y + z) and math.isfinite(before_x + before_y + before_z)
    known = known and dt_s <= GAP_S
    tilt.t_s, tilt.x_radps, tilt.y_radps, tilt.z_radps = t_s, x, y, z
    if known:
        _doubt_noise(tilt, t_s, dt_s, max(abs(x - before_x), abs(y - before_y)))
    steep = max(abs(roll_rad), abs(pitch_rad)) > STEEP_RAD
    if not known or steep or t_s < tilt.alone_until_s:
        lean_roll, lean_pitch = lean_of(tilt.lean)
        roll_rad, pitch_rad = roll_rad - lean_roll, pitch_rad - lean_pitch
        tilt.apart_roll_rad = tilt.apart_pitch_rad = 0.0
        tilt.since_s = t_s
        tilt.offset_roll_rad, tilt.offset_pitch_rad = _if_small(roll_rad), _if_small(pitch_rad)
        tilt.roll_rad, tilt.pitch_rad = roll_rad, pitch_rad
        return roll_rad, pitch_rad
    p, q, r = 0.5 * (x + before_x), 0.5 * (y + before_y), 0.5 * (z + before_z)
    _learn(tilt, dt_s, p, q, stands)
    _turn(tilt, dt_s, p - tilt.bias_x_radps, q - tilt.bias_y_radps, r)
    _towards(tilt, t_s, dt_s, roll_rad, pitch_rad)
    return tilt.roll_rad, tilt.pitch_rad
