"""`CertaintyMaps`: one scan behind where three are looked at, forgetting, layers, what is told."""

import math
import tracemalloc
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from config_file import load_config, with_changes
from core.config import Config
from core.mapping.causes import FLOOR, TOO_HIGH, TOO_LOW, UNSEEN
from core.mapping.certainty.maps import CertaintyMaps
from core.mapping.footing import Footing
from core.mapping.layers import maybe_values
from core.mapping.mapper import Mapper
from core.mapping.method import is_low
from core.records import FREE, OBSTACLE, UNKNOWN, PointSweep, WheelCounts
from tests import ROOT
from tests.core.mapping.test_rays import scan_of
from tests.core.motion.test_attitude import attitude
from tests.support.cases import few

F64 = npt.NDArray[np.float64]
SHIPPED = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
BEAMS, MOUNT_X_M, CELL_M = 481, 0.25, 0.2
BEARING_RAD = np.radians(np.linspace(-60.0, 60.0, BEAMS))
FLOOR_M = 1.08 / math.sin(math.radians(7.5)) / np.cos(BEARING_RAD)
AHEAD_M = MOUNT_X_M + 1.08 / math.tan(math.radians(7.5))  # where it meets the floor


def settings_of(**certainty: Any) -> Config:
    return with_changes(SHIPPED, map={"method": "certainty"}, certainty=certainty)


class Standing:
    """A robot at rest, and its maps; a scan each 0.04 s from 0.5 s on."""

    def __init__(self, config: Config) -> None:
        mapper = Mapper(config)
        for k in range(401):
            mapper.add_attitude(attitude(0.01 * k))
            if k % 5 == 0:
                mapper.add_counts(WheelCounts(0.01 * k, 0.0, 0.0, 0))
            mapper.odometry.settle()
        assert isinstance(mapper.maps, CertaintyMaps)
        self.maps, self._next_s = mapper.maps, 0.5
        self._attitudes, self._odometry = mapper.attitudes, mapper.odometry

    def scan(self, ranges_m: F64, after_s: float = 0.04) -> int:
        scan = scan_of(np.atleast_2d(ranges_m), self._next_s)
        self._next_s += after_s
        return self.maps.add(scan, self._attitudes, self._odometry)

    def look(self, ranges_m: F64) -> None:
        """At three rows of cells in turn, for what has no neighbours is not free."""
        for share in (0.976, 1.024, 1.0):
            for _ in range(4):
                self.scan(share * ranges_m)

    def state(self, x_m: float, y_m: float) -> int:
        grid = self.maps.window.grid
        i, j = grid.cell_of(x_m, y_m)
        return int(self.maps.window.cells[j % grid.size, i % grid.size])

    def cause(self, x_m: float, y_m: float) -> int:
        i, j = self.maps.grid.cell_of(x_m, y_m)
        return int(self.maps.causes(np.array([i]), np.array([j]))[0])

    def layer(self, name: str, x_m: float, y_m: float) -> float:
        i, j = self.maps.grid.cell_of(x_m, y_m)
        found = maybe_values(self.maps, name, np.array([i]), np.array([j]), footing=Footing(0.01))
        assert found is not None
        return float(found[0])


def with_box(range_m: float = 5.0, beams: slice = slice(200, 260)) -> F64:
    ranges_m = FLOOR_M.copy()
    ranges_m[beams] = range_m
    return ranges_m


def test_a_scan_is_mapped_once_the_next_has_come_and_what_it_alone_met_is_not() -> None:
    robot = Standing(settings_of())
    at_once = Standing(settings_of(three_scans=False))
    used = at_once.scan(FLOOR_M)
    assert used > 300
    assert robot.scan(FLOOR_M) == 0
    assert robot.scan(with_box()) == used - 58  # of 60 beams, those beside the floor are borne out
    assert robot.scan(FLOOR_M) == used - 60
    assert robot.cause(5.2, 0.0) == UNSEEN
    assert at_once.scan(with_box()) == used
    assert at_once.state(5.2, 0.0) == OBSTACLE


