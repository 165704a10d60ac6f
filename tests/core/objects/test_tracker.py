"""The tracker's parts against slow and obvious models."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.objects.vector_map.tracker import Kalman, Measured, Tracker, assignment
from tools.experiments.object_world import SETTINGS

EXACT = np.zeros(2)
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
            kalman.correct(truth + random.normal(0.0, SETTINGS.track_sigma_m, 2), EXACT)
        errors.append(kalman.x[2:] - [1.2, -0.5])
        sigmas.append(kalman.speed_sigma_mps)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.03
    assert np.std(errors) < np.mean(sigmas)  # it allows for changes that there were none of


def seen(x_m: float, y_m: float, wide_m: float = 0.4) -> Measured:
    """The box of a hull that is 0.4 m long."""
    return Measured(np.array([x_m, y_m]), np.array([0.4, wide_m]))


def test_two_that_cross_keep_their_ids() -> None:
    tracker = Tracker[str](SETTINGS)
    for k in range(30):
        t = 0.1 * k
        boxes = [seen(t - 1.5, 0.12), seen(1.5 - t, -0.12)]
        tracker.predict(t)
        found = tracker.assign(boxes)
        for box, track, name in zip(boxes, found, "ab", strict=True):
            if track is None:
                tracker.start(t, box, name)
            else:
                assert track.about == name
                tracker.follow(track, t, box)
    assert [track.id for track in tracker.tracks] == [1, 2]


def test_what_is_seen_in_part_keeps_its_track_and_gets_no_velocity_by_it() -> None:
    tracker = Tracker[None](SETTINGS)
    whole, part = seen(2.0, 0.0, 0.9), seen(2.0, 0.4, 0.1)  # that part of it alone
    track = tracker.start(0.0, whole, None)
    for k in range(1, 20):
        now = part if k % 5 == 4 else whole
        tracker.predict(0.1 * k)
        assert tracker.assign([now]) == [track]
        tracker.follow(track, 0.1 * k, now)
        assert np.abs(track.filter.x[2:]).max() < 0.1
    tracker.predict(2.0)
    assert tracker.assign([seen(2.0, 0.9, 0.1)]) == [None]  # beside it: that is no part of it


def test_what_is_out_of_reach_is_another_thing_and_who_may_be_anywhere_is_nobody() -> None:
    tracker = Tracker[None](SETTINGS)
    track = tracker.start(0.0, seen(0.0, 0.0), None)
    tracker.predict(0.1)
    assert tracker.assign([seen(3.0, 0.0)]) == [None]
    assert tracker.assign([seen(0.2, 0.0)]) == [track]
    assert tracker.assign([]) == []
    assert assignment(np.zeros((0, 3))) == []
    assert len(list(tracker.unseen(0.1))) == 1
    tracker.predict(1.0)  # seen once, a second ago: it may have gone anywhere
    assert tracker.assign([seen(0.2, 0.0)]) == [None]


def test_time_that_does_not_pass_changes_nothing() -> None:
    kalman = Kalman(1.0, np.zeros(2), SETTINGS)
    before = kalman.P.copy()
    kalman.predict(0.5)
    assert kalman.at_s == 1.0
    assert pytest.approx(before) == kalman.P
