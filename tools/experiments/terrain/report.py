"""The tables of the terrain maps, and their place in docs/terrain.md."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from core.records import F64
from tools.experiments.terrain.feet import (
    ALL_HEIGHTS,
    FEET,
    MEASURED,
    TRUE,
    Filled,
    Walked,
)
from tools.experiments.terrain.measure import Figures
from tools.experiments.terrain.methods import NAMES, SHADED
from tools.experiments.terrain.runs import Results
from tools.experiments.terrain.scenes import SIZES_M, THINGS
from tools.experiments.terrain.trials import BY_FEET

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "terrain.md"
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"
PAPER = {"stripe": (16.5, 10.0, 3.9, 4.2), "URG-04LX": (6.8, 5.0, 2.6, 17.7)}


def _row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def _head(*names: str) -> list[str]:
    return [_row(*names), "|" + "---|" * len(names)]


def quartiles(off: F64) -> str:
    """Median of the size of relative errors (n,), with its quartiles, percent; NaN: never told."""
    told = 100.0 * np.abs(off[np.isfinite(off)])
    if not told.size:
        return "never"
    low, middle, high = np.quantile(told, (0.25, 0.5, 0.75))
    rest = f", {off.size - told.size} none" if told.size < off.size else ""
    return f"{middle:.1f} ({low:.1f} to {high:.1f}{rest})"


def sizes_table(found: Results) -> list[str]:
    sizes = [f"{name}: {1000 * size_m:.0f} mm" for name, size_m in SIZES_M.items()]
    rows = _head("sensor", "method", *sizes)
    for sensor, told in PAPER.items():
        rows.append(_row(sensor, "the paper's own", *(f"{percent:.1f}" for percent in told)))
    for sensor, runs in (("URG-04LX", found.by_urg), ("stripe", found.by_stripe)):
        for name in runs[0]:
            off = np.array([run[name] for run in runs])
            rows.append(_row(sensor, name, *(quartiles(off[:, k]) for k in range(len(sizes)))))
    return rows


def _mean(figures: Sequence[Figures]) -> Figures:
    """Of each; of the rms, over the maps that know anything."""
    rms_m, *rest = np.array(figures, dtype=float).T
    told = rms_m[np.isfinite(rms_m)]
    return Figures(float(told.mean()) if told.size else np.nan, *(part.mean() for part in rest))


def _told(figures: Figures) -> tuple[str, ...]:
    rms = f"{1000 * figures.rms_m:.1f}" if np.isfinite(figures.rms_m) else "-"
    artefacts = f"{figures.too_high:.1f}", f"{figures.too_low:.1f}"
    return rms, f"{100 * figures.unknown:.1f}", *artefacts


def things_table(found: Results) -> list[str]:
    names = ("rms mm", "unknown %", "too high", "too low")
    rows = _head("thing", "method", *names, "told at all")
    for thing in THINGS:
        runs = found.things[thing]
        for name in NAMES:
            seen = [run[name] for run in runs]
            there = f"{sum(one.is_there for one in seen)} of {len(seen)}"
            rows.append(_row(thing, name, *_told(_mean([one.figures for one in seen])), there))
    return rows


def rocks_table(found: Results) -> list[str]:
    rows = _head("body", "method", "rms mm", "unknown %", "too high", "too low")
    for walk, runs in found.rocks.items():
        for name in NAMES:
            rows.append(_row(walk, name, *_told(_mean([run[name].figures for run in runs]))))
    return rows


def _by_method(found: Results) -> Iterator[tuple[str, str, str, list[Walked]]]:
    """Ground, body and method, and what feet got, seed by seed."""
    for walk, runs in found.rocks.items():
        for name in BY_FEET:
            yield "rocks", walk, name, [one for run in runs if (one := run[name].walked)]
    for walk, boxes in found.boxes.items():
        for name in BY_FEET:
            yield "boxes", walk, name, [run[name] for run in boxes]


def filled_table(found: Results) -> list[str]:
    shares = ("unknown %", "of these filled %", "rms mm", "too high %", "too low %")
    rows = _head("ground", "body", "method", *shares, "90 % within, sigmas")
    for ground, walk, name, runs in _by_method(found):
        of = Filled(*np.array([run.filled for run in runs]).mean(axis=0))
        percent = [f"{100 * share:.1f}" for share in (of.unknown, of.filled)]
        wrong = [f"{100 * share:.1f}" for share in (of.too_high, of.too_low)]
        sigmas = f"{of.off_sigmas:.2f}" if np.isfinite(of.off_sigmas) else "no sigma"
        rows.append(_row(ground, walk, name, *percent, f"{1000 * of.rms_m:.1f}", *wrong, sigmas))
    return rows


def feet_table(found: Results) -> list[str]:
    rows = _head("ground", "body", "method", "heights", "found", "safe %", "worst step mm")
    for ground, walk, name, runs in _by_method(found):
        for by in (MEASURED, ALL_HEIGHTS, TRUE):
            if by == TRUE and name != SHADED:
                continue  # the truth is that of each method
            feet = [run.feet[by] for run in runs]
            count, safe = sum(one.found for one in feet), sum(one.safe for one in feet)
            mean = f"{count / len(feet):.1f} of {FEET}"
            share = f"{100 * safe / count:.1f}" if count else "-"
            worst = f"{1000 * max(one.worst_m for one in feet):.0f}" if count else "-"
            rows.append(_row(ground, walk, "-" if by == TRUE else name, by, mean, share, worst))
    return rows


def free_table(found: Results) -> list[str]:
    rows = _head("ground", "body", "method", "cells told free", "of these not free", "%")
    for ground, walk, name, runs in _by_method(found):
        cells, wrong = np.array([run.freed for run in runs]).mean(axis=0).tolist()
        share = f"{100 * wrong / cells:.2f}" if cells else "-"
        rows.append(_row(ground, walk, name, f"{cells:.1f}", f"{wrong:.2f}", share))
    return rows


def tables(found: Results) -> str:
    """All of them, as Markdown."""
    seeds = found.seeds
    parts = (
        (f"**Sizes of two boxes**: relative error in %, {seeds.sizes} seeds.", sizes_table),
        (f"**Single things**: means of {seeds.things} seeds.", things_table),
        (f"**Rocks**: means of {seeds.rocks} seeds.", rocks_table),
        (f"**Heights filled in**: means of {seeds.rocks} seeds.", filled_table),
        (f"**Footholds**: the best ones of {seeds.rocks} seeds.", feet_table),
        (f"**Free ground**: means of {seeds.rocks} seeds.", free_table),
    )
    return "\n\n".join("\n".join([title, "", *table(found)]) for title, table in parts)


def with_tables(document: str, told: str, marks: tuple[str, str] = (BEGIN, END)) -> str:
    """A document with other tables between two marks; ValueError: it has not both."""
    before, begin, rest = document.partition(marks[0])
    _, end, after = rest.partition(marks[1])
    if not (begin and end):
        raise ValueError(f"the document must have the lines {marks[0]} and {marks[1]}")
    return f"{before}{begin}\n\n{told}\n\n{end}{after}"
