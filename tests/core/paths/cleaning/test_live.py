"""A cleaning beside the loop: what waits is taken in when asked, and what comes out of it."""

import math
from itertools import pairwise

import numpy as np
import shapely

from config_file import load_config
from core.paths.cleaning.live import LiveCleaning, Request
from core.paths.cleaning.planned import Planned, Progress
from core.records import F64, FloorView, PathSegment, StandingThing
from recording.plans import bytes_from_planned, planned_from_bytes
from tests import ROOT

CONFIG = load_config((ROOT / "robots" / "cleaner.toml").read_text(encoding="utf-8"))
NO_WALLS = np.zeros((0, 4))
ROOM = shapely.box(-0.8, -1.2, 1.6, 1.2)


def outline(polygon: shapely.Polygon) -> F64:
    ring: F64 = shapely.get_coordinates(polygon.exterior)[:-1]
    return ring


def live_in_room(
    standing: tuple[shapely.Polygon, ...] = (), room: shapely.Polygon = ROOM
) -> LiveCleaning:
    """It has seen all of a room with four walls."""
    assert CONFIG.coverage is not None
    live = LiveCleaning(CONFIG.coverage, 1.2)
    ring = shapely.get_coordinates(room.exterior)
    walls = np.hstack([ring[:-1], ring[1:]])
    corners = [outline(shapely.orient_polygons(one)) for one in standing]
    told = tuple(StandingThing(one, np.ones(len(one), dtype=bool)) for one in corners)
    for k in range(CONFIG.coverage.seen_frames):
        live.see(FloorView(outline(room), (), told if k == 0 else None, walls))
    return live


def asked(
    wants: str, t_s: float = 1.0, barred: tuple[float, float, float] | None = None
) -> Request:
    return Request(t_s, 0, (0.0, 0.0, 0.0), wants, barred, np.zeros((0, 2)))


def line_of(planned: Planned) -> shapely.LineString:
    return shapely.LineString(np.vstack([one.points_m for one in planned.segments]))


def test_seen_floor_is_swept_from_where_the_machine_is_and_nothing_is_told_unasked() -> None:
    live = live_in_room()
    assert live.step(asked("")) is None
    planned = live.step(asked("new"))
    assert planned is not None
    assert (planned.goal, planned.why, planned.clean_m2) == ("sweep", "", 0.0)
    assert planned.seen_m2 > 0.9 * ROOM.area
    assert math.dist(planned.segments[0].points_m[0], (0.0, 0.0)) < 0.05
    assert ROOM.boundary.distance(line_of(planned)) > 0.35 + 0.10
    live.drive((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), True)
    again = live.step(asked("new", 2.0))
    assert again is not None
    assert again.clean_m2 > 0.3


def test_a_place_that_barred_the_way_counts_as_a_thing_for_a_while() -> None:
    live = live_in_room()
    cell = (0.9, 0.0, 0.05)
    other = live.step(asked("other", barred=cell))
    later = live.step(asked("new", 100.0))
    assert other is not None
    assert later is not None
    at = shapely.Point(cell[:2])
    assert line_of(other).distance(at) > 0.35
    assert line_of(later).distance(at) < 0.35


def test_what_is_left_of_a_path_goes_on_when_another_is_asked_for() -> None:
    kept = []
    for is_told in (False, True):
        live = live_in_room(room=shapely.box(-0.8, -2.2, 4.6, 2.2))
        planned = live.step(asked("new"))
        assert planned is not None
        path, progress = shapely.get_coordinates(line_of(planned)), Progress(planned.segments)
        for a, b in pairwise(path[: len(path) // 2]):
            live.drive((*a, 0.0), (*b, 0.0), True)
            progress.step(*b)
        here, left = (*path[len(path) // 2 - 1], 0.0), shapely.LineString(progress.rest)
        rest = progress.rest if is_told else progress.rest[:0]
        other = live.step(Request(2.0, 0, here, "other", None, rest))
        assert other is not None
        kept.append(line_of(other).intersection(left.buffer(0.05)).length / left.length)
    assert kept[1] > max(0.5, kept[0] + 0.1)


def test_of_a_ring_of_things_around_the_machine_the_rim_alone_bars_the_way() -> None:
    walls_in_one = ROOM.buffer(0.2)  # an object has no holes
    planned = live_in_room((walls_in_one,)).step(asked("new"))
    assert planned is not None
    assert planned.goal == "sweep"


def test_progress_goes_on_by_what_was_passed_and_not_from_aside() -> None:
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    way = PathSegment(False, corner[:2]), PathSegment(True, corner[1:])
    progress = Progress(way)
    assert (progress.ahead, progress.is_done) == (1, False)
    assert progress.left_m((0.5, 0.0, 0.0)) < progress.left_m((0.5, 0.0, 0.3))
    assert progress.left_m((0.5, 0.0, 0.3)) < progress.left_m((0.3, 0.0, 0.0))
    progress.step(0.5, 0.1)
    assert (progress.ahead, progress.sweeps) == (1, False)
    progress.step(1.2, 0.5)  # by another way
    assert progress.ahead == 1
    progress.step(0.98, 0.0)
    assert (progress.ahead, progress.sweeps) == (3, True)  # the segments share a point
    progress.step(1.0, 0.97)
    assert progress.is_done
    assert not progress.sweeps
    assert Progress(()).is_done


def test_a_plan_is_the_same_behind_its_bytes() -> None:
    planned = live_in_room().step(asked("new"))
    assert planned is not None
    data = bytes_from_planned(planned)
    same = planned_from_bytes(data)
    assert bytes_from_planned(same) == data
    np.testing.assert_array_equal(line_of(same).coords, line_of(planned).coords)
