"""The tracker's parts against slow and obvious models."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.objects.vector_map.tracker import Kalman, Tracker, assignment
from tools.experiments.object_world import SETTINGS

SIZES = st.tuples(st.integers(1, 5), st.integers(1, 5))


@given(SIZES.flatmap(lambda size: arrays(np.float64, size, elements=st.integers(0, 50))))
def test_no_other_assignment_costs_less(cost: np.ndarray) -> None:
    pairs = assignment(cost)
    small = cost if cost.shape[0] <= cost.shape[1] else cost.T
    rows = range(small.shape[0])
    least = min(
        sum(small[row, column] for row, column in zip(rows, way, strict=True))
        for way in permutations(range(small.shape[1]), small.shape[0])
    )
    assert sum(cost[pair] for pair in pairs) == least
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(rows)


def test_the_filter_finds_a_constant_velocity_and_knows_how_well() -> None:
    random, errors, sigmas = np.random.default_rng(1), [], []
    for _ in range(200):
        kalman = Kalman(0.0, random.normal(0.0, SETTINGS.track_sigma_m, 2), SETTINGS)
        for k in range(1, 30):
            kalman.predict(0.1 * k)
            truth = np.array([0.1 * k * 1.2, -0.1 * k * 0.5])
            kalman.correct(truth + random.normal(0.0, SETTINGS.track_sigma_m, 2))
        errors.append(kalman.x[2:] - [1.2, -0.5])
        sigmas.append(kalman.speed_sigma_mps)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.03
    assert np.std(errors) < np.mean(sigmas)  # it allows for changes that there were none of


def test_two_that_cross_keep_their_ids() -> None:
    tracker = Tracker[str](SETTINGS)
    for k in range(30):
        t = 0.1 * k
        places = [np.array([t - 1.5, 0.12]), np.array([1.5 - t, -0.12])]
        found = tracker.assign(t, places)
        for place, track, name in zip(places, found, "ab", strict=True):
            if track is None:
                tracker.start(t, place, name)
            else:
                assert track.about == name
                tracker.follow(track, t, place)
    assert [track.id for track in tracker.tracks] == [1, 2]


def test_what_is_out_of_reach_is_another_thing() -> None:
    tracker = Tracker[None](SETTINGS)
    tracker.start(0.0, np.zeros(2), None)
    assert tracker.assign(0.1, [np.array([3.0, 0.0])]) == [None]
    assert tracker.assign(0.1, []) == []
    assert assignment(np.zeros((0, 3))) == []
    assert len(list(tracker.unseen(0.1))) == 1


def test_time_that_does_not_pass_changes_nothing() -> None:
    kalman = Kalman(1.0, np.zeros(2), SETTINGS)
    before = kalman.P.copy()
    kalman.predict(0.5)
    assert kalman.at_s == 1.0
    assert pytest.approx(before) == kalman.P
