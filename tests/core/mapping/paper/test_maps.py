"""The paper's maps as a mapping method: the planner's window against a plain resampling."""

import math

import numpy as np
import numpy.typing as npt
from hypothesis import given, settings
from hypothesis import strategies as st

from config_file import load_config, with_changes
from core.config import Config
from core.mapping.layers import maybe_layer
from core.mapping.mapper import Mapper
from core.mapping.method import is_low
from core.mapping.paper.maps import ReferencePlaneMaps
from core.records import FREE, OBSTACLE, UNKNOWN, WheelCounts
from tests import ROOT
from tests.core.mapping.test_rays import DT_S, scan_of
from tests.core.motion.test_attitude import attitude
from tests.support.cases import examples

F64 = npt.NDArray[np.float64]
SHIPPED = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
BEAMS = 481
BEARING_RAD = np.radians(np.linspace(-60.0, 60.0, BEAMS))
FLOOR_M = 1.08 / math.sin(math.radians(7.5)) / np.cos(BEARING_RAD)  # where all of it is flat


def settings_of(**sections: dict[str, float]) -> Config:
    """The shipped settings with a lens off the middle, and these changed."""
    return with_changes(SHIPPED, **({"scanner": {"mount_y_m": 0.1}} | sections))


class Drive:
    """A robot that goes and tilts evenly for 3 s from t = 0, and its maps."""

    def __init__(
        self,
        config: Config,
        v_mps: float = 0.0,
        rates_radps: tuple[float, float, float] = (0.0, 0.0, 0.0),
        yaw_rad: float = 0.7,
    ) -> None:
        mapper = Mapper(config)
        counts_per_m = 4 * config.robot.encoder_ppr / (2 * math.pi * config.robot.wheel_radius_m)
        for k in range(301):
            t_s = 0.01 * k
            roll, pitch, yaw = (rate * t_s for rate in rates_radps)
            mapper.add_attitude(attitude(t_s, roll, pitch, yaw_rad + yaw))
            if k % 5 == 0:
                side = rates_radps[2] * config.robot.track_width_m / 2
                left, right = (v * t_s * counts_per_m for v in (v_mps - side, v_mps + side))
                mapper.add_counts(WheelCounts(t_s, left, right, 0))
            mapper.odometry.settle()
        self.attitudes, self.odometry = mapper.attitudes, mapper.odometry
        self.maps = ReferencePlaneMaps(config)

    def scan(self, ranges_m: F64, t_s: float) -> int:
        """One scan whose first beam leaves at t_s."""
        return self.maps.add(scan_of(np.atleast_2d(ranges_m), t_s), self.attitudes, self.odometry)


def test_free_ground_that_was_not_met_again_is_unknown_after_a_while() -> None:
    drive = Drive(settings_of(obstacle={"free_max_age_s": 1.0}))
    ranges_m = FLOOR_M.copy()
    ranges_m[200:260] = 5.0
    drive.scan(ranges_m, 0.5)
    drive.scan(np.full(BEAMS, np.nan), 1.4)
    first = straight(drive.maps)
    assert {FREE, OBSTACLE, UNKNOWN} == set(first.values())
    drive.scan(np.full(BEAMS, np.nan), 1.6)
    old = {at: UNKNOWN if state == FREE else state for at, state in first.items()}
    assert straight(drive.maps) == old
    drive.scan(ranges_m, 1.8)
    assert straight(drive.maps) == first


def straight(maps: ReferencePlaneMaps) -> dict[tuple[int, int], int]:
    """States of the window by world cell (i, j)."""
    grid = maps.window.grid
    return {
        (i, j): int(maps.window.cells[j % grid.size, i % grid.size])
        for i in range(grid.corner_i, grid.corner_i + grid.size)
        for j in range(grid.corner_j, grid.corner_j + grid.size)
    }


