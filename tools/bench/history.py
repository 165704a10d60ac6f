"""The figures that were kept, one JSON object a line, and how far counts may grow beyond them.

A figure is a plain number under "setting.name". Counts and ratios compare between machines; times
do only on one.
"""

import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from tools.checkout import commit
from tools.cli.options import ROOT

FILE = ROOT / "docs" / "bench.jsonl"
COLUMNS = 3  # of a setting: new, kept, change
TOLD_CHANGE = 0.05  # smaller ones are not shown
Numbers = Mapping[str, float]  # by "setting.name"


@dataclass(frozen=True, slots=True)
class Bound:
    """How far a count may lie above the kept one: a share of it, and so many more."""

    share: float
    more: float


BOUNDS = {  # what is not here is told and never judged: times
    "calls_per_s": Bound(0.30, 50),  # under strace, which slows: fewer on a busy machine
    "wakeups_per_s": Bound(0.15, 60),  # a loop that is late meets frames in two parts
    "other_wakeups_per_s": Bound(0.25, 20),
    "cpu_rounds_per_s": Bound(0.60, 1.0),  # rounds of the peer: a busy machine is in it
    "resident_mb": Bound(0.10, 5),
    "locked_mb": Bound(0.10, 5),
    "minor_faults_per_s": Bound(0.0, 20),
    "major_faults": Bound(0.0, 2),
    "modules": Bound(0.0, 25),
    "kernels": Bound(0.0, 12),
    "import_ratio": Bound(0.40, 0.0),
}


def grown(kept: Numbers, new: Numbers) -> list[str]:
    """In words, each count that is beyond its bound; what only one of both has is not compared."""
    words = []
    for name, value in new.items():
        bound, before = BOUNDS.get(name.rpartition(".")[2]), kept.get(name)
        if bound is None or before is None:
            continue
        most = before * (1 + bound.share) + bound.more
        if value > most:
            words.append(
                f"{name}: {value:.4g}, kept is {before:.4g}, at most {most:.4g} is let pass"
            )
    return words


def entry(figures: Numbers, calls: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Figures as they are kept: with the time, the commit and the machine."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
        "commit": commit(),
        "machine": machine(),
        "figures": {name: _short(value) for name, value in figures.items() if math.isfinite(value)},
        "calls_per_s": {
            setting: {name: _short(value) for name, value in counts.items() if value >= 0.5}
            for setting, counts in calls.items()
        },
    }


def kept_entries(path: Path = FILE) -> list[dict[str, Any]]:
    """Oldest first."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def keep(new: Mapping[str, Any], path: Path = FILE) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(new, separators=(", ", ": ")) + "\n")


def machine() -> str:
    names = [
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        if line.startswith("model name")
    ]
    processor = names[0] if names else platform.machine()
    python = platform.python_version()
    return (
        f"{processor}, {len(os.sched_getaffinity(0))} cores, {platform.system()}, Python {python}"
    )


def table_of(
    settings: Sequence[str],
    rows: Sequence[tuple[str, str, int]],
    new: Numbers,
    kept: Mapping[str, Any] | None,
) -> Table:
    """New figures beside those kept last.

    Args:
        rows: name of a figure, what it is in words, digits behind the point; a name with a setting
            of its own stands in the first column alone.
    """
    before: Numbers = kept["figures"] if kept else {}
    title = f"kept last: {kept['date']}, commit {kept['commit']}" if kept else None
    table = Table(title=title, box=box.SIMPLE_HEAD)
    table.add_column("", no_wrap=True)
    for setting in settings:
        for column in (setting, *(("kept", "change") if kept else ())):
            table.add_column(column, justify="right", no_wrap=True)
    for name, words, digits in rows:
        names = [name] if "." in name else [f"{setting}.{name}" for setting in settings]
        cells = [cell for one in names for cell in _cells(new.get(one), before.get(one), digits)]
        if any(cells):
            table.add_row(words, *(cells if kept else cells[::COLUMNS]))
    return table


def _cells(value: float | None, before: float | None, digits: int) -> tuple[str, str, str]:
    """New, kept, and how much it changed where that is worth telling."""
    now, then = ("" if one is None else f"{one:.{digits}f}" for one in (value, before))
    change = value / before - 1 if value is not None and before else 0.0
    return now, then, f"{100 * change:+.0f} %" if abs(change) >= TOLD_CHANGE else ""


def _short(value: float) -> float:
    return float(f"{value:.4g}")
