"""The optical model of the fake URG-04LX: noise, edges and codes, against the known truth."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.urg04lx.models import MODELS
from fakes.urg04lx.optics import WHITE, Measured, Optics

F64 = npt.NDArray[np.float64]
URG = MODELS["URG-04LX"]
N = URG.amax - URG.amin + 1
STEP_RAD = 2 * np.pi / 1024


def measured(
    true_m: F64, seed: int = 1, noise: float = 1.0, remissions: F64 | float = WHITE
) -> Measured:
    random = np.random.default_rng(seed)
    return Optics(URG, seed).measured(true_m, random, noise, remissions=remissions)


def flat(range_m: float) -> F64:
    return np.full(N, range_m)


@pytest.mark.parametrize(("range_m", "sigma_mm"), [(0.3, 3.0), (0.9, 3.0), (2.0, 6.0), (4.0, 12.0)])
def test_noise_is_3_mm_near_and_0_3_percent_far(range_m: float, sigma_mm: float) -> None:
    told = np.concatenate([measured(flat(range_m), seed).values for seed in range(10)])
    assert told.mean() == pytest.approx(1000 * range_m, abs=0.5)
    assert told.std() == pytest.approx(sigma_mm, rel=0.06)


def test_a_surface_that_is_looked_along_is_noisier_and_has_no_edges() -> None:
    angles_rad = np.radians(np.arange(60.0, 80.0, 360 / 1024))
    true_m = 0.5 / np.cos(angles_rad)  # a wall 0.5 m aside
    told = np.array([measured(true_m, seed).values for seed in range(300)])
    assert not measured(true_m).mixed.any()
    spread_mm = told.std(0)
    assert spread_mm[:5].mean() < 4.5
    assert spread_mm[-5:].mean() > 3 * spread_mm[:5].mean()


@pytest.mark.parametrize(
    ("true_m", "code"),
    [
        (np.nan, 1),
        (np.inf, 1),
        (5.7, 0),
        (8.5, 0),
        (10.0, 2),
        (20.0, 1),
        (-np.inf, 18),
        (0.0, 19),
        (0.01, 19),
    ],
)
def test_what_is_no_range_is_a_code(true_m: float, code: int) -> None:
    assert set(measured(flat(true_m)).values.tolist()) == {code}


def test_what_is_dark_seems_farther_away_and_is_lost_sooner() -> None:
    remissions = np.repeat([0.9, 0.45, 0.05], [N - 400, 200, 200])
    told = measured(flat(1.0), noise=0.0, remissions=remissions).values
    assert np.unique(told, return_counts=True)[0].tolist() == [1000, 1010, 1019]
    assert set(measured(flat(2.5), remissions=0.05).values.tolist()) == {2}
    assert set(measured(flat(3.5), remissions=0.05).values.tolist()) == {1}
    assert not measured(flat(3.5), remissions=remissions).mixed.any()


def test_a_wall_that_is_looked_along_returns_too_little_light_at_its_end() -> None:
    bearings_rad = (np.arange(N) - (URG.afrt - URG.amin)) * STEP_RAD
    wall_m = np.where(np.abs(bearings_rad) < 1.5, 1.0 / np.cos(bearings_rad), np.nan)
    told = measured(wall_m, noise=0.0).values[N // 2 :]
    codes = told[told < 20].tolist()
    assert codes == sorted(codes, reverse=True)  # darker and darker
    assert set(codes) == {1, 2}
    assert told[300:].max() < 20


def test_some_of_what_is_near_and_square_to_the_beam_is_too_strong() -> None:
    assert (measured(flat(0.06)).values == 18).mean() == pytest.approx(0.2, abs=0.05)
    assert not (measured(flat(0.06), noise=0.0).values == 18).any()


def scenes() -> list[F64]:
    """Boxes before walls."""
    random = np.random.default_rng(5)
    made = []
    for _ in range(60):
        true_m = flat(random.uniform(2.0, 5.0))
        for _ in range(10):
            begin = random.integers(5, N - 45)
            true_m[begin : begin + random.integers(5, 40)] = random.uniform(0.5, 4.5)
        made.append(true_m)
    return made


def test_edges_make_mixed_pixels_between_behind_and_before_two_surfaces_and_codes() -> None:
    found = dict.fromkeys(("between", "behind", "before", "7", "8"), 0)
    mixed_beams = 0
    for seed, true_m in enumerate(scenes()):
        told = measured(true_m, seed)
        jumps = np.abs(np.diff(true_m)) > 0
        beside = np.append(jumps, False) | np.append(False, jumps)
        assert not (told.mixed & ~beside).any()
        twice = np.append(jumps[:-1] & jumps[1:], [False, False])
        alone = ~told.mixed & ~np.roll(twice, 1)  # what jumps twice may be steep
        assert np.abs(told.values[alone] - 1000 * true_m[alone]).max() < 5 * 15
        mixed_beams += told.mixed.sum()
        for k in np.flatnonzero(told.mixed):
            near_mm, far_mm = 1000 * true_m[k - 1 : k + 2].min(), 1000 * true_m[k - 1 : k + 2].max()
            value = told.values[k]
            found["between"] += near_mm + 60 < value < far_mm - 60
            found["behind"] += value > far_mm + 60
            found["before"] += 20 <= value < near_mm - 60
            found["7"] += value == 7
            found["8"] += value == 8
    shares = {name: count / mixed_beams for name, count in found.items()}
    assert 0.25 < shares["between"] < 0.7
    assert 0.01 < shares["behind"] < 0.2
    assert 0.03 < shares["before"] < 0.3
    assert 0.005 < shares["7"] < 0.1
    assert 0.02 < shares["8"] < 0.2


def test_an_edge_stays_where_it_is_and_thin_rays_meet_none() -> None:
    true_m = scenes()[0]
    optics, random = Optics(URG, 1), np.random.default_rng(1)
    told = [optics.measured(true_m, random, noise=0.0) for _ in range(20)]
    ranges = np.array([one.values for one in told])
    assert all((one.mixed == told[0].mixed).all() for one in told)
    is_range = (ranges >= 20).all(0)
    assert (np.ptp(ranges, axis=0)[is_range] == 0).all()
    thin = optics.measured(true_m, random, noise=0.0, mixes=False)
    assert not thin.mixed.any()
    assert (thin.values == np.rint(1000 * true_m)).all()


def test_a_post_one_beam_wide_is_mixed_and_a_jump_smaller_than_the_spot_is_not() -> None:
    post, kerb = flat(2.0), flat(2.0)
    post[300], kerb[300:] = 1.0, 1.99
    assert measured(post).mixed[300]
    assert not measured(kerb).mixed.any()


def test_a_scanner_that_times_pulses_mixes_between_only() -> None:
    model = MODELS["UTM-30LX"]
    for seed, true_m in enumerate(scenes()):
        told = Optics(model, seed).measured(true_m, np.random.default_rng(seed), noise=0.0)
        values = told.values[told.mixed & (told.values >= 20)]
        assert values.min() >= 1000 * true_m.min() - 1
        assert values.max() <= 1000 * true_m.max() + 1


ANY = st.floats() | st.floats(-0.1, 7.0) | st.sampled_from([0.0, 0.02, 5.6])


@given(st.lists(ANY, min_size=2, max_size=40), st.integers(0, 9))
def test_whatever_is_there_it_tells_ranges_or_codes(true_m: list[float], seed: int) -> None:
    told = measured(np.array(true_m), seed).values
    known = np.isin(told, (0, 1, 2, 7, 8, 18, 19)) | ((told >= 20) & (told <= 5600))
    assert known.all()
    assert (told == measured(np.array(true_m), seed).values).all()
