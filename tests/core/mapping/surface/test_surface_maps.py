"""Method `surface` in closed scenes, and what its map tells to who asks."""

import math

import msgspec
import numpy as np
import pytest

from core.mapping import causes
from core.mapping.freshness import SWEEP_S
from core.mapping.layers import ON_ASKING, UNITS, maybe_layer, maybe_values
from core.mapping.method import is_low
from core.mapping.shadows import NOTHING_M
from core.mapping.surface.maps import SurfaceMaps
from core.records import FREE, OBSTACLE, UNKNOWN, Scan
from jit import COMPILED
from tests.support.cases import few
from tests.support.maps.cell_rig import CellRig
from tests.support.maps.flat_ride import SCAN_S, Ride, Rig, config_of, places_where, state_at
from tests.support.maps.flat_world import Box, Profile, World, ditch, kerb
from tools.experiments.views import heights_over_ground_m

LANES_M = (-0.3, -0.1, 0.1, 0.3)  # the cells that the robot's width of 0.6 m covers
SLACK_M = 0.15  # half the diagonal of a cell
CONFIG = config_of(map={"method": "surface"})
GONE_S = 4.0
BOX = Box((8.03, -0.5, 0.0), (8.43, 0.5, 0.4), until_s=GONE_S)


def drive(world: World, metres: float, pitching_rad: float = 0.0) -> Rig:
    """At 1 m/s."""
    return Rig(CONFIG, world, Ride(v_mps=1.0, pitching_rad=pitching_rad), metres).run()


def maps_of(rig: Rig) -> SurfaceMaps:
    maps = rig.mapper.maps
    assert isinstance(maps, SurfaceMaps)
    return maps


def barred_lanes(rig: Rig, low_m: float, high_m: float) -> set[float]:
    """The lanes of the robot's way in which an obstacle lies between x = low and high."""
    x, y = places_where(rig, OBSTACLE).T
    inside = (x >= low_m - SLACK_M) & (x <= high_m + SLACK_M)
    return {lane for lane in LANES_M if np.any(np.abs(y[inside] - lane) < 0.05)}


def way(rig: Rig, low_m: float, high_m: float) -> list[int]:
    """States of the cells of the robot's way."""
    return [state_at(rig, x, lane) for x in np.arange(low_m, high_m, 0.2) for lane in LANES_M]


@pytest.mark.parametrize("pitching_deg", few([0.0, 1.0], 2))
def test_a_flat_floor_is_free_ahead_and_nothing_stands_on_it(pitching_deg: float) -> None:
    rig = drive(World(), 5.0, pitching_rad=math.radians(pitching_deg))
    assert len(places_where(rig, OBSTACLE)) == 0
    assert set(way(rig, 9.1, 12.0)) == {FREE}
    assert not np.any(np.abs(places_where(rig, FREE)[:, 0] - 5.0) > 11.0)


@pytest.mark.parametrize(("wall_m", "free"), [(3.0, 0), (5.0, 0), (10.0, 80)])
def test_a_robot_that_has_not_moved_tells_walls_and_the_line_of_floor(
    wall_m: float, free: int
) -> None:
    """It meets the floor 8.45 m ahead."""
    wall = Box((wall_m, -20.0, 0.0), (wall_m + 0.3, 20.0, 2.5))
    rig = Rig(CONFIG, World(solids=(wall,)), Ride(), 2.0).run()
    stands, floor = places_where(rig, OBSTACLE), places_where(rig, FREE)
    assert len(stands) == 0 if free else len(stands) > 80
    assert np.all(np.abs(stands[:, 0] - wall_m) < 0.15)
    assert len(floor) >= free
    assert np.all(floor[:, 0] > 8.3)


def test_what_a_robot_took_for_a_wall_before_it_moved_may_be_a_ramp() -> None:
    foot = Profile(((-300.0, 0.0), (5.0, 0.0), (300.0, 295.0 * math.tan(math.radians(5.0)))))
    stood = Rig(CONFIG, World(foot), Ride(), 1.0).run()
    assert len(places_where(stood, OBSTACLE)) > 40
    driven = drive(World(foot), 3.0)
    assert OBSTACLE not in way(driven, 6.1, 8.5)
    assert maps_of(driven).window.epoch == 0  # forgotten by changes, not told as an erased map


