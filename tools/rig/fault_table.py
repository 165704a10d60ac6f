"""The fault campaign: `python -m tools.rig.fault_table [--pairs 40]`, or `make faults`.

Each fault of the catalogue once, and pairs by chance, while the robot drives. What became of
each is held against the catalogue; exit status 1 if anything is not as it must be.
"""

import argparse
import os
import random
import statistics
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tools.rig.faults.catalogue import CATALOGUE, Fault
from tools.rig.faults.drive import Outcome, course_of, drive_with, problems, problems_of_pair
from tools.rig.faults.stripe import ROBOT as SMALL_ROBOT
from tools.rig.faults.stripe import STRIPE
from tools.rig.faults.urg04lx import ROBOT, URG04LX
from tools.sweep.jobs import Failure, with_bar
from tools.sweep.local import LocalProcesses

EARLIER_S, LATER_S = -1.0, 1.5  # of the faults' begin, by chance
FILE_COLUMNS = 180
COLUMNS = ("fault", "must", "stands after s", "blind m", "told after s", "not well",
           "well after s", "drives after s", "verdict")  # fmt: skip
SUMMARY = ("device", "drives", "stopped", "stands after s", "blind m", "well after s",
           "drives after s", "wait", "wrong")  # fmt: skip
HEAD = """# Every fault while driving: what the robot did

Made by `python -m tools.rig.fault_table --markdown docs/faults.md`; docs/rig.md says how, and
what the columns mean.
Seconds and metres; by device: the median, then the greatest.
"""


@dataclass(frozen=True, slots=True)
class Job:
    """One drive."""

    faults: tuple[Fault, ...]
    seed: int
    start_s: float

    @property
    def title(self) -> str:
        return " AND ".join(fault.title for fault in self.faults)

    @property
    def must(self) -> str:
        musts = {fault.must for fault in self.faults}
        return next(must for must in ("stops", "either", "goes on") if must in musts)

    @property
    def group(self) -> str:
        """The device, the robot if that is not the shipped one, or "pairs"."""
        return self.faults[0].robot or self.faults[0].device if len(self.faults) == 1 else "pairs"


@dataclass(slots=True)
class Row:
    """What became of one drive, in the table."""

    job: Job
    outcome: Outcome | None  # None: it crashed
    problems: list[str] = field(default_factory=list)

    def complaint(self) -> str:
        job = self.job
        return f"  {job.title} (seed {job.seed}, {job.start_s:g} s): {'; '.join(self.problems)}"


def jobs(pairs: int, rounds: int, seed: int, only: str = "") -> list[Job]:
    """All drives: each fault so many times, then pairs of different devices' faults.

    Pairs are the shipped robot's.
    """
    chance = random.Random(f"fault campaign {seed}")
    chosen = [fault for fault in (*CATALOGUE, *URG04LX, *STRIPE) if only in fault.title]

    def later_s() -> float:
        return chance.uniform(EARLIER_S, LATER_S)

    def start_s(robot: str, off_s: float) -> float:
        return round(course_of(robot).fault_from_s + off_s, 2)

    first = [0.0, *(later_s() for _ in range(rounds - 1))]
    found = [
        Job((fault,), seed + k, start_s(fault.robot, off_s))
        for fault in chosen
        for k, off_s in enumerate(first)
    ]
    noticed = [fault for fault in chosen if fault.is_noticed and not fault.robot]
    for _ in range(pairs if noticed else 0):
        one = chance.choice(noticed)
        others = [f for f in CATALOGUE if f.device != one.device and f.is_noticed]
        found.append(
            Job(
                (one, chance.choice(others)),
                seed + len(found),
                start_s("", later_s()),
            )
        )
    return found


def row_of(job: Job) -> Row:
    outcome = drive_with(*job.faults, seed=job.seed, start_s=job.start_s)
    if len(job.faults) == 1:
        return Row(job, outcome, problems(job.faults[0], outcome))
    return Row(job, outcome, problems_of_pair(job.faults, outcome))


def run_all(wanted: Sequence[Job], processes: int, console: Console) -> list[Row]:
    rows = (
        Row(wanted[at], None, [f"crashed: {row.cause.splitlines()[-1]}"])
        if isinstance(row, Failure)
        else row
        for at, row in LocalProcesses(processes).results(row_of, wanted)
    )
    found: dict[Job, Row] = {}
    for row in with_bar(console, len(wanted), rows, lambda seen: f"{len(wrong(seen))} wrong"):
        found[row.job] = row
        if row.problems:
            console.print(row.complaint())
    return [found[job] for job in wanted]


