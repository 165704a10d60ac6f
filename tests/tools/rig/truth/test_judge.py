"""The judge against truths made by hand: what is a collision, what is not, what is a false stop."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.scenes.movers import person
from fakes.scenes.scene import Scene, load_scene
from fakes.scenes.solids import GLASS, PLAIN, Material, Pillar, Solid, bump, soft
from tests.support.robot.shipped import FLOOR
from tools.rig.truth.contact import OVERLAP_M, USUAL, Place, box_gap, disc_gap, outline, placed
from tools.rig.truth.judge import Judge, Truth
from tools.rig.truth.stops import Orders, StopWatch

WANTS, HELD = Orders(True, True, "", True), Orders(True, False, "an obstacle is in the way", True)
PERIOD_S = 0.02


def scene_of(*solids: Solid | Pillar, floor: bool = True) -> Scene:
    return Scene("made", (FLOOR, *solids) if floor else solids)


def driven(
    judge: Judge, x_m: float, to_m: float, v_mps: float = 0.5, y_m: float = 0.0, **truth: Any
) -> Judge:
    """Straight along x at a speed, from a place to a place, nose ahead."""
    since_s = judge.truth.since_s
    while x_m < to_m:
        judge.step(Truth(since_s, (x_m, y_m, 0.0), **truth))
        x_m, since_s = x_m + v_mps * PERIOD_S, since_s + PERIOD_S
    return judge


def standing(judge: Judge, seconds: float, x_m: float, people: np.ndarray | None = None) -> Judge:
    since_s = judge.truth.since_s
    for _ in range(round(seconds / PERIOD_S)):
        since_s += PERIOD_S
        judge.step(Truth(since_s, (x_m, 0.0, 0.0), people=people))
    return judge


def test_a_robot_driven_into_a_box_collides_once_with_the_speed_that_it_had() -> None:
    judge = driven(Judge(scene_of(Solid("box", (3.0, 3.5), (-0.5, 0.5), (0.0, 0.15)))), 0.0, 2.7)
    (contact,) = judge.collisions
    assert (contact.kind, contact.what) == ("thing", "box")
    assert contact.x_m == pytest.approx(3.0 - 0.52, abs=0.011)
    assert contact.speed_mps == pytest.approx(0.5, abs=0.01)
    assert not judge.bumps
    driven(judge, 2.6, 2.7, 0.05)
    assert len(judge.collisions) == 1  # it lasts
    driven(judge, 0.0, 2.7)
    assert len(judge.collisions) == 2


def test_a_robot_that_stops_short_of_it_or_passes_beside_does_not() -> None:
    box = Solid("box", (3.0, 3.5), (-0.5, 0.5), (0.0, 0.5))
    judge = driven(Judge(scene_of(box)), 0.0, 2.47)
    assert not judge.collisions
    assert judge.least_gap_m == pytest.approx(3.0 - 0.52 - 2.46, abs=0.011)
    assert judge.nearest == "box"
    judge = driven(Judge(scene_of(box)), 0.0, 6.0, y_m=0.85)
    assert not judge.collisions
    assert judge.least_gap_m == pytest.approx(0.05, abs=1e-6)


def thing(low_m: float, high_m: float, material: Material = PLAIN) -> Solid:
    return Solid("thing", (2.0, 3.0), (-1.0, 1.0), (low_m, high_m), material=material)


@pytest.mark.parametrize(
    ("solid", "collides"),
    [
        (thing(0.0, 0.10), False),  # too low to count
        (thing(0.0, 0.15), True),
        (thing(0.72, 0.75), True),  # a table top
        (thing(1.25, 1.40), True),
        (thing(1.40, 2.00), False),  # higher than the robot
        (thing(0.0, 0.4, soft(20.0)), False),  # grass
        (thing(0.0, 0.4, GLASS), True),
        (Pillar("leg", (2.0, 0.29), 0.015, (0.0, 0.45)), True),  # of a chair
        (bump("bump", (2.0, 2.6), (-2.0, 2.0), 0.05), False),
    ],
)
def test_what_counts_depends_on_heights_and_kind(solid: Solid | Pillar, collides: bool) -> None:
    assert bool(driven(Judge(scene_of(solid)), 0.0, 4.0).collisions) is collides


def ground(from_m: float, to_m: float, top_m: float) -> Solid:
    return Solid("ground", (from_m, to_m), (-5.0, 5.0), (-3.0, top_m))


@pytest.mark.parametrize(
    ("beyond", "to_m", "collides"),
    [
        ([ground(3.0, 20.0, -1.2)], 3.0, True),  # a loading dock
        ([ground(3.0, 20.0, -1.2)], 2.4, False),  # short of it
        ([ground(3.3, 20.0, 0.0)], 3.0, True),  # a hole without a bottom
        ([ground(3.0, 3.3, -0.12), ground(3.3, 20.0, 0.0)], 5.0, False),  # a shallow one
    ],
)
def test_a_corner_over_a_drop_collides(beyond: list[Solid], to_m: float, collides: bool) -> None:
    scene = scene_of(ground(-5.0, 3.0, 0.0), *beyond, floor=False)
    contacts = driven(Judge(scene), 0.0, to_m).collisions
    assert bool(contacts) is collides
    for contact in contacts:
        assert contact.kind == "drop"
        assert contact.x_m == pytest.approx(3.0 - 0.52, abs=0.015)


def test_a_ramp_is_no_collision() -> None:
    rise_rad = math.radians(5.0)
    ramp = Solid("ramp", (3.0, 9.0), (-5.0, 5.0), (-0.5, 0.0), rise_x_rad=rise_rad)
    judge = Judge(Scene("ramp", (FLOOR, ramp)))
    for step in range(400):
        x_m = 0.02 * step
        axle_m = max(0.0, (x_m - 3.0) * math.tan(rise_rad))
        caster_m = max(0.0, (x_m + 0.4 - 3.0) * math.tan(rise_rad))
        pitch_rad = -math.atan2(caster_m - axle_m, 0.4)
        judge.step(Truth(0.02 * step, (x_m, 0.0, 0.0), axle_m, pitch_rad))
    assert not judge.collisions


def test_who_walks_into_a_robot_that_stands_is_counted_apart() -> None:
    judge = standing(Judge(scene_of()), 1.0, 0.0)
    for away_m in np.arange(2.0, 0.4, -0.02):
        standing(judge, PERIOD_S, 0.0, np.array([[away_m, 0.0, 0.22]]))
    assert not judge.collisions
    (contact,) = judge.bumps
    assert contact.kind == "person"


def test_a_person_whom_a_driving_robot_touches_is_a_collision_on_a_timetable_too() -> None:
    people = np.array([[9.0, 3.0, 0.22], [2.0, 0.3, 0.22]])
    (contact,) = driven(Judge(scene_of()), 0.0, 1.6, people=people).collisions
    assert (contact.kind, contact.what) == ("person", "person 2")
    walker = person("walker", ((4.0, 0.0), (-4.0, 0.0)), speed_mps=1.0)
    scene = Scene("made", (FLOOR,), movers=(walker,))
    assert standing(Judge(scene), 4.0, 0.0).bumps
    judge = driven(Judge(scene), 0.0, 2.0)
    assert judge.collisions[0].what == "walker"
    assert not judge.bumps


def stopped(scene: Scene, why: str = HELD.why, faulty: bool = False) -> StopWatch:
    """Driven at 0.5 m/s to x = 2, told to stop there, and stood for a second."""
    judge = Judge(scene)
    watch = StopWatch(judge, faulty)
    since_s = x_m = 0.0
    v_mps = 0.5
    while since_s < 6.0:
        judge.step(Truth(since_s, (x_m, 0.0, 0.0)))
        watch.step(WANTS if x_m < 2.0 else Orders(True, False, why, True))
        v_mps = v_mps if x_m < 2.0 else max(0.0, v_mps - 0.8 * PERIOD_S)
        since_s, x_m = since_s + PERIOD_S, x_m + v_mps * PERIOD_S
    return watch


def test_a_stop_before_nothing_is_false_and_before_a_drop_right() -> None:
    watch = stopped(scene_of())
    (stop,) = watch.stops
    assert stop.is_false
    assert stop.why == HELD.why
    assert stop.way_m == pytest.approx(0.5**2 / 1.6, abs=0.03)
    assert watch.worst_way_m == stop.way_m
    near = Solid("quay", (-5.0, 3.0), (-5.0, 5.0), (-1.5, 0.0))
    (stop,) = stopped(scene_of(near, floor=False)).stops
    assert stop.in_way == "a drop"


@pytest.mark.parametrize(
    ("thing", "in_way"),
    [
        (Solid("near", (3.0, 3.4), (-0.3, 0.3), (0.0, 0.12)), True),
        (Solid("farther", (3.7, 4.0), (-0.3, 0.3), (0.0, 0.5)), True),
        (Solid("far", (3.85, 4.0), (-0.3, 0.3), (0.0, 0.5)), False),
        (Solid("beside", (2.4, 3.0), (0.60, 1.0), (0.0, 0.5)), True),
        (Solid("aside", (2.4, 3.0), (0.70, 1.0), (0.0, 0.5)), False),
        (Solid("flat", (2.6, 3.0), (-0.3, 0.3), (0.0, 0.09)), False),
    ],
)
def test_only_what_is_truly_in_the_way_excuses_a_stop(thing: Solid, in_way: bool) -> None:
    (stop,) = stopped(scene_of(thing)).stops
    assert stop.is_false is not in_way
    assert stop.in_way == (thing.name if in_way else "")


@pytest.mark.parametrize(
    ("why", "faulty", "is_false"),
    [
        ("the scanner delivers no scans", False, True),
        ("the scanner delivers no scans", True, False),
        ("ground in the way was not seen to be free", True, True),
        ("a drop is in the way", True, True),
        ("the pose is not known", True, False),
    ],
)
def test_a_stop_for_a_doubt_needs_a_fault(why: str, faulty: bool, is_false: bool) -> None:
    (stop,) = stopped(scene_of(), why, faulty).stops
    assert stop.is_false is is_false


def test_arriving_is_no_stop_and_a_moment_is_none_either() -> None:
    judge = Judge(scene_of())
    watch = StopWatch(judge)
    driven(judge, 0.0, 1.0)
    watch.step(Orders(False, False, "", False))
    standing(judge, 1.0, 1.0)
    watch.step(Orders(False, False, "", False))
    assert not watch.stops
    driven(judge, 1.0, 2.0)
    watch.step(HELD)
    standing(judge, 0.3, 2.0)
    watch.step(HELD)
    driven(judge, 2.0, 2.5)
    watch.step(WANTS)
    assert not watch.stops


places = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-4, 4))


def check_gap(gap_m: float, by_points_m: float, place: Place, middle: tuple[float, float]) -> None:
    """A gap is what the outline's points say; an overlap, that they or the thing lie within."""
    if gap_m != OVERLAP_M:
        assert by_points_m == pytest.approx(gap_m, abs=0.015)
        return
    c, s = math.cos(place[2]), math.sin(place[2])
    dx, dy = middle[0] - place[0], middle[1] - place[1]
    within = -0.2 <= c * dx + s * dy <= 0.52 and abs(c * dy - s * dx) <= 0.3
    assert by_points_m < 0.02 or within


