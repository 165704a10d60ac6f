"""What a fake MTi measures: the truth with noise, biases and limits, in the frames it was told.

Source: MTi sheet, sections 3 to 7.
"""

import math
from collections.abc import Callable

import numpy as np

from fakes.mti.errors import ACCEL_NOISE_MPS2, RATE_NOISE_RADPS, SheetErrors
from fakes.mti.kernels import Sigmas, told, warm
from fakes.mti.memory import BAD_PARAMETER, Memory
from fakes.mti.models import Model
from fakes.mti.mtdata import Sample
from fakes.mti.rotation import F64, rotation_z

Motion = Callable[[float], tuple[F64, F64, F64]]
Distortion = Callable[[float], F64]

FULL_ACCEL_MPS2, FULL_RATE_RADPS, FULL_MAGNETIC = 50.0, math.radians(300.0), 3.0
FULL = np.array([FULL_ACCEL_MPS2, FULL_RATE_RADPS, FULL_MAGNETIC])
SELF_TEST_BIT, VALID_BIT = 0x1, 0x2
STILL_BITS = 0x18  # no-rotation update is running
ANY_CLIP_BIT, CLIP_SHIFT = 1 << 19, 8


class Sensor:
    """The measuring side; plain attributes are properties and faults, settable any time."""

    def __init__(self, motion_at: Motion, seed: int, model: Model) -> None:
        self.nan = False  # all numbers
        self.yaw_jump_rad = 0.0
        self.sheet_errors = False  # True: as wrong as the sheet says it may be
        self.fa_ff = False  # the bytes FA FF occur in the data of each message
        self.angle_noise_rad = math.radians(0.05)
        self.rate_noise_radps = math.radians(0.3)
        self.accel_noise_mps2 = 0.02
        self.magnetic_noise = 0.002
        self.rate_bias_radps: F64 = np.zeros(3)
        self.accel_bias_mps2: F64 = np.zeros(3)
        self.earth_field: F64 = np.array([0.4, 0.0, -0.9])  # north, west, up
        self.temperature_deg = 35.0
        self.self_test = 0x01FF  # bits of message 25; 01FF: all passed
        self.distortion_at: Distortion = _undisturbed  # what (3, 3) steel makes of earth_field
        self.pull_s = 3.0  # time constant with which the yaw follows the magnetic field
        self.counter = 0  # of the next message
        self.memory = Memory(model)
        self._motion_at = motion_at
        self._pulled_rad = 0.0  # by which the yaw is off
        self._pulled_at_s = -math.inf
        self._noise = np.random.default_rng(seed)
        self._still_until_s = -math.inf
        self._errors = SheetErrors(seed)
        warm()
        self._G, self._A = self.memory.G_reset, self.memory.A_reset  # as now; see Memory

    def _forget_resets(self) -> None:
        """Orientation resets as stored."""
        self._G, self._A = self.memory.G_reset, self.memory.A_reset

    def _earth(self) -> F64:
        """What the heading's setting and the resets turn the earth by; (3, 3)."""
        return rotation_z(self.memory.heading_rad) @ self._G

    def _told(self, R_earth_sensor: F64) -> F64:
        """The orientation in the frames that settings and resets have made."""
        return np.asarray(self._earth() @ R_earth_sensor @ self._A.T)

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
            self._A = turn.T @ R @ self._A
        if code in (1, 4):
            self._G = turn.T @ self._G
        if code == 2:
            offset = rotation_z(self.memory.heading_rad)
            self._G = offset.T @ R.T @ offset @ self._G
        return b""

    def _sample(self, t_s: float, fine: int) -> Sample:
        """All that can be measured at an instant of the host's clock."""
        R_true, rate_radps, accel_mps2 = self._motion_at(t_s)
        noise = self._noise.standard_normal((4, 3))
        field = self.earth_field
        if self.distortion_at is not _undisturbed:
            field = self.distortion_at(t_s) @ field
        believed = self._believed(R_true, accel_mps2, t_s)
        pulled_rad = self._pulled_by(field, t_s)
        sigmas, accel_off, rate_off = self._wrong_by()
        R, vectors, clipped = told(
            R_true, believed, accel_mps2, rate_radps, field, pulled_rad,
            sigmas, noise, accel_off, rate_off, FULL, self._earth(), self._A,
        )  # fmt: skip
        bad = math.nan if self.nan else 0.0
        if self.nan or self.yaw_jump_rad:
            R, vectors = rotation_z(self.yaw_jump_rad) @ R + bad, vectors + bad
        return Sample(
            R_earth_sensor=R,
            rate_radps=vectors[1],
            accel_mps2=vectors[0],
            magnetic=vectors[2],
            temperature_deg=self.temperature_deg + bad,
            status=self._status(t_s, clipped),
            counter=self.counter,
            fine=fine,
            preamble=self.fa_ff,
        )

    def _believed(self, R_earth_sensor: F64, accel_mps2: F64, t_s: float) -> F64:
        """What the sensor takes the truth for, but for steel."""
        if not self.sheet_errors:
            return R_earth_sensor
        self._errors.goes_on(t_s, R_earth_sensor, accel_mps2)
        return self._errors.orientation(R_earth_sensor)

    def _wrong_by(self) -> tuple[Sigmas, F64, F64]:
        """Noise (1 sigma) of each kind; biases (3,) of acceleration and rate."""
        accel, rate, magnetic = self.accel_noise_mps2, self.rate_noise_radps, self.magnetic_noise
        accel_off, rate_off = self.accel_bias_mps2, self.rate_bias_radps
        if self.sheet_errors:
            accel, rate = max(accel, ACCEL_NOISE_MPS2), max(rate, RATE_NOISE_RADPS)
            accel_off = accel_off + self._errors.accel_bias_mps2
            rate_off = rate_off + self._errors.rate_bias_radps
        return (self.angle_noise_rad, accel, rate, magnetic), accel_off, rate_off

    def _pulled_by(self, field: F64, t_s: float) -> float:
        """By how much the yaw is off: it follows the magnetic north of a field (3,), slowly.

        Where the field is turned to the left, the sensor takes itself for turned to the right.
        """
        wrong_rad = 0.0
        if field is not self.earth_field:
            north, ours = (math.atan2(part[1], part[0]) for part in (field, self.earth_field))
            wrong_rad = math.remainder(ours - north, math.tau)
        gone_s = max(0.0, t_s - self._pulled_at_s)  # at first for ever: it has stood here
        share = 1.0 - math.exp(-gone_s / self.pull_s)
        self._pulled_rad += share * math.remainder(wrong_rad - self._pulled_rad, math.tau)
        self._pulled_at_s = max(t_s, self._pulled_at_s)
        return self._pulled_rad

    def _status(self, t_s: float, clipped: int) -> int:
        """The status word, with the clip bits: acc xyz, gyr xyz, mag xyz."""
        word = VALID_BIT | (SELF_TEST_BIT if self.self_test == 0x01FF else 0)
        word |= STILL_BITS if t_s < self._still_until_s else 0
        return word | clipped << CLIP_SHIFT | (ANY_CLIP_BIT if clipped else 0)


def _undisturbed(t_s: float) -> F64:
    return np.eye(3)
