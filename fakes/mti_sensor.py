"""What a fake MTi measures: the truth with noise, biases and limits, in the frames it was told.

Source: MTi sheet, sections 3 to 7.
"""

import math
from collections.abc import Callable

import numpy as np

from fakes.mti_data import Sample
from fakes.mti_gnss import Place, place_near
from fakes.mti_memory import BAD_PARAMETER, Memory
from fakes.mti_models import Model
from fakes.mti_rotation import F64, rotation, rotation_from_quaternion, rotation_z

Motion = Callable[[float], tuple[F64, F64, F64]]
Travel = Callable[[float], tuple[F64, F64]]
Distortion = Callable[[float], F64]

FULL_ACCEL_MPS2, FULL_RATE_RADPS, FULL_MAGNETIC = 50.0, math.radians(300.0), 3.0
SELF_TEST_BIT, VALID_BIT, FIX_BIT = 0x1, 0x2, 0x4
STILL_BITS = 0x18  # no-rotation update is running
ANY_CLIP_BIT, CLIP_SHIFT = 1 << 19, 8
GNSS_MODE_BITS = 3 << 23


class Sensor:
    """The measuring side; plain attributes are properties and faults, settable any time."""

    def __init__(self, motion_at: Motion, seed: int, model: Model) -> None:
        self.nan = False  # all numbers
        self.yaw_jump_rad = 0.0
        self.fa_ff = False  # the bytes FA FF occur in the data of each message
        self.angle_noise_rad = math.radians(0.05)
        self.rate_noise_radps = math.radians(0.3)
        self.accel_noise_mps2 = 0.02
        self.magnetic_noise = 0.002
        self.rate_bias_radps: F64 = np.zeros(3)
        self.accel_bias_mps2: F64 = np.zeros(3)
        self.earth_field: F64 = np.array([0.4, 0.0, -0.9])  # north, west, up
        self.temperature_deg = 35.0
        self.analog_1 = self.analog_2 = 0  # AD counts
        self.self_test = 0x01FF  # bits of message 25; 01FF: all passed
        self.gps_fix = True  # of the models with a receiver
        self.home: tuple[float, float, float] = (57.6794, 11.8825, 81.0)  # deg, deg, m
        self.utc_at_zero_s = 1_547_992_000.0  # since 1970, where the host's clock reads zero
        self.travel_at: Travel = _at_rest  # instant to position and velocity, north west up
        self.distortion_at: Distortion = _undisturbed  # what (3, 3) steel makes of earth_field
        self.pull_s = 3.0  # time constant with which the yaw follows the magnetic field
        self.counter = 0  # of the next message
        self.memory = Memory(model)
        self._motion_at = motion_at
        self._pulled_rad = 0.0  # by which the yaw is off
        self._pulled_at_s = -math.inf
        self._noise = np.random.default_rng(seed)
        self._still_until_s = -math.inf
        self._G, self._A = self.memory.G_reset, self.memory.A_reset  # as now; see Memory

    def _forget_resets(self) -> None:
        """Orientation resets as stored."""
        self._G, self._A = self.memory.G_reset, self.memory.A_reset

    @property
    def _yaw_offset_rad(self) -> float:
        return self.memory.heading_rad - self.memory.declination_rad

    @property
    def _object(self) -> F64:
        """Sensor to object axes as the settings alone make it."""
        A = np.array(self.memory.alignment).reshape(3, 3)
        return np.asarray(rotation_from_quaternion(*self.memory.turns[0]) @ A)

    def _told(self, R_earth_sensor: F64) -> F64:
        """The orientation in the frames that settings and resets have made."""
        A = self._object @ self._A
        local = rotation_from_quaternion(*self.memory.turns[1])
        turn = local @ rotation_z(self._yaw_offset_rad)
        return np.asarray(turn @ self._G @ R_earth_sensor @ A.T)

    def _reset_orientation(self, now_s: float, code: int, in_config: bool) -> bytes | int:
        """1 heading, 2 global, 3 object, 4 both 3 and 1, 5 to 7 their defaults; 0 stores."""
        model = self.memory.model
        codes = (0, 1, 2, 3, 4) if model.legacy else (0, 1, 3, 4, 5, 6, 7)
        if (code == 0) is not in_config or code not in codes:
            return BAD_PARAMETER
        if model.legacy and model.gnss and code in (1, 4):  # no heading reset
            return BAD_PARAMETER
        if code == 0:
            self.memory.G_reset, self.memory.A_reset = self._G, self._A
        if code in (5, 7):
            self._G = np.eye(3)
        if code in (6, 7):
            self._A = np.eye(3)
        R = self._told(rotation_z(self._pulled_rad) @ self._motion_at(now_s)[0])
        turn = rotation_z(math.atan2(R[1, 0], R[0, 0]))
        if code in (3, 4):
            alignment = self._object
            self._A = alignment.T @ turn.T @ R @ alignment @ self._A
        if code in (1, 4):
            self._G = turn.T @ self._G
        if code == 2:
            offset = rotation_z(self._yaw_offset_rad)
            self._G = offset.T @ R.T @ offset @ self._G
        return b""

    def _place(self, t_s: float) -> Place:
        moved_m, velocity_mps = self.travel_at(t_s)
        fix = self.memory.model.gnss and self.gps_fix
        return Place(*place_near(self.home, moved_m), velocity_mps, fix, self.utc_at_zero_s + t_s)

    def _sample(self, t_s: float, fine: int) -> Sample:
        """All that can be measured at an instant of the host's clock."""
        R_true, rate_radps, accel_mps2 = self._motion_at(t_s)
        noise = self._noise.standard_normal((4, 3))
        field = self.earth_field
        if self.distortion_at is not _undisturbed:
            field = self.distortion_at(t_s) @ field
        R = self._pulled(R_true, field, t_s) @ rotation(self.angle_noise_rad * noise[0])
        R = self._told(R)
        vectors = (
            accel_mps2 + self.accel_bias_mps2 + self.accel_noise_mps2 * noise[2],
            rate_radps + self.rate_bias_radps + self.rate_noise_radps * noise[1],
            R_true.T @ field + self.magnetic_noise * noise[3],
        )
        limits = (FULL_ACCEL_MPS2, FULL_RATE_RADPS, FULL_MAGNETIC)
        A, bad = self._object @ self._A, math.nan if self.nan else 0.0
        accel, rate, magnetic = (
            A @ np.clip(vector, -limit, limit) + bad
            for vector, limit in zip(vectors, limits, strict=True)
        )
        clipped = [
            bool(abs(value) > limit)
            for vector, limit in zip(vectors, limits, strict=True)
            for value in vector
        ]
        return Sample(
            R_earth_sensor=rotation_z(self.yaw_jump_rad) @ R + bad,
            rate_radps=rate,
            accel_mps2=accel,
            magnetic=magnetic,
            temperature_deg=self.temperature_deg + bad,
            analog=(self.analog_1, self.analog_2),
            status=self._status(t_s, clipped),
            counter=self.counter,
            place=self._place(t_s),
            fine=fine,
            preamble=self.fa_ff,
        )

    def _pulled(self, R_earth_sensor: F64, field: F64, t_s: float) -> F64:
        """The orientation whose yaw follows the magnetic north of a field (3,), as slowly as told.

        Where the field is turned to the left, the sensor takes itself for turned to the right.
        """
        north, ours = (math.atan2(part[1], part[0]) for part in (field, self.earth_field))
        wrong_rad = math.remainder(ours - north, math.tau)
        gone_s = max(0.0, t_s - self._pulled_at_s)  # at first for ever: it has stood here
        share = 1.0 - math.exp(-gone_s / self.pull_s)
        self._pulled_rad += share * math.remainder(wrong_rad - self._pulled_rad, math.tau)
        self._pulled_at_s = max(t_s, self._pulled_at_s)
        return rotation_z(self._pulled_rad) @ R_earth_sensor

    def _status(self, t_s: float, clipped: list[bool]) -> int:
        """The status word; the clip bits are acc xyz, gyr xyz, mag xyz."""
        word = VALID_BIT | (SELF_TEST_BIT if self.self_test == 0x01FF else 0)
        word |= STILL_BITS if t_s < self._still_until_s else 0
        if self.memory.model.gnss and self.gps_fix:
            word |= FIX_BIT if self.memory.model.legacy else FIX_BIT | GNSS_MODE_BITS
        word |= sum(1 << CLIP_SHIFT + k for k, is_clipped in enumerate(clipped) if is_clipped)
        return word | (ANY_CLIP_BIT if any(clipped) else 0)


def _undisturbed(t_s: float) -> F64:
    return np.eye(3)


def _at_rest(t_s: float) -> tuple[F64, F64]:
    return np.zeros(3), np.zeros(3)
