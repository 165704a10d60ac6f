"""A wall's line, from segments of frames."""

import numpy as np
import pytest

from core.objects.records import FrameObjects
from core.objects.vector_map.align import Correction
from core.objects.vector_map.mapped import MapObject
from core.objects.vector_map.object_map import ObjectMap
from core.objects.vector_map.wall_map import WallMap
from core.objects.vector_map.walls import Wall
from core.records import F64
from tools.experiments.object_world import SETTINGS, Noise, Thing, World, box

SIGMA_M = 0.012  # of a segment's end


def seen(wall: Wall | None, from_m: float, to_m: float, noise: F64, at_s: float) -> Wall:
    """One segment of a wall along x."""
    segment = np.array([from_m, noise[0], to_m, noise[1]])
    wall = wall or Wall(1, segment, at_s, SETTINGS)
    wall.hit(segment, segment, at_s)
    return wall


@pytest.mark.parametrize("seed", range(4))
def test_what_is_seen_of_one_end_does_not_turn_the_other_away(seed: int) -> None:
    """Twenty metres, seen piece by piece, then two metres of its end for half a minute."""
    random, wall = np.random.default_rng(seed), None
    for k in range(180):
        at_m = 0.1 * k
        wall = seen(wall, at_m, at_m + 2.0, SIGMA_M * random.standard_normal(2), 0.1 * k)
    for k in range(120):
        wall = seen(wall, 18.0, 20.0, SIGMA_M * random.standard_normal(2), 18.0 + 0.25 * k)
    assert wall is not None
    [segment] = wall.record().segments
    assert segment[[0, 2]] == pytest.approx([0.4, 20.0], abs=0.06)  # before it too few saw it
    assert np.abs(segment[[1, 3]]).max() < 0.02


def test_a_wall_is_where_the_poses_had_it_in_the_mean_and_not_where_it_was_first() -> None:
    """A frame is fitted to the map before, and lies on its wall then, wherever that is."""
    first = np.array([0.0, 0.03, 3.0, 0.03])
    wall = Wall(1, first, 0.0, SETTINGS)
    wall.hit(first, first, 0.0)
    for k in range(1, 60):
        on_map = wall.record().segments[0] if len(wall.record().segments) else first
        told = on_map * [1.0, 0.0, 1.0, 0.0]  # in truth it is at 0
        wall.hit(on_map, told, 0.1 * k)
    assert np.abs(wall.record().segments[0][[1, 3]]).max() < 0.003


@pytest.mark.parametrize("half_m", [1.47, 1.5, 1.52])
def test_a_walls_ends_do_not_grow_with_the_noise_of_the_pose(half_m: float) -> None:
    noise = Noise(pose_m=0.03, pose_rad=0.005, hull_m=0.005, missing=0.02)
    world, objects = World([], noise=noise), ObjectMap(SETTINGS)
    world.walls = np.array([[3.0, -half_m, 3.0, half_m]])
    for _ in range(300):
        objects.update(world.frame(0.0, 0.0, 0.0))
    [wall] = objects.walls.records()
    [segment] = wall.segments
    assert np.abs(segment[[1, 3]]).max() < half_m + 0.5 * SETTINGS.wall_cell_m + 0.01
    assert segment[3] - segment[1] > 2.0 * half_m - SETTINGS.wall_cell_m


def frame_of(at_s: float, *segments: tuple[float, float, float, float]) -> FrameObjects:
    """A frame that shows walls alone, from before them."""
    view = np.array([[0.0, -2.0], [9.0, -2.0], [9.0, -0.5], [0.0, -0.5]])
    return FrameObjects(at_s, (4.0, -2.5), view, (), np.array(segments))


def walls_of(*frames: FrameObjects) -> tuple[WallMap, list[int]]:
    """A map of them, and the ids that it took back."""
    walls, ids, gone = WallMap(SETTINGS), iter(range(1, 99)), list[int]()
    nowhere = Correction(0.0, 0.0, 0.0, (0.0, 0.0))
    for frame in frames:
        told = walls.update(frame, np.zeros((0, 3)), nowhere, lambda: next(ids))
        gone += [number for number in told if not walls.has(number)]
    return walls, gone


