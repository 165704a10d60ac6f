"""Whether the magnetic field is the earth's: its strength and dip against what they were at first.

Steel nearby bends the field that a heading is made of. Where strength or dip differ from the
reference, that heading is not to be believed. A field of the right strength and dip but the wrong
direction is not seen here; the gyro tells of it.
"""

import math

LEARNT_S = 1.0  # the reference is the mean of so long
PLAUSIBLE = (0.4, 2.5)  # strength, 1 = the field at calibration: anything else is no earth's field
STRENGTH = 0.10  # how far, relatively, the strength may be from the reference,
DIP_RAD = math.radians(5.0)  # and how far the dip
SMOOTH_S = 0.5  # time constant of the field as it is now
ADAPT_S = 300.0  # time constant of the reference while heading and gyro agree

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


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


class FieldReference:
    """Strength (1 = at calibration) and dip (rad) of the undisturbed field, as learnt."""

    def __init__(self) -> None:
        self.known = False
        self.strength = self.dip_rad = 0.0
        self._now_strength = self._now_dip_rad = 0.0  # smoothed
        self._learnt_s = 0.0

    def is_plain(
        self, dt_s: float, q_earth_sensor: Quaternion, magnetic: Vector | None, *, agrees: bool
    ) -> bool:
        """Whether nothing is known against the field; `agrees`: heading and gyro do just now.

        True without a field: then there is nothing to judge by.
        """
        if magnetic is None:
            return True
        strength, dip_rad = strength_and_dip(q_earth_sensor, magnetic)
        if not PLAUSIBLE[0] <= strength <= PLAUSIBLE[1]:
            return False
        share = min(1.0, dt_s / SMOOTH_S)
        self._now_strength += share * (strength - self._now_strength)
        self._now_dip_rad += share * (dip_rad - self._now_dip_rad)
        if not self.known:
            self._learn(dt_s, strength, dip_rad)
            return True
        plain = (
            abs(strength - self.strength) <= STRENGTH * self.strength
            and abs(dip_rad - self.dip_rad) <= DIP_RAD
        )
        if plain and agrees:
            self.strength += dt_s / ADAPT_S * (strength - self.strength)
            self.dip_rad += dt_s / ADAPT_S * (dip_rad - self.dip_rad)
        return plain

    def _learn(self, dt_s: float, strength: float, dip_rad: float) -> None:
        """The mean of what there was since the start."""
        if self._learnt_s == 0.0:
            self._now_strength, self._now_dip_rad = strength, dip_rad
        self._learnt_s += max(dt_s, 1e-3)
        share = min(1.0, max(dt_s, 1e-3) / self._learnt_s)
        self.strength += share * (strength - self.strength)
        self.dip_rad += share * (dip_rad - self.dip_rad)
        self.known = self._learnt_s >= LEARNT_S

    def adopt(self) -> None:
        """What the field is now is the reference from now on."""
        if self.known:
            self.strength, self.dip_rad = self._now_strength, self._now_dip_rad
