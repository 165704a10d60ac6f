"""What came of a campaign: a table by scene, the goals that were not reached, and the verdict."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from tools.rig.one_run import RunResult, RunSpec
from tools.rig.record import facts_of

GOALS_WANTED = 0.9  # of all
NO_GAP = "-"
COLUMNS = (
    "scene",
    "runs",
    "goals",
    "collisions",
    "bumped",
    "false stops",
    "worst stop m",
    "least gap m",
    "way m",
    "x real time",
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of a campaign: its result, or why there is none."""

    number: int
    spec: RunSpec
    result: RunResult | None = None
    crash: str = ""  # in words, with the traceback
    repeated: bool | None = None  # whether a second run agreed to the bit; None: there was none

    @property
    def is_well(self) -> bool:
        """No crash, no collision, nothing that differed."""
        return self.result is not None and not self.result.collisions and self.repeated is not False


@dataclass(frozen=True, slots=True)
class Totals:
    """Sums over runs."""

    runs: int
    goals: int
    reached: int
    collisions: int
    bumps: int
    stops: int
    false_stops: int
    worst_stop_m: float
    least_gap_m: float
    driven_m: float
    sim_s: float
    cpu_s: float  # of computing, on one core

    @property
    def share(self) -> float:
        """Of the goals that were reached."""
        return self.reached / self.goals if self.goals else 1.0

    def cells(self) -> list[str]:
        """For a row of the table, without its name."""
        gap = f"{self.least_gap_m:.2f}" if math.isfinite(self.least_gap_m) else NO_GAP
        speed = f"{self.sim_s / self.cpu_s:.1f}" if self.cpu_s else NO_GAP
        return [
            str(self.runs),
            f"{self.reached}/{self.goals}",
            str(self.collisions),
            str(self.bumps),
            f"{self.false_stops}/{self.stops}",
            f"{self.worst_stop_m:.2f}",
            gap,
            f"{self.driven_m:.0f}",
            speed,
        ]


def totals_of(results: Sequence[RunResult]) -> Totals:
    """Sums and worst ones."""
    return Totals(
        len(results),
        sum(result.goals for result in results),
        sum(result.reached for result in results),
        sum(len(result.collisions) for result in results),
        sum(len(result.bumps) for result in results),
        sum(len(result.stops) for result in results),
        sum(len(result.false_stops) for result in results),
        max((result.worst_stop_m for result in results), default=0.0),
        min((result.least_gap_m for result in results), default=math.inf),
        sum(result.driven_m for result in results),
        sum(result.sim_s for result in results),
        sum(result.cpu_s for result in results),
    )


def table(results: Sequence[RunResult]) -> Table:
    """By scene, and all."""
    drawn = Table(box=None, header_style="bold", pad_edge=False)
    for name in COLUMNS:
        drawn.add_column(name, justify="left" if name == "scene" else "right")
    for scene in dict.fromkeys(result.scene for result in results):
        of_scene = [result for result in results if result.scene == scene]
        drawn.add_row(scene, *totals_of(of_scene).cells())
    drawn.add_row("all", *totals_of(results).cells(), style="bold")
    return drawn


def markdown(results: Sequence[RunResult]) -> str:
    """The same table, for a document."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    for scene in dict.fromkeys(result.scene for result in results):
        of_scene = [result for result in results if result.scene == scene]
        lines.append("| " + " | ".join([scene, *totals_of(of_scene).cells()]) + " |")
    lines.append("| " + " | ".join(["all", *totals_of(results).cells()]) + " |")
    return "\n".join(lines)


def complaints(outcomes: Iterable[Outcome], again: str) -> list[str]:
    """What must not be: crashes, collisions, runs that differ; a line each, and how to repeat it.

    Args:
        again: the words that repeat a run, with {number} in them.
    """
    lines = []
    for outcome in outcomes:
        if outcome.result is None:
            what = [f"crashed: {outcome.crash.strip()}"]
        else:
            what = [f"collision with {contact.words()}" for contact in outcome.result.collisions]
        what += ["a second run differed"] if outcome.repeated is False else []
        lines += [
            f"run {outcome.number} ({outcome.spec.name}): {words}; "
            f"again: {again.format(number=outcome.number)}"
            for words in what
        ]
    return lines


def missed_goals(outcomes: Iterable[Outcome], again: str) -> list[str]:
    """Each goal that was not reached, its cause, and how to repeat the run."""
    return [
        f"run {outcome.number} ({outcome.spec.name}), goal {missed.number} at "
        f"({missed.x_m:.1f}, {missed.y_m:.1f}) m: {missed.cause}; "
        f"again: {again.format(number=outcome.number)}"
        for outcome in outcomes
        if outcome.result is not None
        for missed in outcome.result.missed
    ]


def false_stops(outcomes: Iterable[Outcome]) -> dict[str, int]:
    """How many by reason, the most frequent first."""
    counts: dict[str, int] = {}
    for outcome in outcomes:
        for stop in outcome.result.false_stops if outcome.result is not None else ():
            counts[stop.why or "no reason told"] = counts.get(stop.why or "no reason told", 0) + 1
    return dict(sorted(counts.items(), key=lambda entry: -entry[1]))


def is_well(outcomes: Sequence[Outcome], planned: int) -> bool:
    """As many runs as planned, all well; goals enough in those where nothing was made to fail."""
    sound = [o.result for o in outcomes if o.result is not None and not o.spec.faults]
    are_well = len(outcomes) >= planned and all(outcome.is_well for outcome in outcomes)
    return are_well and totals_of(sound).share >= GOALS_WANTED


def show(
    console: Console, outcomes: Sequence[Outcome], planned: int, again: str, passed_s: float
) -> None:
    """All of it, for a person."""
    results = [outcome.result for outcome in outcomes if outcome.result is not None]
    if results:
        console.print(table(results))
    all_of = totals_of(results)
    lines = [
        f"{all_of.reached} of {all_of.goals} goals ({100 * all_of.share:.1f} %), "
        f"{all_of.collisions} collisions, {len(outcomes) - len(results)} crashes; "
        f"{all_of.sim_s:.0f} simulated seconds in {passed_s:.0f} s: "
        f"{all_of.sim_s / passed_s if passed_s else 0.0:.1f} x real time in all, "
        f"{all_of.sim_s / all_of.cpu_s if all_of.cpu_s else 0.0:.1f} x on one core"
    ]
    reasons = ", ".join(f"{count} x {why}" for why, count in false_stops(outcomes).items())
    lines += [f"false stops: {reasons}"] if reasons else []
    missed = missed_goals(outcomes, again)
    lines += ["goals not reached:", *(f"  {line}" for line in missed)] if missed else []
    lines += complaints(outcomes, again)
    lines += [f"broken off after {len(outcomes)} of {planned} runs"] * (len(outcomes) < planned)
    lines += ["well" if is_well(outcomes, planned) else "NOT WELL"]
    for line in lines:
        console.print(Text(line), soft_wrap=True)


def as_json(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Each run as JSON takes it."""
    return [
        {"number": outcome.number, "crash": outcome.crash, "repeated": outcome.repeated}
        | (facts_of(outcome.result) if outcome.result is not None else {})
        for outcome in outcomes
    ]