@pytest.mark.parametrize("apart_m", [0.0, 0.02, 0.04])
def test_a_wall_that_is_seen_from_both_ends_becomes_one(apart_m: float) -> None:
    """Until they meet these are two walls: they begin too far from each other."""
    frames = []
    for k in range(100):
        left, right = 0.05 * k, 9.0 - 0.05 * k
        ends = (left, 0.0, left + 1.5, 0.0), (right - 1.5, apart_m, right, apart_m)
        frames.append(frame_of(0.1 * k, *ends))
    walls, gone = walls_of(*frames)
    [wall] = walls.records()
    [segment] = wall.segments
    assert (wall.id, wall.first_seen_s) == (1, 0.0)
    assert gone == [2]
    assert sorted(segment[[0, 2]]) == pytest.approx([0.2, 8.8], abs=0.1)
    assert -0.02 < segment[[1, 3]].min() <= segment[[1, 3]].max() < apart_m + 0.02


@pytest.mark.parametrize("apart_m", [0.08, 0.3])
def test_two_faces_of_a_partition_stay_two_walls(apart_m: float) -> None:
    """One of them is known from elsewhere than where it meets the other."""
    near = [frame_of(0.1 * k, (0.0, 0.0, 1.5, 0.0)) for k in range(8)]
    far = [frame_of(1.0 + 0.1 * k, (4.0, apart_m, 8.0, apart_m)) for k in range(40)]
    more = [frame_of(6.0 + 0.1 * k, (0.3, apart_m, 8.0, apart_m)) for k in range(8)]
    walls, _ = walls_of(*near, *far, *more)
    offsets = sorted(float(wall.segments[0][1]) for wall in walls.records())
    assert offsets == pytest.approx([0.0, apart_m], abs=0.03)


@pytest.mark.parametrize(
    ("long_m", "short_m", "telling"),
    [(9.0, 1.5, 1), (12.0, 3.2, 2), (12.0, 2.8, 1), (8.0, 1.5, 1), (3.0, 1.5, 2)],
)
def test_long_walls_alone_tell_a_frame_where_it_is(
    long_m: float, short_m: float, telling: int
) -> None:
    """In a large room, and in a small one."""
    short, long = (0.5, 0.0, 0.5 + short_m, 0.0), (0.0, -1.0, long_m, -1.0)
    walls, _ = walls_of(*(frame_of(0.1 * k, short, long) for k in range(20)))
    assert len(walls.records()) == 2
    segments = walls.landmarks()
    assert len(segments) == telling
    assert {-1.0} <= set(segments[:, 1].round(3)) <= {-1.0, 0.0}


def test_where_no_wall_is_known_none_tells() -> None:
    assert walls_of()[0].landmarks().shape == (0, 4)


ROUND = [(0.0, 0.0, 0.0), (3.0, -3.0, 1.57), (6.0, 0.0, 3.14), (3.0, 3.0, -1.57)]
BEFORE = ROUND[:1]


@pytest.mark.parametrize(("places", "walls"), [(ROUND, 0), (BEFORE, 1)])
def test_a_face_of_a_thing_that_was_seen_round_is_no_new_wall(
    places: list[tuple[float, float, float]], walls: int
) -> None:
    """From nearby a long face is an upright plane; but one seen from before may be of a wall."""
    world, objects = World([box(3.0, 0.0, 0.6, 1.2)]), ObjectMap(SETTINGS)
    for place in places:
        for _ in range(20):
            objects.update(world.frame(*place))
    [known] = objects.objects()
    world.things = []
    world.walls = np.array([[2.7, -0.6, 2.7, 0.6]])
    for _ in range(20):
        objects.update(world.frame(1.2, 0.0, 0.0))
    assert len(objects.walls.records()) == walls
    if not walls:
        assert [one.id for one in objects.objects()] == [known.id]
    world.walls = np.array([[2.7, -0.6, 2.7, 1.9]])  # it goes on: that is a wall
    for _ in range(20):
        objects.update(world.frame(0.5, 0.4, 0.0))
    assert len(objects.walls.records()) == 1


