"""Many runs by chance, on all cores, each judged by the truth: `make campaign N=200`.

    python -m tools.rig.campaign --runs 200 --seed 1
    python -m tools.rig.campaign --seed 1 --only 17 --watch
    python -m tools.rig.campaign --seed 1 --only 17 --record rig_runs
    python -m tools.rig.campaign --runs 50 --faults 1

Run k of a seed takes the k-th of the scenes in turn and a seed of its own, and is the same in
whatever process and order. Exit status 1: a collision, a crash, runs that differ, or fewer than
nine goals of ten where nothing was made to fail.
"""

import argparse
import concurrent.futures
import contextlib
import json
import logging
import multiprocessing
import os
import random
import signal
import sys
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

import structlog
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from fakes.scenes.scene import campaign_scenes, load_scene
from tools.rig import report
from tools.rig.c_build import CompileError, MissingToolError, shipped_robot
from tools.rig.c_planner import library
from tools.rig.faults import draw
from tools.rig.one_run import LIMIT_S, Run, RunResult, RunSpec
from tools.rig.record import Recorder
from tools.rig.report import Outcome
from tools.rig.watch import Watcher

TOLD_EVERY_S = 5.0  # without a screen
WIDE = 120  # columns, likewise
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")  # a worker has one core


@dataclass(frozen=True, slots=True)
class Task:
    """A run of a campaign, and what is wanted of it beside the result."""

    number: int
    spec: RunSpec
    folder: Path | None = None  # to record it in
    twice: bool = False


def spec_of(
    seed: int, number: int, scenes: Sequence[str], faults: int = 0, limit_s: float = LIMIT_S
) -> RunSpec:
    """Run `number` of a campaign, from the campaign's seed alone."""
    own = random.Random(f"run {seed} {number}").randrange(1, 10**6)
    orders = tuple(draw(own, faults)) if faults else ()
    return RunSpec(scenes[number % len(scenes)], own, orders, limit_s)


def work() -> None:
    """A worker begins: quiet, and ended by Ctrl-C without a word."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    quiet()


def quiet() -> None:
    """No log: thousands of runs would drown a person."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))


def result_of(task: Task, each: Callable[[Run], None] | None = None) -> RunResult:
    """One run from begin to end, recorded where that is wanted."""
    run = Run(task.spec)
    with contextlib.ExitStack() as stack:
        recorder = None
        if task.folder is not None:
            recorder = stack.enter_context(Recorder(run, task.folder))
        while not run.ended:
            run.step()
            if recorder is not None:
                recorder(run)
            if each is not None:
                each(run)
        result = run.result()
        if recorder is not None:
            recorder.finish(result)
    return result


def outcome_of(task: Task, each: Callable[[Run], None] | None = None) -> Outcome:
    """One run, or two that must agree."""
    result = result_of(task, each)
    agreed = None
    if task.twice:
        agreed = result_of(replace(task, folder=None)).digest == result.digest
    return Outcome(task.number, task.spec, result, repeated=agreed)


def outcomes_of(tasks: Sequence[Task], jobs: int) -> Generator[Outcome, None, None]:
    """All runs, as they end, over so many processes."""
    for name in THREADS:
        os.environ.setdefault(name, "1")
    pool = concurrent.futures.ProcessPoolExecutor(
        min(jobs, len(tasks)), multiprocessing.get_context("spawn"), work
    )
    with pool:
        waiting = {pool.submit(outcome_of, task): task for task in tasks}
        try:
            for future in concurrent.futures.as_completed(waiting):
                task, error = waiting[future], future.exception()
                if error is None:
                    yield future.result()
                else:
                    yield Outcome(task.number, task.spec, crash=words_of(error))
        except (KeyboardInterrupt, GeneratorExit):
            pool.shutdown(cancel_futures=True)
            raise


def words_of(error: BaseException) -> str:
    """A crash, with where it happened."""
    if isinstance(error, BrokenProcessPool):
        return "the process that ran it, or one beside it, was killed"
    return "".join(traceback.format_exception(error))


def followed(
    console: Console, tasks: Sequence[Task], outcomes: Iterator[Outcome]
) -> Iterator[Outcome]:
    """The same outcomes, with a bar; or, without a screen, a line now and then."""
    seen: list[Outcome] = []
    if not console.is_terminal:
        told_s = time.monotonic()
        for outcome in outcomes:
            seen.append(outcome)
            if time.monotonic() - told_s >= TOLD_EVERY_S:
                told_s = time.monotonic()
                console.print(f"  {len(seen)} of {len(tasks)} runs: {counts(seen)}", soft_wrap=True)
            yield outcome
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console) as bar:
        followed_task = bar.add_task("runs", total=len(tasks))
        for outcome in outcomes:
            seen.append(outcome)
            bar.update(followed_task, advance=1, description=counts(seen))
            yield outcome


