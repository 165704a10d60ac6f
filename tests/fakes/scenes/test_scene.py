"""Scenes: their solids' tops and rays, their files, what moves in them by timetable."""

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.scenes.movers import STRIDE_M, Mover, person
from fakes.scenes.scene import Scene, Solid, load_scene
from fakes.scenes.solids import BLACK, GLASS, Pillar, Ridge, Shape, bump, soft
from fakes.world.kinematic import KinematicWorld
from fakes.world.magnetic import MagneticDisturbance
from fakes.world.slip import Slip
from fakes.world.trajectory import held
from tests.support.robot.flat_floor import FLOOR, TILT

AHEAD = np.zeros(1)  # bearing
SHAPES = (
    Solid("box", (5.0, 6.0), (-0.7, 0.9), (0.0, 0.4)),
    Solid("table", (4.5, 6.5), (-1.0, 1.0), (0.30, 0.33)),
    Solid("up", (4.0, 7.0), (-2.0, 2.0), (-0.5, 0.0), rise_x_rad=math.radians(8.0)),
    Solid("down", (4.0, 7.0), (-2.0, 2.0), (-0.5, 0.7), rise_x_rad=math.radians(-7.0)),
    Solid("both", (4.0, 7.0), (-2.0, 2.0), (-0.5, 0.1), math.radians(3.0), math.radians(5.0)),
    Pillar("pillar", (5.5, 0.1), 0.8, (0.0, 0.5)),
    bump("round", (5.0, 7.0), (-2.0, 2.0), 0.6),
    bump("lying across", (4.0, 7.0), (-0.4, 0.4), 0.6, along="y"),
)


def world_of(*solids: Shape, movers: tuple[Mover, ...] = ()) -> KinematicWorld:
    """A robot that stands at the origin of a floor with something on it, at 1000 s."""
    world = KinematicWorld(Scene("some", (FLOOR, *solids), movers=movers), held())
    world.step_to(1000.0)
    return world


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_beams_end_on_the_surface_that_the_heights_tell_of(shape: Shape) -> None:
    """Just before its end a beam is above the surface, or under a table; just behind, inside."""
    bearings = np.radians(np.linspace(-20.0, 20.0, 161))
    ranges = world_of(shape).ranges_m(np.full(161, 1000.0), bearings)
    ends = []
    for way_m in (ranges - 2e-3, ranges + 2e-3):
        ahead, left = way_m * np.cos(bearings), way_m * np.sin(bearings)
        x, y = 0.25 + ahead * math.cos(TILT), left
        z = 1.08 - ahead * math.sin(TILT)
        on_it = (z < shape.tops_m(x, y)) & (z > shape.bottom_m)
        ends.append(on_it | (z < 0.0))
    before, behind = ends
    assert behind.mean() > 0.96  # all but corners that a beam grazes
    assert before.mean() < 0.04
    met = (np.isfinite(ranges) & (ranges * np.cos(bearings) * math.sin(TILT) < 1.075)).sum()
    assert met > 20


@pytest.mark.parametrize("along", ["x", "y"])
def test_a_bump_begins_and_ends_on_the_floor_and_is_highest_in_the_middle(
    along: Literal["x", "y"],
) -> None:
    made = bump("bump", (1.0, 1.4), (1.0, 1.4), 0.05, along)
    way, beside = np.array([1.0, 1.1, 1.2, 1.3, 1.4]), np.full(5, 1.2)
    heights = made.tops_m(way, beside) if along == "x" else made.tops_m(beside, way)
    assert heights == pytest.approx([0.0, heights[1], 0.05, heights[1], 0.0], abs=1e-9)
    assert 0.035 < heights[1] < 0.039


def test_the_yard_holds_all_that_a_scene_can_hold() -> None:
    yard = load_scene("yard")
    kinds = {solid.material.kind for solid in yard.solids}
    assert kinds == {"plain", "glass", "black", "soft"}
    assert {type(solid) for solid in yard.solids} == {Solid, Pillar, Ridge}
    assert yard.waypoints[0] == (8.0, 0.0, 0.3)
    assert [mover.name.split()[0] for mover in yard.movers] == ["walks", "parcel"]
    assert yard.steels == (MagneticDisturbance("steel door", (22.0, -1.5), math.radians(40.0)),)
    assert yard.slips == (Slip(0.05, 0.05, 20.0, 30.0),)
    top_m = 3.0 * math.tan(math.radians(3.0))
    at_x = np.array([10.07, 13.06, 13.08, 16.07, 7.27, 5.5, 12.13])
    at_y = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.5, 2.37])
    expected = [0.0, top_m, top_m, 0.0, 0.05, 0.70, 3.0]
    np.testing.assert_allclose(yard.height_at(at_x, at_y), expected, atol=1e-3)
    np.testing.assert_allclose(yard.height_at([17.2, 17.2], [-1.8, -2.2]), 0.0)
    assert yard.height_at([17.2], [-1.8], 29.9)[0] == 0.4
    assert yard.height_at([17.2], [-1.8], 30.1)[0] == 0.0


