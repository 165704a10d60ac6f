"""What a Kinect's sensor makes of a world: raw 11-bit values, with the gaps that are its own.

    raw = 4 ((e - r e / z) / p + 0.375) + 4 s       rounded: so far apart are its depths

Its projector stands to the right of its camera: what it can't reach left of a near thing is a
shadow. So are the image's right rim, what is too near, what is black and far, and what is seen
flat. Left out: sunlight, glass, the lens's distortion.
Source: kinect sheet, sections 1 and 2; shares and noise are ours.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fakes.kinect.faults import Faults
from fakes.rays.kernels import BLACK
from fakes.rays.sight import Met
from fakes.wires.timing import F64
from fakes.world.rotations import rotation_y

U16 = npt.NDArray[np.uint16]
Sight = Callable[[float, F64, F64], Met]  # instant, rays' begins and ways (n, 3) in the body
E_CM, R_CM, P_CM, SHIFT = 7.5, 120.0, 0.1042, 200.0  # emitter, reference, pixel, constant shift
NO_RAW = 2047
RIM_COLUMNS = 8
LEAST_M, MOST_M, MOST_BLACK_M = 0.4, 9.7, 2.0
FLAT_COS = 0.08
NOISE_RAW = 0.25  # 1 sigma, before it is rounded


class Lens(NamedTuple):
    """What the pixels see."""

    size_px: tuple[int, int] = (640, 480)
    focal_px: tuple[float, float] = (580.0, 580.0)
    centre_px: tuple[float, float] = (319.5, 239.5)


def ways_of(lens: Lens, tilt_deg: float) -> F64:
    """(rows * columns, 3) of unit length, row by row, of a camera that looks down so much."""
    (w, h), (fx, fy), (cx, cy) = lens
    columns, rows = np.meshgrid(np.arange(w, dtype=float), np.arange(h, dtype=float))
    ways = np.stack([np.ones_like(columns), -(columns - cx) / fx, -(rows - cy) / fy], axis=2)
    ways = ways.reshape(-1, 3) / np.linalg.norm(ways.reshape(-1, 3), axis=1)[:, None]
    return np.ascontiguousarray(ways @ rotation_y(math.radians(tilt_deg)).T)


def raw_of_depths(depths_m: F64) -> F64:
    """Raw values of depths along the axis, not rounded."""
    m_cm = E_CM - R_CM * E_CM / (100.0 * depths_m)
    return np.asarray(4.0 * (m_cm / P_CM + 0.375) + 4.0 * SHIFT)


class Picture(NamedTuple):
    """One frame, each (rows, columns)."""

    raw: U16
    truth_m: F64  # along the optical axis; inf: nothing is met


class Sensor:
    """Lens and sensor.

    Args:
        sight: what rays meet.
    """

    def __init__(self, faults: Faults, lens: Lens, sight: Sight, seed: int) -> None:
        self._faults, self._sight, self.lens = faults, sight, lens
        self._random = np.random.default_rng([seed, 23])
        self._ways: tuple[float, F64] | None = None  # tilt, and the ways that it makes

    def picture(self, t_s: float) -> Picture:
        """What it sees at an instant."""
        faults, (w, h) = self._faults, self.lens.size_px
        if self._ways is None or self._ways[0] != faults.tilt_deg:
            self._ways = faults.tilt_deg, ways_of(self.lens, faults.tilt_deg)
        ways, axis = self._ways[1], rotation_y(math.radians(faults.tilt_deg))[:, 0]
        met = self._sight(t_s, np.broadcast_to(np.array(faults.mount_m), ways.shape), ways)
        depths_m = np.asarray(met.ranges_m) * (ways @ axis)
        cosines = np.abs((met.normals * met.ways).sum(axis=1))  # both of the map frame
        is_seen = (depths_m >= LEAST_M) & (depths_m <= MOST_M) & (cosines >= FLAT_COS)
        is_seen &= (met.materials != BLACK) | (depths_m <= MOST_BLACK_M)
        depths_m = depths_m.reshape(h, w)
        is_seen = is_seen.reshape(h, w) & self._is_lit(depths_m)
        is_seen[:, -RIM_COLUMNS:] = False
        noise = NOISE_RAW * faults.noise * self._random.standard_normal((h, w))
        with np.errstate(divide="ignore"):
            raw = np.rint(raw_of_depths(np.where(is_seen, depths_m, 1.0)) + noise)
        is_seen &= (raw >= 0) & (raw < NO_RAW)
        if faults.all_invalid:
            is_seen[:] = False
        return Picture(np.where(is_seen, raw, NO_RAW).astype(np.uint16), depths_m)

    def _is_lit(self, depths_m: F64) -> npt.NDArray[np.bool_]:
        """Whether the projector reaches it: nothing nearer is in the way, in its own row."""
        at = np.arange(depths_m.shape[1]) - self.lens.focal_px[0] * E_CM / 100.0 / depths_m
        first = np.minimum.accumulate(at[:, ::-1], axis=1)[:, ::-1]
        return np.asarray(at <= first + 1.0)