def test_a_box_is_an_obstacle_and_once_it_is_gone_free_ground_very_soon() -> None:
    """A robot that stands: its sweep meets the box, and the same sweep floor behind it."""
    before = Box(BOX.low, BOX.high, from_s=2.0, until_s=GONE_S)
    rig = Rig(CONFIG, World(solids=(before,)), Ride(v_mps=0.5, stop_s=1.0), GONE_S + 1.5)
    stood, free_s = False, math.inf
    for now_s in rig.drive():
        lanes = barred_lanes(rig, 8.03, 8.43)
        stood = stood or lanes == set(LANES_M)
        if stood and not lanes and free_s == math.inf:
            free_s = now_s
    assert stood
    assert free_s - GONE_S <= 0.6 + SCAN_S
    assert len(places_where(rig, OBSTACLE)) == 0


def test_a_beam_that_came_back_and_tells_nothing_is_no_sign_of_missing_ground() -> None:
    """As the shadow filter leaves them; beams that did not come back tell of it."""
    told = {}
    for taken_m in (NOTHING_M, math.nan):
        rig = drive(World(), 3.0)
        maps, mapper = maps_of(rig), rig.mapper
        assert isinstance(mapper.newest_scan, Scan)
        ranges_m = mapper.newest_scan.ranges_m.copy()
        ranges_m[:, 200:280] = taken_m
        beyond = msgspec.structs.replace(mapper.newest_scan, ranges_m=ranges_m)
        for _ in range(6):
            maps.add(beyond, mapper.attitudes, mapper.odometry)
        told[taken_m] = len(places_where(rig, OBSTACLE))
    assert told[NOTHING_M] == 0
    assert told[math.nan] > 0


@pytest.mark.parametrize("width_m", few([0.3, 0.6, 1.5], 2))
def test_a_ditch_bars_the_way_and_is_never_free(width_m: float) -> None:
    rig = drive(World(ditch(9.05, width_m)), 0.55 + 2 * width_m + 1.0)
    assert barred_lanes(rig, 9.05, 9.05 + width_m) == set(LANES_M)
    x = places_where(rig, FREE)[:, 0]
    assert not np.any((x > 9.05 + SLACK_M) & (x < 9.05 + width_m - SLACK_M))


NARROW = pytest.mark.xfail(
    strict=True,
    reason="once the far face, 4 cm down at most, counts as floor, what lay under the ground is "
    "held against that",
)
DITCHES = [
    (9.05, 0.3),
    (9.1, 0.6),
    (9.15, 0.6),
    (9.0, 0.6),
    pytest.param(9.0, 0.3, marks=NARROW),
    pytest.param(9.1, 0.3, marks=NARROW),
    pytest.param(9.15, 0.3, marks=NARROW),
]


@pytest.mark.parametrize("width_m", [0.3, 0.6])
@pytest.mark.parametrize("near_m", few([9.0, 9.1, 9.05, 9.15], 2))
def test_a_ditch_is_free_nowhere_wherever_the_cells_begin(near_m: float, width_m: float) -> None:
    rig = drive(World(ditch(near_m, width_m)), 0.55 + 2 * width_m + 1.0)
    x = places_where(rig, FREE)[:, 0]
    assert not np.any((x > near_m + 0.09) & (x < near_m + width_m - 0.09))


@pytest.mark.parametrize(("near_m", "width_m"), DITCHES)
def test_a_ditch_bars_every_lane_wherever_the_cells_begin(near_m: float, width_m: float) -> None:
    rig = drive(World(ditch(near_m, width_m)), 0.55 + 2 * width_m + 1.0)
    assert barred_lanes(rig, near_m, near_m + width_m) == set(LANES_M)


@pytest.mark.parametrize("near_m", few([9.05, 9.1, 9.15], 1))
def test_a_ditch_is_told_by_its_far_face_before_its_far_side_is_seen(near_m: float) -> None:
    """It is met first 8.45 m ahead; 0.6 m of way later its far side is."""
    seconds = (near_m - 8.45 + 0.4) / 0.5
    rig = Rig(CONFIG, World(ditch(near_m, 0.6)), Ride(v_mps=0.5), seconds).run()
    assert barred_lanes(rig, near_m, near_m + 0.6) == set(LANES_M)


@pytest.mark.parametrize(("rise_m", "lanes_m"), [(0.12, LANES_M), (0.15, LANES_M), (0.08, ())])
def test_a_face_is_told_while_its_top_is_not_seen(
    rise_m: float, lanes_m: tuple[float, ...]
) -> None:
    """Its returns are as high as the bound of 10 cm after 0.76 m of way."""
    rig = Rig(CONFIG, World(kerb(9.05, rise_m)), Ride(v_mps=0.5), 2.0 * (0.6 + 0.84)).run()
    assert barred_lanes(rig, 9.05, 9.05) == set(lanes_m)


