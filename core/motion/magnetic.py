"""Whether the magnetic field is the earth's: its strength and dip against what they were at first.

Steel nearby bends the field that a heading is made of. Where strength or dip differ from the
reference, that heading is not to be believed. A field of the right strength and dip but the wrong
direction is not seen here; the gyro tells of it.
"""

import math

import numpy as np

from jit import Record, kernel

LEARNT_S = 1.0  # the reference is the mean of so long
PLAUSIBLE = (0.4, 2.5)  # strength, 1 = the field at calibration: anything else is no earth's field
STRENGTH = 0.10  # how far, relatively, the strength may be from the reference,
DIP_RAD = math.radians(5.0)  # and how far the dip
SMOOTH_S = 0.5  # time constant of the field as it is now
ADAPT_S = 300.0  # time constant of the reference while heading and gyro agree

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

FIELD = np.dtype(
    [
        ("known", np.bool_),
        ("strength", np.float64),  # of the undisturbed field, 1 = at calibration, as learnt
        ("dip_rad", np.float64),
        ("now_strength", np.float64),  # smoothed
        ("now_dip_rad", np.float64),
        ("learnt_s", np.float64),
    ],
    align=True,
)


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
def is_plain(
    field: Record, dt_s: float, q_earth_sensor: Quaternion, magnetic: Vector, agrees: bool
) -> bool:
    """Whether nothing is known against the field; `agrees`: heading and gyro do just now."""
    strength, dip_rad = strength_and_dip(q_earth_sensor, magnetic)
    if not PLAUSIBLE[0] <= strength <= PLAUSIBLE[1]:
        return False
    share = min(1.0, dt_s / SMOOTH_S)
    field.now_strength += share * (strength - field.now_strength)
    field.now_dip_rad += share * (dip_rad - field.now_dip_rad)
    if not field.known:  # the mean of what there was since the start
        if field.learnt_s == 0.0:
            field.now_strength, field.now_dip_rad = strength, dip_rad
        field.learnt_s += max(dt_s, 1e-3)
        share = min(1.0, max(dt_s, 1e-3) / field.learnt_s)
        field.strength += share * (strength - field.strength)
        field.dip_rad += share * (dip_rad - field.dip_rad)
        field.known = field.learnt_s >= LEARNT_S
        return True
    plain = (
        abs(strength - field.strength) <= STRENGTH * field.strength
        and abs(dip_rad - field.dip_rad) <= DIP_RAD
    )
    if plain and agrees:
        field.strength += dt_s / ADAPT_S * (strength - field.strength)
        field.dip_rad += dt_s / ADAPT_S * (dip_rad - field.dip_rad)
    return bool(plain)


@kernel
def adopt_field(field: Record) -> None:
    """What the field is now is the reference from now on."""
    if field.known:
        field.strength, field.dip_rad = field.now_strength, field.now_dip_rad
