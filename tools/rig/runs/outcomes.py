"""What came of many runs: their sums, a table, a line for each that is not well."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from tools.rig.runs.one_run import RunResult, RunSpec
from tools.rig.runs.record import facts_of

GOALS_WANTED = 0.9  # of all
NO_GAP = "-"
COLUMNS = (
    "scene", "runs", "goals", "collisions", "bumped", "false stops", "worst stop m",
    "least gap m", "way m", "x real time",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of a campaign: its result, or why there is none."""

    number: int
    spec: RunSpec
    result: RunResult | None = None
    crash: str = ""  # in words, with the traceback

    @property
    def is_well(self) -> bool:
        return self.result is not None and not self.result.collisions


class Totals:
    """Sums over runs, and worst ones."""

    def __init__(self, results: Sequence[RunResult]) -> None:
        self.runs = len(results)
        self.goals = sum(result.goals for result in results)
        self.reached = sum(result.reached for result in results)
        self.collisions = sum(len(result.collisions) for result in results)
        self.bumps = sum(len(result.bumps) for result in results)
        self.stops = sum(len(result.stops) for result in results)
        self.false_stops = sum(len(result.false_stops) for result in results)
        self.worst_stop_m = max((result.worst_stop_m for result in results), default=0.0)
        self.least_gap_m = min((result.least_gap_m for result in results), default=math.inf)
        self.driven_m = sum(result.driven_m for result in results)
        self.sim_s = sum(result.sim_s for result in results)
        self.cpu_s = sum(result.cpu_s for result in results)  # of computing, on one core

    @property
    def share(self) -> float:
        return self.reached / self.goals if self.goals else 1.0

    @property
    def speed(self) -> float:
        """Simulated seconds per second of one core."""
        return self.sim_s / self.cpu_s if self.cpu_s else 0.0

    def cells(self) -> list[str]:
        return [
            str(self.runs),
            f"{self.reached}/{self.goals}",
            str(self.collisions),
            str(self.bumps),
            f"{self.false_stops}/{self.stops}",
            f"{self.worst_stop_m:.2f}",
            f"{self.least_gap_m:.2f}" if math.isfinite(self.least_gap_m) else NO_GAP,
            f"{self.driven_m:.0f}",
            f"{self.speed:.1f}",
        ]


def results_in(outcomes: Iterable[Outcome]) -> list[RunResult]:
    return [outcome.result for outcome in outcomes if outcome.result is not None]


def counts(outcomes: Sequence[Outcome]) -> str:
    total = Totals(results_in(outcomes))
    crashes = len(outcomes) - total.runs
    return (
        f"{total.reached}/{total.goals} goals, {total.collisions} collisions, "
        f"{total.false_stops} false stops" + (f", {crashes} crashes" if crashes else "")
    )


def table(results: Sequence[RunResult], markdown: bool = False) -> Table:
    drawn = Table(box=box.MARKDOWN if markdown else None, header_style="bold", pad_edge=markdown)
    for name in COLUMNS:
        drawn.add_column(name, justify="left" if name == "scene" else "right")
    for scene in dict.fromkeys(result.scene for result in results):
        drawn.add_row(scene, *Totals([r for r in results if r.scene == scene]).cells())
    drawn.add_row("all", *Totals(results).cells(), style="bold")
    return drawn


def complaints(outcomes: Iterable[Outcome], again: str) -> list[str]:
    """A line for each crash, collision and missed goal; `again` repeats run {number}."""
    lines = []
    for outcome in outcomes:
        if outcome.result is None:
            what = [f": crashed: {outcome.crash}"]
        else:
            what = [f": collision with {contact.words()}" for contact in outcome.result.collisions]
            what += [
                f", goal {missed.number} at ({missed.x_m:.1f}, {missed.y_m:.1f}) m not reached: "
                f"{missed.cause}"
                for missed in outcome.result.missed
            ]
        repeat = again.format(number=outcome.number)
        lines += [
            f"run {outcome.number} ({outcome.spec.name}){said}; again: {repeat}" for said in what
        ]
    return lines


def is_well(outcomes: Sequence[Outcome], planned: int) -> bool:
    """As many runs as planned, all well; goals enough in those where nothing was made to fail."""
    sound = results_in(outcome for outcome in outcomes if not outcome.spec.faults)
    are_well = len(outcomes) >= planned and all(outcome.is_well for outcome in outcomes)
    return are_well and Totals(sound).share >= GOALS_WANTED


def show(
    console: Console,
    outcomes: Sequence[Outcome],
    planned: int,
    again: str,
    passed_s: float | None,  # None: not all of it was run now
    markdown: bool = False,
) -> None:
    results = results_in(outcomes)
    if results:
        console.print(table(results, markdown))
    all_of, in_all = Totals(results), ""
    if passed_s is not None:
        in_all = f" in {passed_s:.0f} s: {all_of.sim_s / passed_s:.1f} x real time in all"
    lines = [
        f"{all_of.reached} of {all_of.goals} goals ({100 * all_of.share:.1f} %), "
        f"{all_of.collisions} collisions, {len(outcomes) - len(results)} crashes; "
        f"{all_of.sim_s:.0f} simulated seconds{in_all}, {all_of.speed:.1f} x on one core"
    ]
    whys = (stop.why or "no reason told" for result in results for stop in result.false_stops)
    reasons = ", ".join(f"{count} x {why}" for why, count in Counter(whys).most_common())
    lines += [f"false stops: {reasons}"] if reasons else []
    lines += complaints(outcomes, again)
    lines += [f"broken off after {len(outcomes)} of {planned} runs"] * (len(outcomes) < planned)
    lines += ["well" if is_well(outcomes, planned) else "NOT WELL"]
    for line in lines:
        console.print(Text(line), soft_wrap=True)


def as_json(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    return [
        {"number": outcome.number, "crash": outcome.crash}
        | (facts_of(outcome.result) if outcome.result is not None else {})
        for outcome in outcomes
    ]
