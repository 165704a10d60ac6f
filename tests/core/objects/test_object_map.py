"""The map of objects against the truth of a simulated world."""

import math

import msgspec
import numpy as np
import pytest
import shapely
from shapely.affinity import rotate

from core.objects.records import Detection, FrameObjects
from core.objects.vector_map.contour import area_of, polygons_of, straightened
from core.objects.vector_map.field import DistanceField
from core.objects.vector_map.object_map import MapUpdate, ObjectMap
from core.objects.vector_map.seen import pieces_of
from core.objects.vector_map.settings import QuickCheckSettings
from core.objects.vector_map.warm import warm_object_map
from tests.support.cases import few
from tools.experiments.object_world import (
    SETTINGS,
    Noise,
    World,
    apart_m,
    box,
    corner_errors,
    overlap,
    person,
)

NOISE = Noise(pose_m=0.01, pose_rad=0.005, hull_m=0.005, missing=0.02)
SEEN_S = 30  # frames: three seconds


def watch(world: World, objects: ObjectMap, frames: int, yaw: float = 0.0) -> list[MapUpdate]:
    """Frames from one place: the origin, looking along x unless told otherwise."""
    updates = []
    for _ in range(frames):
        updates.append(objects.update(world.frame(0.0, 0.0, yaw)))
        world.walk()
    return updates


def outlines(objects: ObjectMap) -> list[np.ndarray]:
    return [one.polygon for one in objects.objects()]


@pytest.mark.parametrize("seed", few([1, 2, 3], 1))
def test_a_box_seen_500_times_neither_grows_nor_wanders(seed: int) -> None:
    """Its top is seen, so that each hull is the whole box; its far sides are hidden."""
    random, thing = np.random.default_rng(seed), box(2.0, 0.0, 0.6, 0.4, 0.3)
    objects, view = ObjectMap(SETTINGS), World([thing]).frame(0.0, 0.0, 0.0).view
    for k in range(500):
        by = random.normal(0.0, 0.03, 2)
        hull = thing.outline + by + random.normal(0.0, 0.005, thing.outline.shape)
        seen = Detection(hull, 0.0, 0.4, 500)
        place = float(by[0]), float(by[1])
        objects.update(FrameObjects(0.1 * k, place, view + by, (seen,), np.zeros((0, 4))))
    [found] = objects.objects()
    growth = np.ptp(found.polygon, axis=0) - np.ptp(thing.outline, axis=0)
    assert np.abs(growth).max() < 0.03
    assert corner_errors(thing.outline, found.polygon).max() < 0.03
    assert found.id == 1


def test_an_object_is_in_the_map_after_n_frames_and_told_as_an_obstacle_before() -> None:
    world, objects = World([box(2.0, 0.3, 0.4, 0.4)]), ObjectMap(SETTINGS)
    updates = watch(world, objects, SETTINGS.confirm_frames - 1)
    assert outlines(objects) == []
    assert [len(update.obstacles) for update in updates] == [1] * len(updates)
    [last] = watch(world, objects, 1)
    assert len(outlines(objects)) == 1
    assert last.obstacles == ()


