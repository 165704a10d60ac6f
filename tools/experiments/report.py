"""The outcome of the experiments as a document: one table, what does not hold, and the pictures."""

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from tools.experiments.pictures import draw_maps
from tools.experiments.views import MapView

Span = tuple[float, float]
Aim = Literal["less", "more", "none"]
SAME = 0.02  # figures that differ by less than this share count as the same
METHODS = ("reference_plane", "surface")


@dataclass(frozen=True, slots=True)
class Row:
    """One quantity of one experiment, for each method that has it."""

    experiment: str  # number and name
    quantity: str  # with its unit
    values: dict[str, float]  # by method; NaN: not applicable
    aim: Aim = "less"  # what is better; "none": told, not judged
    digits: int = 2
    paper: str = "-"
    timed: bool = False  # measured on this machine's clock: never twice the same


@dataclass(slots=True)
class Outcome:
    """What an experiment gave, or a part of it: parts of the same name are shown as one."""

    name: str  # number and name
    note: str = ""  # what was done, in a sentence or two
    rows: list[Row] = field(default_factory=list)
    pictures: list[tuple[str, str]] = field(default_factory=list)  # file, caption

    def tell(self, quantity: str, values: dict[str, float], aim: Aim = "less", **more: Any) -> None:
        if not all(map(math.isnan, values.values())):
            self.rows.append(Row(self.name, quantity, values, aim, **more))

    def draw(
        self, path: Path, caption: str, views: Sequence[MapView], x_m: Span, y_m: Span
    ) -> None:
        if views:
            draw_maps(path, caption, views, x_m, y_m)
            self.pictures.append((path.name, caption))


def verdict(row: Row) -> str:
    """`better`, `same` or `worse`: ours against the paper's; "" where that is not judged."""
    theirs, ours = (row.values.get(method, math.nan) for method in METHODS)
    if row.aim == "none" or math.isnan(ours) or math.isnan(theirs):
        return ""
    if math.isinf(ours) or math.isinf(theirs):
        nearer = ours if row.aim == "more" else theirs
        return "same" if ours == theirs else "better" if math.isinf(nearer) else "worse"
    near = max(SAME * max(abs(ours), abs(theirs)), 0.5 * 10.0**-row.digits)
    if row.timed:
        near = max(near, 0.25 * max(abs(ours), abs(theirs)))
    if abs(ours - theirs) <= near:
        return "same"
    return "better" if (ours < theirs) is (row.aim == "less") else "worse"


def _told(row: Row, method: str) -> str:
    value = row.values.get(method, math.nan)
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "never"
    if row.timed:
        return f"~ {float(f'{value:.1g}'):g}"
    return f"{value:.{row.digits}f}"


MARKS = {"better": "better", "same": "same", "worse": "**worse**", "": ""}


def table(rows: Sequence[Row]) -> list[str]:
    lines = [
        "| experiment | quantity | paper | reference_plane | surface | |",
        "|---|---|---|---|---|---|",
    ]
    before = ""
    for row in rows:
        name = row.experiment if row.experiment != before else ""
        before = row.experiment
        told = [_told(row, method) for method in METHODS]
        cells = [name, row.quantity, row.paper, *told, MARKS[verdict(row)]]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _not_better(rows: Sequence[Row]) -> list[str]:
    lines, alike, faultless = [], [], 0
    for row in rows:
        told = f"{row.experiment}, {row.quantity}: "
        told += f"{_told(row, 'surface')} against {_told(row, 'reference_plane')}"
        judged = verdict(row)
        if judged == "worse":
            lines.append(f"- worse: {told}")
        elif judged == "same" and _is_faultless(row):
            faultless += 1
        elif judged == "same":
            alike.append(f"- the same: {told}")
    return [*lines, *alike, "", f"In {faultless} more rows neither method has any fault to tell."]


def _is_faultless(row: Row) -> bool:
    """Whether nothing could be better: no cell wrong, or 100 % of what should be."""
    best = 100.0 if row.aim == "more" else 0.0
    return abs(row.values["surface"] - best) < 0.5 * 10.0**-row.digits


def merged(parts: Iterable[Outcome]) -> list[Outcome]:
    whole: dict[str, Outcome] = {}
    for part in parts:
        into = whole.setdefault(part.name, Outcome(part.name))
        into.note = into.note or part.note
        into.rows += part.rows
        into.pictures += part.pictures
    return list(whole.values())


INTRODUCTION = """\
# The experiments

`make experiments` rebuilds the experiments of the paper (P. Gomes, "LADAR Based Mapping and
Obstacle Detection System for Service Robots", 2010, chapter 5) in the simulated world, and goes on
where the paper stopped. It writes this page and the pictures; `make experiments ONLY=5.3` runs one
and prints its figures.

One robot drives in a simulated place. Its devices' bytes go to several instances of the app at the
same instants, which differ in `map.method` only: `reference_plane` is the paper's method to the
letter, `surface` is ours ([method.md](method.md)). The body moves on order, without physics, so
that what is measured is the maps; sensors have the noise of their sheets. All is seeded: the
figures come out the same again, but those marked `~`, which are times on the machine that ran them.

What is measured, always in the window that the planner gets, held against the world:

- *False obstacle cells*: told as obstacle although nothing of 0.10 m or more rises or falls in the
  cell, in the eight around it, or in those next to them. Floor is what a wheel reaches without such
  a step; so a ramp is floor.
- *Obstacle cells missed*: cells of which half or more is 0.15 m or more above or below the floor,
  in which three beams or more truly ended, one of them as much above or below the floor, and which
  are not told as obstacle, nor is one of the eight around.
- *Free on an obstacle*: cells told as free of which half or more is 0.15 m or more above or below
  the floor. The worst that a map can say.
- *Holes, empty cells*: floor cells that beams met, without a height, while there are cells with one
  within two cells on all four sides.
- *Position error of walls*: from each obstacle cell to the nearest true one, centre to centre.

The paper's column has its figures where it gives any. The last column says whether surface is
better than reference_plane, the same (within 2 %, times within 25 %), or worse.
"""


def stale_pictures(folder: Path, outcomes: Sequence[Outcome]) -> list[Path]:
    """Pictures of experiments, named by their numbers, that these have not drawn."""
    drawn = {file for outcome in outcomes for file, _ in outcome.pictures}
    return [path for path in folder.glob("[0-9]*.png") if path.name not in drawn]


def document(outcomes: Sequence[Outcome]) -> str:
    rows = [row for outcome in outcomes for row in outcome.rows]
    judged = [verdict(row) for row in rows]
    lines = [INTRODUCTION.rstrip(), "", "## What was done", ""]
    for outcome in outcomes:
        what = f"- **{outcome.name}**{': ' if outcome.note else ''}{outcome.note}"
        lines += textwrap.wrap(what, 108, subsequent_indent="  ", break_on_hyphens=False)
    lines += ["", "## The table", "", *table(rows), ""]
    counts = [f"{judged.count(word)} {word}" for word in ("better", "same", "worse")]
    lines += [
        f"Of {sum(map(bool, judged))} figures that both methods have, surface is in "
        f"{counts[0]}, in {counts[1]}, in {counts[2]}.",
        "",
    ]
    lines += ["## Where surface is not better", "", *_not_better(rows), "", "## Pictures", ""]
    for outcome in outcomes:
        for file, caption in outcome.pictures:
            lines += [caption, "", f"![{caption}](pictures/{file})", ""]
    return "\n".join(lines).rstrip() + "\n"
