"""What the monitor finds in the robot's way, whatever a pilot computes."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box
from shapely.affinity import rotate, translate

from config_file import with_changes
from core.driving import monitor
from core.driving.monitor import Place, Powers
from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import examples
from tests.support.robot.monitored_robot import CONFIG, ROBOT, SHORT_S, TICK_S, Robot

REACH_M = math.hypot(0.52, 0.30)


@pytest.mark.parametrize("state", [OBSTACLE, UNKNOWN])
@pytest.mark.parametrize(("front_m", "rear_m"), [(0.52, 0.20), (0.20, 0.52)])
@pytest.mark.parametrize("v_mps", [0.8, -0.8, 0.05, -0.05])
def test_the_way_to_a_stop_must_be_free(
    v_mps: float, front_m: float, rear_m: float, state: int
) -> None:
    """0.3 s and v^2 / 1.6 m/s2; the cell counts that is 0.03 m deep in the footprint."""
    way_m, sense = 0.3 * abs(v_mps) + v_mps**2 / 1.6, math.copysign(1.0, v_mps)
    edge_m = front_m if v_mps > 0 else rear_m
    config = with_changes(CONFIG, robot={"front_m": front_m, "rear_m": rear_m})
    for beyond_m, why in ((-SHORT_S, ""), (SHORT_S, monitor.IN_WAY[state])):
        robot = Robot(with_changes(config, drive={"full_power_mps": 0.9}))
        robot.mark(10 if sense > 0 else -11, 0, state)  # its edge is at 2 m
        robot.x_m = sense * (2.0 - edge_m - way_m + 0.03 + beyond_m)
        creeps = state == UNKNOWN and way_m < 0.03  # unseen ground that it has touched is no matter
        assert robot.told(v_mps, 0.0) == ("" if creeps else why)


def test_what_it_would_drive_over_on_its_way_is_in_its_way() -> None:
    """At 1 m/s it goes 0.925 m on: so far that all of its 0.72 m have passed the cell."""
    robot = Robot()
    robot.mark(10, 0, OBSTACLE)
    robot.x_m = 2.0 - 0.52 - 0.001
    assert robot.told(1.0, 0.0) == monitor.IN_WAY[OBSTACLE]


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_turn_on_the_spot_is_followed_to_its_end(sense: float) -> None:
    """By 1 rad/s for 0.3 s and as long as its farthest corner, at 0.60 m/s, takes to stand.

    After these 0.675 rad that corner has come as far back as x = 0.214 m, y = 0.517 m.
    """
    for i, why in ((9, monitor.IN_WAY[OBSTACLE]), (8, "")):
        robot = Robot()
        robot.window.grid.cell_m = 0.02
        robot.mark(i, 25 if sense > 0 else -26, OBSTACLE)
        assert robot.told(0.0, sense) == why


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_robot_that_is_faster_than_told_must_have_room_to_brake(sense: float) -> None:
    way_m, edge_m = 0.9**2 / 1.6, 0.52 if sense > 0 else 0.20
    for beyond_m, why in ((-0.001, ""), (0.001, monitor.IN_WAY[OBSTACLE])):
        robot = Robot()
        robot.mark(10 if sense > 0 else -11, 0, OBSTACLE)
        robot.moves = sense * 0.9, 0.0
        for _ in range(12):
            robot.tick()
            robot.passed((0.0, 0.0), (sense * 0.1, 0.0))
        robot.x_m = sense * (2.0 - edge_m - way_m + 0.03 + beyond_m)
        assert robot.told(sense * 0.1, 0.0) == why


def test_beside_the_footprint_and_under_it_nothing_is_in_the_way() -> None:
    robot = Robot()
    robot.y_m = 0.1
    for j, why in ((-2, ""), (-1, monitor.IN_WAY[OBSTACLE]), (2, "")):  # it reaches -0.2 to 0.4 m
        robot.window.cells[...] = FREE
        robot.mark(4, j, OBSTACLE)
        robot.passed((0.0, 0.0), None)
        assert robot.told(0.8, 0.0) == why
    for i in range(-1, 3):
        robot.mark(i, 0, OBSTACLE)
    robot.window.cells[-1 % 101, 4] = FREE
    robot.passed((0.0, 0.0), None)
    assert robot.told(0.8, 0.0) == ""


@pytest.mark.parametrize("corner", [(-50, -50), (-1, -50), (-98, -50), (-50, -1), (-50, -98)])
def test_outside_of_the_window_nothing_is_known(corner: tuple[int, int]) -> None:
    grid_m = 0.2
    for k, (yaw_rad, edge_m) in enumerate(
        (
            (0.0, (corner[0] + 101) * grid_m),
            (math.pi, -corner[0] * grid_m),
            (math.pi / 2, (corner[1] + 101) * grid_m),
            (-math.pi / 2, -corner[1] * grid_m),
        )
    ):
        for inside_m, why in ((0.001, ""), (-0.001, monitor.IN_WAY[UNKNOWN])):
            robot = Robot()
            grid = robot.window.grid
            grid.corner_i, grid.corner_j = corner
            ahead_m = edge_m - 0.52 - 0.64 + 0.03 - inside_m
            robot.yaw_rad = yaw_rad
            middle_m = (corner[k < 2] + 50.5) * grid_m  # of the other axis
            way = ahead_m * round(math.cos(yaw_rad)), ahead_m * round(math.sin(yaw_rad))
            robot.x_m, robot.y_m = (way[0], middle_m) if k < 2 else (middle_m, way[1])
            assert robot.told(0.8, 0.0) == why


def test_the_ground_of_the_start_is_vouched_for_as_far_as_the_settings_say() -> None:
    config = with_changes(CONFIG, robot={"start_clear_m": 1.0})
    for i, vouched, why in (
        (3, True, ""),  # its middle is 0.7 m away
        (3, False, monitor.IN_WAY[UNKNOWN]),
        (5, True, monitor.IN_WAY[UNKNOWN]),
    ):
        robot = Robot(config)
        robot.mark(i, 0, UNKNOWN)
        robot.vouched = vouched
        assert robot.told(0.8, 0.0) == why
    robot = Robot(config)
    robot.vouched = True
    robot.mark(3, 0, OBSTACLE)
    assert robot.told(0.8, 0.0) == monitor.IN_WAY[OBSTACLE]
    robot = Robot(with_changes(CONFIG, robot={"unknown_stops": False}))
    robot.mark(5, 0, UNKNOWN)
    assert robot.told(0.8, 0.0) == ""


def test_the_middle_of_the_ground_that_is_vouched_for_is_where_the_map_began() -> None:
    robot = Robot(with_changes(CONFIG, robot={"start_clear_m": 1.0}))
    robot.window.cells[...] = UNKNOWN
    robot.vouched = True
    for k in range(8):
        robot.yaw_rad = k * math.pi / 4
        for ahead_m, why in ((0.05, ""), (0.55, monitor.IN_WAY[UNKNOWN])):
            robot.x_m, robot.y_m = (ahead_m * f(robot.yaw_rad) for f in (math.cos, math.sin))
            robot.passed((0.0, 0.0), None)
            assert robot.told(0.4, 0.0) == why


def footprint(x_m: float, y_m: float, yaw_rad: float, less_m: float = 0.0) -> Polygon:
    one = box(-ROBOT.rear_m + less_m, -0.3 + less_m, ROBOT.front_m - less_m, 0.3 - less_m)
    return translate(rotate(one, yaw_rad, origin=(0, 0), use_radians=True), x_m, y_m)


def after(place: Place, motion: tuple[float, float], t_s: float) -> Place:
    """Where a motion leads, by the radius of its arc."""
    x, y, yaw = place
    v, w = motion
    if abs(w) < 1e-9:
        return x + v * t_s * math.cos(yaw), y + v * t_s * math.sin(yaw), yaw
    turned = yaw + w * t_s
    r = v / w
    return (
        x + r * (math.sin(turned) - math.sin(yaw)),
        y - r * (math.cos(turned) - math.cos(yaw)),
        turned,
    )


@given(
    place=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-4.0, 4.0)),
    motion=st.tuples(st.sampled_from([0.0, 0.3, 0.7, -0.4]), st.sampled_from([0.0, 0.6, -1.0])),
    at=st.tuples(st.integers(-8, 8), st.integers(-8, 8)),
)
@settings(max_examples=300)
def test_it_halts_where_a_cell_comes_under_the_footprint_and_nowhere_else(
    place: tuple[float, float, float], motion: tuple[float, float], at: tuple[int, int]
) -> None:
    """Against polygons, at many instants; its own instants are up to 0.1 m of way apart."""
    if not any(motion):
        return
    robot = Robot()
    robot.x_m, robot.y_m, robot.yaw_rad = place
    robot.mark(*at, OBSTACLE)
    cell = box(0.2 * at[0], 0.2 * at[1], 0.2 * at[0] + 0.2, 0.2 * at[1] + 0.2)
    rate_mps = abs(motion[0]) + abs(motion[1]) * REACH_M
    seconds = 0.3 + rate_mps / 1.6
    ways = [after(place, motion, seconds * k / 40) for k in range(41)]
    halted = robot.told(*motion) != ""
    is_under = footprint(*place).intersects(cell)
    if halted:
        assert not footprint(*place, 0.031).intersects(cell)
        assert any(footprint(*way, 0.029).intersects(cell) for way in ways)
    elif not is_under:
        assert not any(footprint(*way, 0.125).intersects(cell) for way in ways)


@given(
    place=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-4.0, 4.0)),
    bearing_rad=st.floats(-math.pi, math.pi),
    half_m=st.floats(0.01, 0.5),
)
def test_footprint_and_cell_overlap_from_where_polygons_do(
    place: tuple[float, float, float], bearing_rad: float, half_m: float
) -> None:
    c, s = math.cos(bearing_rad), math.sin(bearing_rad)

    def places(away_m: float) -> tuple[float, float]:
        return place[0] + away_m * c, place[1] + away_m * s

    def square(away_m: float) -> Polygon:
        x, y = places(away_m)
        return box(x - half_m, y - half_m, x + half_m, y + half_m)

    low_m, high_m = 0.0, 3.0
    for _ in range(40):
        middle_m = (low_m + high_m) / 2
        touches = footprint(*place).intersects(square(middle_m))
        low_m, high_m = (middle_m, high_m) if touches else (low_m, middle_m)
    rect = (ROBOT.front_m, ROBOT.rear_m, ROBOT.width_m / 2)
    assert monitor._overlaps(*places(low_m - 1e-6), half_m, place, rect)
    assert not monitor._overlaps(*places(high_m + 1e-6), half_m, place, rect)


@given(
    place=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-4.0, 4.0)),
    motion=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
    seconds=st.floats(0.0, 2.0),
)
def test_an_arc_leads_where_its_radius_says(
    place: tuple[float, float, float], motion: tuple[float, float], seconds: float
) -> None:
    if abs(motion[1]) > 1e-4:
        moved = monitor._moved(place, motion, seconds)
        assert moved == pytest.approx(after(place, motion, seconds), abs=1e-6)
    straight = monitor._moved(place, (motion[0], 0.0), seconds)
    assert straight == pytest.approx(after(place, (motion[0], 0.0), seconds))


class Adversary:
    """A robot whose pilot tells anything; it obeys at once, and brakes 0.1 s after a zero."""

    def __init__(self, cells: list[tuple[int, int]]) -> None:
        self.robot, self.goes, self.zero_s = Robot(), (0.0, 0.0), math.inf
        self.cells = []
        for i, j in cells:
            cell = box(0.2 * i, 0.2 * j, 0.2 * i + 0.2, 0.2 * j + 0.2)
            if not footprint(0.0, 0.0, 0.0).intersects(cell):
                self.cells.append(cell)
                self.robot.mark(i, j, OBSTACLE)

    def step(self, powers: Powers, asks: bool) -> None:
        robot = self.robot
        robot.moves = self.goes
        robot.tick()
        place = after((robot.x_m, robot.y_m, robot.yaw_rad), self.goes, TICK_S)
        robot.x_m, robot.y_m, robot.yaw_rad = place
        asked = (math.copysign(9.0, sum(powers)), math.copysign(9.0, powers[1] - powers[0]))
        left, right = robot.passed(powers, asked if asks else None)
        if left or right:
            self.goes, self.zero_s = ((left + right) / 2, (right - left) / 0.5), math.inf
            return
        self.zero_s = min(self.zero_s, robot.now_s)
        if robot.now_s - self.zero_s >= 0.1:
            rate_mps = abs(self.goes[0]) + abs(self.goes[1]) * REACH_M
            share = max(0.0, rate_mps - 0.8 * TICK_S) / rate_mps if rate_mps else 0.0
            self.goes = self.goes[0] * share, self.goes[1] * share


POWER = st.floats(-1.2, 1.2)


@given(
    orders=st.lists(st.tuples(POWER, POWER, st.booleans()), min_size=4, max_size=10),
    cells=st.lists(st.tuples(st.integers(-8, 9), st.integers(-8, 8)), min_size=15, max_size=40),
)
@settings(max_examples=examples(25))
def test_whatever_a_pilot_tells_the_robot_runs_into_nothing(
    orders: list[tuple[float, float, bool]], cells: list[tuple[int, int]]
) -> None:
    pilot = Adversary(cells)
    for left, right, lets_go in orders:
        if lets_go:
            pilot.step((0.0, 0.0), asks=False)
        for _ in range(25):
            pilot.step((left, right), asks=True)
            robot = pilot.robot
            inside = footprint(robot.x_m, robot.y_m, robot.yaw_rad, 0.05)
            assert not any(inside.intersects(cell) for cell in pilot.cells)