@pytest.mark.parametrize("material", [GLASS, soft(2.0)])
def test_what_is_glass_or_soft_must_be_an_upright_box(material: object) -> None:
    wedge = Solid("a", (0.0, 1.0), (0.0, 1.0), (0.0, 1.0), 0.1, material=material)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="upright box"):
        world_of(wedge)


def test_wheels_roll_on_what_is_firm_and_near_and_stands_on_the_ground() -> None:
    solids = (
        FLOOR,
        Solid("table", (0.0, 1.0), (0.0, 1.0), (0.67, 0.70)),
        Solid("grass", (0.0, 1.0), (0.0, 1.0), (0.0, 0.1), material=soft(3.0)),
        Solid("mat", (0.0, 1.0), (0.0, 1.0), (0.0, 0.01), material=BLACK),
        Solid("far box", (9.0, 9.5), (0.0, 1.0), (0.0, 0.2)),
    )
    scene = Scene("some", solids)
    near = scene.ground_near(np.array([0.2, 0.5]), np.array([0.0, 0.0]))
    assert [solid.name for solid in near.solids] == ["floor", "mat"]
    assert [solid.name for solid in scene.firm] == ["floor", "table", "mat", "far box"]


WALK = person("walks", ((2.0, -3.0), (2.0, 3.0), (5.0, 3.0)), 1.5, start_s=4.0, legs=False)


@pytest.mark.parametrize(
    ("t_s", "x", "y"),
    [(0, 2, -3), (4, 2, -3), (5, 2, -1.5), (8, 2, 3), (9, 3.5, 3), (10, 5, 3), (99, 5, 3)],
)
def test_a_person_keeps_to_waypoints_speed_and_time(t_s: float, x: float, y: float) -> None:
    [middle] = WALK.middles_m(WALK.parts[0], np.array([float(t_s)]))
    np.testing.assert_allclose(middle, [x, y], atol=1e-12)


def test_legs_swing_against_each_other_and_stand_side_by_side_at_the_end() -> None:
    walk = person("walks", ((0.0, 0.0), (7.0, 0.0)), 1.0)
    body, left, right = walk.parts
    quarter_s = np.array([STRIDE_M / 4, 20.0])
    trunk, ahead, behind = (walk.middles_m(part, quarter_s) for part in (body, left, right))
    np.testing.assert_allclose(ahead - trunk, [[0.25, 0.1], [0.0, 0.1]], atol=1e-9)
    np.testing.assert_allclose(behind - trunk, [[-0.25, -0.1], [0.0, -0.1]], atol=1e-9)
    assert body.z == (0.85, 1.75)
    assert left.z == (0.0, 0.85)


def test_beams_see_a_person_at_their_own_instants() -> None:
    """Across the way, 4 m ahead: nobody, then his round body, then nobody."""
    walk = person("crosses", ((4.0, -3.0), (4.0, 3.0)), 1.5, start_s=1.0, legs=False)
    world = world_of(movers=(walk,))
    world.step_to(1010.0)
    floor_m = 1.08 / math.sin(TILT)
    times_s = 1000.0 + np.array([0.0, 2.8, 3.0, 3.2, 6.0])
    ranges = world.ranges_m(times_s, np.zeros(5))
    assert ranges[2] == pytest.approx((3.75 - 0.22) / math.cos(TILT), abs=1e-6)
    np.testing.assert_allclose(ranges[[0, 1, 3, 4]], floor_m, atol=1e-6)
    assert world.height_at([4.0], [0.0], 1003.0)[0] == 1.75
    assert world.height_at([4.0], [0.0], 1003.2)[0] == 0.0
    assert world.height_at([4.0], [0.0])[0] == 0.0  # now


@pytest.fixture(scope="module")
def walked() -> KinematicWorld:
    """A world in which somebody walks to and fro, after half a minute."""
    walk = person("walks", ((3.0, -3.0), (5.0, 3.0), (3.0, -3.0)), 0.8, returns=True)
    world = world_of(movers=(walk,))
    world.step_to(1030.0)
    return world


@given(t_s=st.floats(0.0, 30.0), bearing_deg=st.floats(-50.0, 50.0))
def test_whatever_moves_stands_where_its_height_is(
    walked: KinematicWorld, t_s: float, bearing_deg: float
) -> None:
    at_s, bearing = np.array([1000.0 + t_s]), np.radians([bearing_deg])
    way_m = walked.ranges_m(at_s, bearing)[0] + 1e-6  # just behind its end
    ahead, left = way_m * math.cos(bearing[0]), way_m * math.sin(bearing[0])
    x, z = 0.25 + ahead * math.cos(TILT), 1.08 - ahead * math.sin(TILT)
    assert z <= walked.height_at([x], [left], float(at_s[0]))[0]