@pytest.mark.parametrize("rise_m", [0.15, -0.2])
def test_ground_beyond_a_step_is_not_free(rise_m: float) -> None:
    rig = drive(World(kerb(9.05, rise_m)), 4.0)
    assert barred_lanes(rig, 9.05, 9.05 + 0.4) == set(LANES_M)
    assert FREE not in way(rig, 9.5, 11.5)
    assert set(way(rig, 8.7, 9.0)) == {FREE}  # the map begins as the robot moves


def test_a_gentle_ramp_is_ground() -> None:
    foot = Profile(((-300.0, 0.0), (9.0, 0.0), (300.0, 291.0 * math.tan(math.radians(4.0)))))
    rig = drive(World(foot), 4.0)
    assert OBSTACLE not in way(rig, 6.1, 11.5)
    assert way(rig, 9.3, 11.1).count(FREE) > 0.9 * len(way(rig, 9.3, 11.1))


def test_heights_over_the_plane_of_the_robot_do_not_tilt_with_its_attitude() -> None:
    """The sensor is off by half a degree for always: the map tilts, and the robot's plane too."""
    ride = Ride(v_mps=1.0, bias_rad=(0.0, math.radians(0.5)))
    maps = maps_of(Rig(CONFIG, World(), ride, 6.0).run())
    assert np.nanmax(np.abs(maps.heights_m())) > 0.05
    assert np.nanmax(np.abs(heights_over_ground_m(maps))) < 0.03


@pytest.mark.skipif(not COMPILED, reason="a ride through kernels as Python takes minutes")
@pytest.mark.parametrize(("roll_deg", "pitch_deg"), few([(0.4, -0.3), (0.0, 0.5)], 1))
def test_an_attitude_sensor_that_sits_askew_bends_no_floor_as_the_robot_turns(
    roll_deg: float, pitch_deg: float
) -> None:
    askew_rad = math.radians(roll_deg), math.radians(pitch_deg)
    rig = Rig(CONFIG, World(), Ride(v_mps=0.4, w_radps=0.3, bias_rad=askew_rad), 50.0).run()
    maps = maps_of(rig)
    z_m, seen = maps.heights_m(), maps.cells["looks"] > 0
    assert len(places_where(rig, OBSTACLE)) == 0
    assert len(places_where(rig, FREE)) > 3000
    assert float(np.std(z_m[seen])) < 0.02


@pytest.mark.parametrize("echo", few(["first", "both"], 2))
def test_second_echoes_are_no_scans_of_their_own(echo: str) -> None:
    """By the count of scans, each beam is followed all along in every other scan."""
    config = config_of(map={"method": "surface"}, scanner={"echo": echo})
    rig = Rig(config, World(), Ride(), 0.5)
    for scans, _ in enumerate(rig.drive(), 1):
        assert maps_of(rig)._surface.now["scan"][0] == scans


def test_erasing_forgets_everything() -> None:
    rig = drive(World(ditch(9.05, 0.6)), 2.0)
    maps = maps_of(rig)
    low = [maps.window.grid.cell_of(*place) for place in places_where(rig, OBSTACLE).tolist()]
    assert sum(is_low(maps, i, j) for i, j in low) > 0.9 * len(low) > 20
    assert not any(is_low(maps, i + maps.window.grid.size, j) for i, j in low)
    epoch = maps.window.epoch
    maps.erase()
    assert maps.window.epoch == epoch + 1
    assert not maps.window.cells.any()
    assert len(maps.window.take_changed()) == 0
    assert not maps.cells["looks"].any()
    assert not np.isfinite(maps.cells["var_m2"]).any()
    assert not any(is_low(maps, i, j) for i, j in low)
    assert not maps.static_rad.any()
    i, j = np.array(low).T
    for name in ("state", "height", "z", "variance", "slope", "step", "roughness", "age"):
        values = maybe_values(maps, name, i, j)
        assert values is not None
        assert np.isnan(values).all(), name


@pytest.mark.parametrize("window_cells", [101, 61])
def test_what_is_told_of_a_cell_agrees_with_the_window(window_cells: int) -> None:
    config = config_of(map={"method": "surface"}, obstacle={"window_cells": window_cells})
    solid = Box((6.0, 1.0, 0.0), (7.0, 2.0, 0.5))
    rig = Rig(config, World(ditch(9.05, 0.6), (solid,)), Ride(v_mps=1.0), 4.0).run()
    maps = maps_of(rig)
    grid, outer = maps.window.grid, maps.grid
    j, i = np.mgrid[: outer.size + 4, : outer.size + 4].reshape(2, -1) - 2
    i, j = i + outer.corner_i, j + outer.corner_j
    inside = (i >= grid.corner_i) & (i < grid.corner_i + grid.size)
    inside &= (j >= grid.corner_j) & (j < grid.corner_j + grid.size)
    shown = np.where(inside, maps.window.cells[j % grid.size, i % grid.size], UNKNOWN)
    assert set(shown.tolist()) == {FREE, UNKNOWN, OBSTACLE}
    told = maybe_values(maps, "cause", i, j)
    states = maybe_values(maps, "state", i, j)
    assert told is not None
    assert states is not None
    assert (told[~inside] == causes.OUTSIDE).all()
    assert [causes.state_of(int(cause)) for cause in told] == shown.tolist()
    assert (np.where(np.isnan(states), UNKNOWN, states) == shown).all()
    assert {causes.FLOOR, causes.STANDS, causes.NO_FLOOR, causes.UNSEEN} <= set(told.tolist())