@pytest.mark.parametrize("three_scans", few([True, False], 2))
def test_floor_a_box_and_a_pit_are_told_as_what_they_are(three_scans: bool) -> None:
    robot = Standing(settings_of(three_scans=three_scans))
    ranges_m = with_box()
    ranges_m[160:190] *= 1.12
    robot.look(ranges_m)
    assert robot.cause(AHEAD_M, 2.0) == FLOOR
    assert robot.cause(5.2, 0.0) == TOO_HIGH
    pit_m = 1.12 * (AHEAD_M - MOUNT_X_M) + MOUNT_X_M
    pit_y_m = (pit_m - MOUNT_X_M) * math.tan(BEARING_RAD[175])
    assert robot.cause(pit_m, pit_y_m) == TOO_LOW
    assert is_low(robot.maps, *robot.maps.grid.cell_of(pit_m, pit_y_m))
    assert not is_low(robot.maps, *robot.maps.grid.cell_of(5.2, 0.0))
    assert robot.cause(AHEAD_M, 0.0) == UNSEEN  # behind the box
    assert robot.layer("height", 5.2, 0.0) == pytest.approx(1.08 - 5.0 * math.sin(0.1309), abs=0.01)
    assert robot.layer("z", AHEAD_M, 2.0) == pytest.approx(0.0, abs=1e-9)
    assert robot.layer("foothold", AHEAD_M, 2.0) != 0.0
    assert math.isnan(robot.layer("z", 1.0, 0.0))
    assert robot.layer("slope", AHEAD_M, 2.0) < math.radians(10.0)
    assert math.isnan(robot.layer("step", 1.0, 0.0))
    assert robot.maps.maybe_ring("variance") is None
    at = robot.maps.grid.cell_of(AHEAD_M, 2.0)
    assert robot.maps.evidence(*at)["certainty of its height"] > 10
    assert not is_low(robot.maps, *at)


@pytest.mark.parametrize("cell_m", [0.005, 0.010, 0.015])
def test_a_walking_robots_small_cells_and_steep_mount(cell_m: float) -> None:
    mount = {"mount_x_m": 0.0, "mount_z_m": 0.30, "mount_tilt_deg": 55.0}
    config = with_changes(
        settings_of(three_scans=False),
        map={"cells": 100, "cell_m": cell_m},
        obstacle={"window_cells": 100, "h_pos_m": 0.03, "h_neg_m": -0.03},
        scanner=mount,
    )
    robot, tilt_rad = Standing(config), math.radians(55.0)
    to_floor_m = 0.30 / math.sin(tilt_rad) / np.cos(BEARING_RAD)
    for rise_m in (-0.02, -0.01, 0.0, 0.01):  # of all that is seen: a row of cells each
        for _ in range(3):
            robot.scan(np.where(abs(BEARING_RAD) < 0.1, 0.8, 1.0 - rise_m / 0.30) * to_floor_m)
    x_m = 0.30 / math.tan(tilt_rad)
    assert robot.cause(0.8 * x_m, 0.0) == TOO_HIGH
    assert robot.layer("z", 0.8 * x_m, 0.0) == pytest.approx(0.06, abs=1e-9)
    assert robot.layer("z", x_m, 0.1) == pytest.approx(0.0, abs=0.011)
    assert robot.cause(x_m, 0.0) == UNSEEN
    assert robot.cause(-x_m, 0.0) == UNSEEN


def test_heights_that_differ_within_a_cell_are_a_step_of_it() -> None:
    robot = Standing(settings_of(three_scans=False, min_group=1))
    for x_m in (8.25, 8.35):  # both meet the row of cells from 8.2 to 8.4 m, where all of it does
        robot.scan((x_m - MOUNT_X_M) / (AHEAD_M - MOUNT_X_M) * FLOOR_M)
    rises_m = 0.1 * math.tan(math.radians(7.5))
    assert robot.layer("step", 8.3, 0.1) == pytest.approx(rises_m, abs=1e-6)


def test_what_was_free_is_unknown_once_no_beam_has_met_it_for_long() -> None:
    config = with_changes(settings_of(), obstacle={"free_max_age_s": 1.0})
    robot = Standing(config)
    robot.look(FLOOR_M)
    assert robot.state(AHEAD_M, 2.0) == FREE
    for _ in range(45):
        robot.scan(np.full(BEAMS, np.nan))
    assert robot.state(AHEAD_M, 2.0) == UNKNOWN
    assert robot.maps.ages_s(*(np.array([k]) for k in robot.maps.grid.cell_of(AHEAD_M, 2.0))) > 1.0


def test_erasing_forgets_all_and_the_scan_that_waits() -> None:
    robot = Standing(settings_of())
    robot.look(with_box())
    assert robot.maps.window.cells.any()
    robot.maps.erase()
    assert not robot.maps.window.cells.any()
    assert np.isnan(robot.maps.heights_m()).all()
    assert robot.scan(with_box()) == 0
    assert robot.cause(5.2, 0.0) == UNSEEN


def test_another_pattern_of_beams_supports_nothing_and_an_image_is_refused() -> None:
    robot = Standing(settings_of())
    robot.scan(FLOOR_M)
    assert robot.scan(FLOOR_M[:-1]) == 0
    nowhere = np.zeros((1, 3))
    image = PointSweep(nowhere, nowhere, np.ones((1, 1)), np.ones(1), 0, 1.0)
    with pytest.raises(ValueError, match="its scanner sends fans"):
        robot.maps.add(image, robot._attitudes, robot._odometry)


def test_a_scan_makes_no_array_of_the_grids_size() -> None:
    robot = Standing(with_changes(settings_of(), map={"cells": 1001}))
    for _ in range(3):
        robot.scan(with_box())
    tracemalloc.start()
    robot.scan(with_box())
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1001 * 1001 / 4
