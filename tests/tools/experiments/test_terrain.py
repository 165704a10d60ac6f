"""Maps of centimetres: the measures on made-up maps, and the experiments with few seeds."""

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")

from core.records import F64, FREE, OBSTACLE, Scan
from fakes.scenes.solids import Solid
from tools.experiments.terrain import scenes
from tools.experiments.terrain.__main__ import main
from tools.experiments.terrain.feet import FEET, feet_on, filled_figures, freed, true_step_m
from tools.experiments.terrain.measure import figures, truth_of, width_and_height_m
from tools.experiments.terrain.methods import NAMES, SHADED, Region, settings_of
from tools.experiments.terrain.pictures import BLUE, RED, WHITE, pixels_of
from tools.experiments.terrain.report import BEGIN, END, quartiles, with_tables
from tools.experiments.terrain.ride import STEADY, WALKING, Gait, Ride
from tools.experiments.terrain.trials import (
    BY_STRIPE,
    STEEP,
    STRIPE,
    rocks_mapped,
    sizes_off,
    thing_seen,
)
from tools.experiments.terrain.urg import Urg

SEED = 1001  # not one of those that are judged
CELL_M = 0.010
REGION = Region((0.0, 0.4), (-0.2, 0.2), CELL_M)
BOX = Solid("box", (0.1, 0.3), (-0.06, 0.05), (0.0, 0.1))
SOME = ("certainty, none", "certainty, all", "surface", SHADED)


def perfect_map() -> F64:
    """Of the box: highest surface of each cell."""
    return truth_of(scenes.scene("box", BOX), REGION).high_m


def test_a_box_in_a_perfect_map_has_its_size_to_a_cell() -> None:
    told = perfect_map() + 0.002  # what all heights share is no error of a size
    width_m, height_m = width_and_height_m(told, REGION, BOX)
    assert height_m == pytest.approx(0.1, abs=1e-12)
    assert width_m == pytest.approx(0.11, abs=CELL_M + 1e-9)


def test_a_box_ends_in_the_middle_of_its_last_cell_beside_a_shadow_and_at_no_hole() -> None:
    told, clear = perfect_map(), width_and_height_m(perfect_map(), REGION, BOX)
    rows = (REGION.cells()[1] + 0.5) * CELL_M
    told[(rows > 0.05) & (rows < 0.085)] = np.nan
    told[(rows > 0.0) & (rows < 0.02)] = np.nan
    width_m, height_m = width_and_height_m(told, REGION, BOX)
    assert height_m == pytest.approx(clear[1])
    assert width_m == pytest.approx(clear[0] - CELL_M / 2)


@pytest.mark.parametrize("unknown", ["top", "floor", "all"])
def test_a_size_that_the_map_does_not_tell_is_not_guessed(unknown: str) -> None:
    told = perfect_map()
    told[{"top": told > 0.0, "floor": told == 0.0, "all": told > -1.0}[unknown]] = np.nan
    assert np.isnan(width_and_height_m(told, REGION, BOX)).all()


def test_what_lies_between_the_lowest_and_the_highest_of_its_cell_is_right() -> None:
    truth = truth_of(scenes.scene("box", replace(BOX, x=(0.105, 0.3))), REGION)
    at = np.argwhere(truth.low_m < truth.high_m)  # cells through which its faces go
    assert len(at) == 11
    told = truth.low_m + 0.5 * (truth.high_m - truth.low_m)
    assert figures(told, truth) == (0.0, 0.0, 0, 0)
    told[0, 0], told[0, 1], told[0, 2], told[0, 3] = 0.02, -0.03, 0.015, np.nan
    found = figures(told, truth)
    assert (found.too_high, found.too_low) == (1, 1)  # one at the bound is none
    assert found.unknown == pytest.approx(1 / told.size)
    squares = 0.02**2 + 0.03**2 + 0.015**2
    assert found.rms_m == pytest.approx(math.sqrt(squares / (told.size - 1)))
    assert math.isnan(figures(np.full(told.shape, np.nan), truth).rms_m)
    pixels = pixels_of(told, truth)
    assert [tuple(pixels[0, k]) for k in (0, 1, 3)] == [RED, BLUE, WHITE]


def test_a_foot_is_safe_by_the_truth_alone_and_the_best_ones_stand_apart() -> None:
    scene = scenes.scene("box", Solid("box", (0.5, 1.0), (-0.5, 0.5), (0.0, 0.08)))
    assert true_step_m(scene, 0.3, 0.0) == 0.0
    assert true_step_m(scene, 0.45, 0.0) == pytest.approx(0.08)
    region = Region((0.0, 1.0), (-0.5, 0.5), CELL_M)
    wrong, nothing = np.ones((100, 100)), np.zeros((100, 100))  # a map that takes all for good
    feet = feet_on(wrong, nothing, scene, region, SEED)
    assert feet.found == FEET
    assert feet.safe < FEET
    assert feet.worst_m == pytest.approx(0.08)
    best = np.where(np.arange(100) < 40, wrong, 0.0)  # but none at the box
    feet = feet_on(best, nothing, scene, region, SEED)
    assert (feet.safe, feet.worst_m) == (feet.found, 0.0)
    assert 3 <= feet.found < FEET  # for more there is no room before it
    assert feet_on(np.full(wrong.shape, np.nan), nothing, scene, region, SEED) == (0, 0, 0.0)


