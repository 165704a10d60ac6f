"""Many runs by chance, on all cores, each judged by the truth: `make campaign N=200`.

    python -m tools.rig.campaign --runs 200 --seed 1
    python -m tools.rig.campaign --seed 1 --only 17 --watch
    python -m tools.rig.campaign --seed 1 --only 17 --record rig_runs
    python -m tools.rig.campaign --runs 50 --faults 1
    python -m tools.rig.campaign --runs 200 --resume campaign_rows

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
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from config_file import load_config
from core.run_settings import Robot
from fakes.scenes.mixed import MIXED
from fakes.scenes.scene import campaign_scenes, load_scene
from tools.rig.faults.catalogue import draw
from tools.rig.planner.build import CompileError, MissingToolError, shipped_robot
from tools.rig.planner.host import library
from tools.rig.runs.loop import ROBOTS, SHIPPED
from tools.rig.runs.one_run import LIMIT_S, Run, RunSpec
from tools.rig.runs.outcomes import Outcome, as_json, counts, is_well, show
from tools.rig.runs.record import Recorder, facts_of, recorded_run, result_from_facts
from tools.rig.runs.sheet import draw_sheet
from tools.rig.runs.watch import Watcher
from tools.sweep.cluster import DaskCluster
from tools.sweep.code import code_digest, digest_of
from tools.sweep.engine import Done, done_before, run_missing
from tools.sweep.jobs import Scheduler, SchedulerError, with_bar
from tools.sweep.local import LocalProcesses
from tools.sweep.rows import FolderError, Row, Rows

DECIDES = ("fakes", "tools/rig", "recording", "mapod.toml", "robots")  # a run, beside the app
WIDE = 120  # columns, without a screen


@dataclass(frozen=True, slots=True)
class Task:
    """A run of a campaign, and what is wanted of it beside the result."""

    number: int
    spec: RunSpec
    folder: Path | None = None  # to record it in


def spec_of(
    seed: int, number: int, scenes: Sequence[str], faults: int = 0, limit_s: float = LIMIT_S,
    robot: str = "",
) -> RunSpec:  # fmt: skip
    own = random.Random(f"run {seed} {number}").randrange(1, 10**6)
    orders = tuple(draw(own, faults)) if faults else ()
    return RunSpec(scenes[number % len(scenes)], own, orders, limit_s, robot)


def outcome_of(task: Task, *each: Callable[[Run], None]) -> Outcome:
    if task.folder is None:
        return Outcome(task.number, task.spec, Run(task.spec).to_end(*each))
    run = recorded_run(task.spec, task.folder)
    with Recorder(run, task.folder) as recorder:
        result = run.to_end(recorder, *each)
        recorder.finish(result)
    return Outcome(task.number, task.spec, result)


def row_of(task: Task) -> Row:
    result = outcome_of(task).result
    assert result is not None
    return facts_of(result)


def tasks_by_key(tasks: Iterable[Task]) -> dict[str, Task]:
    """By a digest of all that decides a run, and of where it is recorded."""
    code, found = code_digest(*DECIDES), {}
    for task in tasks:
        spec, scene = task.spec, Path(str(task.spec.scene))
        own = scene.read_bytes() if scene.is_file() else b""
        what = (str(spec.scene), spec.seed, spec.faults, spec.limit_s, spec.robot)
        facts = (*what, str(task.folder))
        found[digest_of(code, repr(facts), own)] = task
    return found


class Outcomes:
    """Of all these runs, what was kept of them before, and the others as they end."""

    def __init__(self, tasks: Sequence[Task], rows: Rows | None = None) -> None:
        self._tasks, self._rows = tasks_by_key(tasks), rows
        self.before = [self._outcome(done) for done in done_before(self._tasks, rows)]

    def _outcome(self, done: Done) -> Outcome:
        task = self._tasks[done.key]
        if done.failed:
            return Outcome(task.number, task.spec, crash=done.failed)
        return Outcome(task.number, task.spec, result_from_facts(done.row))

    def missing(self, scheduler: Scheduler) -> Iterator[Outcome]:
        with contextlib.closing(run_missing(row_of, self._tasks, self._rows, scheduler)) as ended:
            for done in ended:
                yield self._outcome(done)


def arguments_of(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tools.rig.campaign",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--runs", type=int, default=200, help="how many (200)")
    add("--seed", type=int, default=1, help="of the campaign (1)")
    add("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    add("--only", type=int, help="this run alone")
    add("--scene", help="all runs in this one, a name or a file")
    add("--mixed", action="store_true", help="in rooms by chance, with things of all scenes")
    add("--robot", default="", help="another one, of robots/, on the same body: urg04lx")
    add("--faults", type=int, default=0, help="by chance, in each run (0)")
    add("--limit", type=float, default=LIMIT_S, help="simulated seconds of a run")
    add("--watch", action="store_true", help="a live picture of one run")
    add("--speed", type=float, default=1.0, help="of what is watched (1: real time)")
    add("--resume", type=Path, help="a folder that keeps each result; begun again, the rest is run")
    add("--scheduler", default="", help="a Dask cluster, tcp://host:8786, instead of --jobs")
    add("--record", type=Path, help="a folder for bytes, path, events, picture")
    add("--misses", type=Path, help="a folder to record each run in that missed a goal, once more")
    add("--json", type=Path, help="a file for all results")
    add("--markdown", action="store_true", help="the table for a document")
    options = parser.parse_args(arguments)
    if options.mixed and options.scene:
        parser.error("--mixed has scenes of its own: no --scene with it")
    options.scene = MIXED if options.mixed else options.scene
    if options.runs < 1 or options.jobs < 1 or options.limit <= 0.0 or options.faults < 0:
        parser.error("--runs, --jobs and --limit must be above 0, --faults not below it")
    return options


def folder_of(root: Path, number: int) -> Path:
    return root / f"run_{number:03d}"


def driven() -> list[str]:
    """Robots of robots/ on the body and the wheels of the shipped one: its planner drives them."""
    shipped, found = load_config(SHIPPED.read_text(encoding="utf-8")), list[str]()
    for path in sorted(ROBOTS.glob("*.toml")):
        config = load_config(path.read_text(encoding="utf-8"))
        if config.drive == shipped.drive and body_of(config.robot) == body_of(shipped.robot):
            found.append(path.stem)
    return found


def body_of(robot: Robot) -> tuple[float, ...]:
    """Its footprint and height, and its wheels."""
    wheels = robot.wheel_radius_m, robot.encoder_ppr, robot.gear_ratio, robot.track_width_m
    return robot.front_m, robot.rear_m, robot.width_m, robot.height_m, *wheels


def tasks_of(options: argparse.Namespace) -> list[Task]:
    """Raises OSError, ValueError: no such scene, or one without goals; no such robot."""
    if options.robot not in ("", *driven()):
        raise ValueError(f"--robot: must be one of {', '.join(driven())}, is {options.robot!r}")
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
            spec_of(options.seed, number, scenes, options.faults, options.limit, options.robot),
            folder_of(options.record, number) if options.record else None,
        )
        for number in numbers
    ]


def again(options: argparse.Namespace) -> str:
    words = ["make campaign ONLY={number}", f"SEED={options.seed}", "WATCH=1"]
    words += [f"SCENE={options.scene}"] if options.scene else []
    words += [f"FAULTS={options.faults}"] if options.faults else []
    more = [f"--robot {options.robot}"] if options.robot else []
    more += [f"--limit {options.limit:g}"] if options.limit != LIMIT_S else []
    words += [f'ARGS="{" ".join(more)}"'] if more else []
    return " ".join(words)


def kept_rows(options: argparse.Namespace) -> contextlib.AbstractContextManager[Rows | None]:
    """Where results are kept, if they are. Raises FolderError, OSError."""
    if options.resume is None:
        return contextlib.nullcontext()
    what = {"kind": "campaign", "seed": options.seed, "scene": options.scene}
    what |= {"faults": options.faults, "limit_s": options.limit, "robot": options.robot}
    return Rows(options.resume, what)


def run_all(
    options: argparse.Namespace, tasks: Sequence[Task], console: Console, found: list[Outcome]
) -> int:
    """Adds outcomes as they come; how many were there before.

    Raises:
        FolderError, OSError: of the folder that keeps them. SchedulerError: nobody runs them.
    """
    address = options.scheduler
    scheduler = DaskCluster(address) if address else LocalProcesses(options.jobs)
    with kept_rows(options) as rows:
        outcomes = Outcomes(tasks, rows)
        found += outcomes.before
        if found:
            console.print(f"{len(found)} of {len(tasks)} runs were done before")
        running = outcomes.missing(scheduler)
        for outcome in with_bar(console, len(tasks), running, counts, done=outcomes.before):
            found.append(outcome)
    return len(outcomes.before)


def record_misses(
    options: argparse.Namespace, outcomes: Sequence[Outcome], console: Console
) -> None:
    """Run what crashed, collided or missed a goal once more, and record it, with a picture.

    `misses.png` in their folder has all pictures on one sheet, with the causes.
    """
    tasks = [
        Task(outcome.number, outcome.spec, folder_of(options.misses, outcome.number))
        for outcome in outcomes
        if outcome.result is None or outcome.result.collisions or outcome.result.missed
    ]
    if not tasks:
        return
    console.print(f"recording {len(tasks)} of these runs in {options.misses}, each with a picture")
    running, drawn = Outcomes(tasks).missing(LocalProcesses(options.jobs)), list[Path]()
    for outcome in with_bar(console, len(tasks), running, counts):
        if not outcome.crash:
            drawn.append(folder_of(options.misses, outcome.number))
        else:
            console.print(
                f"run {outcome.number} was not recorded: {outcome.crash.splitlines()[-1]}",
                markup=False,
            )
    if drawn:
        draw_sheet(sorted(drawn), options.misses / "misses.png")


def main(arguments: Sequence[str]) -> int:
    options, begun_s = arguments_of(arguments), time.monotonic()
    console = Console() if sys.stdout.isatty() else Console(width=WIDE)
    outcomes: list[Outcome] = []
    before = 0
    try:
        tasks = tasks_of(options)
        for folder in filter(None, (options.record, options.misses)):
            folder.mkdir(parents=True, exist_ok=True)
        library(shipped_robot())  # the planner is compiled before many want it at once
    except (OSError, ValueError, MissingToolError, CompileError) as error:
        print(f"tools.rig.campaign: {error}", file=sys.stderr)
        return 2
    try:
        with contextlib.suppress(KeyboardInterrupt):
            if options.watch:
                with Watcher(console, options.speed) as watcher:
                    outcomes.append(outcome_of(tasks[0], watcher))
            else:
                before = run_all(options, tasks, console, outcomes)
    except (OSError, FolderError, SchedulerError) as error:
        print(f"tools.rig.campaign: {error}", file=sys.stderr)
        if not outcomes:
            return 2
    outcomes.sort(key=lambda outcome: outcome.number)
    passed_s = None if before else time.monotonic() - begun_s
    show(console, outcomes, len(tasks), again(options), passed_s, options.markdown)
    if options.json:
        options.json.write_text(json.dumps(as_json(outcomes), indent=1), encoding="utf-8")
    if options.misses:
        with contextlib.suppress(KeyboardInterrupt):
            record_misses(options, outcomes, console)
    return 0 if is_well(outcomes, len(tasks)) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
