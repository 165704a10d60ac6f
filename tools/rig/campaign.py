"""Many runs by chance, on all cores, each judged by the truth: `make campaign N=200`.

    python -m tools.rig.campaign --runs 200 --seed 1
    python -m tools.rig.campaign --seed 1 --only 17 --watch
    python -m tools.rig.campaign --seed 1 --only 17 --record rig_runs
    python -m tools.rig.campaign --runs 50 --faults 1

Run k of a seed takes the k-th of the scenes in turn and a seed of its own, and is the same in
whatever process and order. Exit status 1: a collision, a crash, or fewer than nine goals of ten
where nothing was made to fail.
"""

import argparse
import contextlib
import json
import os
import random
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from fakes.scenes.scene import campaign_scenes, load_scene
from tools.rig import report
from tools.rig.c_build import CompileError, MissingToolError, shipped_robot
from tools.rig.c_planner import library
from tools.rig.faults import draw
from tools.rig.one_run import LIMIT_S, Run, RunSpec
from tools.rig.pool import results_of, with_bar
from tools.rig.record import Recorder
from tools.rig.report import Outcome
from tools.rig.watch import Watcher
from tools.terminal.progress import quiet

WIDE = 120  # columns, without a screen


@dataclass(frozen=True, slots=True)
class Task:
    """A run of a campaign, and what is wanted of it beside the result."""

    number: int
    spec: RunSpec
    folder: Path | None = None  # to record it in


def spec_of(
    seed: int, number: int, scenes: Sequence[str], faults: int = 0, limit_s: float = LIMIT_S
) -> RunSpec:
    own = random.Random(f"run {seed} {number}").randrange(1, 10**6)
    orders = tuple(draw(own, faults)) if faults else ()
    return RunSpec(scenes[number % len(scenes)], own, orders, limit_s)


def outcome_of(task: Task, *each: Callable[[Run], None]) -> Outcome:
    run = Run(task.spec)
    if task.folder is None:
        return Outcome(task.number, task.spec, run.to_end(*each))
    with Recorder(run, task.folder) as recorder:
        result = run.to_end(recorder, *each)
        recorder.finish(result)
    return Outcome(task.number, task.spec, result)


def outcomes_of(tasks: Sequence[Task], jobs: int) -> Iterator[Outcome]:
    with contextlib.closing(results_of(outcome_of, tasks, jobs)) as results:
        for task, result in results:
            if isinstance(result, str):
                result = Outcome(task.number, task.spec, crash=result)
            yield result


def arguments_of(arguments: Sequence[str]) -> argparse.Namespace:
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
    parser.add_argument("--markdown", action="store_true", help="the table for a document")
    options = parser.parse_args(arguments)
    if options.runs < 1 or options.jobs < 1 or options.limit <= 0.0 or options.faults < 0:
        parser.error("--runs, --jobs and --limit must be above 0, --faults not below it")
    return options


def tasks_of(options: argparse.Namespace) -> list[Task]:
    """Raises OSError, ValueError: no such scene, or one without goals."""
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
            outcomes += with_bar(console, len(tasks), running, report.counts)
    outcomes.sort(key=lambda outcome: outcome.number)
    passed_s = time.monotonic() - begun_s
    report.show(console, outcomes, len(tasks), again(options), passed_s, options.markdown)
    if options.json:
        options.json.write_text(json.dumps(report.as_json(outcomes), indent=1), encoding="utf-8")
    return 0 if report.is_well(outcomes, len(tasks)) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
