"""Free ground ages where something may have come in, and the stop zone sees it."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from core.driving.control import DriveControl
from core.driving.zone import ZoneReporter
from core.grid.ring import RingGrid
from core.grid.window import ObstacleWindow
from core.mapping.freshness import SWEEP_S, Freshness
from core.records import FREE, OBSTACLE, UNKNOWN, StopZoneReport
from tests.support.maps.cell_rig import SCAN_S, CellRig, Point, floor_at
from tests.support.maps.flat_ride import Ride, Rig, config_of, state_at
from tests.support.maps.flat_world import World

HERE = (2.1, 0.1)
FOOTPRINT = (0.5, 0.25, 0.25)  # ahead, behind, to either side


def seen_after(x: float, y: float, yaw: float) -> dict[tuple[int, int], float]:
    """When each world cell of a window was seen, once a robot has stood somewhere at 7 s."""
    grid = RingGrid(11, 0.25)
    grid.follow(1.75, -2.0)  # its last column in memory lies within it
    fresh = Freshness(grid, 1.0, FOOTPRINT)
    fresh.follow(7.0, x, y, (math.cos(yaw), math.sin(yaw)))
    return {
        (i, j): float(fresh.seen_s[(j % 11) * 11 + i % 11])
        for i in range(grid.corner_i, grid.corner_i + 11)
        for j in range(grid.corner_j, grid.corner_j + 11)
    }


@given(st.floats(-0.5, 3.2), st.floats(-3.5, -0.5), st.floats(-3.2, 3.2))
@example(1.125, -1.875, 0.0)  # middles of cells lie on its edges
@example(0.0, -3.25, 0.0)
@example(2.25, -1.0, 0.5)
@example(2.5, -2.0, 0.0)
@example(3.0, -2.0, 0.0)
def test_the_robot_sees_to_the_cells_whose_middles_it_covers(
    x: float, y: float, yaw: float
) -> None:
    c, s = math.cos(yaw), math.sin(yaw)
    for (i, j), seen_s in seen_after(x, y, yaw).items():
        dx, dy = (i + 0.5) * 0.25 - x, (j + 0.5) * 0.25 - y
        ahead, aside = c * dx + s * dy, c * dy - s * dx
        covered = -0.25 <= ahead <= 0.5 and -0.25 <= aside <= 0.25
        assert seen_s == (7.0 if covered else -math.inf)


def test_ages_count_to_now_and_what_was_never_seen_has_none() -> None:
    fresh = Freshness(RingGrid(3, 0.25), 1.0, FOOTPRINT)
    never_s = -math.inf
    assert np.isnan(fresh.ages_s(np.array([never_s, never_s]))).all()  # before the first scan
    fresh.now_s = 7.0
    np.testing.assert_array_equal(fresh.ages_s(np.array([7.0, 4.5, never_s])), [0.0, 2.5, math.nan])


@pytest.mark.parametrize("footprint", [(0.2, 1.2, 0.2), (1.2, 0.2, 0.2), (0.2, 0.2, 1.2)])
def test_the_farthest_corners_of_a_long_robot_count(footprint: tuple[float, float, float]) -> None:
    grid = RingGrid(21, 0.25)
    fresh = Freshness(grid, 1.0, footprint)
    fresh.follow(1.0, 0.0, 0.0, (1.0, 0.0))
    assert np.sum(np.isfinite(fresh.seen_s)) == (20 if footprint[2] > 1.0 else 12)


def test_a_beam_that_leaves_the_map_says_nothing_of_the_cells_that_lie_across() -> None:
    rig = CellRig(11, 11)
    seen_s = rig.maps.fresh.seen_s
    seen_s[:], rig.t_s = -1.0, 1.0
    for _ in range(2):  # each beam is looked at in every other scan
        rig.add((3.1, 0.1, 0.0))
    seen = {(i, j) for i in range(-5, 6) for j in range(-5, 6) if seen_s[j % 11 * 11 + i % 11] > 0}
    footprint = {(i, j) for i in range(-3, 4) for j in range(-2, 2)}
    assert {(4, 0), (5, 0)} <= seen <= {(i, 0) for i in range(6)} | footprint


AGES = st.lists(st.sampled_from([0.0, 1.0, 2.0]), min_size=81, max_size=81)


@given(AGES, st.lists(st.sampled_from([0.1, 0.25, 0.5, 1.5]), min_size=1, max_size=6))
def test_rows_are_looked_at_in_turn_and_what_is_too_old_there_is_unknown(
    ages_s: list[float], waits_s: list[float]
) -> None:
    """A window of five rows, in a grid of nine: what is older than a second is too old."""
    grid, window = RingGrid(9, 0.25), ObstacleWindow(5, 0.25)
    fresh = Freshness(grid, 1.0, FOOTPRINT)
    grid.follow(1.5, -1.0)
    window.follow(1.25, -0.75)
    window.cells[...] = FREE
    window.cells[2, 3], window.cells[4, 1] = OBSTACLE, UNKNOWN
    model, now_s, row = window.cells.copy(), 0.0, 0
    for wait_s in (math.inf, *waits_s):  # the first time, all
        now_s += min(wait_s, 100.0)
        fresh.follow(now_s, 99.0, 99.0, (1.0, 0.0))
        fresh.seen_s[:] = now_s - np.array(ages_s)
        for k in range(row, row + math.ceil(5 * min(wait_s, 1.0))):
            for column in range(5):
                i = next(i for i in range(window.grid.corner_i, 99) if i % 5 == column)
                j = next(j for j in range(window.grid.corner_j, 99) if j % 5 == k % 5)
                old = ages_s[(j % 9) * 9 + i % 9] > 1.0
                if model[k % 5, column] == FREE and old:
                    model[k % 5, column] = UNKNOWN
        row += math.ceil(5 * min(wait_s, 1.0))
        fresh.expire(window)
        np.testing.assert_array_equal(window.cells, model)
        if wait_s != math.inf:
            ages_s = ages_s[1:] + ages_s[:1]


def zone_of(rig: Rig) -> StopZoneReport:
    """What the planner is told of the stop zone now."""
    control = DriveControl(config_of(), rig.mapper.maps)
    pose = rig.mapper.maybe_pose(rig.now_s)
    reporter = ZoneReporter(control, rig.maps.window, 1.0)
    return reporter.report(pose, True, (0.0, 0.0), None)


def test_a_robot_that_stands_for_long_says_no_longer_that_it_is_free_behind_it() -> None:
    config = config_of(obstacle={"free_max_age_s": 5.0})
    rig = Rig(config, World(), Ride(v_mps=1.5, stop_s=8.0), 8.0 + 5.0 + 2 * SWEEP_S)
    for now_s in rig.drive():
        if now_s < 8.5:
            soon = zone_of(rig)
    late = zone_of(rig)
    assert soon.free_behind_m > 1.5
    assert late.free_behind_m < 0.1
    assert soon.free_ahead_m == pytest.approx(late.free_ahead_m, abs=0.5)  # beams pass over it
    assert late.free_ahead_m > 6.0
    x, y, _ = rig.place()
    assert state_at(rig, x, y) == FREE  # nothing comes in under the robot
    assert state_at(rig, x - 1.0, y) == UNKNOWN
    assert state_at(rig, x + 2.0, y) == FREE


def rest(rig: CellRig, seconds: float, *points: Point) -> None:
    """Scans that see nothing, or these places, for a while."""
    for _ in range(round(seconds / SCAN_S)):
        rig.add(*points)


def free_rig(max_age_s: float = 1.5, window: int = 41, here: tuple[float, float] = HERE) -> CellRig:
    """Floor that is free at a place, and around."""
    rig = CellRig(window=window, free_max_age_s=max_age_s)
    rig.lay_floor(*here)
    assert rig.state(*here) == FREE
    return rig


@pytest.mark.parametrize("window", [41, 25])
def test_free_lasts_as_long_as_the_settings_say_and_comes_back_when_floor_is_met(
    window: int,
) -> None:
    rig = free_rig(window=window)
    rig.window.take_changed()
    rest(rig, 1.4)
    assert rig.state(*HERE) == FREE
    rest(rig, 0.2 + SWEEP_S)
    assert not (rig.window.cells == FREE).any()
    changed = rig.window.take_changed()
    assert len(changed) >= 9
    assert (rig.window.cells.ravel()[changed] == UNKNOWN).all()
    rig.add(*floor_at(*HERE, 1))
    assert rig.state(*HERE) == FREE
    assert rig.state(HERE[0] + 0.2, HERE[1]) == UNKNOWN


def test_a_neighbour_that_is_met_does_not_make_old_ground_free_again() -> None:
    rig = free_rig()
    rest(rig, 1.7 + SWEEP_S, *floor_at(HERE[0], HERE[1] + 0.2, 1))
    assert rig.state(HERE[0], HERE[1] + 0.2) == FREE
    assert rig.state(*HERE) == UNKNOWN


@pytest.mark.parametrize(("falls", "state"), [(True, FREE), (False, UNKNOWN)])
def test_beams_that_pass_over_on_their_way_down_keep_ground_free(falls: bool, state: int) -> None:
    rig = free_rig()
    over: Point = (3.9, 0.1, 0.05 if falls else 1.2)
    rest(rig, 3.0, *[over] * 3)
    assert rig.state(*HERE) == state


def test_beams_that_pass_over_too_late_or_that_never_come_back_do_not() -> None:
    rig, over = free_rig(), [(3.9, 0.1, 0.05)] * 3
    for _ in range(round(3.0 / SCAN_S)):
        rig.add(*over, returns=False)
    assert rig.state(*HERE) == UNKNOWN
    rest(rig, 0.5, *over)
    assert rig.state(*HERE) == UNKNOWN


@pytest.mark.parametrize("here", [HERE, (-2.1, -1.1)])
def test_under_the_robot_nothing_comes_in(here: tuple[float, float]) -> None:
    rig = free_rig(here=here)
    rig.follow(*here)
    rest(rig, 3.0)
    assert rig.state(*here) == FREE
    assert rig.state(here[0], here[1] + 0.2) == FREE
    assert rig.state(here[0] - 0.4, here[1]) == UNKNOWN  # its middle lies behind the footprint
    rig.follow(here[0] + 1.5, here[1])  # it has gone
    rest(rig, 1.7 + SWEEP_S)
    assert rig.state(*here) == UNKNOWN


def test_after_a_pause_all_of_the_window_is_looked_at_once() -> None:
    rig = free_rig()
    rig.t_s += 60.0
    rig.add()
    assert not (rig.window.cells == FREE).any()


def test_an_obstacle_does_not_age() -> None:
    rig = CellRig(free_max_age_s=1.0)
    rest(rig, 0.4, *floor_at(1.5, 0.1, 5))
    rest(rig, 0.4, *floor_at(1.5, 0.1, 5), *[(2.1, 0.1, 0.05 * k) for k in range(6, 12)])
    assert rig.state(2.1, 0.1) == OBSTACLE
    rest(rig, 2.5)
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_old_ground_that_comes_into_a_smaller_window_is_unknown() -> None:
    rig = free_rig(max_age_s=60.0, window=21)
    for pause_s, state in ((50.0, FREE), (20.0, UNKNOWN)):
        rig.follow(-2.0, 0.0)
        rig.add()
        rig.t_s += pause_s
        rig.add()
        rig.follow(0.0, 0.0)
        rig.add()
        assert rig.state(*HERE) == state