def random_scan(seed: int) -> F64:
    """Floor with boxes, holes and gaps."""
    random = np.random.default_rng(seed)
    ranges_m = FLOOR_M.copy()
    for _ in range(12):
        first = random.integers(0, BEAMS - 40)
        ranges_m[first : first + random.integers(1, 40)] *= random.uniform(0.3, 1.15)
    ranges_m[random.random(BEAMS) < 0.05] = np.nan
    return ranges_m


@settings(max_examples=examples(8), deadline=None)
@given(
    v_mps=st.floats(-1, 1),
    w_radps=st.floats(-0.5, 0.5),
    t_s=st.floats(0.5, 2.9),
    seed=st.integers(0, 99),
)
def test_the_window_shows_the_cell_in_which_its_centre_lies_and_every_obstacle(
    v_mps: float, w_radps: float, t_s: float, seed: int
) -> None:
    config = settings_of(map={"cells": 91}, obstacle={"window_cells": 91})
    drive = Drive(config, v_mps, (0.0, 0.0, w_radps))
    for at_s in (0.2, t_s):
        drive.scan(random_scan(seed), at_s)
    last_s = t_s + (BEAMS - 1) * DT_S
    x_m, y_m = drive.odometry.xy_at(last_s)
    yaw_rad = drive.attitudes.rpy_at(last_s)[2] - drive.odometry.yaw_start_rad
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    lens_x_m, lens_y_m = x_m + c * 0.25 - s * 0.1, y_m + s * 0.25 + c * 0.1
    expected: dict[tuple[int, int], int] = {}
    states = drive.maps.plane.obstacles
    shown = straight(drive.maps)
    for i, j in shown:
        dx_m, dy_m = (i + 0.5) * 0.2 - lens_x_m, (j + 0.5) * 0.2 - lens_y_m
        row = math.floor((c * dx_m + s * dy_m) / 0.2 + 45.5)
        column = math.floor((s * dx_m - c * dy_m) / 0.2 + 45.5)
        inside = 0 <= row < 91 and 0 <= column < 91
        expected[i, j] = int(states[row, column]) if inside else UNKNOWN
    for row, column in np.argwhere(states == OBSTACLE):
        ahead_m, right_m = (row - 45) * 0.2, (column - 45) * 0.2
        i = math.floor((lens_x_m + c * ahead_m + s * right_m) / 0.2)
        j = math.floor((lens_y_m + s * ahead_m - c * right_m) / 0.2)
        if (i, j) in shown:
            expected[i, j] = OBSTACLE
    # the middle of a cell may lie on the border of another: rounding decides
    differing = [at for at, state in shown.items() if state != expected[at]]
    assert len(differing) <= 1
    assert OBSTACLE in shown.values()
    assert FREE in shown.values()


def test_only_what_changed_is_told_and_erasing_forgets_all() -> None:
    drive = Drive(settings_of(), 0.5)
    drive.scan(random_scan(1), 0.5)
    maps, window = drive.maps, drive.maps.window
    np.testing.assert_array_equal(np.isfinite(maps.heights_m()), window.cells != UNKNOWN)
    told = window.cells.ravel().copy()
    window.take_changed()
    drive.scan(random_scan(2), 0.54)
    changed = np.sort(window.take_changed())
    np.testing.assert_array_equal(changed, np.flatnonzero(told != window.cells.ravel()))
    assert 0 < changed.size < 1000
    epoch = window.epoch
    maps.erase()
    assert window.epoch == epoch + 1
    assert not window.cells.any()
    assert np.isnan(maps.heights_m()).all()
    assert np.isnan(maps.plane.elevation_m).all()
    assert not is_low(maps, 0, 0)


def test_another_ground_and_other_beams_begin_an_epoch_with_the_newest_scan_alone() -> None:
    drive = Drive(settings_of(), 0.2, (0.0, math.radians(1.0), 0.0))
    maps = drive.maps
    drive.scan(FLOOR_M * 0.8, 0.2)
    assert OBSTACLE in maps.window.cells
    epoch = maps.window.epoch
    drive.scan(FLOOR_M, 0.9)  # 0.7 deg since, all at once
    assert maps.window.epoch == epoch
    drive.scan(FLOOR_M, 0.94)  # 0.04 deg more
    assert maps.window.epoch == epoch + 1
    assert maps.plane.restarts == 1
    assert OBSTACLE not in maps.window.cells
    assert FREE in maps.window.cells
    drive.scan(FLOOR_M[::2] * 0.8, 1.1)  # other beams start anew
    assert maps.window.epoch == epoch + 2
    assert FREE not in maps.window.cells


