"""What the scanner's beams meet in a scene, from wherever the lens is.

Solids that stand and return every beam are left to MuJoCo; what moves or lets beams through is met
in closed formulas, each beam at its own instant. The robot itself is in nobody's way.
"""

import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from fakes import robot
from fakes.crossings import Beams, across_box, across_cylinder
from fakes.rotations import rotation_y
from fakes.scene import Scene, mjcf_from_solids
from fakes.solids import Solid

F64 = npt.NDArray[np.float64]
mj: Any = mujoco  # compiled: it comes without types
GROUP = 8  # beams that share one pose: 0.2 ms of a sweep
FAR_M = 30.0  # a beam returns nothing from beyond
BLACK_REACH_M = 3.0  # nor from what is black, beyond this
GLASS_COS = math.cos(math.radians(10.0))  # glass returns a beam that is nearer to a right angle
SECOND_SHARE = 0.6  # of the beams that end on a stalk and return from what is behind it, too
SCENE_ONLY = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)  # geom groups that beams hit
R_BODY_LENS = rotation_y(math.radians(robot.LENS_TILT_DEG))

Poses = Callable[[F64], tuple[F64, F64]]  # instants (m,) to t_map_body (m, 3), R_map_body (m, 3, 3)

MODEL = """
<mujoco>
  <default><default class="scene"><geom group="0"/></default></default>
  <asset>{assets}</asset>
  <worldbody>{geoms}</worldbody>
</mujoco>
"""


class Rays:
    """Beams through a scene. The same beams at the same instants meet the same, whenever asked.

    Args:
        seed: of what they meet in soft things.

    Raises:
        ValueError: glass or a soft thing is no upright box.
    """

    def __init__(self, scene: Scene, seed: int) -> None:
        solids = [s for s in scene.solids if s.material.kind in ("plain", "black")]
        assets, geoms = mjcf_from_solids(solids)
        self._model = mj.MjModel.from_xml_string(MODEL.format(assets=assets, geoms=geoms))
        self._data = mj.MjData(self._model)
        mj.mj_forward(self._model, self._data)
        self._black = np.array([*(s.material.kind == "black" for s in solids), False])  # -1: none
        self._boxes = {
            kind: [_box(s) for s in scene.solids if s.material.kind == kind]
            for kind in ("glass", "soft")
        }
        self._densities = [
            s.material.density_per_m for s in scene.solids if s.material.kind == "soft"
        ]
        self._movers, self._seed = scene.movers, seed
        self._only_plain = not (any(self._boxes.values()) or self._movers or self._black.any())

    def ranges_m(self, poses_at: Poses, times_s: F64, bearings_rad: F64, begin_s: float) -> F64:
        """What beams from the lens meet: metres, NaN where nothing is within 30 m.

        Args:
            poses_at: where the body is at an instant.
            times_s: (n,) instants, in order.
            bearings_rad: (n,) in the scan plane, from straight ahead, counter-clockwise.
            begin_s: the instant at which the movers' time is zero.

        Returns:
            (n,), or (2, n) with the second echoes of a scene that has soft things.
        """
        n = len(times_s)
        rays = np.zeros((n, 3))
        rays[:, 0], rays[:, 1] = np.cos(bearings_rad), np.sin(bearings_rad)
        rays = rays @ R_BODY_LENS.T
        starts = np.arange(0, n, GROUP)
        bodies, turns = poses_at(times_s[np.minimum(starts + GROUP // 2, n - 1)])
        distances, solids = np.empty(n), np.empty(n, dtype=np.int32)
        lenses_map, rays_map = np.empty((n, 3)), np.empty((n, 3))
        for start, t_map_body, R_map_body in zip(starts, bodies, turns, strict=True):
            some = slice(start, start + GROUP)
            rays_map[some] = rays[some] @ R_map_body.T
            lenses_map[some] = lens_map = t_map_body + R_map_body @ robot.LENS_BODY_M
            mj.mj_multiRay(
                self._model, self._data, lens_map, rays_map[some].ravel(), SCENE_ONLY, 1, -1,
                solids[some], distances[some], None, len(solids[some]), FAR_M,
            )  # fmt: skip
        if self._only_plain:
            distances[distances < 0] = np.nan
            return distances
        distances[distances < 0] = np.inf
        beams = Beams(lenses_map, rays_map)
        found = self._in_the_way(beams, times_s - begin_s, distances)
        echoes = self._among_stalks(beams, times_s, found) if self._boxes["soft"] else found
        swallowed = self._black[solids] & (distances > BLACK_REACH_M) & (echoes == distances)
        return np.where(swallowed | (echoes > FAR_M), np.nan, echoes)

    def _in_the_way(self, beams: Beams, since_begin_s: F64, found: F64) -> F64:
        """Where beams end (n,) that would go to found (n,), with movers and glass in the way."""
        for mover in self._movers:
            is_there = mover.is_there(since_begin_s)
            for part in mover.parts if is_there.any() else ():
                middles = mover.middles_m(part, since_begin_s)
                if part.half_m is None:
                    near_m = across_cylinder(beams, middles, part.radius_m, part.z)[0]
                else:
                    half = np.array(part.half_m)
                    low = np.column_stack([middles - half, np.full(len(middles), part.z[0])])
                    high = np.column_stack([middles + half, np.full(len(middles), part.z[1])])
                    near_m = across_box(beams, low, high)[0]
                found = np.where(is_there, np.minimum(found, near_m), found)
        for low, high in self._boxes["glass"]:
            near_m, _, cosine = across_box(beams, low, high)
            found = np.where(cosine > GLASS_COS, np.minimum(found, near_m), found)
        return found

    def _among_stalks(self, beams: Beams, times_s: F64, behind_m: F64) -> F64:
        """Echoes (2, n) where beams that would go to behind_m (n,) cross soft things."""
        begun = round(abs(float(times_s[0])) * 1e6)
        random = np.random.default_rng([self._seed, begun, len(times_s)])
        echoes = [behind_m]
        for (low, high), density in zip(self._boxes["soft"], self._densities, strict=True):
            enter_m, leave_m, _ = across_box(beams, low, high)
            depths_m = np.cumsum(random.exponential(1.0 / density, (2, len(times_s))), axis=0)
            stalks_m = enter_m + depths_m
            echoes += list(np.where(stalks_m < np.minimum(leave_m, behind_m), stalks_m, np.inf))
        first, second = np.sort(echoes, axis=0)[:2]
        second[random.random(len(times_s)) >= SECOND_SHARE] = np.inf
        return np.stack([first, second])


def _box(shape: object) -> tuple[F64, F64]:
    """Lowest and highest corner (3,) of what is glass or soft."""
    if not isinstance(shape, Solid) or shape.rise_rad or shape.rise_x_rad:
        raise ValueError("what is glass or soft must be an upright box")
    spans = np.array([shape.x, shape.y, shape.z])
    return spans[:, 0], spans[:, 1]
