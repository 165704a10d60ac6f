"""The mapper: scans wait for what covers them, and a broken chain erases the maps."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from config_file import load_config, with_changes
from core.mapping.certainty.maps import CertaintyMaps
from core.mapping.mapper import WAIT_S, WAITING, Mapper
from core.mapping.paper.maps import ReferencePlaneMaps
from core.mapping.surface.maps import SurfaceMaps
from core.records import FREE, OBSTACLE, PointSweep, Scan, WheelCounts
from tests import ROOT
from tests.core.mapping.test_rays import scan_of
from tests.core.motion.test_attitude import attitude

CONFIG = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
LOOKS = 6  # scans, after which what stands and what is free is known


def wall_and_floor(t_s: float, wall_m: float = 5.0) -> Scan:
    """What a level, standing robot sees of the floor, with a wall ahead in the middle."""
    bearings = np.radians(np.linspace(-60, 60, 481))
    to_floor = 1.08 / (np.cos(bearings) * math.sin(math.radians(7.5)))
    to_wall = wall_m / (np.cos(bearings) * math.cos(math.radians(7.5)))
    ranges = np.where(np.abs(bearings) < 0.3, np.minimum(to_wall, to_floor), to_floor)
    return scan_of(np.where(ranges <= 20, ranges, np.nan)[None, :], t_s)


def standing(until_s: float, mapper: Mapper | None = None) -> Mapper:
    """A mapper that has been told of a standing robot up to an instant."""
    mapper = mapper or Mapper(CONFIG)
    for k in range(round(until_s * 100) + 1):
        mapper.add_attitude(attitude(0.01 * k))
        if k % 5 == 0:
            mapper.add_counts(WheelCounts(0.01 * k, 0.0, 0.0, 0))
    return mapper


def state(mapper: Mapper, x: float, y: float) -> int:
    window = mapper.window(True)
    i, j = mapper.maps.window.grid.cell_of(x, y)
    return int(window.cells[j % 101, i % 101])


def test_floor_is_free_a_wall_is_an_obstacle_and_the_rest_unknown() -> None:
    mapper = standing(1.0)
    for k in range(LOOKS):
        mapper.add_scan(wall_and_floor(0.3 + 0.02 * k))
        assert mapper.settle(1.0) == 1
    assert state(mapper, 5.25, 0.1) == OBSTACLE
    assert state(mapper, 8.45, 4.0) == FREE
    assert state(mapper, 7.0, 0.1) == 0
    assert state(mapper, 1.0, 0.1) == 0


def test_the_settings_name_the_method() -> None:
    kinds = {
        "surface": SurfaceMaps,
        "reference_plane": ReferencePlaneMaps,
        "certainty": CertaintyMaps,
    }
    for method, kind in kinds.items():
        mapper = Mapper(with_changes(CONFIG, map={"method": method}))
        assert isinstance(mapper.maps, kind)
        assert not mapper.window(True).cells.any()


def test_what_is_told_is_the_methods_window_and_each_change_once() -> None:
    mapper = standing(1.0)
    mapper.add_scan(wall_and_floor(0.5))
    mapper.settle(1.0)
    told = mapper.window(False)
    assert told.cells is mapper.maps.window.cells
    assert not told.trusted
    assert set(told.changed.tolist()) == set(np.flatnonzero(told.cells).tolist())
    assert len(mapper.window(True).changed) == 0
    assert mapper.counts.points == np.count_nonzero(wall_and_floor(0.5).ranges_m > 0)


def test_a_scan_waits_for_the_attitude_of_its_last_beam_or_is_dropped_and_counted() -> None:
    mapper = standing(0.40)
    mapper.add_scan(wall_and_floor(0.395))
    assert mapper.settle(0.40) == 0
    mapper.add_attitude(attitude(0.41))
    assert mapper.settle(0.41) == 1
    mapper = standing(0.40)
    mapper.add_scan(wall_and_floor(0.395))
    scan_arrived_s = 0.395 + 0.02
    assert mapper.settle(scan_arrived_s + WAIT_S - 0.001) == 0
    assert mapper.counts.scans_dropped == 0
    assert mapper.settle(scan_arrived_s + WAIT_S + 0.001) == 0
    assert mapper.counts.scans_dropped == 1
    early = Mapper(CONFIG)  # before any pose
    early.add_scan(wall_and_floor(0.4))
    early.settle(1.0)
    assert (early.counts.scans_early, early.counts.scans_dropped) == (1, 0)


def test_what_no_scanner_may_deliver_is_refused_before_any_kernel_walks_it() -> None:
    mapper, good = standing(1.0), wall_and_floor(0.5)
    nowhere = np.zeros((481, 3))
    sweep = PointSweep(nowhere, nowhere, good.ranges_m, np.full(481, 0.5), 0, 0.52)
    late = np.full(481, 0.5)
    late[7] = 0.6
    for bad, told in (
        (scan_of(np.ones((1, 1141))), "1 to 1081 beams, this one 1 x 1141"),
        (scan_of(np.ones((1, 0))), "1 to 1081 beams, this one 1 x 0"),
        (replace(good, t_s=math.nan), "finite"),
        (replace(good, step_rad=math.inf), "finite"),
        (replace(good, beam_dt_s=-1e-5), "ascend"),
        (replace(sweep, origins=nowhere[:480]), "shapes"),
        (replace(sweep, times_s=late), "its last the latest"),
        (replace(sweep, directions=np.full((481, 3), np.nan)), "finite"),
    ):
        with pytest.raises(ValueError, match=told):
            mapper.add_scan(bad)
    mapper.add_scan(good)
    assert mapper.settle(1.0) == 1


def test_a_scan_given_as_a_sweep_of_points_makes_the_same_map() -> None:
    mappers = standing(1.0), standing(1.0)
    for k in range(LOOKS):
        scan = wall_and_floor(0.3 + 0.02 * k)
        bearings = scan.first_rad + scan.step_rad * np.arange(481)
        rays = np.stack([np.cos(bearings), np.sin(bearings), np.zeros(481)], axis=1)
        times_s = scan.t_s + scan.beam_dt_s * np.arange(481, dtype=np.float64)
        sweep = PointSweep(np.zeros((481, 3)), rays, scan.ranges_m, times_s, k, scan.arrived_s)
        mappers[0].add_scan(scan)
        mappers[1].add_scan(sweep)
        assert [mapper.settle(1.0) for mapper in mappers] == [1, 1]
    cells, again = (mapper.window(True).cells for mapper in mappers)
    assert (cells == OBSTACLE).sum() > 10
    np.testing.assert_array_equal(cells, again)


def test_no_more_scans_wait_than_the_codec_has_slots_for() -> None:
    mapper = standing(0.40)
    for k in range(WAITING + 3):
        mapper.add_scan(wall_and_floor(0.5 + 0.01 * k))
    assert mapper.counts.scans_dropped == 3


def test_restarted_counters_erase_both_maps_and_begin_a_new_epoch() -> None:
    mapper = standing(1.0)
    mapper.add_scan(wall_and_floor(0.5))
    mapper.settle(1.0)
    epoch = mapper.window(True).epoch
    mapper.add_counts(WheelCounts(1.05, 0.0, 0.0, 1))
    mapper.add_attitude(attitude(1.06))
    mapper.settle(1.06)
    window = mapper.window(True)
    assert window.epoch > epoch
    assert not window.cells.any()
    assert mapper.newest_scan_s == -math.inf
