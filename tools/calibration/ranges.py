"""By how much a scanner's ranges are off, as a polynomial, from targets at known distances.

What is to be added to a range r in m is a + b r + c r^2 + d r^3. It is fitted by least squares,
each target weighted by how well its reading is known, with fewer terms where there are few targets.
One target that the others contradict is left out and named: a slip of the tape, or a wrong surface.
It refuses where two do not fit. Beyond the targets nothing is known, and nothing is extrapolated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.records import F64

TERMS, TARGETS_OF_TERMS = 4, ((6, 4), (5, 3), (3, 2), (2, 1))  # at least so many targets: terms
MEDIAN_SHARE = 1.2533  # error of a median, times that of a mean
SPREAD_SHARE = 1.4826  # standard deviation of noise whose middle half lies within +-1 / this
WRONG_SIGMAS = 5.0  # off what the other targets foretell


class NoFitError(Exception):
    """No correction can be told; the text says why."""


@dataclass(frozen=True, slots=True)
class Target:
    """A target, and what was read of it without any correction."""

    true_m: float
    read_m: float  # median of the scans
    spread_m: float  # of one scan, 1 sigma; 0 where it was read once
    scans: int

    def error_m(self, placed_m: float) -> float:
        """Of the reading against the distance, 1 sigma; placed_m: of the distance itself."""
        return float(np.hypot(MEDIAN_SHARE * self.spread_m / self.scans**0.5, placed_m))


@dataclass(frozen=True, slots=True, eq=False)
class RangeFit:
    """A correction, and how well it fits the targets."""

    targets: tuple[Target, ...]
    terms: int  # of `correction` that were fitted, from the first on
    correction: F64  # (4,) added to a range r in m: a + b r + c r^2 + d r^3
    errors: F64  # (4,) of it, 1 sigma; 0 where a term was not fitted
    correction_m: tuple[float, float]  # the nearest and farthest reading it was fitted to
    off_m: F64  # (n,) by which the corrected reading of each target is still too far
    wrong: int | None  # the target that was left out
    tested: bool  # there were enough to notice a wrong one
    worst_m: float  # error of the correction where it is least known within `correction_m`, 1 sigma

    @property
    def rms_m(self) -> float:
        """Of what is still off, without the target that was left out."""
        return rms_of(self.off_m, self.wrong)


def rms_of(off_m: F64, wrong: int | None) -> float:
    kept = np.arange(off_m.size) != (-1 if wrong is None else wrong)
    return float(np.sqrt(np.mean(off_m[kept] ** 2)))


def target_of(true_m: float, reads_m: Sequence[float] | F64) -> Target:
    """From all scans of one target: their median, and a spread that a stray one does not move."""
    reads = np.asarray(reads_m, dtype=np.float64)
    read_m = float(np.median(reads))
    spread_m = SPREAD_SHARE * float(np.median(np.abs(reads - read_m)))
    return Target(true_m, read_m, spread_m, reads.size)


def terms_for(targets: int) -> int:
    """How many terms so many targets carry.

    >>> [terms_for(n) for n in (2, 3, 4, 5, 6, 20)]
    [1, 2, 2, 3, 4, 4]

    Raises:
        NoFitError: none.
    """
    for least, terms in TARGETS_OF_TERMS:
        if targets >= least:
            return terms
    raise NoFitError(f"targets at two distances are the least, {targets} given; six are better")


def powers_of(ranges_m: F64, terms: int) -> F64:
    """(n, terms): 1, r, r^2, ..."""
    return np.vander(ranges_m, terms, increasing=True)


@dataclass(frozen=True, slots=True, eq=False)
class _Weighted:
    """Least squares over some targets."""

    values: F64  # (terms,)
    covariance: F64  # (terms, terms), by the errors that the readings ought to have
    grown: float  # how much larger than these the residuals are, 1 or more

    @classmethod
    def of(cls, powers: F64, missing_m: F64, errors_m: F64) -> "_Weighted":
        size = np.abs(powers).max(axis=0)  # columns of one size: r^3 may be large
        design = powers / size / errors_m[:, None]
        values, _, rank, _ = np.linalg.lstsq(design, missing_m / errors_m, rcond=None)
        if rank < powers.shape[1]:
            raise NoFitError("the targets lie too near to each other")
        left, free = design @ values - missing_m / errors_m, len(errors_m) - rank
        grown = float(np.sqrt(left @ left / free)) if free > 0 else 1.0
        covariance = np.linalg.inv(design.T @ design) / np.outer(size, size)
        return cls(values / size, covariance, max(1.0, grown))

    def error_m(self, powers: F64) -> F64:
        """(n,) of what it foretells, 1 sigma."""
        of_rows = np.einsum("ni,ij,nj->n", powers, self.covariance, powers)
        return np.asarray(self.grown * np.sqrt(of_rows))


def _off_sigmas(powers: F64, missing_m: F64, errors_m: F64) -> F64:
    """(n,) how far each target is off what all others foretell of it, in their sigmas."""
    found = np.zeros(len(errors_m))
    for k in range(len(errors_m)):
        rest = np.arange(len(errors_m)) != k
        others = _Weighted.of(powers[rest], missing_m[rest], errors_m[rest])
        one = powers[k : k + 1]
        sigma_m = np.hypot(others.error_m(one)[0], others.grown * errors_m[k])
        found[k] = abs(one[0] @ others.values - missing_m[k]) / sigma_m
    return found


def fit(targets: Sequence[Target], placed_m: float) -> RangeFit:
    """The correction that the targets tell.

    Args:
        targets: each distance once.
        placed_m: how well the distances are known, 1 sigma.

    Raises:
        NoFitError: too few of them, or two that do not fit.
    """
    read_m = np.array([target.read_m for target in targets])
    missing_m = np.array([target.true_m for target in targets]) - read_m
    errors_m = np.array([target.error_m(placed_m) for target in targets])
    terms, wrong = terms_for(len(targets)), None
    tested = len(targets) - 1 > terms
    kept: npt.NDArray[np.bool_] = np.ones(len(targets), dtype=np.bool_)
    if tested:
        sigmas = _off_sigmas(powers_of(read_m, terms), missing_m, errors_m)
        if sigmas.max() > WRONG_SIGMAS:
            wrong = int(sigmas.argmax())
            kept[wrong] = False
            _check_others(targets, kept, missing_m, errors_m)
            terms = terms_for(len(targets) - 1)
    found = _Weighted.of(powers_of(read_m[kept], terms), missing_m[kept], errors_m[kept])
    correction, errors = np.zeros(TERMS), np.zeros(TERMS)
    correction[:terms] = found.values
    errors[:terms] = found.grown * np.sqrt(np.diag(found.covariance))
    span_m = float(read_m[kept].min()), float(read_m[kept].max())
    within = powers_of(np.linspace(*span_m, 50), terms)
    r = np.clip(read_m, *span_m)
    return RangeFit(
        targets=tuple(targets),
        terms=terms,
        correction=correction,
        errors=errors,
        correction_m=span_m,
        off_m=powers_of(r, TERMS) @ correction - missing_m,
        wrong=wrong,
        tested=tested,
        worst_m=float(found.error_m(within).max()),
    )


def _check_others(
    targets: Sequence[Target], kept: npt.NDArray[np.bool_], missing_m: F64, errors_m: F64
) -> None:
    """Raises NoFitError if another one is wrong, too."""
    at, read_m = np.nonzero(kept)[0], np.array([target.read_m for target in targets])
    terms = terms_for(len(at))
    if len(at) - 1 <= terms:
        return
    sigmas = _off_sigmas(powers_of(read_m[at], terms), missing_m[at], errors_m[at])
    if sigmas.max() > WRONG_SIGMAS:
        pair = sorted(targets[k].true_m for k in (*np.nonzero(~kept)[0], at[sigmas.argmax()]))
        raise NoFitError(
            f"the targets at {pair[0]:g} m and {pair[1]:g} m both do not fit the others: measure "
            "them anew, and look whether the nearest surface straight ahead is the target"
        )
