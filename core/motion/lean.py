"""By how much a sensor leans that takes what it feels of the robot's driving for the vertical.

It takes the mean of what it feels over some seconds. Felt is gravity less the acceleration of the
body, which the wheels tell: with the speed V along the way, a vector in earth's axes,

    A = (V - V_slow) / LEAN_S,   V_slow follows V within LEAN_S
    l = (A_y, -A_x) / g          about earth's x and y, and within LEAN_RAD

A sensor that takes accelerations out by itself leans by a smaller share, which is a state of the
filter. At the first news the robot may have gone so for long: then l is zero. Without news, l
fades within LEAN_S.
Source: MTi sheet, section 7 (orientation filter: gravity by the mean acceleration of some seconds).
"""

import math

import numpy as np

from jit import Record, Records, kernel

LEAN_S = 4.0  # in which the sensor turns to what it feels: 2 to 8 s hardly differ
LEAN_RAD = math.radians(5.0)  # at most, as of 0.9 m/s2 for long: more is a wheel that spins
GRAVITY_MPS2 = 9.81
LASTS_S = 0.5  # for so long the newest speed speaks of now

LEAN = np.dtype(
    [
        ("known", np.bool_),  # there was news
        ("speed_mps", np.float64, 2),  # by the wheels, earth's x and y,
        ("slow_mps", np.float64, 2),  # and its low pass
        ("rad", np.float64, 2),  # l
        ("lasts_s", np.float64),  # for so long without news from the wheels
    ],
    align=True,
)


@kernel
def _within(most: float, value: float) -> float:
    return max(-most, min(most, value))


@kernel
def note_speed(leans: Records, dt_s: float, v_mps: float, yaw_rad: float) -> None:
    """The wheels went at such a speed along such a yaw, for so long. leans: (1,) of LEAN."""
    lean, passed = leans[0], 1.0 - math.exp(-dt_s / LEAN_S)
    lean.speed_mps[0], lean.speed_mps[1] = v_mps * math.cos(yaw_rad), v_mps * math.sin(yaw_rad)
    if not lean.known:  # it may have gone so for long
        lean.known, passed = True, 1.0
    for k in range(2):
        lean.slow_mps[k] += passed * (lean.speed_mps[k] - lean.slow_mps[k])
    scale = 1.0 / (LEAN_S * GRAVITY_MPS2)
    lean.rad[0] = _within(LEAN_RAD, scale * (lean.speed_mps[1] - lean.slow_mps[1]))
    lean.rad[1] = _within(LEAN_RAD, scale * (lean.slow_mps[0] - lean.speed_mps[0]))
    lean.lasts_s = LASTS_S


@kernel
def fade(lean: Record, dt_s: float) -> None:
    """Time passes; without news from the wheels, the lean comes back by itself."""
    lean.lasts_s -= dt_s
    if lean.lasts_s <= 0.0:
        kept = math.exp(-dt_s / LEAN_S)
        for k in range(2):
            lean.rad[k] *= kept
            lean.slow_mps[k] = lean.speed_mps[k] + kept * (lean.slow_mps[k] - lean.speed_mps[k])
