"""Where a laser's plane lies to its camera, from pictures of its line on boards at known distances.

A board stands square to the camera's axis, so far ahead of its centre. With s, the slope of the
line's place across the image, and X, that distance, geometry.py has s = tan(beta) - b / X: straight
in the two that are sought. A board that is turned aside a little, or a laser that is rolled, makes
s change along the line; its value at the axis is taken, which stays as it is. A board that leans
forward or back is not allowed for.

Least squares, each board weighted by how well its line and its distance are known; covariance from
there, larger where the boards contradict each other more than that.
"""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.records import F64
from hw.device import BadFrame
from hw.stripe.detect import Stripe
from hw.stripe.geometry import slopes_from_pixel
from hw.stripe.images import MISSING, Decoder
from hw.stripe.options import LEAST_BASELINE_M, StripeOptions
from hw.stripe.sweep import SweepMaker

FILE, TRUE = "file", "true_m"
LEAST_BOARDS, LEAST_RATIO = 3, 1.3  # of distances; of the farthest to the nearest
LEAST_COLUMNS = 50  # with a line, of a picture
OUTLIER_SIGMAS, ROUNDS = 3.0, 3
BASELINE_SIGMAS = 3.0  # that a baseline has at least, or chance alone may have made it
MOST_CHI2 = 1000.0  # of what is expected: one distance that is 5 cm off makes 600
LEAST_PX = 0.05  # error of the line's place that many columns share
SPREAD_SHARE = 1.4826  # standard deviation of noise whose middle half lies within +-1 / this


class PicturesError(Exception):
    """The pictures can't be used, or do not tell the plane; says why."""


@dataclass(frozen=True, slots=True)
class Board:
    """What the pictures of one distance tell."""

    true_m: float
    slope: float  # of the line's place at the axis
    error: float  # of that, 1 sigma
    columns: int  # with a line


@dataclass(frozen=True, slots=True, eq=False)
class PlaneFit:
    """A plane, and how well it is known."""

    boards: tuple[Board, ...]
    baseline_m: float
    beta_rad: float
    covariance: F64  # (2, 2) of these
    off_m: F64  # (n,) by which each board then seems too far
    chi2_share: float  # of what is expected of their contradictions; 1: as expected

    @property
    def correlation(self) -> float:
        return float(self.covariance[0, 1] / math.sqrt(np.prod(np.diag(self.covariance))))


def boards_in(path: Path, options: StripeOptions) -> list[Board]:
    """One for each distance of a table with columns file and true_m, the nearest first.

    Raises:
        PicturesError: the table or a picture can't be used.
        OSError: a file is not there.
    """
    w, h = options.image_px
    decoder, maker = Decoder((w, h)), SweepMaker(options)
    if decoder.is_missing:
        raise PicturesError(MISSING)
    found: dict[float, list[Board]] = {}
    with path.open(encoding="utf-8-sig", newline="") as file:
        try:
            lines = file.read().splitlines()
        except UnicodeDecodeError as error:
            raise PicturesError(f"{path}: must be UTF-8 text: {error}") from None
        for name, true_m in _rows(path, lines):
            image = decoder.image((path.parent / name).read_bytes())
            if isinstance(image, BadFrame):
                raise PicturesError(f"{name}: {image.reason}")
            maker.sweep(image, 0.0, 0.0)
            assert maker.maybe_stripe is not None
            board = board_of(true_m, maker.maybe_stripe, options, name)
            found.setdefault(true_m, []).append(board)
    return [_mean(found[true_m]) for true_m in sorted(found)]


def _rows(path: Path, lines: Sequence[str]) -> list[tuple[str, float]]:
    reader = csv.DictReader(lines, skipinitialspace=True)
    try:
        names = list(reader.fieldnames or ())
        if names.count(FILE) != 1 or names.count(TRUE) != 1:
            raise PicturesError(f"{path}: needs the columns {FILE},{TRUE}, each once")
        return [_row(f"{path}: line {reader.line_num}", row) for row in reader]
    except csv.Error as error:
        raise PicturesError(f"{path}: line {reader.line_num + 1}: {error}") from None


def _row(where: str, row: dict[str | None, str]) -> tuple[str, float]:
    if None in row:  # such as 0,5 for 0.5, where the comma divides columns
        raise PicturesError(f"{where}: has more columns than the first line names")
    name = row[FILE]
    try:
        true_m = float(row[TRUE] or "")
    except ValueError:
        true_m = math.nan
    if not 0.05 <= true_m <= 30.0 or not name:
        given = f"{name!r} and {row[TRUE]!r}"
        raise PicturesError(f"{where}: needs a file, and {TRUE} from 0.05 to 30, is {given}")
    if "\0" in name:
        raise PicturesError(f"{where}: no file's name has the character NUL, as {name!r} has")
    return name, true_m


