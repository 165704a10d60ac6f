"""Replay many recordings with many settings, and score each: which settings make a better map.

Each score is a figure of which less is better; docs/sweep.md says what each one is. A drive that
was simulated and recorded by `make campaign RECORD=folder` is held against the truth. A robot that
is replayed drives as it was recorded, whatever the settings. Begun again with the same words, a
sweep does what is missing.
"""

import argparse
import contextlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from core.config import ConfigError
from recording.records import RecordingError
from tools.cli.options import a_seed, fail, parser_of, settings_text, value_of
from tools.sweep.cluster import DaskCluster
from tools.sweep.code import digest_of
from tools.sweep.engine import Done, done_before, run_missing
from tools.sweep.jobs import SchedulerError, with_bar
from tools.sweep.local import LocalProcesses
from tools.sweep.page import figure_text, page_of
from tools.sweep.plan import PlanError, Planned, planned, table_of
from tools.sweep.replays import row_of
from tools.sweep.rows import FolderError, Row, Rows, put
from tools.sweep.space import Settings, SpaceError, settings_of
from tools.sweep.tables import Line, best_of, lines_of, scores_in, write_table

NAME = "sweep"
WIDE = 160  # columns, without a screen


def a_count(text: str) -> int:
    return value_of(text, int, lambda value: value >= 1, "a whole number, 1 or more")


def arguments_of(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_of(
        NAME,
        __doc__,
        "mapod sweep drives --set map.cell_m=0.1,0.2 --set obstacle.h_pos_m=0.08:0.12:3",
        "mapod sweep drives --set obstacle.h_pos_m=0.05:0.2 --sample 20 --out heights",
    )
    add = parser.add_argument
    add("drives", nargs="+", type=Path, help="recordings, or folders of them")
    about = "values of a setting: a list (a,b,c), or from:to:count; may be given again"
    add("--set", action="append", default=[], metavar="KEY=VALUES", dest="texts", help=about)
    add("--sample", type=a_count, help="so many settings by chance (default: all combinations)")
    add("--seed", type=a_seed, default=1, help="of what is drawn by chance (1)")
    add("--config", type=Path, help="settings for all drives (default: the recorded ones)")
    add("--jobs", type=a_count, default=os.cpu_count() or 1, help="processes (one for each core)")
    add("--scheduler", default="", help="a Dask cluster, such as tcp://10.0.0.7:8786, for --jobs")
    parser.add_out("a folder for rows, table and page; the sweep goes on in it", Path(NAME))
    return parser.parse_args(arguments)


def kept_rows(options: argparse.Namespace, text: str | None) -> Rows:
    """Raises FolderError, OSError."""
    drawn = None if options.sample is None else [options.sample, options.seed]
    what = {"kind": NAME, "set": options.texts, "sample": drawn}
    return Rows(options.out, what | {"config": None if text is None else digest_of(text)})


def counts(ended: Sequence[Done]) -> str:
    return f"{sum(bool(done.failed) for done in ended)} failed"


def run(
    options: argparse.Namespace,
    jobs: dict[str, Planned],
    rows: Rows,
    console: Console,
    ended: list[Done],
) -> None:
    """Adds what ends. Raises SchedulerError, OSError."""
    address = options.scheduler
    scheduler = DaskCluster(address) if address else LocalProcesses(options.jobs)
    tasks = {key: job.task for key, job in jobs.items()}
    ended += done_before(tasks, rows)
    console.print(f"{len(jobs)} jobs, {len(ended)} of them done before", highlight=False)
    running = run_missing(row_of, tasks, rows, scheduler)
    with contextlib.closing(running):
        for done in with_bar(console, len(jobs), running, counts, done=list(ended), noun="jobs"):
            ended.append(done)


def failures_of(table: Sequence[Row], all_settings: Sequence[Settings]) -> list[str]:
    keys = all_settings[0].keys()
    return [
        " ".join([row["drive"], *(f"{key}={row[key]}" for key in keys)])
        + f": {row['failed'].splitlines()[-1]}"
        for row in table
        if row.get("failed")
    ]


def shown(title: str, lines: Sequence[Line]) -> Table:
    """Means over drives, the best ones marked."""
    scores = scores_in(lines)
    best = {score.name: best_of(lines, score) for score in scores}
    drawn = Table(box=None, header_style="bold", pad_edge=False, title=title, title_justify="left")
    drawn.add_column("settings")
    for score in scores:
        drawn.add_column(f"{score.name}\n{score.unit}", justify="right")
    for line in lines:
        means = [
            figure_text(line.mean(score.name)) + (" *" if line in best[score.name] else "  ")
            for score in scores
        ]
        drawn.add_row(line.name, *means)
    return drawn


def tell(
    folder: Path,
    console: Console,
    table: Sequence[Row],
    all_settings: Sequence[Settings],
    jobs: int,
) -> int:
    """Write table and page, and show the means; the exit status. Raises OSError."""
    lines, failures = lines_of(table, all_settings), failures_of(table, all_settings)
    drives = len({row["recording"] for row in table})
    facts = f"drives: {drives}, settings: {len(all_settings)}, jobs: {len(table)} of {jobs}"
    title = "Sweep of " + (", ".join(all_settings[0]) or "recordings as they are")
    told = [*failures, write_table(folder, table), f"{folder / 'page.html'} shows all of it"]
    put(folder / "page.html", page_of(title, facts, lines, failures).encode())
    if scores_in(lines):
        console.print(shown(facts, lines))
        told.insert(0, "means over drives; less is better, * is the best")
    for line in filter(None, told):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    return 0 if len(table) == jobs and not failures else 1


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 each job has scores, 1 some have none, 2 wrong use."""
    options = arguments_of(arguments)
    if options.out.exists() and not options.out.is_dir():
        return fail(NAME, f"--out: must be a folder, {str(options.out)!r} is a file")
    console = Console() if sys.stdout.isatty() else Console(width=WIDE)
    ended: list[Done] = []
    try:
        all_settings = settings_of(options.texts, options.sample, options.seed)
        text = settings_text(options.config) if options.config else None
        jobs = planned(options.drives, all_settings, text)
        with kept_rows(options, text) as rows:
            try:
                with contextlib.suppress(KeyboardInterrupt):
                    run(options, jobs, rows, console, ended)
            except SchedulerError as error:
                if not ended:
                    raise
                fail(NAME, error)
            table = table_of(jobs, {done.key: done.row for done in ended})
            return tell(options.out, console, table, all_settings, len(jobs))
    except (SpaceError, PlanError, ConfigError, RecordingError, FolderError) as error:
        return fail(NAME, error)
    except (SchedulerError, OSError) as error:
        return fail(NAME, error)
