"""What is told of the ground before and behind the robot, against the drive control's own look."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from config_file import load_config, with_changes
from core.config import Config
from core.driving.control import MOVING_MPS, DriveControl
from core.driving.corridor import free_path, nearest_in_sectors, nearest_obstacle
from core.driving.stop_zone import TOUCH_M, Place, Rect, clearance, gap_to, leaves
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
from core.grid.ring import RingGrid
from core.mapping.mapper import Mapper
from core.motion.track import Pose
from core.records import FREE, I8, OBSTACLE, UNKNOWN, DriveRequest, StopZoneReport
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
        off_start_m: float = math.inf,
    ) -> StopZoneReport:
        pose = Pose(0.0, 0.0, 0.0, yaw_rad, 0.0, 0.0)
        self.control.off_start_m = off_start_m
        return self.reporter.report(pose, trusted, moves, request)


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
    ground.paint(0.75, 0.05, OBSTACLE)  # within 10 cm
    for mps, state in ((-0.99 * MOVING_MPS, STOP), (-MOVING_MPS, CLEAR)):  # then ahead counts
        assert ground.report(moves=(mps, 0.0)).state == state
    for mps, state in ((0.99 * MOVING_MPS, STOP), (MOVING_MPS, SLOW)):  # which must go on
        assert ground.report(moves=(mps, 0.0)).state == state
    assert math.isinf(ground.report(moves=(0.99 * MOVING_MPS, 0.0)).contact_s)
    told = ground.report(moves=(MOVING_MPS, 0.0))
    assert told.contact_s == pytest.approx(told.free_ahead_m / MOVING_MPS, abs=0.05)
    ground.paint(0.65, 0.05, OBSTACLE)
    assert ground.report(moves=(MOVING_MPS, 0.0)).state == STOP


def test_unseen_ground_ends_the_way_but_is_no_obstacle() -> None:
    ground = Ground()
    ground.paint(0.8, 0.05, UNKNOWN)
    ground.paint(1.6, 0.05, OBSTACLE)
    told = ground.report()
    assert told.causes == UNSEEN
    assert told.free_ahead_m < told.obstacle_ahead_m < 1.0
    vouched_m = ground.report(off_start_m=0.0).free_ahead_m
    assert vouched_m == told.free_ahead_m  # as shipped, for nothing


def test_contact_is_when_the_margin_meets_what_is_not_free() -> None:
    ground = Ground()
    ground.paint(2.05, 0.05, OBSTACLE)
    told = ground.report(moves=(0.5, 0.0))
    assert told.contact_s == pytest.approx((2.0 - RECT[0] - MARGIN_M) / 0.5, abs=0.01)
    assert math.isinf(ground.report(moves=(-0.5, 0.0)).contact_s)
    assert math.isinf(ground.report(moves=(0.44, 0.0)).contact_s)  # just more, and seen
    assert math.isinf(ground.report(moves=(0.3, 0.0)).contact_s)  # more than three seconds


def test_what_is_too_fast_for_the_way_there_is_stops() -> None:
    ground = Ground()
    ground.paint(1.3, 0.05, OBSTACLE)
    allowed_mps = ground.report().allowed_ahead_mps
    for mps, state in ((1.15 * allowed_mps + 0.09, SLOW), (1.15 * allowed_mps + 0.11, STOP)):
        assert ground.report(moves=(mps, 0.0)).state == state


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
    cell = ground.mapper.maps.cells[0, 8]  # type: ignore[attr-defined]
    cell["var_m2"], cell["under_m"] = 1e-4, -0.3
    assert ground.report().causes == OBSTRUCTED | DROP


def test_what_is_not_trusted_has_no_free_way_and_no_speed() -> None:
    ground = Ground()
    assert ground.report(trusted=False) == NOT_TRUSTED
    assert ground.reporter.report(None, True, STILL, None) == NOT_TRUSTED
    assert NOT_TRUSTED.state == 0
    assert not any(NOT_TRUSTED.sectors_m)


def test_sectors_that_nobody_reads_are_not_told() -> None:
    ground = Ground()
    reporter = ZoneReporter(ground.control, ground.window, 1.0, has_sectors=False)
    pose = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    told = reporter.report(pose, True, STILL, None)
    assert told == replace(ground.report(), sectors_m=())


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


PLACES = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-math.pi, math.pi))
CELL = st.tuples(st.integers(-15, 15), st.integers(-15, 15))
MARKS = st.dictionaries(CELL, st.sampled_from([OBSTACLE, UNKNOWN]), max_size=12)
RECTS = st.sampled_from([RECT, (RECT[1], RECT[0], RECT[2])])


def painted(marks: dict[tuple[int, int], int]) -> tuple[I8, tuple[int, int, int]]:
    """The cells of a window that has moved, and its corner and size."""
    grid = RingGrid(49, CELL_M)
    grid.follow(0.4, -0.3)
    cells: I8 = grid.layer(np.int8, FREE)
    for (i, j), state in marks.items():
        cells[j % grid.size, i % grid.size] = state
    return cells, (grid.corner_i, grid.corner_j, grid.size)


def slow_way(
    cell: tuple[int, int], state: int, place: Place, rect: Rect, margin_m: float, kept_m: float
) -> float:
    """How far it is straight ahead to one cell, by its corners."""
    c, s = math.cos(place[2]), math.sin(place[2])
    at = [
        ((cell[0] + u) * CELL_M - place[0], (cell[1] + v) * CELL_M - place[1])
        for u in (0, 1)
        for v in (0, 1)
    ]
    aheads, asides = [c * x + s * y for x, y in at], [c * y - s * x for x, y in at]
    front = min(aheads) - rect[0]
    side = max(min(asides), -max(asides)) - rect[2]  # negative: it lies in the strip
    if max(aheads) < -rect[1] or side >= margin_m - TOUCH_M:
        return math.inf
    cx, cy = (cell[0] + 0.5) * CELL_M, (cell[1] + 0.5) * CELL_M
    gap = gap_to(cx, cy, CELL_M / 2, place, rect)
    if gap < -TOUCH_M:
        free = state == UNKNOWN or leaves(cx, cy, place, rect, 1.0, 0.0)
        return math.inf if free else 0.0
    if gap < margin_m - TOUCH_M:
        return 0.0 if side < -TOUCH_M <= front else math.inf
    return math.inf if side >= kept_m - TOUCH_M or front < 0.0 else max(0.0, front - margin_m)


@settings(max_examples=examples(200))
@given(PLACES, RECTS, MARKS)
@example((0.0, 0.0, 0.0), RECT, {(5, 3): OBSTACLE})
@example(  # one touches its side; of two ahead, the nearer one is looked at later
    (0.0, 0.0, 0.0), RECT, {(0, 3): OBSTACLE, (8, -2): OBSTACLE, (7, 2): OBSTACLE}
)
@example((0.0, 0.386, 2.3e-311), RECT, {(4, 6): OBSTACLE})  # what it is divided by is next to 0
@example((0.0, 0.386, -2.3e-311), RECT, {(4, 6): OBSTACLE})
@example((0.0, 0.386, 1e-20), RECT, {(4, 6): OBSTACLE})
@example((0.0, 0.386, -1e-20), RECT, {(4, 6): OBSTACLE})
def test_the_way_ahead_is_that_of_the_slow_model(
    place: Place, rect: Rect, marks: dict[tuple[int, int], int]
) -> None:
    cells, window = painted(marks)
    vouched = (9.0, 9.0, 0.0)
    free_m, i, j, state, hard_m = free_path(
        cells, window, CELL_M, place, rect, MARGIN_M, 0.4, vouched
    )
    kept_m = clearance(cells, window, CELL_M, place, rect, MARGIN_M, vouched)
    ways = {cell: slow_way(cell, of, place, rect, MARGIN_M, kept_m) for cell, of in marks.items()}
    hard = [way for cell, way in ways.items() if marks[cell] == OBSTACLE and way <= 0.4]
    assert free_m == pytest.approx(min([*ways.values(), 0.4]), abs=1e-8)
    assert hard_m == pytest.approx(min(hard, default=math.inf), abs=1e-8)
    if free_m < 0.4:
        assert ways[i, j] == pytest.approx(free_m, abs=1e-8)
        assert marks[i, j] == state
    else:
        assert (i, j, state) == (0, 0, UNKNOWN)


@pytest.mark.parametrize(
    ("i", "j", "state", "free_m"),
    [
        (8, 2, OBSTACLE, 0.375),
        (8, 3, OBSTACLE, 2.0),  # touches the side of the margin's strip
        (5, 0, OBSTACLE, 0.0),  # touches the margin's front
        (4, 0, OBSTACLE, 0.0),  # touches the footprint's front
        (4, 0, UNKNOWN, 0.0),
        (4, 2, OBSTACLE, 2.0),  # beside the footprint's front corner
        (3, 2, OBSTACLE, 2.0),  # touches the footprint's side
        (3, 2, UNKNOWN, 2.0),
        (-3, 0, OBSTACLE, 2.0),  # touches its rear
        (21, 0, OBSTACLE, 2.0),  # just as far as it is looked
        (20, 0, OBSTACLE, 1.875),
    ],
)
def test_what_touches_the_way_ahead_is_not_in_it(i: int, j: int, state: int, free_m: float) -> None:
    """Cells of an eighth of a metre, a footprint and a margin of whole eighths."""
    cells = np.full((65, 65), FREE, dtype=np.int8)
    cells[j % 65, i % 65] = state
    found = free_path(
        cells, (-32, -32, 65), 0.125, (0.0, 0.0, 0.0), (0.5, 0.25, 0.25), 0.125, 2.0, (9.0, 9.0, 0)
    )
    assert found[0] == free_m
    is_met = free_m < 2.0 or i == 21
    assert found[4] == (free_m if is_met and state == OBSTACLE else math.inf)


def test_of_what_is_equally_near_the_first_is_told() -> None:
    cells = np.full((65, 65), FREE, dtype=np.int8)
    cells[2, 12] = cells[-3, 12] = cells[0, 12] = cells[1, 12] = OBSTACLE
    window, here, rect = (-32, -32, 65), (0.0, 0.0, 0.0), (0.5, 0.25, 0.25)
    found = free_path(cells, window, 0.125, here, rect, 0.125, 2.0, (9.0, 9.0, 0))
    assert found[1:4] == (12, -3, OBSTACLE)
    cells[-1, 4] = cells[0, 4] = OBSTACLE  # within the margin
    found = free_path(cells, window, 0.125, here, rect, 0.125, 2.0, (9.0, 9.0, 0))
    assert found[:4] == (0.0, 4, -1, OBSTACLE)
    cells[-1, 4] = cells[0, 4] = FREE
    cells[0, 12] = cells[1, 12] = FREE
    _, bearing_rad = nearest_obstacle(cells, window, 0.125, here, rect)
    assert bearing_rad > 0.0


@pytest.mark.parametrize("turn", range(24))
@pytest.mark.parametrize("rect", [(0.2, 0.2, 0.8), (0.8, 0.2, 0.2), (0.2, 1.4, 0.2)])
def test_what_ends_the_way_is_found_however_the_robot_stands(rect: Rect, turn: int) -> None:
    """At the sides of the strip, at its begin, and just before the end of the longest way."""
    x, y, yaw = (0.9, -0.6, 0.1) if turn % 2 else (-0.9, 0.6, -0.1)
    yaw += turn * math.tau / 24
    c, s = math.cos(yaw), math.sin(yaw)
    window, clear = (-49, -49, 99), (9.0, 9.0, 0.0)
    cells = np.full((99, 99), FREE, dtype=np.int8)
    far, side = rect[0] + MARGIN_M, rect[2] + MARGIN_M - 0.005
    spots = [(far + way, side * part) for way in (0.1, 1.35, 1.43) for part in (-1.0, -0.4, 0.4, 1)]
    for ahead, aside in (*spots, (0.3 - rect[1], rect[2] - 0.01)):  # and under the footprint
        mark = (
            math.floor((x + c * ahead - s * aside) / CELL_M),
            math.floor((y + s * ahead + c * aside) / CELL_M),
        )
        cells[mark[1] % 99, mark[0] % 99] = OBSTACLE
        kept_m = clearance(cells, window, CELL_M, (x, y, yaw), rect, MARGIN_M, clear)
        way_m = slow_way(mark, OBSTACLE, (x, y, yaw), rect, MARGIN_M, kept_m)
        found = free_path(cells, window, CELL_M, (x, y, yaw), rect, MARGIN_M, 1.5, clear)
        assert found[0] == pytest.approx(min(way_m, 1.5))
        assert found[1:4] == ((*mark, OBSTACLE) if way_m < 1.5 else (0, 0, UNKNOWN))
        assert way_m < 1.5 or ahead < 0.5
        cells[mark[1] % 99, mark[0] % 99] = FREE


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("side", [-1, 1])
def test_a_cell_with_no_more_than_a_corner_in_the_strip_ends_the_way(side: int, turn: int) -> None:
    yaw = math.pi / 4 + turn * math.pi / 2
    c, s = math.cos(yaw), math.sin(yaw)
    ahead, aside = RECT[0] + MARGIN_M + 1.0, side * (RECT[2] + MARGIN_M - 0.004)
    x, y = -c * ahead + s * aside, -s * ahead - c * aside  # the corner is the map's origin
    i, j = (-1 if -s * side < 0.0 else 0), (-1 if c * side < 0.0 else 0)
    cells = np.full((99, 99), FREE, dtype=np.int8)
    cells[j, i] = OBSTACLE
    window, clear = (-49, -49, 99), (9.0, 9.0, 0.0)
    found = free_path(cells, window, CELL_M, (x, y, yaw), RECT, MARGIN_M, 1.5, clear)
    assert found[1:4] == (i, j, OBSTACLE)


def test_ground_that_somebody_vouches_for_does_not_end_the_way() -> None:
    cells = np.full((65, 65), UNKNOWN, dtype=np.int8)
    window, here, rect = (-32, -32, 65), (0.0, 0.0, 0.0), (0.5, 0.25, 0.25)
    found = free_path(cells, window, 0.125, here, rect, 0.125, 2.0, (0.0, 0.0, 1.5))
    assert 0.5 < found[0] < 1.0
    assert found[3] == UNKNOWN


@pytest.mark.parametrize("rect", [(1.4, 0.2, 0.1), (0.2, 1.4, 0.1), (0.2, 0.1, 1.4)])
def test_an_obstacle_in_a_far_row_counts_if_it_is_nearer_than_those_beside(rect: Rect) -> None:
    """The robot reaches far along y; the gaps differ by less than a cell."""
    yaw = 0.0 if rect[2] > 1.0 else (math.pi / 2 if rect[0] > 1.0 else -math.pi / 2)
    edge_x = rect[0] if rect[2] > 1.0 else rect[2]
    for beside in (17, 50):  # cells from the edge
        ground = Ground()
        ground.paint(0.05, 3.05, OBSTACLE)
        ground.paint(edge_x + (beside + 0.5) * CELL_M, 0.05, OBSTACLE)
        grid = ground.window.grid
        window = (grid.corner_i, grid.corner_j, grid.size)
        found = nearest_obstacle(ground.window.cells, window, CELL_M, (0.04, 0.0, yaw), rect)
        assert found[0] == pytest.approx(1.6, abs=1e-6)
        assert abs(found[1] + yaw - math.pi / 2) < 0.1


@settings(max_examples=examples(60))
@given(PLACES, RECTS, MARKS)
def test_the_nearest_obstacle_is_that_of_the_slow_model(
    place: Place, rect: Rect, marks: dict[tuple[int, int], int]
) -> None:
    cells, window = painted(marks)
    sectors_m, told_m = [math.inf] * 8, np.zeros(8)
    nearest_m, bearing_rad = math.inf, 0.0
    c, s = math.cos(place[2]), math.sin(place[2])
    for (i, j), state in marks.items():
        if state == OBSTACLE:
            dx, dy = (i + 0.5) * CELL_M - place[0], (j + 0.5) * CELL_M - place[1]
            ahead, aside = c * dx + s * dy, c * dy - s * dx
            k = round(math.atan2(aside, ahead) / (math.tau / 8)) % 8
            sectors_m[k] = min(sectors_m[k], max(0.0, math.hypot(dx, dy) - CELL_M / 2))
            beside_m = math.hypot(
                ahead - min(max(ahead, -rect[1]), rect[0]),
                aside - min(max(aside, -rect[2]), rect[2]),
            )
            gap_m = max(0.0, beside_m - CELL_M / 2 * (abs(c) + abs(s)))
            if gap_m < nearest_m:
                nearest_m, bearing_rad = gap_m, math.atan2(aside, ahead)
    found = nearest_obstacle(cells, window, CELL_M, place, rect)
    nearest_in_sectors(cells, window, CELL_M, place, told_m)
    assert found[0] == pytest.approx(nearest_m, abs=1e-9)
    if nearest_m > 0.0:  # of several that touch it, any one
        assert found[1] == pytest.approx(bearing_rad)
    np.testing.assert_allclose(told_m, sectors_m)
