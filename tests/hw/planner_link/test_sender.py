"""The sender against the receiver of the fakes: maps equal, budgets kept, requests heard."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.records import FREE, OBSTACLE
from hw.planner_link.frames import ACK, GEOM
from mapod_link.frames import bytes_from_frame
from tests.support.planner_line import Line, Sky


@given(
    size=st.integers(3, 40),
    corner=st.tuples(st.integers(-33000, 33000), st.integers(-33000, 33000)),
    moves=st.lists(
        st.tuples(st.integers(-5, 5), st.integers(-5, 5), st.integers(0, 30)), max_size=12
    ),
    seed=st.integers(0, 1000),
)
def test_without_loss_the_planner_holds_the_map_after_every_tick(
    size: int, corner: tuple[int, int], moves: list[tuple[int, int, int]], seed: int
) -> None:
    line = Line(Sky(size, seed, corner))
    for di, dj, count in moves:
        line.sky.move(di, dj)
        line.sky.change(count)
        line.tick()
        assert line.holds_what_is_meant()
        assert not line.planner.suspect


def test_a_line_that_was_quiet_for_long_is_not_flooded_by_the_next_burst() -> None:
    sky = Sky(101, 1)
    line = Line(sky, baud=115_200)
    sky.show(sky.every_other, FREE)
    line.settle(5.0)
    line.tick_bytes.clear()
    sky.show(sky.every_other, OBSTACLE)
    line.settle(0.2)
    carried = 11_520 * 0.85 / 50
    assert max(line.tick_bytes) < 3 * carried
    assert sum(line.tick_bytes[:5]) < 8 * carried


def test_a_slow_line_spends_on_the_refresh_what_changes_leave() -> None:
    line = Line(Sky(101, 1), baud=115_200, ack_every=0)
    line.sky.change(606)
    line.settle(4.0)
    at = np.argwhere(line.planner.window() == 2)[::20]
    line.planner._map._cells[at[:, 0], at[:, 1]] = 1  # gone wrong, and nobody knows
    line.settle(0.6)
    assert line.holds_what_is_meant()


def test_new_obstacles_near_the_robot_go_first_when_not_all_fits() -> None:
    sky = Sky(101, 1)
    line = Line(sky, baud=115_200)
    line.settle(2.0)
    sky.cells[::2, ::2] = FREE  # 2601 runs: far more than a tick carries
    sky.cells[45:56:2, 45:56:2] = OBSTACLE
    sky.cells[0:20:2, 1:21:2] = OBSTACLE
    sky._changed = list(range(101 * 101))
    line.tick()
    near = line.planner.window()[45:56:2, 45:56:2]
    assert (near == 2).all()
    assert int((line.planner.window() == 1).sum()) < 1500
    line.settle(4.0)
    assert line.holds_what_is_meant()


def test_free_is_taken_back_at_once_when_the_map_is_not_to_be_trusted() -> None:
    line = Line(Sky(41, 3))
    line.sky.change(200)
    line.settle(0.5)
    assert (line.planner.window() == 1).any()
    line.sky.trusted = False
    line.tick()
    assert set(line.planner.window().flat) == {0, 2}
    line.settle(1.0)
    assert set(line.planner.window().flat) == {0, 2}
    line.sky.trusted = True
    line.tick()
    assert line.holds_what_is_meant()


def test_acknowledgements_of_the_old_map_on_their_way_do_not_start_the_new_one_again() -> None:
    line = Line(Sky(41, 3))
    line.sky.change(200)
    line.settle(0.5)
    late = line.planner.ack(line.now_s)
    geometries = line.planner.accepted[GEOM]
    line.sky.cells[:] = 0
    line.sky.epoch += 1
    line.tick()
    assert not line.planner.window().any()
    line.port.give(bytes_from_frame(ACK, 99, 0, late))
    line.sky.change(3)
    line.settle(0.2)
    assert line.planner.accepted[GEOM] == geometries + 1
    assert line.holds_what_is_meant()
