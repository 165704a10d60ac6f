"""Beams through what is no plain solid: glass, black floor, soft things; crossings in general."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st

from fakes.rays.rays import SECOND_SHARE
from fakes.scenes.movers import box, person
from fakes.scenes.scene import Scene, Solid
from fakes.scenes.solids import BLACK, GLASS, Shape, soft
from fakes.world.kinematic import KinematicWorld
from fakes.world.trajectory import Trajectory, Way, held, straight
from fakes.world.world import World
from tests.support.robot.flat_floor import F64, FLOOR, LENS_X_M, SWEEP_RAD, TILT

WALL = Solid("wall", (6.0, 6.2), (-15.0, 15.0), (0.0, 3.0))
LEVEL = held(pitch_rad=-TILT)  # the scan plane is level
UNITS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: sum(abs(p) for p in v) > 0.1)


def sweep(*solids: Shape, trajectory: Trajectory = LEVEL, t_s: float = 100.0, seed: int = 1) -> F64:
    """What a sweep at one instant sees of a floor and more."""
    world = KinematicWorld(Scene("some", (FLOOR, *solids)), trajectory, seed=seed)
    world.step_to(100.0)
    world.step_to(t_s)
    return world.ranges_m(np.full(481, t_s), SWEEP_RAD)


def test_glass_returns_only_beams_that_meet_it_nearly_at_a_right_angle() -> None:
    pane = Solid("pane", (3.0, 3.01), (-15.0, 15.0), (0.0, 3.0), material=GLASS)
    ranges = sweep(pane, WALL)
    steep = np.abs(SWEEP_RAD) < math.radians(9.9)
    flat = np.abs(SWEEP_RAD) > math.radians(10.1)
    c = np.cos(SWEEP_RAD)
    np.testing.assert_allclose(ranges[steep], (3.0 - LENS_X_M) / c[steep], atol=1e-6)
    np.testing.assert_allclose(ranges[flat], (6.0 - LENS_X_M) / c[flat], atol=1e-6)


def test_behind_glass_that_lets_it_through_a_beam_can_meet_another_pane_rightly() -> None:
    """Two panes that make a corner: the oblique one shows the other one behind it."""
    ahead = Solid("ahead", (3.0, 3.01), (-0.1, 6.0), (0.0, 3.0), material=GLASS)
    aside = Solid("aside", (2.0, 9.0), (6.0, 6.01), (0.0, 3.0), material=GLASS)
    turned = held(pitch_rad=0.0, place=(0.0, 0.0, math.radians(85.0)))
    world = KinematicWorld(Scene("some", (FLOOR, ahead, aside)), turned)
    world.step_to(0.0)
    bearing = -math.radians(33.0)  # to the right: oblique to both
    [far] = world.ranges_m(np.zeros(1), np.array([bearing]))
    [right] = world.ranges_m(np.zeros(1), np.array([math.radians(-2.0)]))
    assert far == pytest.approx(1.08 / math.sin(TILT) / math.cos(bearing), abs=1e-6)
    assert right > 5.0


def test_black_floor_returns_nothing_from_beyond_three_metres() -> None:
    black = Solid("black", (-15.0, 15.0), (-15.0, 15.0), (0.0, 0.001), material=BLACK)
    box_near = Solid("box", (2.0, 2.5), (-0.3, 0.3), (0.0, 1.5))
    ranges = sweep(black, box_near, trajectory=held())
    met = np.abs(SWEEP_RAD) < math.radians(8.0)
    assert np.isfinite(ranges[met]).all()
    assert np.isnan(ranges[np.abs(SWEEP_RAD) > math.radians(12.0)]).all()
    steep = sweep(black, trajectory=held(pitch_rad=math.radians(25.0)))
    z, down = 1.08 * math.cos(math.radians(25)) - 0.25 * math.sin(math.radians(25)), 32.5
    expected = z / math.sin(math.radians(down)) / np.cos(SWEEP_RAD)
    near = expected < 2.99
    np.testing.assert_allclose(steep[near], expected[near] - 0.002, atol=2e-3)
    assert near.sum() > 100
    assert np.isnan(steep[expected > 3.01]).all()


def test_what_is_black_hides_what_is_behind_it_and_a_person_before_it_is_seen() -> None:
    black = Solid("black", (4.0, 4.1), (-15.0, 15.0), (0.0, 3.0), material=BLACK)
    assert np.isnan(sweep(black, WALL)).all()
    for x, is_seen in ((3.5, True), (5.0, False)):
        walker = person("stands", ((x, 0.0),), legs=False)
        world = KinematicWorld(Scene("some", (FLOOR, black), movers=(walker,)), LEVEL)
        world.step_to(0.0)
        [ahead] = world.ranges_m(np.zeros(1), np.zeros(1))
        assert np.isfinite(ahead) == is_seen
        assert not is_seen or ahead == pytest.approx(x - 0.22 - LENS_X_M)


def test_in_soft_things_beams_end_at_depths_as_random_as_stalks_stand() -> None:
    """The mean depth is one over the density; each sweep and each seed meets other stalks."""
    density = 4.0
    hedge = Solid("hedge", (3.0, 9.0), (-15.0, 15.0), (0.0, 3.0), material=soft(density))
    world = KinematicWorld(Scene("some", (FLOOR, hedge)), LEVEL, seed=5)
    world.step_to(100.0)
    world.step_to(101.0)

    def depths_m() -> F64:
        sweeps = [
            world.ranges_m(np.full(481, t_s), SWEEP_RAD)[0]
            for t_s in (100.0 + np.arange(20) / 50).tolist()
        ]
        return np.array(sweeps) - (3.0 - LENS_X_M) / np.cos(SWEEP_RAD)

    depths = depths_m()
    assert (depths > 0.0).all()
    assert depths.mean() == pytest.approx(1.0 / density, rel=0.03)
    assert depths.std() == pytest.approx(1.0 / density, rel=0.06)
    assert (depths[0] != depths[1]).all()
    world.step_to(105.0)
    np.testing.assert_array_equal(depths, depths_m())  # whenever asked
    assert (sweep(hedge)[0] != sweep(hedge, seed=2)[0]).all()


def test_beams_that_pass_the_stalks_show_what_is_behind_and_some_show_both() -> None:
    density, thick_m = 2.0, 0.4
    curtain = Solid("curtain", (3.0, 3.0 + thick_m), (-15, 15), (0.0, 3.0), material=soft(density))
    first, second = sweep(curtain, WALL)
    c = np.cos(SWEEP_RAD)
    entry_m, exit_m, wall_m = ((x - LENS_X_M) / c for x in (3.0, 3.0 + thick_m, 6.0))
    passed = np.abs(first - wall_m) < 1e-6
    assert passed.mean() == pytest.approx(np.exp(-density * thick_m / c).mean(), abs=0.06)
    assert ((first > entry_m) & (first < exit_m) | passed).all()
    assert np.isnan(second[passed]).all()
    twice = np.isfinite(second)
    assert (second[twice] > first[twice]).all()
    assert twice.sum() / (~passed).sum() == pytest.approx(SECOND_SHARE, abs=0.08)
    behind = np.abs(second - wall_m) < 1e-6
    assert behind[twice].mean() > 0.5
    assert (second[twice & ~behind] < exit_m[twice & ~behind]).all()


@pytest.mark.parametrize("kind", [World, KinematicWorld])
def test_both_worlds_know_all_materials_and_movers(kind: type[World | KinematicWorld]) -> None:
    pane = Solid("pane", (3.0, 3.01), (-1.0, 1.0), (0.0, 3.0), material=GLASS)
    grass = Solid("grass", (1.0, 4.0), (-3.0, 3.0), (0.0, 0.1), material=soft(3.0))
    scene = Scene("some", (FLOOR, WALL, pane, grass), movers=(box("b", (2, 3), (1, 2), (0, 2)),))
    world = World(scene, 1) if kind is World else KinematicWorld(scene, Way(straight(1.0, 0.5)))
    world.step_to(10.0)
    world.step_to(10.5)
    first, _ = world.ranges_m(np.full(3, 10.4), np.radians([0.0, 12.0, 34.0]))
    assert first[0] == pytest.approx(2.75 / math.cos(TILT), abs=0.05)
    assert first[1] == pytest.approx(5.75 / math.cos(math.radians(12)) / math.cos(TILT), abs=0.1)
    assert first[2] == pytest.approx(1.75 / math.cos(math.radians(34)) / math.cos(TILT), abs=0.1)
    assert world.height_at([2.5], [1.5])[0] == 2.0