def test_walls_that_meet_at_a_slight_angle_stay_two() -> None:
    """Seen from their far ends on, each some centimetres too far."""
    out, frames = np.array([np.cos(np.radians(4.0)), np.sin(np.radians(4.0))]), []
    for k in range(60):
        ends = np.array([4.5, 0.0]) + max(3.0 - 0.1 * k, -0.05) * out, [4.5, 0.0] + 4.5 * out
        frames.append(
            frame_of(0.1 * k, (0.0, 0.0, min(1.5 + 0.1 * k, 4.55), 0.0), (*ends[0], *ends[1]))
        )
    walls, gone = walls_of(*frames)
    assert (len(walls.records()), gone) == (2, [])


def seen_round(*things: Thing) -> tuple[World, ObjectMap]:
    """A map that has these, and a world that has them no more: what follows stands for them."""
    world, objects = World([]), ObjectMap(SETTINGS)
    known = [
        MapObject(
            k, one.outline, 0.0, one.top_m, 0.0, 0.0, 255, np.ones(4, dtype=bool), 1.0, "static"
        )
        for k, one in enumerate(things, start=1)
    ]
    objects.start_from(known, [], 0.0)
    return world, objects


@pytest.mark.parametrize("gap_m", [0.12, 0.25])
def test_a_plane_along_two_things_makes_them_neither_one_nor_taller(gap_m: float) -> None:
    off = 0.5 * (1.0 + gap_m)
    low, tall = box(3.0, -off, 0.6, 1.0), box(3.0, off, 0.6, 1.0, top_m=1.5)
    world, objects = seen_round(low, tall)
    before = {one.id: one for one in objects.objects()}
    world.walls = np.array([[2.7, -off - 0.5, 2.7, off + 0.5]])
    for _ in range(60):
        objects.update(world.frame(0.9, 0.0, 0.0))
    after = {one.id: one for one in objects.objects()}
    assert set(after) == set(before)
    for number, one in after.items():
        assert one.top_m == pytest.approx(before[number].top_m, abs=0.01)
        assert np.ptp(one.polygon[:, 1]) < 1.05


def test_what_a_plane_has_beyond_a_thing_is_told_and_kept() -> None:
    world, objects = seen_round(box(3.0, 0.0, 0.6, 1.2))
    world.walls = np.array([[2.7, -0.6, 2.7, 0.95]])
    for _ in range(8):
        update = objects.update(world.frame(1.0, 0.2, 0.0))
        known = [one.polygon for one in update.obstacles]
        known += [one.polygon for one in objects.objects()]
        assert max(float(polygon[:, 1].max()) for polygon in known) > 0.9
    for _ in range(40):
        world.walk()
        objects.update(world.frame(1.0, 0.2, 3.1))
    known = [one.polygon for one in objects.objects()] + [
        w.segments.reshape(-1, 2) for w in objects.walls.records()
    ]
    assert max(float(polygon[:, 1].max()) for polygon in known) > 0.9


def test_a_wall_in_line_with_a_thing_becomes_a_wall_as_it_is_seen_bit_by_bit() -> None:
    world, objects = seen_round(box(3.0, 0.0, 0.6, 1.2))
    for end_m in np.arange(0.7, 3.2, 0.1):
        world.walls = np.array([[2.7, -0.6, 2.7, end_m]])
        for _ in range(20):
            objects.update(world.frame(0.0, 1.2, 0.0))
    assert objects.walls.records()
    assert max(float(np.ptp(one.polygon[:, 1])) for one in objects.objects()) < 1.6
