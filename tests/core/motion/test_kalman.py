"""The filter's words, against matrices."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.motion.kalman import (
    Information,
    begin,
    clear,
    correct,
    fade,
    follow,
    join,
    note,
    spread,
)
from core.records import F64

SEEDS = st.integers(0, 1000)


def filter_of(seed: int, n: int = 5) -> tuple[np.random.Generator, F64, F64]:
    """Random numbers, a covariance and states."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(n, n))
    return random, root @ root.T + 0.1 * np.eye(n), random.normal(size=n)


@given(seed=SEEDS, told=st.integers(0, 8))
def test_what_many_tell_at_once_is_what_they_tell_one_by_one(seed: int, told: int) -> None:
    """Also where they are fewer than the states."""
    random, P, value = filter_of(seed)
    one_by_one, states = P.copy(), value.copy()
    information, Ph, times = Information.of(5), np.zeros(5), 0.5
    clear(information)
    for _ in range(told):
        h, measured, weight = random.normal(size=5), random.normal(), random.uniform(0.1, 9.0)
        note(information, h, measured, weight)
        innovation = float(measured - h @ states)
        correct(one_by_one, states, h, innovation, 1.0 / (times * weight), Ph)
    join(P, value, information, times)
    np.testing.assert_allclose(P, one_by_one, atol=1e-7)
    np.testing.assert_allclose(value, states, atol=1e-7)


@given(seed=SEEDS)
def test_states_go_on_fade_and_begin_anew_as_matrices_say(seed: int) -> None:
    random, P, value = filter_of(seed)
    F, Q, times, kept = np.eye(5), np.zeros((5, 5)), random.normal(), random.uniform()
    F[0, 1], F[2, 2], Q[2, 2] = times, kept, 0.3
    expected, states = F @ P @ F.T + Q, F @ value
    follow(P, value, 0, 1, times)
    fade(P, value, 2, kept, 0.3)
    np.testing.assert_allclose(P, expected, atol=1e-12)
    np.testing.assert_allclose(value, states)
    h = random.normal(size=5)
    assert np.isclose(spread(h, P), h @ P @ h)
    begin(P, 1, 7.0)
    assert P[1].tolist() == P[:, 1].tolist() == [0.0, 7.0, 0.0, 0.0, 0.0]
