"""Rows as a table on disk, and summed up by settings."""

import csv
import io
import json
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools.sweep.rows import FAILED, Row, put
from tools.sweep.scores import SCORES, Score
from tools.sweep.space import Settings

NO_PARQUET = "rows.parquet needs the extra 'sweep' (pip install 'mapod[sweep]'): rows.csv instead"


@dataclass(frozen=True, slots=True)
class Line:
    """What became of one set of settings, over all drives."""

    settings: Settings
    values: dict[str, list[tuple[str, float]]]  # by score: drive and value

    @property
    def name(self) -> str:
        return name_of(self.settings)

    def mean(self, score: str) -> float:
        """NaN where no drive has it."""
        known = [value for _, value in self.values.get(score, [])]
        return statistics.fmean(known) if known else math.nan


def name_of(settings: Settings) -> str:
    parts = [f"{key.partition('.')[2]} {_text(value)}" for key, value in settings.items()]
    return ", ".join(parts) or "as recorded"


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def lines_of(table: Sequence[Row], all_settings: Sequence[Settings]) -> list[Line]:
    """In the order of the settings."""
    lines = []
    for settings in all_settings:
        mine = [row for row in table if all(row.get(k) == v for k, v in settings.items())]
        values: dict[str, list[tuple[str, float]]] = {}
        for row in mine:
            for score in SCORES:
                if row.get(score.name) is not None:
                    values.setdefault(score.name, []).append((row["drive"], row[score.name]))
        lines.append(Line(settings, values))
    return lines


def scores_in(lines: Sequence[Line]) -> list[Score]:
    return [score for score in SCORES if any(line.values.get(score.name) for line in lines)]


def best_of(lines: Sequence[Line], score: Score) -> list[Line]:
    """Those with the least mean; none where all are the same."""
    means = [line.mean(score.name) for line in lines]
    known = [mean for mean in means if not math.isnan(mean)]
    if not known or min(known) == max(known):
        return []
    return [line for line, mean in zip(lines, means, strict=True) if mean == min(known)]


def write_table(folder: Path, table: Sequence[Row]) -> str:
    """rows.parquet, or rows.csv and why. Raises OSError."""
    columns = list(dict.fromkeys(name for row in table for name in row))
    if FAILED not in columns:
        columns.append(FAILED)
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        put(folder / "rows.csv", _csv(columns, table).encode())
        return NO_PARQUET
    data = {name: _column([row.get(name) for row in table]) for name in columns}
    arrays = {name: pyarrow.array(values) for name, values in data.items()}
    if not data[FAILED] or not any(data[FAILED]):
        arrays[FAILED] = pyarrow.array(data[FAILED], pyarrow.string())
    out = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.table(arrays), out)
    put(folder / "rows.parquet", out.getvalue().to_pybytes())
    return ""


def _column(values: list[Any]) -> list[Any]:
    """Of one type: numbers, yes or no, or text."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float}:
        return values if kinds != {int, float} else [v if v is None else float(v) for v in values]
    if len(kinds) <= 1 and kinds <= {bool, str}:
        return values
    return [None if v is None else v if isinstance(v, str) else json.dumps(v) for v in values]


def _csv(columns: Sequence[str], table: Sequence[Row]) -> str:
    out = io.StringIO()
    rows = csv.DictWriter(out, columns)
    rows.writeheader()
    rows.writerows(table)
    return out.getvalue()
