"""What the fake camera sees at an instant, as the three maps of a frame.

Rays go out at every few pixels. Where four of them meet one plane, what is between is that plane;
elsewhere each pixel has its ray. So a thing that is thinner than that, before a plane, may be
missed: `every_px` = 1 misses none.

Left out: a lens out of focus, sunlight, light that was returned more than twice, the exact shape of
phase errors. All its numbers are ours: no sheet tells them.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fakes.rays.kernels import I64
from fakes.rays.sight import Met
from fakes.visionary.faults import Faults
from fakes.visionary.lens import Lens, axis_of, ways_of
from fakes.visionary.models import Kind
from fakes.visionary.sensing import BLOCK_PX, U16, fill_planes, light_of, second_ways, sense
from fakes.wires.timing import F64

Sight = Callable[[float, F64, F64], Met]  # instant, rays' begins and ways (n, 3) in the body
CHANCES = 1 << 20
U8 = npt.NDArray[np.uint8]


class Maps(NamedTuple):
    """One picture, row by row from the top left; each (rows, columns)."""

    raw: U16
    colour: U16
    third: U16
    truth_m: F64  # ranges from the lens; inf: nothing is met


class Pixels(NamedTuple):
    """What each pixel meets, (n,)."""

    far: F64
    normals: F64  # (n, 3) body frame, as the rays' ways
    solids: I64
    materials: I64


class Camera:
    """Lens and sensor.

    Args:
        sight: what rays meet.
    """

    def __init__(self, faults: Faults, kind: Kind, sight: Sight, seed: int) -> None:
        self._faults, self._kind, self._sight, self._seed = faults, kind, sight, seed
        self._random = np.random.default_rng([seed, 17])
        self._chance = self._random.standard_normal(CHANCES).astype(np.float32)
        self._ways: tuple[object, F64] | None = None  # lens and tilt, and their ways

    def maps(self, t_s: float, lens: Lens) -> Maps:
        """What it sees around an instant, the middle of its exposure."""
        faults, kind = self._faults, self._kind
        key = lens, faults.tilt_deg
        if self._ways is None or self._ways[0] != key:
            self._ways = key, ways_of(lens, faults.tilt_deg)
        ways, axis = self._ways[1], axis_of(faults.tilt_deg)
        begin = np.array(faults.mount_m) - axis * kind.away_mm / 1000.0
        met = self._met(t_s - faults.exposure_s / 2, lens, begin, ways)
        after = met.far
        if faults.exposure_s > 0.0:
            after = self._met(t_s + faults.exposure_s / 2, lens, begin, ways).far
        n, (w, h) = len(ways), lens.size_px
        light = np.empty(n)
        light_of(
            *(met.far, met.normals, met.solids, met.materials, ways),
            *(float(faults.reflectivity), float(faults.shiny_share), self._seed, light),
        )
        if faults.standby or faults.all_invalid:
            light[:] = 0.0
        longer = np.zeros((-(-h // BLOCK_PX), -(-w // BLOCK_PX)))
        if faults.multipath:
            second_ways(w, h, met.far, met.normals, ways, longer)
        raw, colour, third = (np.empty(n, np.uint16) for _ in range(3))
        sense(
            *(met.far, after, met.solids, longer, light, ways, axis, w, kind.is_planar),
            *(kind.unit_mm / 1000.0, float(faults.noise), float(faults.flying)),
            *(float(faults.multipath), float(faults.ambiguity_m), float(faults.least_amplitude)),
            *(kind.has_states, self._chance, int(self._random.integers(CHANCES))),
            *(raw, colour, third),
        )
        one, two, three = (number.reshape(h, w) for number in (raw, colour, third))
        return Maps(one, two, three, met.far.reshape(h, w))

    def _met(self, t_s: float, lens: Lens, begin: F64, ways: F64) -> Pixels:
        n, every, (w, h) = len(ways), int(self._faults.every_px), lens.size_px
        met = Pixels(np.empty(n), np.zeros((n, 3)), np.empty(n, np.int64), np.empty(n, np.int64))
        todo, count = np.arange(n, dtype=np.int64), n
        if every > 1:
            rows, columns = _steps(h, every), _steps(w, every)
            grid = (rows[:, None] * w + columns).ravel()
            coarse = self._seen(t_s, begin, ways[grid])
            shape = len(rows), len(columns)
            count = fill_planes(
                coarse.ranges_m.reshape(shape),
                coarse.normals.reshape(*shape, 3),
                coarse.solids.reshape(shape),
                coarse.materials.reshape(shape),
                *(every, w, h),
                ways,
                *(met.far, met.normals),
                *(met.solids, met.materials, todo),
            )
        if count:
            others = todo[:count]
            fine = self._seen(t_s, begin, ways[others])
            met.far[others], met.normals[others] = fine.ranges_m, fine.normals
            met.solids[others], met.materials[others] = fine.solids, fine.materials
        return met

    def _seen(self, t_s: float, begin: F64, ways: F64) -> Met:
        """What rays (n, 3) meet, with the normals in the body frame."""
        axes = self._sight(t_s, np.broadcast_to(begin, (3, 3)), np.eye(3)).ways  # in the map
        met = self._sight(t_s, np.broadcast_to(begin, ways.shape), ways)
        return met._replace(normals=np.ascontiguousarray(met.normals @ axes.T))


def _steps(size: int, every: int) -> I64:
    """Every so many pixels, and the last one."""
    return np.append(np.arange(math.ceil((size - 1) / every)) * every, size - 1)
