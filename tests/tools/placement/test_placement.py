"""Mounts over stepfields: shadows and errors by hand, the ranking, and wrong use."""

import math
from pathlib import Path

import numpy as np
import pytest

from core.records import F64
from tests import ROOT
from tools.cli.placement import main, of_settings
from tools.placement.field import BLOCKS, flat, stepfield
from tools.placement.measure import XS, YS, fields_of, measured, over, seen_of
from tools.placement.search import best_mount
from tools.placement.sensor import NAMED, Sensor, stripe, urg
from tools.placement.sight import OCCLUDED, SEEN, look

BLOCK = 20  # a wall across the way, 2.0 to 2.1 m ahead


def walled(height_m: float) -> F64:
    heights = flat()
    heights[BLOCK] = height_m
    return heights


def states_ahead(sensor: Sensor, heights: F64, xs: F64) -> list[int]:
    states, sigmas = np.empty((len(xs), 1), np.int8), np.empty((len(xs), 1))
    look(heights, xs, np.array([0.05]), sensor.numbers, states, sigmas)
    return [int(state) for state in states[:, 0]]


@pytest.mark.parametrize("sensor", NAMED, ids=lambda sensor: sensor.name)
def test_flat_ground_is_never_occluded(sensor: Sensor) -> None:
    assert measured(sensor, flat())[0] == 0.0


@pytest.mark.parametrize("tilt_deg", [30.0, 45.0, 60.0])
def test_a_scanners_shadow_is_as_long_as_similar_triangles_say(tilt_deg: float) -> None:
    end_m = 2.1 + 0.15 / math.tan(math.radians(tilt_deg))
    xs = np.array([1.99, 2.05, 2.101, end_m - 0.002, end_m + 0.002])
    got = states_ahead(urg("one", 0.6, tilt_deg), walled(0.15), xs)
    assert got == [SEEN, SEEN, OCCLUDED, OCCLUDED, SEEN]


def test_a_stripes_shadow_is_that_of_camera_and_laser_together() -> None:
    sensor = stripe("one", 0.5, 40.0)
    laser_z_m = 0.5 + 0.15 * math.cos(math.radians(40.0))
    ahead_m = 0.15 * math.sin(math.radians(40.0)) + laser_z_m / math.tan(math.radians(55.0))
    end_m = 2.1 + 0.15 * ahead_m / 0.5  # the camera looks flatter than the laser falls
    laser_end_m = 2.1 + 0.15 / math.tan(math.radians(55.0))
    xs = np.array([2.05, laser_end_m - 0.002, laser_end_m + 0.002, end_m - 0.002, end_m + 0.002])
    got = states_ahead(sensor, walled(0.15), xs)
    assert laser_end_m < end_m - 0.01
    assert got == [SEEN, OCCLUDED, OCCLUDED, OCCLUDED, SEEN]


def sigma_ahead_m(sensor: Sensor) -> float:
    states, sigmas = np.empty((1, 1), np.int8), np.empty((1, 1))
    look(flat(), np.array([2.0]), np.array([0.0]), sensor.numbers, states, sigmas)
    assert states[0, 0] == SEEN
    return float(sigmas[0, 0])


def test_a_scanners_error_is_that_by_hand() -> None:
    # 45 deg from 0.5 m: 5 mm of range are 3.536 mm of height, 0.2 deg over 0.5 m are 1.745 mm
    assert sigma_ahead_m(urg("one", 0.5, 45.0)) == pytest.approx(0.003943, abs=2e-6)


def test_a_stripes_error_is_that_by_hand() -> None:
    # laser 0.6061 m high falls at 60 deg: 0.3499 m ahead of it, 0.4560 m ahead of the camera;
    # depth 0.6760 m on the axis; 0.5 * 0.6760 * 0.3 / (500 * 0.15) m, and 0.2 deg over 0.4560 m
    along_m = 0.5 * 0.67599 * 0.3 / 75.0
    turned_m = 0.4560 * math.radians(0.2)
    assert sigma_ahead_m(stripe("one", 0.5, 45.0)) == pytest.approx(
        math.hypot(along_m, turned_m), abs=2e-6
    )