def counts(outcomes: Sequence[Outcome]) -> str:
    """So far, in a few words."""
    results = [outcome.result for outcome in outcomes if outcome.result is not None]
    total = report.totals_of(results)
    crashes = len(outcomes) - len(results)
    return (
        f"{total.reached}/{total.goals} goals, {total.collisions} collisions, "
        f"{total.false_stops} false stops" + (f", {crashes} crashes" if crashes else "")
    )


def arguments_of(arguments: Sequence[str]) -> argparse.Namespace:
    """What a person wrote."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.rig.campaign",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--runs", type=int, default=200, help="how many (200)")
    parser.add_argument("--seed", type=int, default=1, help="of the campaign (1)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--only", type=int, help="this run alone")
    parser.add_argument("--scene", help="all runs in this one, a name or a file")
    parser.add_argument("--faults", type=int, default=0, help="by chance, in each run (0)")
    parser.add_argument("--limit", type=float, default=LIMIT_S, help="simulated seconds of a run")
    parser.add_argument("--watch", action="store_true", help="a live picture of one run")
    parser.add_argument(
        "--speed", type=float, default=1.0, help="of what is watched (1: real time)"
    )
    parser.add_argument("--record", type=Path, help="a folder for bytes, path, events, picture")
    parser.add_argument("--json", type=Path, help="a file for all results")
    parser.add_argument("--markdown", action="store_true", help="the table for a document, too")
    parser.add_argument("--repeatable", action="store_true", help="each run twice: do they agree?")
    options = parser.parse_args(arguments)
    if options.runs < 1 or options.jobs < 1 or options.limit <= 0.0 or options.faults < 0:
        parser.error("--runs, --jobs and --limit must be above 0, --faults not below it")
    return options


def tasks_of(options: argparse.Namespace) -> list[Task]:
    """The runs that are asked for.

    Raises:
        OSError, ValueError: no such scene, or one without goals.
    """
    scenes = [options.scene] if options.scene else list(campaign_scenes())
    for scene in scenes:
        if not load_scene(scene, 1).goals:
            names = ", ".join(campaign_scenes())
            raise ValueError(f"scene '{scene}' has no goals to drive to; these have: {names}")
    if options.only is not None:
        numbers = [options.only]
    else:
        numbers = [0] if options.watch else list(range(options.runs))
    return [
        Task(
            number,
            spec_of(options.seed, number, scenes, options.faults, options.limit),
            options.record / f"run_{number:03d}" if options.record else None,
            options.repeatable,
        )
        for number in numbers
    ]


def again(options: argparse.Namespace) -> str:
    """The words that repeat a run, with {number} in them."""
    words = ["make campaign ONLY={number}", f"SEED={options.seed}", "WATCH=1"]
    words += [f"SCENE={options.scene}"] if options.scene else []
    words += [f"FAULTS={options.faults}"] if options.faults else []
    words += [f'ARGS="--limit {options.limit:g}"'] if options.limit != LIMIT_S else []
    return " ".join(words)


def main(arguments: Sequence[str]) -> int:
    """Exit status."""
    options, begun_s = arguments_of(arguments), time.monotonic()
    console = Console() if sys.stdout.isatty() else Console(width=WIDE)
    try:
        tasks = tasks_of(options)
        library(shipped_robot())  # the planner is compiled before many want it at once
    except (OSError, ValueError, MissingToolError, CompileError) as error:
        print(f"tools.rig.campaign: {error}", file=sys.stderr)
        return 2
    quiet()
    outcomes: list[Outcome] = []
    with contextlib.suppress(KeyboardInterrupt):
        if options.watch:
            with Watcher(console, options.speed) as watcher:
                outcomes.append(outcome_of(tasks[0], watcher))
        else:
            running = outcomes_of(tasks, options.jobs)
            with contextlib.closing(running):
                outcomes += followed(console, tasks, running)
    outcomes.sort(key=lambda outcome: outcome.number)
    passed_s = time.monotonic() - begun_s
    report.show(console, outcomes, len(tasks), again(options), passed_s)
    if options.markdown:
        print(report.markdown([o.result for o in outcomes if o.result is not None]))
    if options.json:
        options.json.write_text(json.dumps(report.as_json(outcomes), indent=1), encoding="utf-8")
    return 0 if report.is_well(outcomes, len(tasks)) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
