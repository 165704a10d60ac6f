"""Whether the sensor's own yaw, which follows the magnetic field, is to be believed.

Steel that bends the field changes its strength s and dip d too, against what they were at first, s0
and d0. No heading is needed to see that, and steel prefers no direction: what it does to two of the
field's parts, it does to the third, which is the heading,

    a^2 = ((s - s0)^2 + s^2 (d - d0)^2) / 2,    R = SENSOR_RAD^2 + (a / (s0 cos d0))^2

and for seconds after, as the sensor takes them to find back. The yaw counts while four things hold:

    the field is not bent beyond use          a / (s0 cos d0) < GATE OFFSET_RAD
    it is no noisier than it should be        by its jumps from sample to sample
    it says what was expected                 innovation^2 <= GATE^2 (h P h' + SENSOR_RAD^2)
    it is not being drawn away                |OFFSET| <= GATE OFFSET_RAD

and after HOLD_S without a doubt again. Where it stands off by the same angle for ADOPT_S of
driving, that angle is its usual offset from then on. Standing beside steel teaches nothing.
Source: Laidig and Seel, VQF, Information Fusion 91, 2023 (norm and dip against a reference, and a
new one after 20 s of motion).
"""

import math

import numpy as np

from core.geometry import Quaternion, Vector, wrapped_in_kernels
from core.motion.error_state import OFFSET, OFFSET_RAD, YAW, correct, define
from core.motion.kalman import begin
from jit import Record, Records, allocating_kernel, kernel

GATE = 3.0  # sigmas: 0.3 % of what is right is left out
SENSOR_RAD = math.radians(0.3)  # noise of the sensor's own yaw within a step
LEARNT_S = 1.0  # the reference field is the mean of so long
WEAKEST, STRONGEST = 0.4, 2.5  # 1 = the field at calibration: anything else is no earth's field
SMOOTH_S = 0.5  # time constant of the field as it is now
ADAPT_S = 300.0  # time constant of the reference while it is trusted
BEYOND_VAR = (GATE * OFFSET_RAD) ** 2
LEAST_LEVEL = 0.05  # of the field's level part: nearer to a pole there is no compass
HOLD_S = 5.0  # after a disturbance the sensor takes seconds to find back
ADOPT_S = 30.0  # so long a new offset must have stood, while moving, to be the usual one
ADOPT_RAD = math.radians(2.0)  # and within this

COMPASS = np.dtype(
    [
        ("trusted", np.bool_),  # whether the sensor's own yaw counts just now,
        ("trust_from_s", np.float64),  # and from when on it may again
        ("disturbed", np.int64),  # how often it was found not to be believed
        ("adopted", np.int64),  # how often a new usual offset was taken
        ("usual_rad", np.float64),  # offset that counts as none
        ("steady_rad", np.float64),  # an offset that may become usual, and since when it stands
        ("steady_from_s", np.float64),
        ("learnt_s", np.float64),  # how long the reference was learnt; of the earth's field
        ("strength", np.float64),  # 1 = at calibration
        ("dip_rad", np.float64),
        ("bent_var", np.float64),  # rad2, of what steel does to the yaw, now or a while ago
        ("now_strength", np.float64),  # smoothed
        ("now_dip_rad", np.float64),
    ],
    align=True,
)


def begin_compass(compass: Records) -> None:
    """Nothing is known yet. compass: (1,) of COMPASS."""
    compass["trusted"] = True
    compass["trust_from_s"], compass["steady_from_s"] = -math.inf, math.inf


@kernel
def strength_and_dip(q_earth_sensor: Quaternion, magnetic: Vector) -> tuple[float, float]:
    """Length of a field (sensor axes) and its angle below the horizon; no heading is needed.

    >>> strength_and_dip((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -2.0))[0]
    2.0
    """
    w, x, y, z = q_earth_sensor
    mx, my, mz = magnetic
    strength = math.sqrt(mx * mx + my * my + mz * mz)
    up = 2 * (x * z - w * y) * mx + 2 * (y * z + w * x) * my + (1 - 2 * (x * x + y * y)) * mz
    if not strength > 0.0:
        return 0.0, 0.0
    return strength, -math.asin(max(-1.0, min(1.0, up / strength)))


