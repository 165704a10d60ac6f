"""What a fake MTi measures: the truth with noise, biases and limits, in the frames it was told.

Source: MTi sheet, sections 3 to 7.
"""

import math
from collections.abc import Callable

import numpy as np

from fakes.mti.errors import ACCEL_NOISE_MPS2, RATE_NOISE_RADPS, SheetErrors
from fakes.mti.faults import Faults
from fakes.mti.kernels import times, told, turn_about, warm
from fakes.mti.memory import BAD_PARAMETER, Memory
from fakes.mti.messages import Sample
from fakes.wires.timing import F64
from fakes.world.rotations import rotation_z

Motion = Callable[[float], tuple[F64, F64, F64]]

FULL = np.array([50.0, math.radians(300.0), 3.0])  # acceleration m/s2, rate rad/s, field
SELF_TEST_BIT, VALID_BIT = 0x1, 0x2
STILL_BITS = 0x18  # no-rotation update is running
ANY_CLIP_BIT, CLIP_SHIFT = 1 << 19, 8


class Sensor:
    """The measuring side of a fake, of which it takes faults and settings.

    Args:
        motion_at: see FakeMti.
    """

    def __init__(self, faults: Faults, memory: Memory, motion_at: Motion, seed: int) -> None:
        self.still_until_s = -math.inf  # host clock, end of a no-rotation update
        self._faults, self._memory, self._motion_at = faults, memory, motion_at
        self._pulled_rad = 0.0  # by which the yaw is off
        self._pulled_at_s = -math.inf
        self._noise = np.random.default_rng(seed)
        self._errors = SheetErrors(seed)
        self.forget_resets()
        warm()

    def forget_resets(self) -> None:
        """Orientation resets as stored."""
        self._G, self._A = self._memory.G_reset, self._memory.A_reset  # as now; see Memory

    def reset_orientation(self, now_s: float, code: int, in_config: bool) -> bytes | int:
        """1 heading, 2 global, 3 object, 4 both 3 and 1, 5 to 7 their defaults; 0 stores."""
        memory, model = self._memory, self._memory.model
        codes = (0, 1, 2, 3, 4) if model.legacy else (0, 1, 3, 4, 5, 6, 7)
        if (code == 0) is not in_config or code not in codes:
            return BAD_PARAMETER
        if model.legacy and model.gnss and code in (1, 4):  # no heading reset
            return BAD_PARAMETER
        if code == 0:
            memory.G_reset, memory.A_reset = self._G, self._A
        if code in (5, 7):
            self._G = np.eye(3)
        if code in (6, 7):
            self._A = np.eye(3)
        R = rotation_z(self._pulled_rad) @ self._motion_at(now_s)[0]
        R = self._earth() @ R @ self._A.T
        turn = rotation_z(math.atan2(R[1, 0], R[0, 0]))
        if code in (3, 4):
            self._A = turn.T @ R @ self._A
        if code in (1, 4):
            self._G = turn.T @ self._G
        if code == 2:
            offset = rotation_z(memory.heading_rad)
            self._G = offset.T @ R.T @ offset @ self._G
        return b""

    def sample(self, t_s: float, fine: int = 0) -> Sample:
        faults = self._faults
        R_true, rate_radps, accel_mps2 = self._motion_at(t_s)
        noise = self._noise.standard_normal((4, 3))
        field = faults.earth_field
        if faults.distortion_at is not None:
            field = faults.distortion_at(t_s) @ field
        R_believed, accel_off, rate_off = R_true, faults.accel_bias_mps2, faults.rate_bias_radps
        accel_noise, rate_noise = faults.accel_noise_mps2, faults.rate_noise_radps
        if faults.sheet_errors:
            self._errors.goes_on(t_s, R_true, accel_mps2)
            R_believed = self._errors.orientation(R_true)
            accel_off = accel_off + self._errors.accel_bias_mps2
            rate_off = rate_off + self._errors.rate_bias_radps
            accel_noise = max(accel_noise, ACCEL_NOISE_MPS2)
            rate_noise = max(rate_noise, RATE_NOISE_RADPS)
        sigmas = (faults.angle_noise_rad, accel_noise, rate_noise, faults.magnetic_noise)
        if faults.tilt_off_rad.any():
            roll_rad, pitch_rad = faults.tilt_off_rad.tolist()
            R_believed = times(R_believed, turn_about(roll_rad, pitch_rad, 0.0))
        R, vectors, clipped = told(
            R_true, R_believed, accel_mps2, rate_radps, field, self._pulled_by(field, t_s),
            sigmas, noise, accel_off, rate_off, FULL, self._earth(), self._A,
        )  # fmt: skip
        bad = math.nan if faults.nan else 0.0
        if faults.nan or faults.yaw_jump_rad:
            R, vectors = rotation_z(faults.yaw_jump_rad) @ R + bad, vectors + bad
        return Sample(
            R_earth_sensor=R,
            rate_radps=vectors[1],
            accel_mps2=vectors[0],
            magnetic=vectors[2],
            temperature_deg=faults.temperature_deg + bad,
            status=self._status(t_s, clipped),
            counter=faults.counter,
            fine=fine,
            preamble=faults.fa_ff,
        )

    def _earth(self) -> F64:
        """What the heading's setting and the resets turn the earth by; (3, 3)."""
        return rotation_z(self._memory.heading_rad) @ self._G

    def _pulled_by(self, field: F64, t_s: float) -> float:
        """By how much the yaw is off: it follows the magnetic north of a field (3,), slowly.

        Where the field is turned to the left, the sensor takes itself for turned to the right.
        """
        wrong_rad, true_field = 0.0, self._faults.earth_field
        if field is not true_field:
            north, ours = (math.atan2(part[1], part[0]) for part in (field, true_field))
            wrong_rad = math.remainder(ours - north, math.tau)
        gone_s = max(0.0, t_s - self._pulled_at_s)  # at first for ever: it has stood here
        share = 1.0 - math.exp(-gone_s / self._faults.pull_s)
        self._pulled_rad += share * math.remainder(wrong_rad - self._pulled_rad, math.tau)
        self._pulled_at_s = max(t_s, self._pulled_at_s)
        return self._pulled_rad

    def _status(self, t_s: float, clipped: int) -> int:
        """The status word, with the clip bits: acc xyz, gyr xyz, mag xyz."""
        word = VALID_BIT | (SELF_TEST_BIT if self._faults.self_test == 0x01FF else 0)
        word |= STILL_BITS if t_s < self.still_until_s else 0
        return word | clipped << CLIP_SHIFT | (ANY_CLIP_BIT if clipped else 0)