def test_each_layer_gives_the_same_as_a_whole_and_cell_by_cell() -> None:
    solid = Box((6.0, -2.0, 0.0), (7.0, -1.0, 0.5))
    rig = drive(World(solids=(solid,)), 3.0)
    maps = maps_of(rig)
    named = [name for name in UNITS if maybe_layer(maps, name) is not None]
    assert {"state", "height", "z", "variance", "slope", "step", "roughness"} <= set(named)
    for name in named:
        view = maybe_layer(maps, name)
        assert view is not None
        j, i = np.mgrid[: len(view.values), : len(view.values)].reshape(2, -1)
        values = maybe_values(maps, name, i + view.corner_i, j + view.corner_j)
        assert values is not None
        assert values.astype(np.float32).tobytes() == view.values.tobytes(), name
        assert np.isfinite(values).any()
    assert all(maybe_layer(maps, name) is None for name in (*ON_ASKING, "nothing"))
    i, j = (np.array([k]) for k in maps.grid.cell_of(6.1, -1.5))
    height, z = maybe_values(maps, "height", i, j), maybe_values(maps, "z", i, j)
    assert height == pytest.approx(0.5, abs=0.1)
    assert z == pytest.approx(0.5, abs=0.1)


def test_step_and_roughness_tell_level_floor_from_a_kerb_and_a_box() -> None:
    rise_m, solid = 0.2, Box((6.0, -2.0, 0.0), (7.0, -1.0, 0.5))
    rig = drive(World(kerb(9.0, rise_m), solids=(solid,)), 4.0)
    maps = maps_of(rig)
    told = {}
    for name in ("step", "roughness"):
        values = [
            maybe_values(maps, name, *(np.array([k]) for k in maps.grid.cell_of(x, y)))
            for x, y in ((8.5, 0.1), (8.9, 0.1), (10.1, 0.1), (6.1, -1.5), (-5.0, 0.0))
        ]
        told[name] = [float(value[0]) for value in values if value is not None]
    floor, foot, above, box, never = told["step"]
    assert max(floor, above) < 0.05
    assert foot == pytest.approx(rise_m, abs=0.05)
    assert box == pytest.approx(0.5, abs=0.1)
    assert math.isnan(never)
    floor, foot, above, box, never = told["roughness"]
    assert max(floor, above) < 0.01
    assert min(foot, box) > 0.04
    assert math.isnan(never)


def test_what_nobody_has_watched_for_too_long_is_unknown() -> None:
    """A robot that has turned away from where it looked."""
    age_s = 3.0
    config = config_of(map={"method": "surface"}, obstacle={"free_max_age_s": age_s})
    rig = Rig(config, World(), Ride(v_mps=0.3, w_radps=1.0, stop_s=math.pi), 10.0)
    was_free, ahead = 0, set()
    for _ in rig.drive():
        maps = maps_of(rig)
        free = places_where(rig, FREE)
        i, j = np.floor(free / maps.grid.cell_m).astype(np.int64).T
        ages_s = maybe_values(maps, "age", i, j)
        assert ages_s is not None
        assert not np.isnan(ages_s).any()
        assert (ages_s <= age_s + SWEEP_S + 2 * SCAN_S).all()
        was_free += len(free) > 200
        ahead.add(state_at(rig, 8.7, 0.1))
    assert was_free > 50
    assert FREE in ahead
    place = 8.7, 0.1
    assert state_at(rig, *place) == UNKNOWN
    i, j = (np.array([k]) for k in maps.grid.cell_of(*place))
    assert maps.causes(i, j).tolist() == [causes.AGED]


def test_beams_straight_down_break_nothing() -> None:
    rig = CellRig()
    down = [(0.0, 0.0, z) for z in (0.0, -0.3, 0.1)] * 8
    for _ in range(3):
        assert rig.add(*down) == len(down)