@kernel
def note_field(compass: Record, dt_s: float, q_earth: Quaternion, magnetic: Vector) -> None:
    """The field was so for so long, in axes that are turned to earth's by q_earth."""
    strength, dip_rad = strength_and_dip(q_earth, magnetic)
    compass.bent_var *= math.exp(-dt_s / HOLD_S)
    if not WEAKEST <= strength <= STRONGEST:
        compass.bent_var = BEYOND_VAR
        return
    share = 1.0 if compass.learnt_s == 0.0 else min(1.0, dt_s / SMOOTH_S)
    compass.now_strength += share * (strength - compass.now_strength)
    compass.now_dip_rad += share * (dip_rad - compass.now_dip_rad)
    share = dt_s / ADAPT_S if compass.trusted else 0.0
    if compass.learnt_s < LEARNT_S:  # the mean of what there was since the start
        compass.learnt_s += max(dt_s, 1e-3)
        share = min(1.0, max(dt_s, 1e-3) / compass.learnt_s)
    compass.strength += share * (compass.now_strength - compass.strength)
    compass.dip_rad += share * (compass.now_dip_rad - compass.dip_rad)
    level = max(compass.strength * math.cos(compass.dip_rad), LEAST_LEVEL)
    stronger = (compass.now_strength - compass.strength) / level
    steeper = compass.now_strength * (compass.now_dip_rad - compass.dip_rad) / level
    bent_var = 0.5 * (stronger * stronger + steeper * steeper)
    compass.bent_var = max(compass.bent_var, min(bent_var, BEYOND_VAR))


@kernel
def is_plain(compass: Record) -> bool:
    """Whether the field is not bent beyond use."""
    return bool(compass.bent_var < BEYOND_VAR)


@kernel
def is_believed(compass: Record, errors: Record, t_s: float) -> bool:
    """Whether the sensor's own turn counts where there is no gyro."""
    if not is_plain(compass):
        distrust(compass, errors, t_s)
    elif t_s >= compass.trust_from_s:
        compass.trusted = True
    return bool(compass.trusted)


@kernel
def distrust(compass: Record, errors: Record, t_s: float) -> None:
    if compass.trusted:
        compass.disturbed += 1
        begin(errors.P, OFFSET, OFFSET_RAD**2)
        errors.value[OFFSET] = 0.0
    compass.trusted = False
    compass.trust_from_s = t_s + HOLD_S


@kernel
def _look_for_offset(
    compass: Record, errors: Record, t_s: float, dt_s: float, off_rad: float, stands: bool
) -> None:
    """Its yaw is off for long, but moves as the gyro says: then it is off by a constant."""
    first_rad = GATE * math.sqrt(errors.P[YAW, YAW] + OFFSET_RAD**2 + SENSOR_RAD**2)
    if compass.usual_rad != 0.0 and abs(off_rad) <= first_rad:
        compass.usual_rad = 0.0  # as it was at the start
        return
    if stands:
        compass.steady_from_s += dt_s  # nothing is learnt about a place by standing there
    away_rad = wrapped_in_kernels(off_rad - compass.steady_rad)
    if not abs(away_rad) <= ADOPT_RAD or math.isinf(compass.steady_from_s):
        compass.steady_rad, compass.steady_from_s = off_rad, t_s
    if t_s - compass.steady_from_s >= ADOPT_S:
        compass.usual_rad, compass.steady_from_s = off_rad, math.inf
        define(errors.P, OFFSET, YAW, -1.0, OFFSET_RAD**2)
        errors.value[OFFSET] = 0.0
        compass.strength, compass.dip_rad = compass.now_strength, compass.now_dip_rad
        compass.bent_var = 0.0
        compass.trust_from_s = t_s
        compass.adopted += 1


@allocating_kernel
def use_compass(
    compass: Record, errors: Record, t_s: float, dt_s: float, off_rad: float, off_var: float,
    stands: bool,
) -> None:  # fmt: skip
    """Correct by the sensor's own yaw, where nothing speaks against it.

    off_rad: that yaw less the estimated one, within the last dt_s; off_var: its noise, as measured.
    """
    P, value = errors.P, errors.value
    var = SENSOR_RAD**2
    innovation_rad = wrapped_in_kernels(off_rad - compass.usual_rad) - value[OFFSET]
    spread = P[YAW, YAW] + P[OFFSET, OFFSET] + 2.0 * P[YAW, OFFSET] + var
    fits = innovation_rad * innovation_rad <= GATE * GATE * spread
    sound = is_plain(compass) and off_var <= var
    if not (sound and fits and abs(value[OFFSET]) <= GATE * OFFSET_RAD):
        distrust(compass, errors, t_s)
        _look_for_offset(compass, errors, t_s, dt_s, off_rad, stands)
        return
    compass.trusted = t_s >= compass.trust_from_s
    if compass.trusted and not stands:
        compass.steady_from_s = math.inf
        h = np.zeros(len(value))
        h[YAW] = h[OFFSET] = 1.0
        correct(P, value, h, innovation_rad, var + compass.bent_var)
