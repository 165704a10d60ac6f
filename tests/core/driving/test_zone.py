"""What is told of the ground before and behind the robot, against the drive control's own look."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config_file import load_config, with_changes
from core.config import Config
from core.driving.control import MOVING_MPS, DriveControl
from core.driving.corridor import free_path, nearest_obstacles
from core.driving.stop_zone import LONGEST_M, StopZone
from core.driving.zone import (
    CLEAR,
    DROP,
    NOT_TRUSTED,
    OBSTRUCTED,
    SLOW,
    STOP,
    UNSEEN,
    ZoneReporter,
)
from core.mapping.mapper import Mapper
from core.motion.odometry import Pose
from core.records import FREE, OBSTACLE, UNKNOWN, DriveRequest, StopZoneReport
from tests import ROOT
from tests.support.cases import examples

CELL_M, SIZE = 0.1, 121
RECT, MARGIN_M = (0.5, 0.2, 0.3), 0.15
STILL = (0.0, 0.0)


def config() -> Config:
    shipped = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
    return with_changes(
        shipped,
        map={"cells": SIZE, "cell_m": CELL_M},
        obstacle={"window_cells": SIZE},
        robot={
            "front_m": RECT[0],
            "rear_m": RECT[1],
            "width_m": 2 * RECT[2],
            "stop_margin_m": MARGIN_M,
            "start_clear_m": 0.0,
            "max_speed_mps": 1.0,
        },
    )


class Ground:
    """A robot at the origin of a map whose cells a test paints."""

    def __init__(self, state: int = FREE) -> None:
        self.mapper = Mapper(config())
        self.window = self.mapper.maps.window
        self.window.cells[...] = state
        self.control = DriveControl(config(), self.mapper.maps)
        self.reporter = ZoneReporter(self.control, self.window, 1.0)

    def paint(self, x_m: float, y_m: float, state: int) -> None:
        i, j = self.window.grid.cell_of(x_m, y_m)
        self.window.cells[j % SIZE, i % SIZE] = state

    def report(
        self,
        moves: tuple[float, float] = STILL,
        request: DriveRequest | None = None,
        yaw_rad: float = 0.0,
        trusted: bool = True,
        assumed_clear: bool = False,
    ) -> StopZoneReport:
        pose = Pose(0.0, 0.0, 0.0, yaw_rad, 0.0, 0.0)
        return self.reporter.report(pose, trusted, moves, request, assumed_clear)


def test_on_free_ground_the_way_ends_where_the_window_does() -> None:
    told = Ground().report()
    edge_m = (SIZE - SIZE // 2) * CELL_M
    assert told.free_ahead_m == pytest.approx(edge_m - RECT[0] - MARGIN_M, abs=1e-6)
    assert told.free_behind_m == pytest.approx(SIZE // 2 * CELL_M - RECT[1] - MARGIN_M, abs=1e-6)
    assert (told.state, told.causes) == (CLEAR, 0)
    assert told.allowed_ahead_mps == told.allowed_behind_mps == 1.0
    assert math.isinf(told.obstacle_ahead_m)
    assert math.isinf(told.nearest_m)
    assert math.isinf(told.contact_s)


def test_a_wall_ahead_slows_and_then_stops_and_leaves_the_way_back_free() -> None:
    for x_m, expected in ((1.3, SLOW), (0.75, STOP)):
        ground = Ground()
        ground.paint(x_m, 0.05, OBSTACLE)
        told = ground.report()
        assert (told.state, told.causes) == (expected, OBSTRUCTED)
        near_m = math.floor(x_m / CELL_M + 1e-9) * CELL_M - RECT[0]
        assert told.free_ahead_m == pytest.approx(max(0.0, near_m - MARGIN_M), abs=1e-6)
        assert told.obstacle_ahead_m == told.free_ahead_m
        assert told.nearest_m == pytest.approx(near_m, abs=1e-6)
        assert told.allowed_behind_mps == 1.0
        assert ground.report(moves=(-0.5, 0.0)).state == CLEAR


def test_a_robot_at_the_least_speed_of_motion_counts_as_moving() -> None:
    ground = Ground()
    ground.paint(0.75, 0.05, OBSTACLE)
    assert ground.report(moves=(-0.99 * MOVING_MPS, 0.0)).state == STOP  # ahead counts
    assert ground.report(moves=(-MOVING_MPS, 0.0)).state == CLEAR


def test_unseen_ground_ends_the_way_but_is_no_obstacle() -> None:
    ground = Ground()
    ground.paint(0.8, 0.05, UNKNOWN)
    ground.paint(1.6, 0.05, OBSTACLE)
    told = ground.report()
    assert told.causes == UNSEEN
    assert told.free_ahead_m < told.obstacle_ahead_m < 1.0
    assert (
        ground.report(assumed_clear=True).free_ahead_m == told.free_ahead_m
    )  # nobody vouches for 0 m


def test_contact_is_when_the_margin_meets_what_is_not_free() -> None:
    ground = Ground()
    ground.paint(2.05, 0.05, OBSTACLE)
    told = ground.report(moves=(0.5, 0.0))
    assert told.contact_s == pytest.approx((2.0 - RECT[0] - MARGIN_M) / 0.5, abs=0.01)
    assert math.isinf(ground.report(moves=(-0.5, 0.0)).contact_s)
    assert math.isinf(ground.report(moves=(0.3, 0.0)).contact_s)  # more than three seconds


def test_what_is_too_fast_for_the_way_there_is_stops() -> None:
    ground = Ground()
    ground.paint(1.3, 0.05, OBSTACLE)
    assert ground.report(moves=(0.2, 0.0)).state == SLOW
    assert ground.report(moves=(1.0, 0.0)).state == STOP


def test_a_standing_robot_is_told_of_the_way_that_it_is_asked_to_go() -> None:
    ground = Ground()
    ground.paint(-0.4, 0.05, OBSTACLE)
    assert ground.report().state == CLEAR
    back = DriveRequest(-0.3, 0.0, 1e9)
    assert ground.report(request=back).state == STOP
    assert ground.report(request=DriveRequest(0.0, 0.0, 1e9)).state == CLEAR


def test_a_drop_is_told_as_one() -> None:
    ground = Ground()
    ground.paint(0.85, 0.05, OBSTACLE)
    assert ground.report().causes == OBSTRUCTED
    cell = ground.mapper.maps.cells.cells[0, 8]  # type: ignore[attr-defined]
    cell["count"], cell["mean_m"] = 5, -0.3
    assert ground.report().causes == OBSTRUCTED | DROP


def test_what_is_not_trusted_has_no_free_way_and_no_speed() -> None:
    ground = Ground()
    assert ground.report(trusted=False) == NOT_TRUSTED
    assert ground.reporter.report(None, True, STILL, None, False) == NOT_TRUSTED
    assert NOT_TRUSTED.state == 0
    assert not any(NOT_TRUSTED.sectors_m)


def test_the_sectors_begin_ahead_and_go_round_counter_clockwise() -> None:
    ground = Ground()
    for k in range(8):
        angle = k * math.tau / 8
        ground.paint((2.0 + 0.3 * k) * math.cos(angle), (2.0 + 0.3 * k) * math.sin(angle), OBSTACLE)
    told = ground.report()
    for k in range(8):
        assert told.sectors_m[k] == pytest.approx(2.0 + 0.3 * k, abs=0.12)
    turned = ground.report(yaw_rad=math.tau / 8)
    assert turned.sectors_m == pytest.approx(told.sectors_m[1:] + told.sectors_m[:1])
    assert told.bearing_rad == pytest.approx(0.0, abs=0.05)
    assert turned.bearing_rad == pytest.approx(-math.tau / 8, abs=0.05)


places = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-math.pi, math.pi))
marks = st.lists(
    st.tuples(st.integers(-20, 20), st.integers(-20, 20), st.sampled_from([OBSTACLE, UNKNOWN])),
    max_size=12,
)


@settings(max_examples=examples(150))
@given(places, marks)
def test_the_free_way_is_never_longer_than_that_of_the_drive_control(
    place: tuple[float, float, float], cells: list[tuple[int, int, int]]
) -> None:
    zone = StopZone(*RECT[:2], 2 * RECT[2], MARGIN_M, 0.8, True, 0.45)
    ground = Ground()
    for i, j, state in cells:
        ground.window.cells[j % SIZE, i % SIZE] = state
    grid, states = ground.window.grid, ground.window.cells
    frame = (grid.corner_i, grid.corner_j, grid.size)
    clear = (0.0, 0.0, 0.0)
    free_m, _, _, hard_m = free_path(states, frame, CELL_M, place, RECT, MARGIN_M, LONGEST_M, clear)
    found = zone.look(grid, states, place, (1.0, 0.0), clear, from_mps=10.0)
    assert free_m <= found.free_m + 1e-3
    assert free_m <= hard_m
    if math.isfinite(found.free_m):  # and hardly shorter: by the corner of a cell
        blocked = [_slow_way(i, j, place) for i, j, state in cells if state in (OBSTACLE, UNKNOWN)]
        assert free_m >= min([found.free_m, *blocked]) - 2 * CELL_M


def _slow_way(i: int, j: int, place: tuple[float, float, float]) -> float:
    """How far ahead of the margin any point of a cell lies that is within the widest corridor."""
    ways = [math.inf]
    c, s = math.cos(place[2]), math.sin(place[2])
    for u in np.linspace(0, 1, 6):
        for v in np.linspace(0, 1, 6):
            dx, dy = (i + u) * CELL_M - place[0], (j + v) * CELL_M - place[1]
            ahead, aside = c * dx + s * dy, c * dy - s * dx
            if abs(aside) <= RECT[2] + MARGIN_M and ahead >= -RECT[1] - MARGIN_M:
                ways.append(max(0.0, ahead - RECT[0] - MARGIN_M))
    return min(ways)


@settings(max_examples=examples(60))
@given(places, st.sets(st.tuples(st.integers(-60, 59), st.integers(-60, 59)), max_size=20))
def test_the_nearest_obstacle_is_the_nearest(
    place: tuple[float, float, float], cells: set[tuple[int, int]]
) -> None:
    ground = Ground()
    for i, j in cells:
        ground.window.cells[j % SIZE, i % SIZE] = OBSTACLE
    grid = ground.window.grid
    sectors_m = np.zeros(8)
    frame = (grid.corner_i, grid.corner_j, grid.size)
    nearest_m, bearing_rad = nearest_obstacles(
        ground.window.cells, frame, CELL_M, place, RECT, sectors_m
    )
    distances = []
    for i, j in cells:
        dx, dy = (i + 0.5) * CELL_M - place[0], (j + 0.5) * CELL_M - place[1]
        distances.append(math.hypot(dx, dy))
    if not cells:
        assert math.isinf(nearest_m)
        assert np.isinf(sectors_m).all()
        return
    assert sectors_m.min() == pytest.approx(max(0.0, min(distances) - CELL_M / 2))
    reach_m = math.hypot(RECT[0], RECT[2])
    assert min(distances) - reach_m - CELL_M <= nearest_m <= min(distances)
    assert -math.pi <= bearing_rad <= math.pi
