"""The path reaches the planner by whatever line: whole, or the planner knows that it is not."""

import numpy as np
import pytest
from msgspec.structs import replace

from core.records import PathReport, PathSegment
from fakes.planner_mcu.receiver import FakePlanner
from hw.planner_link.paths import MOST_POINTS
from mapod_link.frames import PATH
from mapod_link.paths import SWEEP, TRAVEL
from tests.support.link.object_source import ObjectWorld
from tests.support.link.planner_line import Line, Sky
from tests.support.link.planner_sender import whole


def line_of(world: ObjectWorld, **how: object) -> Line:
    return Line(Sky(11, 3), vectors=world, **how)  # type: ignore[arg-type]


def planned(*sizes: int) -> ObjectWorld:
    world = ObjectWorld(3)
    world.plan(1, *sizes)
    return world


def holds_path(line: Line, world: ObjectWorld) -> bool:
    told, meant = line.planner.vectors.path, world.path
    assert meant is not None
    points_m = np.concatenate([np.zeros((0, 2)), *(one.points_m for one in meant.segments)])
    kinds = [SWEEP if one.sweeps else TRAVEL for one in meant.segments for _ in one.points_m]
    numbers = [k for k, one in enumerate(meant.segments) for _ in one.points_m]
    if told.points_m.shape != points_m.shape or told.ahead != meant.ahead:
        return False
    near = points_m.size == 0 or np.abs(told.points_m - points_m).max() < 0.00051
    return bool(near) and told.kinds.tolist() == kinds and told.segments.tolist() == numbers


def state(line: Line) -> tuple[str, str]:
    return line.planner.vectors.path_state(line.now_s)


@pytest.mark.parametrize(
    ("baud", "ack_every", "loss"), [(None, 1, 0.3), (None, 0, 0.1), (115_200, 16, 0.1)]
)
def test_a_path_that_is_called_known_is_the_senders_whatever_gets_lost(
    baud: int | None, ack_every: int, loss: float
) -> None:
    world = planned(100, 7, 80)
    line = line_of(world, baud=baud, rate_hz=25, ack_every=ack_every, loss=loss, seed=2)
    known = 0
    for k in range(500):
        if k % 150 == 149:
            world.plan(k, 30, k % 4, 200)
        line.tick()
        seen = line.planner.numbers.last == line.link._scheduler.seq % 2**16
        if seen and state(line)[0] == "known":
            known += 1
            assert holds_path(line, world)
    assert known > 40
    line.loss = 0.0
    line.settle(1.0 if ack_every else 6.0)
    assert state(line) == ("known", "")


def test_where_the_robot_is_on_it_is_told_soon_and_a_new_path_at_once() -> None:
    world = planned(20)
    line = line_of(world)
    line.settle(1.0)
    assert world.path is not None
    world.path = replace(world.path, ahead=7)
    line.settle(0.12)
    assert line.planner.vectors.path.ahead == 7
    world.path = replace(world.path, ahead=None)
    line.settle(0.12)
    assert line.planner.vectors.path.ahead is None
    world.plan(2, 5)
    line.tick()
    assert holds_path(line, world)


def test_that_there_is_no_path_is_told_and_where_nobody_plans_nothing_is() -> None:
    world = planned()
    line = line_of(world)
    line.settle(0.2)
    assert state(line) == ("known", "")
    assert line.planner.vectors.path.points_m.shape == (0, 2)
    nobody = line_of(ObjectWorld())
    nobody.settle(0.2)
    assert state(nobody) == ("none", "no path told yet")
    line.link._vectors.publish = lambda *_, **__: None  # type: ignore[method-assign]
    line.settle(1.5)
    assert state(line) == ("suspect", "the path comes late")


def test_far_points_are_told_from_a_place_near_them_and_what_cannot_be_told_is_counted() -> None:
    far = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 2e6], [1.0, np.nan], [0.0, 0.0]])
    world = ObjectWorld()
    world.path = PathReport(1, (PathSegment(True, far), PathSegment(False, far)), 0)
    line = line_of(world)
    line.settle(0.2)
    path = line.planner.vectors.path
    np.testing.assert_allclose(path.points_m, far[:3])
    assert path.left_out == 7
    world.path = PathReport(2, (PathSegment(True, np.zeros((MOST_POINTS + 5, 2))),), 0)
    line.settle(3.0)
    assert path.whole
    assert (len(path.points_m), path.left_out) == (MOST_POINTS, 5)


def test_who_only_asks_gets_the_path_for_each_question_and_nothing_else() -> None:
    world = planned(100, 10)
    line = line_of(world, planner=FakePlanner(poll_only=True))
    line.settle(0.1)
    for version in (2, 3):
        world.plan(version, 50, 50)
        line.planner.vectors.ask(path=True)
        line.settle(0.1)
        assert holds_path(line, world)
        line.planner.accepted.clear()
        world.plan(version + 10, 3)
        line.settle(1.0)
        assert line.planner.accepted[PATH] == 0


def test_a_long_path_comes_whole_over_a_slow_line_although_it_is_asked_for_again() -> None:
    world = planned(500, 500, 500, 500)
    line = line_of(world, baud=115_200, rate_hz=25)
    line.settle(8.0)
    assert holds_path(line, world)


def test_a_piece_that_is_missing_is_asked_for() -> None:
    world = planned(600)
    line = line_of(world, baud=115_200)
    line.settle(6.0)
    path = line.planner.vectors.path
    assert path.whole
    path.points_m[500] = np.nan  # by a fault of its own, which no ACK shows
    line.settle(0.1)
    assert state(line) == ("suspect", "a piece is missing")
    line.settle(6.0)
    assert holds_path(line, world)
    assert all(len(frame.body) <= 24 + 24 * 4 for frame in whole(line.frames) if frame.type == PATH)
