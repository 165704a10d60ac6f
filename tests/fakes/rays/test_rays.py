"""The rays against MuJoCo's own, over shipped and random scenes; and against slow formulas."""

import math
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import pytest

from fakes.rays.beam_kernels import FAR_M, Beams, aims_of, echoes_of_beams, horizon_of
from fakes.rays.rays import GLASS_COS, Rays
from fakes.rays.targets import MODEL, targets_from
from fakes.scenes.scene import SCENES, Scene, Solid, load_scene
from fakes.scenes.solids import Pillar, Shape, bump, mjcf_from_solids
from fakes.world.kernels import pose_at, poses_at, row_at
from fakes.world.robot import LENS_TILT_DEG
from fakes.world.rotations import R_from_angles, rotation_y
from tests.support.cases import few

F64 = npt.NDArray[np.float64]
mj: Any = mujoco
SWEEP_RAD = np.radians(np.linspace(-135.0, 135.0, 541))
MIDDLE = np.zeros((1, 4))
GROUND = Solid("ground", (-40.0, 40.0), (-40.0, 40.0), (-1.0, 0.0))
GRAZED_M = 1e-4  # a ray that passes an edge nearer than this may meet it or not


class MujocoRays:
    """The peer: MuJoCo's multi-ray, one call a beam."""

    def __init__(self, solids: list[Shape]) -> None:
        assets, geoms = mjcf_from_solids(solids)
        self._model = mj.MjModel.from_xml_string(MODEL.format(assets=assets, geoms=geoms))
        self._data = mj.MjData(self._model)
        mj.mj_forward(self._model, self._data)

    def meet(self, begins: F64, ways: F64) -> tuple[F64, npt.NDArray[np.int32]]:
        """Ranges (n,), inf where nothing is, and solids (n,), of rays (n, 3)."""
        n = len(ways)
        ranges, met = np.empty(n), np.empty(n, dtype=np.int32)
        groups = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
        for k in range(n):
            mj.mj_multiRay(
                self._model, self._data, begins[k], ways[k], groups, 1, -1,
                met[k : k + 1], ranges[k : k + 1], None, 1, FAR_M,
            )  # fmt: skip
        return np.where((ranges < 0) | (ranges > FAR_M), np.inf, ranges), met


def beams_at(place: tuple[float, float], angles: tuple[float, float, float]) -> Beams:
    """A sweep of a robot that turns and drives meanwhile."""
    n = len(SWEEP_RAD)
    gone = np.linspace(0.0, 0.03, n)
    yaw, pitch, roll = angles
    R = R_from_angles(yaw + gone, np.full(n, pitch), np.full(n, roll))
    lens = np.column_stack([place[0] + gone, place[1] - gone, np.full(n, 1.08)])
    return Beams(
        lens, R, np.zeros(3), rotation_y(math.radians(LENS_TILT_DEG)), SWEEP_RAD, MIDDLE, 0.0
    )


def met_by_kernel(solids: list[Shape], beams: Beams) -> F64:
    """Ranges (n,) as the kernels have them, inf where nothing is."""
    zero = np.zeros(len(beams.bearings))
    targets = targets_from(solids)
    nobody = Rays(Scene("empty", ()), 1)._passers.between(0.0, 0.0)
    echoes, _ = echoes_of_beams(beams, zero, targets, nobody, GLASS_COS, False)
    return np.asarray(echoes[0])


def random_solids(seed: int, count: int = 60) -> list[Shape]:
    """Boxes, shelves, ramps, pillars and bumps all over the place, none where the lens is."""
    random = np.random.default_rng(seed)
    solids: list[Shape] = []
    while len(solids) < count:
        x, y = random.uniform(-15.0, 15.0, 2).tolist()
        if math.hypot(x, y) < 4.5:
            continue
        long, wide, low = random.uniform([0.05, 0.05, 0.0], [2.0, 2.0, 0.8]).tolist()
        spans = (x, x + long), (y, y + wide)
        rises = random.uniform(-0.3, 0.3, 2).tolist()
        name = f"solid {len(solids)}"
        solids.append(
            (
                Solid(name, *spans, (0.0, low + 0.05)),
                Solid(name, *spans, (low, low + random.uniform(0.02, 2.0))),
                Solid(name, *spans, (-2.0, low), *rises),
                Pillar(name, (x, y), wide / 2, (low, low + long)),
                bump(name, *spans, 0.1 + 0.1 * wide, "x" if low > 0.4 else "y"),
            )[random.integers(5)]
        )
    return [*solids, GROUND]


