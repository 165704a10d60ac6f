"""Cleaning a floor that nobody knows: a perfect eye, and a machine that jumps along its path."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from core.paths.cleaning.cleaning import (
    BARRED_M,
    LOOKS,
    Cleaning,
    CleaningSettings,
    Place,
    Task,
)
from core.paths.cleaning.free_floor import NO_PLACE, FreeFloor
from core.paths.cleaning.frontiers import Block
from core.paths.cleaning.things import Thing, new_thing, outlines, thing_of, walls
from core.paths.coverage.measures import swept_by
from core.paths.records import Machine
from core.records import PassingThing

MACHINE = Machine(radius_m=0.35, clearance_m=0.03, width_m=0.6, overlap_m=0.03)
SETTINGS = CleaningSettings(
    machine=MACHINE, cell_m=0.05, size_m=20.0, seen_frames=1, start_clear_m=1.2, guard_m=0.03,
    explained_m=0.3, sliver_m=0.08, enough=0.004, enough_lively=0.1, rounds=4, tries=6,
)  # fmt: skip
ROOM = shapely.box(-0.7, -1.5, 5.0, 2.8)
BOXES = [shapely.box(1.6, 0.9, 2.3, 1.5), shapely.box(3.6, -0.7, 3.9, -0.2)]
FREE = ROOM.difference(shapely.union_all(BOXES))
STEP_M = 0.2


def view(place: Place) -> np.ndarray:
    """What an eye sees from there, 4 m far, all but what is right below it."""
    x, y, yaw = place
    angles = yaw + np.radians(np.arange(-40.0, 40.1, 1.0))
    ends = np.column_stack([x + 4.0 * np.cos(angles), y + 4.0 * np.sin(angles)])
    rays = [shapely.LineString([(x, y), end]) for end in ends.tolist()]
    far = np.array([_reach(ray) for ray in rays])
    outer = np.array([x, y]) + (far - 0.02)[:, None] * np.column_stack(
        [np.cos(angles), np.sin(angles)]
    )
    return np.vstack([outer, [[x, y]]])


def _reach(ray: shapely.LineString) -> float:
    met = ray.intersection(FREE.boundary)
    return min(4.0, float(shapely.Point(ray.coords[0]).distance(met)) if not met.is_empty else 4.0)


def free_of(
    cleaning: Cleaning, things: list[Thing], barred: BaseGeometry = NO_PLACE
) -> BaseGeometry:
    there = FreeFloor(cleaning.floor, things)
    return there.area(SETTINGS.guard_m, MACHINE.radius_m, barred)


class Jumper:
    """A machine that is where its path says, step by step."""

    def __init__(self) -> None:
        self.cleaning, self.place = Cleaning(SETTINGS, (0.0, 0.0, 0.0)), (0.0, 0.0, 0.0)
        self.known = [Thing(one) for one in BOXES]
        self.goals, self.swept = list[str](), list[np.ndarray]()

    def go(self, task: Task) -> None:
        """Drive a task; only where the machine has room."""
        self.goals.append(task.goal)
        for segment in task.segments:
            if segment.kind == "sweep":
                self.swept.append(segment.points)
            line = shapely.LineString(segment.points)
            assert FREE.buffer(1e-6).covers(line.buffer(MACHINE.radius_m - 0.001))
            for at_m in [*np.arange(STEP_M, line.length, STEP_M), line.length]:
                to = line.interpolate(at_m)
                yaw = math.atan2(to.y - self.place[1], to.x - self.place[0])
                self.jump((to.x, to.y, yaw), segment.kind == "sweep")
        if task.yaw is not None:
            self.jump((*self.place[:2], task.yaw), False)

    def jump(self, place: Place, sweeps: bool) -> None:
        self.cleaning.drive(self.place, place, sweeps)
        self.place = place
        self.cleaning.see(view(place), [])


@pytest.mark.slow
def test_it_looks_sweeps_and_comes_home_and_leaves_hardly_anything() -> None:
    machine = Jumper()
    machine.jump((0.0, 0.0, 0.0), False)
    for _ in range(60):
        machine.go(machine.cleaning.plan(machine.place, machine.known, may_look=True))
        if machine.goals[-1] == "home":
            break
    assert {"look", "sweep"} <= set(machine.goals)
    assert machine.goals[-1] == "home"
    assert math.dist(machine.place[:2], (0.0, 0.0)) < 0.05
    swept = swept_by(machine.swept, MACHINE.width_m / 2)
    space = FREE.buffer(-MACHINE.margin_m - SETTINGS.guard_m - 0.08)
    reachable = space.buffer(MACHINE.width_m / 2).intersection(FREE)
    assert swept.intersection(reachable).area > 0.98 * reachable.area


def test_what_stands_there_now_gets_no_path_and_what_was_not_seen_neither() -> None:
    machine = Jumper()
    machine.jump((0.0, 0.0, 0.0), False)
    bar = shapely.box(1.2, -0.4, 1.4, 0.4)
    task = machine.cleaning.plan(machine.place, [*machine.known, Thing(bar)], may_look=False)
    for segment in task.segments:
        assert shapely.LineString(segment.points).distance(bar) > MACHINE.radius_m
    unseen = FREE.difference(machine.cleaning.floor.area())
    for segment in task.segments:
        disc_m = MACHINE.radius_m - 0.08
        assert shapely.LineString(segment.points).buffer(disc_m).intersection(unseen).area < 0.05


def test_a_gap_between_seen_floor_and_a_known_wall_is_free_and_what_is_behind_is_not() -> None:
    machine = Jumper()
    floor, wall = machine.cleaning.floor, shapely.box(3.03, -1.0, 3.05, 1.0)
    floor.vouch(np.array([[0.0, -1.0], [3.0, -1.0], [3.0, 1.0], [0.0, 1.0]]))
    gap = shapely.box(2.8, -0.8, 3.03 - SETTINGS.guard_m - 0.001, 0.8)
    free = free_of(machine.cleaning, [Thing(wall)])
    assert free.covers(gap)
    hidden = shapely.get_coordinates(shapely.box(2.8, -0.8, 3.06, 0.8).exterior)[:-1]
    assert not floor.is_free(hidden)  # a question changes nothing
    floor.explain(FreeFloor(floor, [Thing(wall)]).gaps())
    assert floor.is_free(hidden)
    assert free.intersection(shapely.box(3.03, -1.0, 4.0, 1.0)).is_empty
    assert not free_of(machine.cleaning, []).intersects(shapely.box(3.0, -1.0, 4.0, 1.0))


def test_a_gap_behind_a_thing_that_was_seen_from_one_side_may_be_more_of_it() -> None:
    machine = Jumper()
    for low, high in ((-0.95, -0.04), (0.15, 1.05)):  # floor is seen on both sides of it
        machine.cleaning.floor.vouch(np.array([[2, low], [3, low], [3, high], [2, high]]))
    corners = np.array([[2.2, 0.0], [2.8, 0.0], [2.8, 0.1], [2.2, 0.1]])
    before, behind = shapely.box(2.3, -0.08, 2.7, -0.04), shapely.box(2.3, 0.14, 2.7, 0.18)
    for seen, is_free in (([True, False, False, False], False), ([True] * 4, True)):
        free = free_of(machine.cleaning, [thing_of(corners, np.array(seen))])
        assert free.covers(before)
        assert free.covers(behind) == is_free
    assert not free_of(machine.cleaning, [new_thing(corners)]).covers(before)


def test_floor_stays_as_it_was_below_what_was_new_and_then_seen_to_move() -> None:
    machine = Jumper()
    cleaning, floor = machine.cleaning, machine.cleaning.floor
    for _ in range(8):
        machine.jump((0.0, 0.0, 0.0), False)
    before = floor.count.copy()
    at = 2.0, 0.0
    who = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]) + at
    for told, is_as_before in (
        (PassingThing(7, who, is_moving=False, is_seen=True), False),
        (PassingThing(7, who, is_moving=False, is_seen=False), False),
        (PassingThing(7, who + 0.3, is_moving=True, is_seen=True), True),
        (PassingThing(8, who, is_moving=False, is_seen=False), True),  # told from memory alone
        (PassingThing(9, who, is_moving=False, is_seen=True), False),
        (PassingThing(10, who, is_moving=True, is_seen=True), False),  # another one
    ):
        cleaning.see(np.zeros((0, 2)), [], [told])
        assert np.array_equal(floor.count, before) == is_as_before


@pytest.mark.parametrize(
    ("edge_m", "thing_m", "may_look", "is_swept"),
    [
        (0.3, 3.0, True, True),
        (0.3, 0.05, True, False),  # beside a thing it may be more of it
        (0.3, 3.0, False, False),  # it was barred there
        (0.9, 3.0, True, False),  # the machine would stand in it whole
    ],
)
def test_a_small_hole_in_seen_floor_is_planned_over_and_no_other(
    edge_m: float, thing_m: float, may_look: bool, is_swept: bool
) -> None:
    machine = Jumper()
    x, y = 1.4, -0.02
    hole = shapely.box(x, y, x + edge_m, y + edge_m)
    seen = shapely.box(-0.6, -1.4, 4.0, 1.4)
    slit = shapely.box(x + edge_m, 0.0, 5.0, 0.001)  # a ring of floor, as one outline
    machine.cleaning.floor.add(shapely.get_coordinates((seen - hole - slit).exterior)[:-1])
    thing = Thing(shapely.box(x, y + edge_m + thing_m, x + 0.1, y + edge_m + thing_m + 0.1))
    barred = shapely.Polygon() if may_look else shapely.Point(0.0, 0.0).buffer(BARRED_M)
    free = free_of(machine.cleaning, [thing], barred)
    assert free.covers(hole.buffer(-0.01)) == is_swept


@pytest.mark.parametrize(("frames", "is_kept"), [(2, False), (3, True)])
def test_where_something_stood_nothing_explains_the_floor_until_it_is_seen_anew(
    frames: int, is_kept: bool
) -> None:
    """A sheet 3 cm before a row of boxes, that no frame tells any more."""
    cleaning = Cleaning(replace(SETTINGS, seen_frames=3, cell_m=0.025), (0.0, 0.0, 0.0))
    floor = np.array([[0.0, -1.0], [1.92, -1.0], [1.92, 1.0], [0.0, 1.0]])
    corners = np.array([[2.0, -1.0], [2.4, -1.0], [2.4, 1.0], [2.0, 1.0]])
    boxes = [thing_of(corners, np.array([True] * 4))]
    post = np.array([[1.955, -0.03], [1.97, -0.03], [1.97, 0.03], [1.955, 0.03]])
    for _ in range(12):
        cleaning.see(floor, outlines(boxes))
    gap = shapely.box(1.9, -0.06, 1.98, 0.06)
    for _ in range(frames):
        told = PassingThing(1, post, is_moving=False, is_seen=True)
        cleaning.see(np.zeros((0, 2)), outlines(boxes), [told])
    cleaning.see(np.zeros((0, 2)), outlines(boxes))
    cleaning.floor.explain(FreeFloor(cleaning.floor, boxes).gaps())
    ring = shapely.get_coordinates(gap.exterior)[:-1]
    assert free_of(cleaning, boxes).buffer(0.01).covers(shapely.Point(1.95, 0.0)) != is_kept
    assert cleaning.floor.is_free(ring) != is_kept
    for _ in range(3):
        cleaning.see(np.minimum(1.06 * floor, 1.99), outlines(boxes))
    assert cleaning.floor.is_free(ring)


def test_the_tool_has_work_where_floor_is_not_clean_and_no_more_behind_it() -> None:
    machine = Jumper()
    machine.jump((0.0, 0.0, 0.0), True)
    machine.jump((1.0, 0.0, 0.0), True)
    assert machine.cleaning.has_work((1.0, 0.0, 0.0))
    assert not machine.cleaning.has_work((1.0, 0.0, math.pi))
    assert machine.cleaning.has_work((0.5, 0.2, 0.0))


def box(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


@pytest.mark.parametrize(
    ("moved", "goal"), [((), "sweep"), ((1, 1, 2), "sweep"), ((1, 2, 3), "home")]
)
def test_where_several_things_have_moved_more_may_be_left(
    moved: tuple[int, ...], goal: str
) -> None:
    cleaning = Cleaning(SETTINGS, (0.0, 0.0, 0.0))
    cleaning.floor.vouch(box(-2.0, 3.0, -2.0, 2.0))
    cleaning.clean.add(box(-2.0, 2.0, -2.0, 2.0))
    cleaning.clean.add(box(-2.0, 3.0, -2.0, 1.0))  # all but a corner
    for number in moved:
        who = box(9.0, 9.3, 9.0, 9.3)
        passing = [PassingThing(number, who, is_moving=True, is_seen=True)]
        cleaning.see(view((0.0, 0.0, 0.0)), [], passing)
    wall = Thing(shapely.box(-2.1, -2.1, 3.1, 2.1).exterior.buffer(0.05))
    assert cleaning.plan((0.0, 0.0, 0.0), [wall], may_look=False).goal == goal


def test_where_the_machine_has_no_room_it_waits() -> None:
    machine = Jumper()
    around = [Thing(ROOM.buffer(1.0))]
    assert machine.cleaning.plan(machine.place, around, may_look=True).goal == "wait"


def test_what_parts_it_from_the_dock_makes_it_stop_and_say_so() -> None:
    machine = Jumper()
    for x in (0.0, 0.5, 1.0, 1.2):
        machine.jump((x, 0.0, 0.0), False)
    far, wall = (4.2, 2.0, 0.0), shapely.box(2.7, -2.0, 2.8, 3.0)
    machine.jump(far, False)
    for _ in range(40):
        task = machine.cleaning.plan(machine.place, [*machine.known, Thing(wall)], may_look=True)
        machine.go(task)
        if task.goal in ("stuck", "home"):
            break
    assert (task.goal, task.why) == ("stuck", "something parts it from the dock")
    assert not task.segments
    assert machine.goals.count("look") < 30


def test_looks_that_win_nothing_end_and_it_goes_home() -> None:
    machine = Jumper()
    machine.jump((0.0, 0.0, 0.0), False)
    machine.cleaning.floor.vouch(shapely.get_coordinates(ROOM.exterior)[:-1])
    cleaning, goals = machine.cleaning, ["look"]
    most = LOOKS * len(cleaning.frontiers(machine.known)) + SETTINGS.tries
    while goals[-1] in ("look", "sweep") and len(goals) < most:
        goals.append(cleaning.plan((0.0, 0.0, 0.0), machine.known, may_look=True).goal)
        cleaning.clean.add(shapely.get_coordinates(ROOM.exterior)[:-1])
    assert goals[1] == "look"
    assert goals[-1] == "home"


def test_frontiers_that_show_nothing_keep_it_from_looking_at_no_other() -> None:
    machine, looks = Jumper(), Counter[Block]()
    machine.jump((0.0, 0.0, 0.0), False)
    machine.cleaning.floor.vouch(shapely.get_coordinates(ROOM.exterior)[:-1])
    while (task := machine.cleaning.plan(machine.place, machine.known, may_look=True)).viewpoint:
        machine.place = *task.viewpoint.place, 0.0  # it came there, and saw nothing new
        looks[task.viewpoint.block] += 1
    assert task.goal == "sweep"
    known = machine.known
    assert set(looks) == machine.cleaning.frontiers(known)
    for block in set(looks) | {(a + 1, b) for a, b in looks}:
        assert machine.cleaning.is_frontier(block, known) == (block in looks)
    assert set(looks.values()) == {LOOKS}


@pytest.mark.parametrize(("told", "is_looked_at"), [(0, False), (1, True)])
def test_floor_that_was_seen_and_lost_beside_a_thing_is_looked_at_again(
    told: int, is_looked_at: bool
) -> None:
    cleaning = Cleaning(replace(SETTINGS, cell_m=0.025), (0.0, 0.0, 0.0))
    box, corners = shapely.box(2.0, -0.5, 2.6, 0.5), shapely.get_coordinates(ROOM.exterior)
    known = [Thing(box), *walls(np.hstack([corners[:-1], corners[1:]]))]
    for low, high in ((-9.0, 2.5), (2.1, 9.0)):  # outlines without holes
        half = ROOM.difference(box).intersection(shapely.box(low, -9.0, high, 9.0))
        cleaning.floor.vouch(shapely.get_coordinates(half.exterior)[:-1])
    bump = np.array([[1.7, -0.1], [1.98, -0.1], [1.98, 0.1], [1.7, 0.1]])
    for _ in range(told):  # by one frame, and no other tells of it again
        new = PassingThing(1, bump, is_moving=False, is_seen=True)
        cleaning.see(np.zeros((0, 2)), outlines(known[:1]), [new])
    task = cleaning.plan((0.0, 0.0, 0.0), known, may_look=True)
    assert (task.goal == "look") == is_looked_at
    if task.viewpoint is not None:
        assert math.dist(task.viewpoint.frontier, (1.84, 0.0)) < 0.15


def test_what_takes_long_and_wins_floor_is_not_given_up() -> None:
    machine = Jumper()
    machine.jump((0.0, 0.0, 0.0), False)
    goals = []
    for k in range(2 * SETTINGS.tries):
        machine.cleaning.floor.vouch(np.array([[8, k], [9, k], [9, k + 0.9], [8, k + 0.9]]))
        around = [Thing(ROOM.buffer(1.0))]
        goals.append(machine.cleaning.plan(machine.place, around, may_look=True).goal)
    assert goals == ["wait"] * len(goals)
