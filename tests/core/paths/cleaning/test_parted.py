"""Two rooms and somebody in the door between them: what waits behind him, and who looks at him."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from core.paths.cleaning.cleaning import GAP_LOOKS, Cleaning, Place, Task
from core.paths.cleaning.frontiers import FAR_M, NEAR_M
from core.paths.cleaning.things import Thing, new_thing, thing_of, walls
from core.paths.geometry.rings import joined
from core.paths.geometry.space import polygons_in
from tests.core.paths.cleaning.test_cleaning import SETTINGS

HALL = shapely.box(-0.7, -3.0, 9.0, 3.0)  # two rooms, with a door
DOOR_WALL = walls(np.array([[4.5, -3.0, 4.5, -0.8], [4.5, 0.8, 4.5, 3.0]]))
ROUND = walls(np.array([[-0.7, -3.0, -0.7, 3.0], [-0.7, 3.0, 9.0, 3.0], [9.0, 3.0, 9.0, -3.0],
                        [9.0, -3.0, -0.7, -3.0]]))  # fmt: skip
IN_DOOR = new_thing(shapely.box(4.3, -0.2, 4.7, 0.2))
HERE = shapely.box(-0.7, -3.0, 4.6, 3.0)


def seen_hall(clean: BaseGeometry) -> Cleaning:
    cleaning = Cleaning(replace(SETTINGS, tries=24), (0.0, 0.0, 0.0))
    cleaning.floor.vouch(shapely.get_coordinates(HALL.exterior)[:-1])
    for part in polygons_in(clean):
        cleaning.clean.add(shapely.get_coordinates(part.exterior)[:-1])
    return cleaning


def looks_at_gap(cleaning: Cleaning, place: Place, things: list[Thing], most: int) -> list[Task]:
    """Its looks, one after the other, each from where the last one ended."""
    found = list[Task]()
    while len(found) < most:
        task = cleaning.plan(place, things, may_look=False)
        if task.goal != "look":
            break
        assert task.yaw is not None
        x, y = task.segments[-1].points[-1].tolist() if task.segments else place[:2]
        found.append(task)
        place = x, y, task.yaw
    return found


def test_it_looks_at_who_parts_off_unswept_floor_before_it_goes_home() -> None:
    cleaning, place, things = seen_hall(HERE), (2.0, -2.0, 0.0), [*DOOR_WALL, IN_DOOR]
    looks = looks_at_gap(cleaning, place, things, 2 * GAP_LOOKS)
    assert [bool(task.segments) for task in looks] == GAP_LOOKS // 2 * [True, False]
    for task in looks[::2]:
        x, y = task.segments[-1].points[-1].tolist()
        assert task.why == "floor that was seen is parted off"
        assert NEAR_M < math.dist((x, y), (4.5, 0.0)) < FAR_M + 1.0
        assert task.yaw is not None
        assert abs(math.remainder(task.yaw - math.atan2(-y, 4.5 - x), math.tau)) < 0.3
    assert cleaning.plan(place, things, may_look=False).goal == "home"
    assert cleaning.plan(place, DOOR_WALL, may_look=False).goal == "sweep"
    looks = looks_at_gap(cleaning, place, things, 2 * GAP_LOOKS)
    assert len(looks) == GAP_LOOKS, "it has swept since, and he may be gone"


def test_it_looks_at_who_parts_it_from_the_dock_until_it_is_stuck() -> None:
    cleaning, things = seen_hall(HALL), [*DOOR_WALL, IN_DOOR]
    looks = looks_at_gap(cleaning, (7.0, 1.0, 0.0), things, 99)
    assert {task.why for task in looks} == {"something parts it from the dock"}
    assert [bool(task.segments) for task in looks] == len(looks) // 2 * [True, False]
    assert len(looks) == 24  # tries


def test_what_no_map_holds_is_looked_at_first() -> None:
    """Things that stand for good part aisles, too."""
    racks = [shapely.box(4.3, y, 4.7, y + 0.5) for y in (-2.4, 1.2, 2.2)]
    known = [thing_of(shapely.get_coordinates(r.exterior)[:4], np.ones(4, bool)) for r in racks]
    cleaning = seen_hall(shapely.box(-0.7, -3.0, 4.6, 3.0))
    wall = walls(np.array([[4.5, -3.0, 4.5, -0.8], [4.5, 0.8, 4.5, 3.0]]))
    [first, *_] = looks_at_gap(cleaning, (2.0, -2.0, 0.0), [*wall, *known, IN_DOOR], 1)
    (x, y), yaw = first.segments[-1].points[-1].tolist(), first.yaw
    assert yaw is not None
    assert abs(math.remainder(yaw - math.atan2(-y, 4.5 - x), math.tau)) < 0.3


def test_there_are_no_more_plans_than_rounds_whatever_bars_its_way_home() -> None:
    cleaning, place = seen_hall(shapely.MultiPolygon()), (2.0, -2.0, 0.0)
    shut = [*DOOR_WALL, *ROUND]
    goals = [cleaning.plan(place, shut, True).goal for _ in range(SETTINGS.rounds + 1)]
    assert goals == [*["sweep"] * SETTINGS.rounds, "home"]
    assert cleaning.plan(place, shut, may_look=False).goal == "home"


def test_plans_while_much_is_parted_off_are_no_rounds() -> None:
    cleaning, place = seen_hall(shapely.MultiPolygon()), (2.0, -2.0, 0.0)
    shut = [*DOOR_WALL, *ROUND]
    for _ in range(SETTINGS.rounds + 1):
        assert cleaning.plan(place, [*shut, IN_DOOR], may_look=True).goal == "sweep"
    assert cleaning.plan(place, shut, may_look=True).goal == "sweep"


def test_floor_that_is_parted_off_and_clean_keeps_it_from_nothing() -> None:
    task = seen_hall(HALL).plan((2.0, 0.0, 0.0), [*DOOR_WALL, IN_DOOR], may_look=False)
    assert task.goal == "home"


def test_what_costs_a_long_way_is_left_while_much_floor_is_parted_off() -> None:
    """It comes by again; else a room was swept for its specks, whoever stood in the door."""
    specks = shapely.MultiPoint([(x, y) for x in (0.5, 2.0, 3.5) for y in (-2.0, 0.0, 2.0)])
    swept = HERE.difference(specks.buffer(0.12))
    cells = [shapely.box(x, y, x + 0.1, y + 0.1) for x in np.arange(-0.7, 4.6, 0.1)
             for y in np.arange(-3.0, 3.0, 0.1)]  # fmt: skip
    clean = shapely.MultiPolygon([cell for cell in cells if swept.covers(cell)])
    beyond = shapely.box(4.5, -3.0, 9.0, 3.0)
    driven_m = []
    for is_swept in (True, False):
        cleaning = seen_hall(shapely.MultiPolygon([*clean.geoms, *[beyond] * is_swept]))
        task = cleaning.plan((2.0, -2.0, 0.0), [*DOOR_WALL, IN_DOOR], may_look=False)
        sweeps = [one.points for one in task.segments if one.kind == "sweep"]
        driven_m.append(sum(shapely.LineString(line).length for line in sweeps))
    assert driven_m[0] > 3.0
    assert driven_m[1] < 0.5 * driven_m[0]


def length_m(task: Task) -> float:
    return float(sum(shapely.LineString(one.points).length for one in task.segments))


def test_a_path_that_was_parted_off_goes_on_when_there_is_a_way_again() -> None:
    """A new one lies beside ragged borders of what was swept."""
    cleaning = seen_hall(shapely.MultiPolygon())
    path = joined([s.points for s in cleaning.plan((0.0, 0.0, 0.0), DOOR_WALL, False).segments])
    k = int(0.3 * len(path))  # in the right room, whose rest is ragged
    assert path[k, 0] > 5.0
    places = [(x, y, 0.0) for x, y in path[: k + 1].tolist()]
    for begin, end in pairwise(places):
        cleaning.drive(begin, end, True)
    here = places[-1]
    parted = cleaning.plan(here, [*DOOR_WALL, IN_DOOR], False, path[k:])
    driven = joined([s.points for s in parted.segments])
    assert driven[:, 0].min() > 4.5
    again = cleaning.plan(here, DOOR_WALL, False, driven)
    assert length_m(again) < 1.03 * shapely.LineString(path[k:]).length
