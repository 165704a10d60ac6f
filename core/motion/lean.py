"""How far an attitude sensor leans by what the robot's own driving makes it feel.

It takes the mean of what it feels over some seconds for the vertical. Felt is gravity less the
acceleration of the body, which the wheels tell, so its angles are off by

    off = share / g * (low pass over LEAN_S of the acceleration)

Of an acceleration along the way, that low pass is (v - v_slow) / LEAN_S, where v_slow follows v. A
sensor that takes accelerations out by itself leans by a smaller share. It is learnt: a Kalman
filter of one state, measured by how far the sensor's angles are off the gyro's.
Source: MTi sheet, section 7 (orientation filter: gravity by the mean acceleration of some seconds).
"""

import math

import numpy as np

from jit import Record, Records, kernel

LEAN_S = 4.0  # in which the sensor turns to what it feels: 2 to 8 s hardly differ
GRAVITY_MPS2 = 9.81
SIGMA_SHARE = 1.0 / 3.0  # before anything is known: a sensor that leans wholly is three sigmas off
SIGMA_RAD = math.radians(0.15)  # what its angles wander by besides, within LEAN_S
WHEELS_S = 0.5  # without wheels for so long, nothing is known of the acceleration
MOST_RAD = math.radians(5.0)  # as of 0.9 m/s2 for long: more is a wheel that spins

LEAN = np.dtype(
    [
        ("share", np.float64),
        ("share_var", np.float64),
        ("slow_mps", np.float64),  # speed, low pass
        ("roll_rad", np.float64),  # by which a sensor that leans wholly is off
        ("pitch_rad", np.float64),
        ("lasts_s", np.float64),  # for so long without news from the wheels
    ],
    align=True,
)


def start(lean: Records) -> None:
    """Nothing is known yet. lean: (1,) of LEAN."""
    lean["share_var"] = SIGMA_SHARE**2


@kernel
def _within(most: float, value: float) -> float:
    return max(-most, min(most, value))


@kernel
def note_wheels(lean: Record, dt_s: float, v_mps: float, w_radps: float) -> None:
    """The wheels went at such a speed, and turned at such a rate, for so long."""
    passed = 1.0 - math.exp(-dt_s / LEAN_S)
    lean.slow_mps += passed * (v_mps - lean.slow_mps)
    forward = (v_mps - lean.slow_mps) / (LEAN_S * GRAVITY_MPS2)
    sideways = v_mps * w_radps / GRAVITY_MPS2
    lean.pitch_rad = _within(MOST_RAD, -forward)
    lean.roll_rad += passed * (_within(MOST_RAD, sideways) - lean.roll_rad)
    lean.lasts_s = WHEELS_S


@kernel
def lean_of(lean: Record) -> tuple[float, float]:
    """By how much roll and pitch of the sensor lean, as far as that is known."""
    return lean.share * lean.roll_rad, lean.share * lean.pitch_rad


@kernel
def lean_step(lean: Record, dt_s: float, off_rad: tuple[float, float]) -> tuple[float, float]:
    """Learn from how far the sensor's roll and pitch are off the gyro's; by how much they lean."""
    lean.lasts_s -= dt_s
    if lean.lasts_s <= 0.0:  # it comes back by itself
        kept = math.exp(-dt_s / LEAN_S)
        lean.roll_rad, lean.pitch_rad = kept * lean.roll_rad, kept * lean.pitch_rad
    R = 2.0 * LEAN_S / dt_s * SIGMA_RAD**2  # samples within LEAN_S err alike
    for k in range(2):
        h = lean.roll_rad if k == 0 else lean.pitch_rad
        gain = lean.share_var * h / (h * h * lean.share_var + R)
        lean.share = _within(1.0, lean.share + gain * (off_rad[k] - lean.share * h))
        lean.share_var *= 1.0 - gain * h
    lean.share = max(0.0, lean.share)
    return lean_of(lean)