@given(places, st.floats(-1, 1), st.floats(0.05, 2.0), st.floats(0.05, 2.0))
def test_the_gap_to_a_box_is_that_of_the_outlines_points(
    place: Place, x0: float, wide_m: float, deep_m: float
) -> None:
    span = (x0, x0 + wide_m, -deep_m / 2, deep_m / 2)
    x, y = placed(outline(), place)
    dx = np.maximum(np.maximum(span[0] - x, x - span[1]), 0.0)
    dy = np.maximum(np.maximum(span[2] - y, y - span[3]), 0.0)
    by_points_m = float(np.hypot(dx, dy).min())
    check_gap(box_gap(place, USUAL.rect, span), by_points_m, place, (x0 + wide_m / 2, 0.0))


@given(places, st.floats(0.01, 0.5))
def test_so_is_the_gap_to_a_disc(place: Place, radius_m: float) -> None:
    x, y = placed(outline(), place)
    by_points_m = float(np.hypot(x - 0.3, y + 0.1).min()) - radius_m
    check_gap(disc_gap(place, USUAL.rect, 0.3, -0.1, radius_m), by_points_m, place, (0.3, -0.1))


@pytest.mark.parametrize("name", ["rooms", "dock", "office"])
def test_the_judge_agrees_with_the_scene_asked_point_by_point(name: str) -> None:
    scene, random = load_scene(name, 5), np.random.default_rng(3)
    grid = np.meshgrid(np.linspace(-0.2, 0.52, 73), np.linspace(-0.3, 0.3, 61))
    points = np.column_stack([part.ravel() for part in grid])
    for _ in range(25):
        place = (random.uniform(-2, 24), random.uniform(-5, 5), random.uniform(-3, 3))
        z = float(np.nan_to_num(scene.height_at([place[0]], [place[1]])[0], nan=-9.0))
        if abs(z) > 0.05:
            continue  # stands on a thing, or on nothing
        judge = Judge(scene)
        judge.step(Truth(0.0, place, z))
        x, y = placed(points, place)
        solid = scene.blocks(x, y, z + 0.14, z + 1.30).any()
        low = (np.nan_to_num(scene.height_at(x, y), nan=-9.0) < z - 0.15).any()
        assert bool(judge.collisions) is bool(solid or low), place
