"""What the C planner never asks for, whatever the map is; and that it gets where it can."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import examples
from tests.support.link.c_bench import Bench, driving, random_ground, set_out
from tools.rig.planner.host import PlannerSettings


@settings(max_examples=examples(12), deadline=None)
@given(
    seed=st.integers(0, 10_000),
    share=st.floats(0.02, 0.5),
    yaw=st.floats(-3.1, 3.1),
    v_mps=st.floats(0.0, 0.8),
)
def test_no_motion_that_it_asks_for_would_be_stopped_by_the_app(
    seed: int, share: float, yaw: float, v_mps: float
) -> None:
    bench = Bench()
    random_ground(bench, seed, share)
    bench.put((-0.6, 0.6), (-0.6, 0.6), FREE)
    bench.place, bench.moves = (0.0, 0.0, yaw), (v_mps, 0.0)
    bench.run(0.3)
    bench.planner.goal(7.0, 3.0)

    def check() -> None:
        assert bench.is_safe(), (bench.newest, bench.state)

    bench.run(3.0, check)


@settings(max_examples=examples(5), deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_robot_that_drives_through_what_lies_about_never_touches_anything(seed: int) -> None:
    bench = Bench()
    random_ground(bench, seed, 0.05)
    bench.put((-1.2, 1.2), (-1.2, 1.2), FREE)
    set_out(bench, 8.0, -2.0)

    def check() -> None:
        assert bench.is_safe(), (bench.newest, bench.state, bench.place)

    bench.run(20.0, check)
    assert bench.place != (0.0, 0.0, 0.0) or bench.state.why


def test_it_drives_to_its_goal_and_says_so() -> None:
    bench = driving(Bench())
    bench.obeys = True
    bench.run(25.0)
    assert bench.state.state == "arrived"
    assert math.dist(bench.place[:2], (8.0, 0.0)) < 0.3
    assert bench.newest == (0.0, 0.0)
    count = len(bench.asked)
    bench.run(3.0)
    assert len(bench.asked) == count, "who has arrived leaves the robot to others"


def test_it_steers_round_what_stands_in_the_way() -> None:
    bench = Bench()
    bench.put((3.0, 3.6), (-1.0, 1.4), OBSTACLE)
    set_out(bench, 8.0, 0.0)
    aside = []
    bench.run(45.0, lambda: aside.append(abs(bench.place[1])))
    assert bench.state.state == "arrived"
    assert max(aside) > 1.3


def test_unknown_ground_is_entered_only_where_the_settings_allow_it_and_slowly() -> None:
    for settings_, expected in (
        (PlannerSettings(), 0.0),
        (PlannerSettings(unknown_mps=0.2), 0.2),
        (PlannerSettings(start_clear_m=9.0), 0.8),
    ):
        bench = Bench(settings_)
        bench.cells[:] = UNKNOWN
        bench.run(0.3)
        bench.planner.goal(5.0, 0.0)
        bench.run(2.0)
        bench.moves = (0.8, 0.0)
        fastest: list[float] = []
        bench.run(5.0, lambda b=bench, f=fastest: f.append(b.newest[0]))  # type: ignore[misc]
        assert max(fastest) <= expected
        assert max(fastest) > 0.7 * expected or expected == 0.0


@pytest.mark.parametrize(("clear_m", "goal_m", "wall_m"), [(3.0, 8.0, 9.9), (9.0, 5.0, 1.4)])
def test_ground_assumed_clear_ends_at_its_radius_and_at_an_obstacle(
    clear_m: float, goal_m: float, wall_m: float
) -> None:
    bench = Bench(PlannerSettings(start_clear_m=clear_m))
    bench.cells[:] = UNKNOWN
    bench.put((wall_m, wall_m + 0.1), (-9.0, 9.0), OBSTACLE)
    set_out(bench, goal_m, 0.0)

    def check() -> None:
        assert bench.is_safe(clear_m)
        assert math.hypot(*bench.place[:2]) < clear_m - 0.3

    bench.run(15.0, check)
    assert min(clear_m, wall_m) - 2.0 < bench.place[0] + 0.52 < min(clear_m, wall_m)


def test_places_beyond_all_sense_move_nothing() -> None:
    bench = Bench()
    bench.place = (2.0e6, 0.0, 0.0)
    bench.run(0.3)
    bench.planner.goal(1.0, 0.0)
    bench.run(1.0)
    assert bench.newest == (0.0, 0.0)
    assert bench.state.why == "the pose is not valid"


def test_requests_hold_for_a_third_of_a_second_and_end_when_it_is_halted() -> None:
    bench = driving(Bench())
    count = len(bench.asked)
    bench.run(3.0)
    assert 29 <= len(bench.asked) - count <= 31
    assert {drive[2] for drive in bench.asked} == {0.3}
    bench.planner.halt()
    bench.run(0.3)
    assert bench.newest == (0.0, 0.0)
    assert bench.state.state == "idle"


def test_settings_out_of_range_are_refused() -> None:
    for start_clear_m, unknown_mps in ((0.0, 9.0), (-1.0, 0.0)):
        with pytest.raises(ValueError, match="start_clear_m must be 0 to 30"):
            PlannerSettings(start_clear_m, unknown_mps)