@pytest.mark.parametrize("kind", ["urg", "stripe"])
def test_the_ranking_is_the_same_over_other_fields(kind: str) -> None:
    sensors = [sensor for sensor in NAMED if sensor.name.startswith(kind)]
    for seed in (1, 2):
        found = [over(sensor, fields_of(seed, 10, 0.15)) for sensor in sensors]
        a, b, c = (result.mean[0] for result in found)
        assert a > b > c


def test_a_stepfield_is_of_its_seed_and_in_steps() -> None:
    heights = stepfield(1, 2, 0.15)
    assert heights.shape == (BLOCKS, BLOCKS)
    assert np.array_equal(heights, stepfield(1, 2, 0.15))
    assert not np.array_equal(heights, stepfield(1, 3, 0.15))
    assert set(np.round(heights.ravel(), 9)) == {0.0, 0.05, 0.1, 0.15}


def test_cells_are_those_told() -> None:
    assert seen_of(NAMED[0], flat())[0].shape == (len(XS), len(YS))


def test_a_search_keeps_its_bounds_and_its_strip() -> None:
    best, tried = best_mount(NAMED[0], (0.3, 0.6), (20.0, 60.0), 0.6, fields_of(1, 3, 0.15))
    assert tried == 75
    assert best is not None
    assert 0.3 <= best.sensor.z_m <= 0.6
    assert best.mean[1] >= 0.6
    assert 20 <= math.degrees(best.sensor.tilt_rad) <= 60 + 1e-9
    assert best_mount(NAMED[0], (0.3, 0.6), (20.0, 60.0), 5.1, fields_of(1, 3, 0.15))[0] is None


def test_a_search_goes_on_from_a_mount_that_sees_nothing() -> None:
    fields = fields_of(1, 2, 0.15)
    assert np.isnan(over(stripe("one", 1.9, 10.0), fields).mean[0])  # all is out of its reach
    best, _ = best_mount(stripe("one", 1.0, 45.0), (1.9, 2.4), (10.0, 70.0), 0.0, fields)
    assert best is not None
    assert best.mean[0] < 1.0


def test_a_mount_that_sees_nothing_is_told_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--sensor", "stripe", "--height", "5", "--tilt", "10", "--fields", "2"]
    assert main(given) == 0
    told = capsys.readouterr().out
    assert "sees nothing of a field 0.0 to 3.0 m ahead" in told
    assert "nan" not in told


def test_the_settings_mount_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--config", str(ROOT / "robots/urg04lx.toml"), "--fields", "2"]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[:3] == ["settings", "1.08", "16.0"]


def test_the_settings_camera_and_laser_are_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = ROOT / "robots/ragno.toml"
    sensor = of_settings(path)
    assert sensor.look_ahead_m == pytest.approx(  # by hand: its axis and the light meet the floor
        0.40 / math.tan(math.radians(40.0)), abs=0.01
    )
    assert math.degrees(sensor.left_rad) == pytest.approx(math.degrees(math.atan(320 / 600)))
    assert (sensor.left_rad, sensor.half_high_px) == (-sensor.right_rad, 240.0)
    assert main(["--config", str(path), "--fields", "2"]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[:3] == ["settings", "0.40", "40.0"]
    beside = tmp_path / "beside.toml"
    beside.write_text(path.read_text().replace('along = "columns"', 'along = "rows"'))
    assert main(["--config", str(beside)]) == 2
    assert "the laser must be above the camera and dip" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--tilt", "3"], "say both"),
        (["--config", "none.toml"], "none.toml"),
        (["--config", "none.toml", "--sensor", "urg"], "not with --config"),
        (["--optimise", "--tilts", "40", "20"], "lower first"),
        (["--picture", "none/seen.png"], "--picture none/seen.png: must be a file in a folder"),
        (["--picture", "seen.jpg"], "--picture seen.jpg: must end with .png"),
    ],
)
def test_wrong_use_gets_one_line(
    given: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(given) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_tilt_that_looks_level_is_refused() -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--height", "1", "--tilt", "0"])
