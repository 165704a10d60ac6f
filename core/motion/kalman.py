"""What a Kalman filter does with time, and with one scalar measurement after another.

For any number of states, `value` (n,), with the covariance P (n, n).

Information M, y of many measurements, of which each says y = M value, is made into such ones:
M = C C' by Cholesky, and each column c of C is a measurement of its own, v = c value, of variance
1, where C v = y. So states of which nothing is said need no special case.
"""

import math
from typing import NamedTuple

import numpy as np

from core.records import F64
from jit import kernel


class Information(NamedTuple):
    """What many measurements tell of n states, and room to take it in."""

    M: F64  # (n, n), and (n,) of what
    y: F64
    C: F64  # (n, n) its root, and (n,) what that tells
    v: F64
    Ph: F64  # (n,)

    @classmethod
    def of(cls, n: int) -> "Information":
        return cls(np.zeros((n, n)), np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros(n))


@kernel
def spread(h: F64, P: F64) -> float:
    """h P h': variance of what h (n,) tells of the states."""
    total = 0.0
    for i in range(h.size):
        if h[i] != 0.0:
            for k in range(h.size):
                total += h[i] * P[i, k] * h[k]
    return total


@kernel
def follow(P: F64, value: F64, one: int, other: int, times: float) -> None:
    """A state goes on by so many times another one."""
    value[one] += value[other] * times
    for k in range(value.size):
        P[one, k] += times * P[other, k]
    for k in range(value.size):
        P[k, one] += times * P[k, other]


@kernel
def fade(P: F64, value: F64, one: int, kept: float, variance: float) -> None:
    """A share of a state is kept; it wanders by so much."""
    value[one] *= kept
    for k in range(value.size):
        P[one, k] *= kept
    for k in range(value.size):
        P[k, one] *= kept
    P[one, one] += variance


@kernel
def begin(P: F64, one: int, variance: float) -> None:
    """Begin a state anew that has to do with no other one."""
    for k in range(P.shape[0]):
        P[one, k] = P[k, one] = 0.0
    P[one, one] = variance


@kernel
def correct(P: F64, value: F64, h: F64, innovation: float, variance: float, Ph: F64) -> None:
    """One scalar measurement: innovation, measured minus expected, = h (n,) . error + noise.

    The variance of the noise must be positive. Ph (n,): room to work in.
    """
    total = variance
    for i in range(h.size):
        Ph[i] = 0.0
        for k in range(h.size):
            Ph[i] += P[i, k] * h[k]
        total += h[i] * Ph[i]
    for i in range(h.size):
        value[i] += Ph[i] / total * innovation
        for k in range(h.size):
            P[i, k] -= Ph[i] * Ph[k] / total


@kernel
def clear(told: Information) -> None:
    """Nothing is told."""
    told.M[:] = 0.0
    told.y[:] = 0.0


@kernel
def note(told: Information, h: F64, value: float, weight: float) -> None:
    """A measurement, of the variance 1 / weight: h (n,) times the states."""
    for i in range(h.size):
        told.y[i] += weight * h[i] * value
        for k in range(h.size):
            told.M[i, k] += weight * h[i] * h[k]


@kernel
def join(P: F64, value: F64, told: Information, times: float) -> None:
    """Take in so many times what is told."""
    M, y, C, v = told.M, told.y, told.C, told.v
    C[:] = 0.0
    v[:] = 0.0
    for i in range(y.size):
        y[i] *= times
        for k in range(y.size):
            M[i, k] *= times
    for k in range(y.size):
        left, rest = M[k, k], y[k]
        for m in range(k):
            left, rest = left - C[k, m] * C[k, m], rest - C[k, m] * v[m]
        if left <= 1e-12 * M[k, k]:
            continue  # nothing is said of this state that was not said of those before
        C[k, k] = math.sqrt(left)
        v[k] = rest / C[k, k]
        for i in range(k + 1, y.size):
            C[i, k] = M[i, k]
            for m in range(k):
                C[i, k] -= C[i, m] * C[k, m]
            C[i, k] /= C[k, k]
    for k in range(y.size):
        off = v[k]
        for i in range(k, y.size):
            off -= C[i, k] * value[i]
        correct(P, value, C[:, k], off, 1.0, told.Ph)