def assert_same(solids: list[Shape], beams: Beams) -> None:
    begins, ways = (np.ascontiguousarray(part.T) for part in aims_of(beams)[:2])
    ours, (theirs, _) = met_by_kernel(solids, beams), MujocoRays(solids).meet(begins, ways)
    both = np.isfinite(ours) & np.isfinite(theirs)
    differ = ~both & (np.isfinite(ours) | np.isfinite(theirs))
    differ[both] = np.abs(ours[both] - theirs[both]) > 1e-5
    same = both & ~differ
    exact = np.abs(ours[same] - theirs[same])
    assert both.sum() > 100
    assert np.median(exact) < 1e-9
    for k in np.nonzero(differ)[0]:  # only what a hair's breadth decides may differ
        assert is_grazing(solids, begins[k], ways[k]), (k, ours[k], theirs[k])
    assert differ.sum() <= 3


def is_grazing(solids: list[Shape], begin: F64, way: F64) -> bool:
    """Whether rays a tenth of a millimetre beside this one meet something else than each other."""
    side, up = np.cross(way, [0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
    begins = begin + GRAZED_M * np.stack([0 * up, side, -side, up, -up])
    ranges = MujocoRays(solids).meet(begins, np.repeat(way[None], 5, axis=0))[0]
    return bool(np.ptp(np.minimum(ranges, 2 * FAR_M)) > 1e-3)


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_in_shipped_scenes_beams_meet_what_mujocos_rays_meet(path: Any) -> None:
    scene = load_scene(path)
    solids = [s for s in scene.solids if s.material.kind == "plain"]
    for place, yaw in (((0.25, 0.0), 0.3), ((0.2, 0.0), -2.4)):
        assert_same(solids, beams_at(place, (yaw, 0.02, -0.01)))


@pytest.mark.parametrize("seed", few(range(8), 2))
def test_in_random_scenes_beams_meet_what_mujocos_rays_meet(seed: int) -> None:
    random = np.random.default_rng(seed + 100)
    solids = random_solids(seed)
    for _ in range(2):
        angles = random.uniform(-3.1, 3.1), *random.uniform(-0.15, 0.15, 2)
        assert_same(solids, beams_at(tuple(random.uniform(-1, 1, 2)), angles))
    if seed == 0:
        assert_same(solids, beams_at((0.0, 0.0), (0.0, 0.3, 1.5)))  # a robot that lies on its side


def test_beams_that_are_in_no_order_meet_the_same_as_in_order() -> None:
    solids, beams = random_solids(7), beams_at((0.0, 0.0), (0.5, 0.0, 0.0))
    order = np.random.default_rng(1).permutation(len(SWEEP_RAD))
    mixed = beams._replace(
        t_map_body=beams.t_map_body[order],
        R_map_body=beams.R_map_body[order],
        bearings=beams.bearings[order],
    )
    assert horizon_of(beams, aims_of(beams)).in_order
    assert not horizon_of(mixed, aims_of(mixed)).in_order
    np.testing.assert_array_equal(met_by_kernel(solids, mixed), met_by_kernel(solids, beams)[order])


def test_each_beam_leaves_from_the_pose_of_its_own_instant() -> None:
    """Turning at 1 rad/s the ranges to a wall are those of 541 single beams."""
    rays = Rays(Scene("wall", (GROUND, Solid("wall", (6.0, 6.2), (-30, 30), (0.0, 3.0)))), 1)
    times_s = np.linspace(0.0, 0.03, 541)

    def poses(at_s: F64) -> tuple[F64, F64]:
        zero = np.zeros(len(at_s))
        place = np.column_stack([at_s, zero, zero])
        return place, R_from_angles(at_s, zero, zero)

    whole = rays.ranges_m(poses, times_s, SWEEP_RAD, 0.0)
    single = [
        rays.ranges_m(poses, times_s[k : k + 1], SWEEP_RAD[k : k + 1], 0.0)[0]
        for k in range(0, 541, 20)
    ]
    np.testing.assert_allclose(whole[::20], single, atol=1e-12)


def test_the_poses_of_a_sweep_are_those_of_each_instant_alone() -> None:
    """Also before the oldest row that is kept and behind the newest, and across the ring's end."""
    ring = np.random.default_rng(3).normal(0.0, 1.0, (8, 15))
    for steps in (0, 5, 7, 8, 21):
        at_steps = np.linspace(-2.0, steps + 2.0, 40)
        places, turns = poses_at(ring, steps, at_steps)
        for k, step in enumerate(at_steps):
            row = row_at(ring, steps, step)
            np.testing.assert_array_equal(places[k], row[:3])
            turn, unit = np.empty(9), row[3:7] / np.linalg.norm(row[3:7])
            mj.mju_quat2Mat(turn, unit)
            np.testing.assert_allclose(turns[k], turn.reshape(3, 3), atol=1e-14)
            yaw, pitch, roll = (np.array([angle]) for angle in pose_at(row)[2:])
            np.testing.assert_allclose(turns[k], R_from_angles(yaw, pitch, roll)[0], atol=1e-14)
    np.testing.assert_array_equal(row_at(ring, 21, 20.0), ring[4])
    np.testing.assert_allclose(row_at(ring, 21, 19.5), (ring[3] + ring[4]) / 2, atol=1e-15)
    np.testing.assert_array_equal(row_at(ring, 21, 3.0), ring[14 % 8])
