"""Depth images into the map of objects, both halves together, against the truth of a room."""

import math

import numpy as np
import pytest
import shapely

from core.objects.vector_map.object_map import MapUpdate
from tools.experiments.depth_rooms import (
    CAMERAS,
    FRAME_S,
    Mapper,
    Room,
    Thing,
    box,
    drive,
    judge,
    person,
    room,
    walls,
)

SOON = round(3.0 / FRAME_S)  # what has changed is right after so many frames in which it is seen


def watch(there: Room, mapper: Mapper, frames: int, yaw: float = 0.0) -> list[MapUpdate]:
    """Stand in the room's left and look, nodding a little to both sides."""
    updates = []
    for k in range(frames):
        told, update = mapper.take(there.view(-2.0, 0.0, yaw + 0.1 * math.sin(0.3 * k)))
        assert told.doubt == ""
        assert update is not None
        updates.append(update)
        there.walk()
    return updates


def over(mapper: Mapper, thing: Thing) -> float:
    """Share of a thing's place that objects of the map cover."""
    truth = shapely.Polygon(thing.outline())
    found = shapely.union_all([shapely.Polygon(one.polygon) for one in mapper.objects.objects()])
    return float(found.intersection(truth).area / truth.area)


@pytest.mark.slow
@pytest.mark.parametrize(("pose_m", "camera"), [(0.01, CAMERAS[1]), (0.03, CAMERAS[2])])
def test_a_drive_finds_what_it_has_seen(pose_m: float, camera: tuple[float, float]) -> None:
    there, mapper = room(11, pose_m, *camera), Mapper()
    drive(there, mapper, 250, 250 / 85.0)
    judged = judge(there, mapper.objects)
    assert judged.things >= 8
    assert judged.missed == 0
    assert judged.fragments + judged.false <= 3
    assert np.median(judged.corners_m) < 0.03
    assert {one.kind for one in mapper.objects.objects()} == {"static"}


@pytest.mark.parametrize("pose_m", [0.01, 0.03])
def test_a_box_taken_away_is_gone_and_a_moved_one_right_within_three_seconds(
    pose_m: float,
) -> None:
    stays, goes, moves = (box(0.2 + 0.3 * k, 0.6 * (k - 1), 0.3, 0.25, 0.3, 0.3) for k in range(3))
    there = Room([stays, goes, moves], walls(), pose_m, 5, *CAMERAS[1])
    mapper = Mapper()
    watch(there, mapper, 40)
    assert all(over(mapper, one) > 0.6 for one in there.things)
    old = shapely.Polygon(moves.outline())
    there.things.remove(goes)
    moves.go(0.1, 0.4)
    watch(there, mapper, SOON)
    assert over(mapper, goes) == 0.0
    assert over(mapper, stays) > 0.6
    assert over(mapper, moves) > 0.6
    left = shapely.union_all([shapely.Polygon(one.polygon) for one in mapper.objects.objects()])
    assert left.intersection(old).area < 0.25 * old.area


@pytest.mark.parametrize("pose_m", [0.01, 0.03])
def test_a_person_who_walks_is_always_told_and_never_in_the_map(pose_m: float) -> None:
    walker = person(0.5, -1.2, 0.0, 0.5)
    there = Room([walker, box(1.0, 0.9, 0.3, 0.3, 0.2, 0.4)], walls(), pose_m, 6, *CAMERAS[1])
    mapper, told = Mapper(), 0
    for _ in range(45):
        before = shapely.Polygon(walker.outline())
        [update] = watch(there, mapper, 1)
        outlines = [shapely.Polygon(one.polygon) for one in update.obstacles]
        told += any(one.intersection(before).area > 0.2 * before.area for one in outlines)
        assert over(mapper, walker) < 0.1
    assert told == 45


def test_a_person_is_one_obstacle_whatever_of_him_is_seen() -> None:
    """So near that legs and trunk come and go, and part."""
    walker = person(-0.6, -0.9, 0.0, 0.5)
    there, mapper = Room([walker], walls(), 0.01, 6, *CAMERAS[0]), Mapper()
    for k in range(24):
        [update] = watch(there, mapper, 1)
        assert [one.id for one in update.obstacles] == [1], k


def test_nothing_is_deleted_before_the_near_edge_of_the_view() -> None:
    near, mapper = box(-0.9, 0.0, 0.3, 0.3, 0.0, 0.3), Mapper()
    there = Room([near], walls(), 0.01, 7, *CAMERAS[1])
    watch(there, mapper, 30)
    assert over(mapper, near) > 0.6
    for _ in range(80):  # so near that the camera sees over it
        told, _ = mapper.take(there.view(-1.25, 0.0, 0.0))
        assert told.doubt == ""
        there.walk()
    assert over(mapper, near) > 0.6


def test_frames_in_doubt_change_nothing() -> None:
    there = Room([box(0.0, 0.0, 0.3, 0.3, 0.0, 0.3)], walls(), 0.01, 8, *CAMERAS[1])
    mapper = Mapper()
    watch(there, mapper, 20)
    before, seen = mapper.objects.changes_since(0), there.view(-2.0, 0.0, 0.0)
    wrong = seen.pose._replace(T_map_sensor=np.full((4, 4), np.nan))
    for _ in range(40):
        told, update = mapper.take(seen._replace(pose=wrong))
        assert (told.doubt, update) == ("pose", None)
        assert told.objects.detections == ()
        assert len(told.objects.view) == 0
        mapper.objects.update(told.objects)  # and even if somebody hands it on
    assert mapper.objects.changes_since(0).digest == before.digest