def board_of(true_m: float, stripe: Stripe, options: StripeOptions, name: str) -> Board:
    """Of one picture's line. Raises PicturesError: there is too little of it."""
    columns = np.flatnonzero(np.isfinite(stripe.peaks_px))
    if len(columns) < LEAST_COLUMNS:
        raise PicturesError(
            f"{name}: needs a line in {LEAST_COLUMNS} columns or more, has {len(columns)}"
        )
    is_level, lens = options.along == "columns", options.lens
    places = [(float(u), float(stripe.peaks_px[u])) for u in columns]
    slopes = np.array([slopes_from_pixel(lens, *(p if is_level else p[::-1])) for p in places])
    along, across = slopes.T if is_level else slopes.T[::-1]
    kept = np.ones(len(columns), dtype=bool)
    for _ in range(ROUNDS):
        bend, at_axis = np.polyfit(along[kept], across[kept], 1)
        off = across - (at_axis + bend * along)
        spread = SPREAD_SHARE * float(np.median(np.abs(off[kept])))
        kept = np.abs(off) <= max(OUTLIER_SIGMAS * spread, 1e-9)
    a = np.stack([np.ones(kept.sum()), along[kept]], axis=1)
    of_chance = spread * math.sqrt(float(np.linalg.inv(a.T @ a)[0, 0]))
    shared = LEAST_PX / options.focal_px[1 if is_level else 0]
    return Board(true_m, float(at_axis), math.hypot(of_chance, shared), len(columns))


def _mean(boards: Sequence[Board]) -> Board:
    """Of pictures of one distance; what they share does not get less."""
    slope = float(np.mean([board.slope for board in boards]))
    error = max(board.error for board in boards)
    return Board(boards[0].true_m, slope, error, sum(board.columns for board in boards))


def fit(boards: Sequence[Board], placed_m: float, near_baseline_m: float) -> PlaneFit:
    """The plane that explains the boards best.

    Args:
        placed_m: 1 sigma of their distances.
        near_baseline_m: about what it is, for the weights of a first round.

    Raises:
        PicturesError: too few, or all at nearly the same distance; or no plane can be so.
    """
    true_m = np.array([board.true_m for board in boards])
    if len(boards) < LEAST_BOARDS or true_m.max() < LEAST_RATIO * true_m.min():
        raise PicturesError(
            f"needs boards at {LEAST_BOARDS} distances or more, the farthest at least "
            f"{LEAST_RATIO:g} times as far as the nearest; given are "
            f"{', '.join(f'{x:g}' for x in true_m) or 'no'} m"
        )
    slopes = np.array([board.slope for board in boards])
    errors = np.array([board.error for board in boards])
    a, baseline_m = np.stack([-1.0 / true_m, np.ones(len(boards))], axis=1), near_baseline_m
    for _ in range(ROUNDS):
        weights = 1.0 / (errors**2 + (baseline_m / true_m**2 * placed_m) ** 2)
        covariance = np.linalg.inv(a.T @ (weights[:, None] * a))
        baseline_m, tangent = covariance @ (a.T @ (weights * slopes))
    chi2 = float(weights @ (slopes - a @ np.array([baseline_m, tangent])) ** 2)
    share = chi2 / (len(boards) - 2)
    if why := _fault_of(baseline_m, math.sqrt(covariance[0, 0]), share, near_baseline_m):
        raise PicturesError(why)
    by_tangent = np.diag([1.0, 1.0 / (1.0 + tangent**2)])  # d beta / d tan(beta)
    return PlaneFit(
        tuple(boards),
        float(baseline_m),
        math.atan(tangent),
        max(1.0, share) * by_tangent @ covariance @ by_tangent,
        baseline_m / (tangent - slopes) - true_m,
        share,
    )


def _fault_of(baseline_m: float, sigma_m: float, share: float, near_m: float) -> str:
    """Why a plane with that baseline can't be; "" if it can.

    Args:
        sigma_m: if the boards' errors explain what is left.
        share: of what is expected of that.
        near_m: what the baseline is about.
    """
    told_m, sigmas = abs(baseline_m), BASELINE_SIGMAS
    widened_m = sigma_m * math.sqrt(max(1.0, share))
    if told_m >= max(LEAST_BASELINE_M, sigmas * sigma_m) and baseline_m * near_m < 0.0:
        return (
            f"the boards tell a baseline of {baseline_m:.3f} m, which has the laser on the other "
            f"side than scanner.baseline_m = {near_m:g}: is each distance that of its picture?"
        )
    if told_m >= LEAST_BASELINE_M and share > MOST_CHI2:
        return (
            f"the boards contradict each other {share:.0f} times as much as their errors explain, "
            f"allowed are {MOST_CHI2:g} times: is each distance that of its picture?"
        )
    if told_m < max(LEAST_BASELINE_M, sigmas * widened_m):
        return (
            f"the boards tell a baseline of {told_m:.3f} m, 1 sigma {widened_m:.2g} m: it must be "
            f"{LEAST_BASELINE_M:g} m or more, and {sigmas:g} sigma or more: "
            "has each distance a picture of its own?"
        )
    return ""
