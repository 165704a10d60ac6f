"""The correction of ranges from readings with a known one, and the tables that they come from."""

import doctest
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.records import F64
from tests.support.cases import examples
from tools.calibration import range_picture, ranges
from tools.calibration.range_readings import ReadingsError, targets_in
from tools.calibration.ranges import NoFitError, RangeFit, Target, fit, powers_of, target_of

TRULY = np.array([-0.012, 0.006, -0.004, 0.0007])  # to be added to a reading
AT_M = (0.4, 0.8, 1.3, 1.9, 2.6, 3.3, 4.1)
PLACED_M = 0.001


def read_for(true_m: float, correction: F64 = TRULY) -> float:
    """What is read where that correction would be right."""
    read_m = true_m
    for _ in range(50):
        read_m = true_m - float(powers_of(np.array([read_m]), 4)[0] @ correction)
    return read_m


def targets_of(
    at_m: tuple[float, ...] = AT_M, noise_m: float = 0.0, seed: int = 1, scans: int = 50
) -> list[Target]:
    random = np.random.default_rng(seed)
    return [
        target_of(true_m, read_for(true_m) + noise_m * random.standard_normal(scans))
        for true_m in at_m
    ]


def shifted(targets: list[Target], which: int, by_m: float) -> list[Target]:
    old = targets[which]
    moved = Target(old.true_m, old.read_m + by_m, old.spread_m, old.scans)
    return [*targets[:which], moved, *targets[which + 1 :]]


def added_m(found: RangeFit, ranges_m: F64) -> F64:
    return np.asarray(powers_of(ranges_m, 4) @ found.correction)


def test_readings_without_noise_give_the_coefficients_back() -> None:
    found = fit(targets_of(), PLACED_M)
    np.testing.assert_allclose(found.correction, TRULY, atol=1e-9)
    assert (found.terms, found.wrong, found.tested) == (4, None, True)
    assert found.rms_m < 1e-9
    assert found.correction_m == pytest.approx((read_for(0.4), read_for(4.1)))


def test_noise_stays_within_the_errors_that_are_told() -> None:
    grid_m, off = np.linspace(0.45, 4.0, 30), []
    for seed in range(40):
        found = fit(targets_of(noise_m=0.01, seed=seed), PLACED_M)
        assert found.wrong is None
        off.append(np.abs(added_m(found, grid_m) - powers_of(grid_m, 4) @ TRULY).max())
        off[-1] /= found.worst_m
        assert (np.abs(found.correction - TRULY) < 6 * found.errors).all()
    assert np.median(off) < 2.0
    assert max(off) < 5.0


def test_what_is_read_with_less_noise_counts_for_more() -> None:
    """A line through three targets, of which the noisy one in the middle is off."""
    straight = [Target(1.0, 1.0, 0.0, 50), Target(2.0, 2.02, 0.5, 50), Target(3.0, 3.0, 0.0, 50)]
    found = fit(straight, PLACED_M)
    assert found.terms == 2
    assert np.abs(added_m(found, np.array([1.0, 2.0, 3.0]))).max() < 1e-4


@settings(max_examples=examples(40), deadline=None)
@given(
    which=st.integers(0, len(AT_M) - 1),
    by_m=st.sampled_from([-0.5, -0.1, 0.1, 1.0]),
    seed=st.integers(0, 1000),
)
def test_one_wrong_target_is_named_and_changes_nothing(which: int, by_m: float, seed: int) -> None:
    good = targets_of(noise_m=0.002, seed=seed)
    found = fit(shifted(good, which, by_m), PLACED_M)
    assert found.wrong == which
    without = fit([*good[:which], *good[which + 1 :]], PLACED_M)
    np.testing.assert_allclose(found.correction, without.correction, atol=1e-12)
    assert abs(found.off_m[which]) > 0.05
    assert found.rms_m < 0.003


def test_two_wrong_targets_are_refused() -> None:
    twice = shifted(shifted(targets_of((*AT_M, 5.0, 5.5)), 2, 0.3), 6, 0.1)
    with pytest.raises(NoFitError, match=r"1\.3 m and 4\.1 m both do not fit"):
        fit(twice, PLACED_M)


@pytest.mark.parametrize(("count", "terms"), [(2, 1), (3, 2), (4, 2), (5, 3), (6, 4)])
def test_few_targets_make_a_lower_order(count: int, terms: int) -> None:
    found = fit(targets_of(AT_M[:count]), 0.02)
    assert found.terms == terms
    assert (found.correction[terms:] == 0.0).all()
    assert (found.errors[:terms] > 0.0).all()
    assert found.tested == (count >= 4)


def test_too_few_or_too_near_targets_are_refused() -> None:
    with pytest.raises(NoFitError, match="targets at two distances are the least, 1 given"):
        fit(targets_of((1.0,)), PLACED_M)
    near = [Target(1.0 + 0.001 * k, 1.0, 0.0, 9) for k in range(6)]
    with pytest.raises(NoFitError, match="too near to each other"):
        fit(near, PLACED_M)


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "board.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_rows_of_one_distance_are_scans_of_one_target(tmp_path: Path) -> None:
    rows = "\ufeffread_m, note, true_m\n1.01,x,1\n2.02,,2.0\n1.03,,1.0\n1.02,,1.00\n3.01,,3\n"
    first, *others = targets_in(table(tmp_path, rows))
    assert (first.true_m, first.read_m, first.scans) == (1.0, 1.02, 3)
    assert first.spread_m == pytest.approx(0.0148, abs=1e-4)
    assert [(t.read_m, t.spread_m) for t in others] == [
        (2.02, first.spread_m),
        (3.01, first.spread_m),
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "must begin with a line that names true_m and read_m"),
        ("true_m;read_m\n1;1\n", "must begin with a line"),
        ("true_m,read_m,read_m\n1,1,2\n", "names true_m and read_m once"),
        ("true_m,read_m\n1,1.0\n2,\n", r"line 3: read_m must be metres above 0 to 100, is ''"),
        ("true_m,read_m\n1\n", r"line 2: read_m must be .* is None"),
        ("true_m,read_m\n-1,1\n", r"line 2: true_m must be .* is '-1'"),
        ("true_m,read_m\n1,nan\n", r"line 2: read_m must be"),
        ("true_m,read_m\n1000,1001\n", r"line 2: true_m must be"),
        ("true_m,read_m\n1,5,1,513\n", "line 2: has more columns than"),  # commas for points
    ],
)
def test_a_table_that_is_none_is_refused_with_the_line(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(ReadingsError, match=words):
        targets_in(table(tmp_path, text))


def test_the_examples_in_the_texts_are_true() -> None:
    assert doctest.testmod(ranges).failed == 0
    assert doctest.testmod(range_picture).failed == 0