def wrong(rows: Iterable[Row]) -> list[Row]:
    return [row for row in rows if row.problems]


def cells(row: Row) -> tuple[str, ...]:
    one, verdict = row.outcome, "; ".join(row.problems) or "as it must"
    if one is None:
        return (row.job.title, row.job.must, *[""] * (len(COLUMNS) - 3), verdict)
    waits = not all(fault.again for fault in row.job.faults)
    again = "" if one.stood_s is None else _seconds(one.again_s, "waits" if waits else "never")
    return (
        row.job.title,
        row.job.must,
        _seconds(one.stood_s, "goes on"),
        f"{one.blind_m:.2f}",
        _seconds(one.told_s, ""),
        " ".join(one.told),
        _seconds(one.well_s, "never"),
        again,
        verdict,
    )


def _seconds(seconds: float | None, none: str) -> str:
    return none if seconds is None else f"{seconds:.2f}"


def summary(rows: Sequence[Row]) -> Iterator[tuple[str, ...]]:
    for group in ("scanner", "ahrs", "drive", "planner", ROBOT, SMALL_ROBOT, "pairs"):
        chosen = [row for row in rows if row.job.group == group]
        outcomes = [row.outcome for row in chosen if row.outcome is not None]
        stood = [one for one in outcomes if one.stood_s is not None]
        if outcomes:
            yield (
                group,
                str(len(outcomes)),
                str(len(stood)),
                _spread([one.stood_s for one in stood]),
                _spread([one.blind_m for one in stood]),
                _spread([one.well_s for one in stood]),
                _spread([one.again_s for one in stood]),
                str(sum(one.again_s is None for one in stood)),
                str(len(wrong(chosen))),
            )


def _spread(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{statistics.median(known):.2f}, {max(known):.2f}" if known else ""


def show(rows: Sequence[Row], console: Console) -> None:
    table = Table(*COLUMNS, title="faults while driving", row_styles=("", "dim"))
    for column in table.columns:
        column.overflow = "fold"
    for row in rows:
        table.add_row(*cells(row), style="red" if row.problems else "")
    short = Table(*SUMMARY, title="by device: median, greatest")
    for line in summary(rows):
        short.add_row(*line)
    console.print(table, short)
    console.print(f"{len(rows)} drives, {len(wrong(rows))} not as they must be")
    for row in wrong(rows):
        console.print(row.complaint())


def markdown(rows: Sequence[Row]) -> str:
    lines = [HEAD, *_markdown_table(SUMMARY, summary(rows)), ""]
    lines += _markdown_table(COLUMNS, (cells(row) for row in rows if len(row.job.faults) == 1))
    return "\n".join(lines) + "\n"


def _markdown_table(head: Sequence[str], body: Iterator[tuple[str, ...]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield f"|{'---|' * len(head)}"
    for line in body:
        yield f"| {' | '.join(cell.replace('|', '/') for cell in line)} |"


def arguments(given: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.rig.fault_table", description=__doc__)
    parser.add_argument("--pairs", type=int, default=40, help="two faults at once, by chance")
    parser.add_argument("--rounds", type=int, default=1, help="drives for each single fault")
    parser.add_argument("--seed", type=int, default=1, help="of all chance")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--only", default="", help="faults whose name holds this")
    parser.add_argument("--markdown", type=Path, help="file for the tables")
    return parser.parse_args(given)


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 all as it must be, 1 something is not, 2 there is no such fault."""
    options, console = arguments(given), Console()
    if not console.is_terminal:  # a file has room
        console = Console(width=FILE_COLUMNS)
    wanted = jobs(options.pairs, options.rounds, options.seed, options.only)
    if not wanted:
        print(f"fault_table: no fault's name holds {options.only!r}", file=sys.stderr)
        return 2
    rows = run_all(wanted, options.jobs, console)
    show(rows, console)
    if options.markdown:
        options.markdown.write_text(markdown(rows), encoding="utf-8")
    return 1 if wrong(rows) else 0


if __name__ == "__main__":
    sys.exit(main())
