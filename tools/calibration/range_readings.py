"""Readings of targets at known distances, from a table that somebody has kept."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from tools.calibration.ranges import Target, target_of

TRUE, READ = "true_m", "read_m"
MOST_M = 100.0


class ReadingsError(Exception):
    """The table can't be used; the text says where and why."""


def targets_in(path: Path) -> list[Target]:
    """One for each distance of the table, the nearest first.

    Rows of the same distance are scans of one target. A target that was read once is taken for as
    noisy as the others are in the middle.

    Raises:
        ReadingsError: what is wrong with the table.
        OSError: there is no such file.
    """
    reads: dict[float, list[float]] = {}
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            for true_m, read_m in _rows(path, csv.DictReader(file, skipinitialspace=True)):
                reads.setdefault(true_m, []).append(read_m)
    except (UnicodeDecodeError, csv.Error) as error:
        raise ReadingsError(f"{path}: {error}") from None
    targets = [target_of(true_m, reads[true_m]) for true_m in sorted(reads)]
    spreads_m = [target.spread_m for target in targets if target.scans > 1]
    usual_m = float(np.median(spreads_m)) if spreads_m else 0.0
    return [replace(t, spread_m=usual_m) if t.scans == 1 else t for t in targets]


def _rows(path: Path, table: "csv.DictReader[str]") -> list[tuple[float, float]]:
    names = list(table.fieldnames or ())
    if names.count(TRUE) != 1 or names.count(READ) != 1:
        raise ReadingsError(f"{path}: must begin with a line that names {TRUE} and {READ} once")
    return [(_length_m(path, table, TRUE, row), _length_m(path, table, READ, row)) for row in table]


def _length_m(
    path: Path, table: "csv.DictReader[str]", name: str, row: dict[str | None, str]
) -> float:
    where = f"{path}, line {table.line_num}"
    if None in row:  # such as 1,5 for 1.5, where the comma divides columns
        raise ReadingsError(f"{where}: has more columns than the first line names")
    try:
        length_m = float(row[name] or "")
    except ValueError:
        length_m = math.nan
    if not 0.0 < length_m <= MOST_M:
        raise ReadingsError(
            f"{where}: {name} must be metres above 0 to {MOST_M:g}, is {row[name]!r}"
        )
    return length_m