def test_what_is_filled_in_is_judged_by_its_own_sigma() -> None:
    truth = truth_of(scenes.scene("floor"), REGION)
    measured, told, sigma = (np.zeros(truth.low_m.shape) for _ in range(3))
    measured[:10], sigma[:10] = np.nan, 0.01
    told[:5] = 0.02  # half of them two sigmas too high
    found = filled_figures(measured, told, sigma, truth)
    assert (found.unknown, found.filled) == (10 / 40, 1.0)
    assert (found.too_high, found.too_low) == (0.5, 0.0)
    assert found.rms_m == pytest.approx(0.02 / math.sqrt(2))
    assert found.off_sigmas == pytest.approx(2.0)
    assert filled_figures(measured, measured, sigma, truth).filled == 0.0


def test_what_is_told_free_is_held_against_all_that_is_in_its_cells() -> None:
    low = replace(BOX, x=(0.105, 0.3), z=(0.0, 0.03))  # at the bound; a face goes through cells
    truth = truth_of(scenes.scene("box", low), REGION)
    states = np.full(truth.low_m.shape, float(OBSTACLE))
    states[truth.high_m > truth.low_m] = FREE
    states[:3] = FREE
    states[5] = np.nan
    assert freed(states, truth) == (3 * 40 + 11, 11)


def test_errors_are_told_by_their_size_and_what_was_not_told_is_counted() -> None:
    assert quartiles(np.array([-0.02, 0.01, 0.03])) == "2.0 (1.5 to 2.5)"
    assert quartiles(np.array([0.02, np.nan])) == "2.0 (2.0 to 2.0, 1 none)"
    assert quartiles(np.array([np.nan])) == "never"


def test_tables_go_between_their_marks_alone() -> None:
    document = f"before\n{BEGIN}\nold\n{END}\nafter\n"
    assert with_tables(document, "new") == f"before\n{BEGIN}\n\nnew\n\n{END}\nafter\n"
    assert with_tables(with_tables(document, "new"), "newer").count("new") == 1
    with pytest.raises(ValueError, match="tables: end"):
        with_tables(f"{BEGIN} alone", "new")


def test_who_asks_for_what_there_is_not_gets_to_know_what_there_is() -> None:
    with pytest.raises(ValueError, match=r"certainty, all, .*'certain'"):
        settings_of("certain", STEEP, STEADY, CELL_M)
    with pytest.raises(ValueError, match=r"box, cylinder, post, is 'ball'"):
        scenes.thing("ball", SEED)


def test_limits_of_a_walking_body_are_as_wide_as_its_errors() -> None:
    rail, walk = (
        settings_of("certainty, all", STEEP, gait, CELL_M).certainty for gait in (STEADY, WALKING)
    )
    assert rail is not None
    assert walk is not None
    assert (rail.pitch_degps, rail.lift_mps) == (4.0, 0.05)
    assert walk.pitch_degps == pytest.approx(3 * math.sqrt(2) * 0.5 / 0.1)
    assert walk.lift_mps > 3 * math.sqrt(2) * 0.003 / 0.1
    assert rail.cas_height_m == pytest.approx(0.03)
    assert all(settings_of(name, STEEP, STEADY, CELL_M).map.cell_m == CELL_M for name in NAMES)


def test_what_is_told_of_the_pose_has_the_errors_that_were_asked_for() -> None:
    gait = Gait(place_m=0.003, angle_rad=math.radians(0.5))
    ride = Ride(Urg(scenes.scene("floor"), STEEP, SEED), (0.0, 3.0), gait, SEED)
    places, angles = [], []
    for k, scan in enumerate(ride.scans()):
        assert isinstance(scan, Scan)
        places.append(np.array(ride.track.place_at(scan.t_s)[:3]) - (0.01 * k, 0.0, 0.0))
        angles.append(ride.attitudes.rpy_at(scan.t_s))
    assert len(places) == 301
    assert np.std(places, axis=0) == pytest.approx(3 * [0.003], rel=0.15)
    assert np.degrees(np.std(angles, axis=0)) == pytest.approx(3 * [0.5], rel=0.15)


def test_a_scanner_tells_heights_to_a_few_percent_and_the_shadow_filter_mends_widths() -> None:
    off = sizes_off(SEED, STEEP, SOME)
    for name in SOME:
        assert np.abs(off[name][2:]).max() < 0.06, name
    for plain, mended in (SOME[:2], SOME[2:]):
        assert (np.abs(off[mended][:2]) <= np.abs(off[plain][:2]) + 1e-9).all()
    again = sizes_off(SEED, STEEP, SOME[1:2])  # alone, and the same
    np.testing.assert_array_equal(again[SOME[1]], off[SOME[1]])


def test_all_steps_leave_fewer_artefacts_of_a_post_of_10_mm_and_may_take_out_the_post() -> None:
    seen = thing_seen("post", SEED, SOME)
    assert [seen[name].is_there for name in SOME] == [True, False, True, True]
    for plain, mended in (SOME[:2], SOME[2:]):
        assert seen[mended].figures.too_high < seen[plain].figures.too_high
    assert seen["surface"].figures.rms_m < 0.01


@pytest.mark.slow
def test_a_walking_body_makes_a_worse_map_of_rocks_than_a_cart() -> None:
    steady, walking = (rocks_mapped(SEED, walk, SOME) for walk in ("steady", "walking"))
    for name in SOME:
        assert walking[name].figures.rms_m > steady[name].figures.rms_m
        assert walking[name].figures.unknown > steady[name].figures.unknown


@pytest.mark.slow
def test_the_stripe_tells_the_boxes_too() -> None:
    off = sizes_off(SEED, STRIPE, BY_STRIPE)["surface"]
    assert np.abs(off).max() < 0.2


@pytest.mark.slow
def test_the_short_form_prints_all_tables(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--quick", "--jobs", "1"]) == 0
    told = capsys.readouterr().out
    for words in ("Sizes of two boxes", "| post | reference_plane |", "| walking | surface |"):
        assert words in told