def test_floor_is_free_where_it_is_a_hole_is_low_and_a_box_is_not() -> None:
    drive = Drive(SHIPPED, yaw_rad=-1.0)
    assert drive.scan(FLOOR_M, 1.0) == 407  # the others reach over the map's edge at 10.1 m
    states = straight(drive.maps)
    reach_m = 0.25 + 1.08 / math.tan(math.radians(7.5))
    ahead = [i for (i, j), state in states.items() if j == 0 and state != UNKNOWN]
    assert ahead == [math.floor(reach_m / 0.2)]
    assert set(states.values()) == {FREE, UNKNOWN}
    for factor, low in ((0.7, False), (1.15, True)):
        drive.maps = ReferencePlaneMaps(SHIPPED)
        drive.scan(FLOOR_M * factor, 0.5)
        obstacles = [at for at, state in straight(drive.maps).items() if state == OBSTACLE]
        assert obstacles
        assert {is_low(drive.maps, *at) for at in obstacles} == {low}


def test_heights_stand_where_the_window_shows_something() -> None:
    drive = Drive(settings_of(), 0.5, (0.0, 0.0, 0.3))
    drive.scan(random_scan(3), 0.5)
    heights_m, cells = drive.maps.heights_m(), drive.maps.window.cells
    np.testing.assert_array_equal(np.isfinite(heights_m), cells != UNKNOWN)
    np.testing.assert_array_equal(np.abs(heights_m[cells != UNKNOWN]) < 0.1, cells[cells != 0] < 0)
    height, state = maybe_layer(drive.maps, "height"), maybe_layer(drive.maps, "state")
    assert height is not None
    assert state is not None
    np.testing.assert_array_equal(np.isfinite(height.values), np.isfinite(state.values))
    np.testing.assert_array_equal(np.abs(height.values) < 0.1, state.values == FREE)
    assert np.count_nonzero(state.values == FREE) == np.count_nonzero(cells == FREE) > 0
    assert maybe_layer(drive.maps, "slope") is None


def test_the_first_echo_counts_and_the_housing_does_not() -> None:
    drive = Drive(SHIPPED)
    nearer = np.full(BEAMS, 0.1)
    nearer[240] = FLOOR_M[240]
    assert drive.scan(np.stack([nearer, FLOOR_M]), 0.5) == 1
    assert np.count_nonzero(drive.maps.window.cells) == 1


def test_attitude_and_travel_are_those_of_the_last_beam() -> None:
    drive = Drive(settings_of(), 0.5, (0.02, -0.01, 0.0))
    drive.scan(FLOOR_M, 0.5)
    drive.scan(FLOOR_M, 1.5)
    again = ReferencePlaneMaps(settings_of()).plane
    again.set_beams(math.pi / 2 + BEARING_RAD)
    for t_s in (0.5, 1.5):
        last_s = t_s + (BEAMS - 1) * DT_S
        again.add(FLOOR_M, 0.0, -0.01 * last_s, 0.02 * last_s, 0.5 * last_s)
    np.testing.assert_allclose(drive.maps.plane.reference_m, again.reference_m, atol=1e-6)
    np.testing.assert_array_equal(drive.maps.plane.obstacles, again.obstacles)


def test_a_robot_that_left_the_map_behind_shows_nothing_of_it() -> None:
    drive = Drive(settings_of(map={"cells": 91}, obstacle={"window_cells": 21}), 10.0)
    drive.scan(FLOOR_M, 0.0)
    drive.scan(np.full(BEAMS, np.nan), 2.9)
    assert not drive.maps.window.cells.any()
    assert (drive.maps.plane.grid.count == 0).all()
