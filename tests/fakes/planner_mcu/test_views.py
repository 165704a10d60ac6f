"""The C planner before ground that it cannot see from here, and before who crosses its way."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import few
from tests.support.link.c_bench import CELL_M, Bench, set_out
from tools.rig.planner.build import shipped_robot
from tools.rig.planner.host import PlannerSettings
from tools.rig.runs.one_run import Run, RunSpec

GOAL = (8.0, 0.0)


def see(bench: Bench, farther_m: float = 0.0) -> None:
    """Unknown ground on the line becomes free, as a laser that looks down would have it.

    farther_m: than on level ground, as on the way up to a crest.
    """
    line_m = bench.planner.settings.robot.line_mm / 1000 + farther_m
    x, y, yaw = bench.place
    j, i = np.nonzero(bench.cells == UNKNOWN)
    dx, dy = (i + bench.corner + 0.5) * CELL_M - x, (j + bench.corner + 0.5) * CELL_M - y
    ahead = dx * math.cos(yaw) + dy * math.sin(yaw)
    aside = np.abs(dy * math.cos(yaw) - dx * math.sin(yaw))
    seen = (ahead >= line_m - 0.15) & (ahead <= line_m + 0.25) & (aside < 4.0)
    bench.cells[j[seen], i[seen]] = FREE


def corridor(line_mm: int = 8450) -> Bench:
    """Walls on both sides, and across it a band of ground that the line has passed unseen."""
    bench = Bench(PlannerSettings(robot=replace(shipped_robot(), line_mm=line_mm)))
    bench.put((-10.2, 10.2), (-2.6, -2.2), OBSTACLE)
    bench.put((-10.2, 10.2), (2.2, 2.6), OBSTACLE)
    bench.put((3.0, 4.4), (-2.2, 2.2), UNKNOWN)
    set_out(bench, *GOAL)
    return bench


@pytest.mark.parametrize(("line_mm", "goes_back_to_m"), few([(8450, -4.0), (6500, -2.0)], 1))
def test_it_looks_from_farther_off_at_ground_that_the_line_has_passed(
    line_mm: int, goes_back_to_m: float
) -> None:
    bench, whys, least_m = corridor(line_mm), set[str](), 0.0
    for _ in range(1800):
        bench.tick()
        see(bench)
        assert bench.is_safe()
        whys.add(bench.state.why)
        least_m = min(least_m, bench.place[0])
        if bench.state.state == "arrived":
            break
    assert bench.state.state == "arrived"
    assert goes_back_to_m - 2.0 < least_m < goes_back_to_m, "from here nothing of it is seen"
    assert "goes to where the ground ahead can be seen" in whys


@pytest.mark.slow
def test_where_the_line_lies_farther_off_than_on_level_ground_it_goes_back_farther_yet() -> None:
    bench = corridor(6500)
    for _ in range(3600):
        bench.tick()
        see(bench, farther_m=1.9)
        assert bench.is_safe()
        if bench.state.state != "driving":
            break
    assert bench.state.state == "arrived"


@pytest.mark.slow
def test_ground_that_no_place_shows_is_given_up_and_so_is_the_goal_behind_it() -> None:
    bench = corridor()
    bench.run(601.0)
    assert bench.state.state == "stopped"
    assert bench.state.why in ("no way over seen ground", "not there after the longest time")
    assert bench.place[0] < 3.0


def test_it_waits_for_who_crosses_though_there_is_a_way_round() -> None:
    bench = Bench()
    set_out(bench, *GOAL)
    bench.run(3.0)
    assert bench.newest[0] > 0.5
    bench.put((5.0, 5.4), (-0.4, 0.4), OBSTACLE)
    bench.run(3.0)
    assert bench.newest == (0.0, 0.0)
    assert bench.state.why == "waits for what is in the way"
    bench.put((5.0, 5.4), (-0.4, 0.4), FREE)
    before_m = bench.place[0]
    bench.run(2.5)
    assert bench.newest[0] > 0.0, "nothing is left to wait for"
    assert bench.place[0] > before_m - 0.1
    bench.run(20.0)
    assert bench.state.state == "arrived"


def test_what_stays_on_the_way_is_driven_round_after_a_look_from_farther_back() -> None:
    bench = Bench()
    set_out(bench, *GOAL)
    bench.run(5.0)
    at_m = bench.place[0]
    bench.put((7.0, 7.4), (-0.4, 0.4), OBSTACLE)
    ways: list[float] = []
    bench.run(90.0, lambda: ways.append(bench.place[0]))
    assert bench.state.state == "arrived"
    lowest = ways.index(min(ways[20:]))
    assert max(ways[:lowest]) > ways[lowest] + 1.0 > at_m


@pytest.mark.slow
def test_who_gets_stuck_as_it_turns_towards_a_view_goes_well_back_before_it_turns_again() -> None:
    """Round a corner, ground beside the robot was not seen, and it can't turn where it stands."""
    run = Run(RunSpec("turn", 232469, limit_s=130.0))
    while not run.ended and run.goals.reached == 0:
        run.step()
    assert run.goals.reached == 1