def test_what_is_taken_away_is_gone_after_m_frames_and_not_before() -> None:
    world, objects = World([box(2.0, 0.3, 0.4, 0.4)], noise=NOISE), ObjectMap(SETTINGS)
    watch(world, objects, 60)
    world.things.clear()
    watch(world, objects, SETTINGS.gone_frames // 2)
    assert len(outlines(objects)) == 1
    watch(world, objects, SEEN_S - SETTINGS.gone_frames // 2)
    assert outlines(objects) == []


def test_what_is_hidden_or_out_of_view_stays() -> None:
    hidden = box(3.0, 0.0, 0.4, 0.4)
    world, objects = World([hidden, box(2.0, 1.0, 0.3, 0.3)], noise=NOISE), ObjectMap(SETTINGS)
    watch(world, objects, 60)
    before = [one.id for one in objects.objects()]
    world.things = [box(1.0, 0.0, 0.1, 1.6)]  # a screen, and both are gone behind it
    watch(world, objects, 100)
    assert set(before) <= {one.id for one in objects.objects()}
    world.things = []
    watch(world, objects, 100, yaw=math.pi)
    assert set(before) <= {one.id for one in objects.objects()}


@pytest.mark.parametrize("by", [0.08, 0.15, 0.3, 1.0])
def test_what_is_moved_is_one_object_of_the_same_size_at_its_new_place(by: float) -> None:
    world = World([box(2.0, -0.6, 0.4, 0.4), box(2.2, 0.7, 0.3, 0.3)], noise=NOISE)
    objects = ObjectMap(SETTINGS)
    watch(world, objects, 60)
    size = np.ptp(objects.objects()[0].polygon, axis=0)
    world.things[0] = box(2.0, -0.6 + by * 0.8, 0.4, 0.4)
    watch(world, objects, SEEN_S)
    found = objects.objects()
    assert len(found) == 2
    front = world.things[0].outline[[0, 3]]  # the side that this place shows
    nearest = min(found, key=lambda one: float(corner_errors(front, one.polygon).max()))
    assert corner_errors(front, nearest.polygon).max() < 0.05
    assert np.ptp(nearest.polygon, axis=0)[1] < size[1] + 0.08  # in its new shadow, some stays


def test_what_is_smaller_than_it_seemed_was_not_moved_and_what_left_its_place_was() -> None:
    """Nobody had seen its far side: hulls of images reach too far there."""
    deep, true = box(2.0, 0.0, 0.6, 0.4), box(1.85, 0.0, 0.3, 0.4)
    objects, seen = ObjectMap(SETTINGS), World([deep]).frame(0.0, 0.0, 0.0)
    for k in range(90):
        whole = Detection(deep.outline, 0.0, 0.4, 500)
        objects.update(seen._replace(at_s=0.1 * k, detections=(whole,)))
    behind = World([true], noise=NOISE)
    for _ in range(SEEN_S):
        objects.update(behind.frame(4.0, 0.0, math.pi))
        behind.walk()
    [one] = objects.objects()
    assert np.ptp(one.polygon, axis=0)[0] < 0.4
    assert one.kind == "static"
    behind.things[0] = box(1.85, 0.24, 0.3, 0.4)
    for _ in range(SEEN_S):
        objects.update(behind.frame(4.0, 0.0, math.pi))
        behind.walk()
    assert {one.kind for one in objects.objects()} == {"moved"}


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_people_are_never_in_the_map_and_always_told(seed: int) -> None:
    random = np.random.default_rng(seed)
    things = [box(2.5, -1.0, 0.4, 0.4), box(3.0, 1.0, 0.8, 0.4)]
    people = [
        person(1.5, -1.5, 0.0, random.uniform(0.3, 1.5)),
        person(4.5, 0.2, -random.uniform(0.2, 0.8), random.uniform(-0.1, 0.1)),
        person(1.2, 0.1),
    ]
    world, objects = World([*things, *people], noise=NOISE, seed=seed), ObjectMap(SETTINGS)
    for _ in range(60):
        update = objects.update(world.frame(0.0, 0.0, 0.0))
        for k, human in enumerate(world.things):
            if human.is_person and (world.hits == k).sum() >= 20:
                told = [apart_m(human.outline, one.polygon) for one in update.obstacles]
                assert min(told, default=1.0) < 0.1
        world.walk()
    humans = [thing.outline for thing in world.things if thing.is_person]
    assert all(overlap(a, b) < 0.02 for a in outlines(objects) for b in humans)
    assert len(outlines(objects)) == 2


def test_a_walkers_velocity_is_told_once_it_is_known() -> None:
    world, objects = World([person(3.0, -1.5, 0.1, 0.9)], noise=NOISE), ObjectMap(SETTINGS)
    first, *_, last = watch(world, objects, 15)
    assert first.obstacles[0].velocity_mps is None
    [walker] = last.obstacles
    assert walker.is_moving
    assert walker.id == first.obstacles[0].id
    assert walker.velocity_mps == pytest.approx((0.1, 0.9), abs=0.3)


def test_a_door_in_a_wall_opens_and_closes() -> None:
    shut = np.array([[3.0, -1.5, 3.0, 1.5]])
    open_ = np.array([[3.0, -1.5, 3.0, -0.5], [3.0, 0.5, 3.0, 1.5]])
    world, objects = World([], shut, NOISE), ObjectMap(SETTINGS)
    watch(world, objects, 30)
    [wall] = objects.walls.records()
    assert len(wall.segments) == 1
    world.walls = open_
    watch(world, objects, SEEN_S)
    [wall] = objects.walls.records()
    assert len(wall.segments) == 2
    assert np.sort(wall.openings[:, [1, 3]].ravel()) == pytest.approx([-0.5, 0.5], abs=0.08)
    world.walls = shut
    watch(world, objects, SEEN_S)
    [wall] = objects.walls.records()
    assert (len(wall.segments), len(wall.openings)) == (1, 0)
    [shape] = objects.changes_since(0).changed
    assert (shape.kind, shape.id) == ("wall", wall.id)
    world.walls = np.zeros((0, 4))  # taken down
    watch(world, objects, SEEN_S)
    assert objects.walls.records() == []
    assert objects.changes_since(0).changed == ()


def test_what_a_post_cut_in_two_is_one_object_once_it_is_seen_whole() -> None:
    world, objects = World([box(2.5, 0.0, 0.3, 1.6), box(1.2, 0.0, 0.2, 0.2)]), ObjectMap(SETTINGS)
    watch(world, objects, 20)
    assert len(outlines(objects)) == 3
    del world.things[1]
    watch(world, objects, 2 * SEEN_S)
    [whole] = outlines(objects)
    assert np.ptp(whole, axis=0)[1] == pytest.approx(1.6, abs=0.04)


def test_two_things_side_by_side_are_two_objects() -> None:
    world = World([box(2.0, 0.3, 0.4, 0.4), box(2.0, -0.25, 0.4, 0.4)], noise=NOISE)
    objects = ObjectMap(SETTINGS)
    watch(world, objects, 60)
    assert len(outlines(objects)) == 2


def test_sides_are_finished_that_were_seen_whole_and_views_are_noted() -> None:
    world, objects = World([box(2.0, 0.0, 0.4, 0.4)]), ObjectMap(SETTINGS)
    watch(world, objects, 20)
    [one] = objects.objects()
    ends = np.roll(one.polygon, -1, axis=0)
    is_front = (np.abs(one.polygon[:, 0] - 1.8) < 0.02) & (np.abs(ends[:, 0] - 1.8) < 0.02)
    assert one.finished[is_front].all()
    assert not one.finished[~is_front].all()
    assert one.seen_from == 1 << 4
    assert one.confidence > 0.4


def test_frames_that_make_no_sense_are_refused_and_odd_hulls_are_not() -> None:
    objects, view = ObjectMap(SETTINGS), np.array([[0.0, 0.0], [1.5, -1.0], [1.5, 1.0]])
    frame = FrameObjects(1.0, (0.0, 0.0), view, (), np.zeros((0, 4)))
    bow = np.array([[2.0, 0.0], [2.4, 0.4], [2.4, 0.0], [2.0, 0.4]])
    odd = (bow, bow[:2], bow[:1], bow[:0], np.repeat(bow[:1], 4, axis=0))
    found = tuple(Detection(polygon, 0.0, 1.0, 9) for polygon in odd)
    objects.update(frame._replace(detections=found))
    objects.update(frame._replace(view=np.zeros((0, 2)), walls=np.zeros((1, 4))))
    with pytest.raises(ValueError, match=r"at_s: must be finite and at least 1\.0, is 0\.5"):
        objects.update(frame._replace(at_s=0.5))
    with pytest.raises(ValueError, match="not finite"):
        objects.update(frame._replace(view=view * np.nan))
    with pytest.raises(ValueError, match="origin: must be finite"):
        objects.update(frame._replace(origin=(np.inf, 0.0)))


def test_after_warming_no_frame_compiles_anything() -> None:
    look = QuickCheckSettings(
        rays=60, max_range_m=3.0, tolerance_m=0.1, most_unknown=0.5, every_frames=5
    )
    warm_object_map(SETTINGS, look)


def test_few_fields_are_kept_and_the_rest_goes_on_from_its_outline() -> None:
    few = msgspec.structs.replace(SETTINGS, active_objects=1)
    world, objects = World([box(2.0, 0.0, 0.4, 0.4), box(-2.0, 0.0, 0.4, 0.4)]), ObjectMap(few)
    for _ in range(4):
        watch(world, objects, 20)
        watch(world, objects, 20, yaw=math.pi)
    first, second = outlines(objects)
    assert corner_errors(world.things[0].outline[[0, 3]], first).max() < 0.03
    assert corner_errors(world.things[1].outline[[1, 2]], second).max() < 0.03


def test_a_piece_of_a_wall_goes_when_the_wall_is_known_and_what_stands_before_it_stays() -> None:
    piece, before = box(3.05, 0.0, 0.1, 0.6), box(2.9, -0.9, 0.2, 0.2)  # flush with the wall
    world, objects = World([piece, before], noise=NOISE), ObjectMap(SETTINGS)
    watch(world, objects, 40)
    assert len(outlines(objects)) == 2
    world.things, world.walls = [before], np.array([[3.0, -1.5, 3.0, 1.5]])
    watch(world, objects, SEEN_S)
    [still] = objects.objects()
    assert overlap(still.polygon, before.outline) > 0.4  # half of it was seen


@pytest.mark.parametrize("is_first", [False, True])
def test_a_post_before_a_wall_is_in_the_map_beside_it(is_first: bool) -> None:
    """Eight centimetres out of it: more than a hull errs by, and less than a machine keeps."""
    post, wall = box(2.96, 0.3, 0.08, 0.08), np.array([[3.0, -1.5, 3.0, 1.5]])
    world, objects = World([post] if is_first else [], noise=NOISE), ObjectMap(SETTINGS)
    world.walls = np.zeros((0, 4)) if is_first else wall
    watch(world, objects, 40)
    world.things, world.walls = [post], wall
    watch(world, objects, 40)
    [found] = objects.objects()
    assert found.polygon[:, 0].min() == pytest.approx(2.92, abs=0.02)
    assert overlap(found.polygon, post.outline) > 0.3  # its front was seen


@pytest.mark.parametrize("x_m", [2.98, 2.6])
def test_a_tall_post_flat_on_a_wall_is_no_person_and_two_short_looks_make_it_an_object(
    x_m: float,
) -> None:
    """Five centimetres out of the wall nobody has room; at 40 a person may stand."""
    world, objects = World([], noise=NOISE), ObjectMap(SETTINGS)
    world.walls = np.array([[3.0, -1.5, 3.0, 1.5]])
    watch(world, objects, 40)
    world.things = [box(x_m, 0.3, 0.06, 0.08, top_m=2.0)]
    for _ in range(2):
        watch(world, objects, SETTINGS.confirm_frames - 2)
        watch(world, objects, 2 * SEEN_S, yaw=math.pi)
    assert len(objects.objects()) == (x_m > 2.9)
    watch(world, objects, 5)
    assert len(objects.objects()) == (x_m > 2.9)


@pytest.mark.parametrize("is_cut", [False, True])
def test_what_goes_on_above_the_image_may_be_a_person(is_cut: bool) -> None:
    world, objects = World([box(1.0, 0.0, 0.3, 0.3, top_m=0.7)]), ObjectMap(SETTINGS)
    for _ in range(2 * SETTINGS.confirm_frames):
        frame = world.frame(0.0, 0.0, 0.0)
        seen = tuple(one._replace(is_cut=is_cut) for one in frame.detections)
        told = objects.update(frame._replace(detections=seen)).obstacles
        world.walk()
    assert (len(objects.objects()), len(told)) == ((0, 1) if is_cut else (1, 0))


def test_somebody_who_leans_into_a_wall_is_not_flat_on_it() -> None:
    world, objects = World([], noise=NOISE), ObjectMap(SETTINGS)
    world.walls = np.array([[3.0, -1.5, 3.0, 1.5]])
    watch(world, objects, 40)
    world.things = [person(3.0, 0.3)]  # half of him in a niche
    [*_, last] = watch(world, objects, 4 * SETTINGS.confirm_frames)
    assert objects.objects() == []
    assert len(last.obstacles) == 1


@pytest.mark.parametrize(("frames", "left"), [(8, 0), (40, 1)])
def test_a_walls_end_face_goes_when_the_wall_is_known_unless_it_has_settled(
    frames: int, left: int
) -> None:
    world, objects = World([box(3.08, 1.58, 0.1, 0.1)]), ObjectMap(SETTINGS)
    watch(world, objects, frames)
    assert len(outlines(objects)) == 1
    world.things, world.walls = [], np.array([[3.0, -1.5, 3.0, 1.5]])
    watch(world, objects, SETTINGS.confirm_frames + 1)  # sooner than it was seen to be gone
    assert len(outlines(objects)) == left


def test_what_a_field_gives_away_is_not_drawn_as_its_own_again() -> None:
    field = DistanceField(SETTINGS)
    field.reach(np.array([0.0, 0.0]), np.array([0.6, 0.6]))
    field.mean[:], field.weight[:] = SETTINGS.band_m, SETTINGS.memory_frames
    for low, high in ((0, 8), (14, 18), (24, 32)):  # three parts, one between the others
        field.mean[low + 4 : high + 4, 10:20] = -SETTINGS.band_m
    places = polygons_of(field.values(), field.place, SETTINGS.cell_m, SETTINGS.least_size_m)
    assert len(places) == 3
    between = min(places, key=area_of)
    field.give_away(pieces_of(between, 1.0))
    left = polygons_of(field.values(), field.place, SETTINGS.cell_m, SETTINGS.least_size_m)
    assert len(left) == 2
    assert all(apart_m(one, between) > 0.05 for one in left)


@pytest.mark.parametrize("turn", range(4))
def test_a_step_between_two_parallel_sides_is_kept_whichever_way_it_is_turned(turn: int) -> None:
    corners = [(0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (11.0, 10.0), (10.0, 12.0), (0.0, 12.0)]
    outline = rotate(shapely.Polygon(corners), 90 * turn)
    ring = np.asarray(outline.segmentize(0.5).exterior.coords)[:-1]
    kept = shapely.Polygon(straightened(ring))
    assert kept.symmetric_difference(outline).area < 1e-6
