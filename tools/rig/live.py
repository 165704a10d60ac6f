"""The live rig behind `make rig`: real processes, real sockets and ptys, real time.

World and fakes are one process, the unchanged main.py is another, the planner is C on an emulated
Cortex-M3; rig.toml says which of them are real devices instead. A second receiver shows the map as
it comes, and what the planner is about. Ctrl-C, or the end of --seconds, ends all of them, and a
summary tells of goals, collisions in truth, lost ticks, and whether the planner's map is the app's.
"""

import argparse
import contextlib
import sys
from pathlib import Path

from rich.console import Console

from core.config import ConfigError
from tools.cli.options import ROOT
from tools.cli.view import print_summary, watch
from tools.rig.bench import Bench
from tools.rig.board import BoardError
from tools.rig.c_build import CompileError, MissingToolError
from tools.rig.config import RigConfig, load_rig_file
from tools.settings import NotThereError
from tools.terminal.processes import RunError, Stop, folder_kept_on_failure, say
from tools.terminal.screen import has_screen

SECONDS_WITHOUT_SCREEN = 60.0
RIG_ERRORS = (
    RunError, NotThereError, BoardError, MissingToolError, CompileError, ConfigError, ValueError,
    OSError,
)  # fmt: skip


def summary(bench: Bench, console: Console, now_s: float, maps: tuple[str, bool]) -> bool:
    print_summary(bench.end, console, now_s)
    tour = bench.tour
    say(f"{tour.reached} of {tour.total} goals reached")
    for visit in tour.visits:
        say(f"  {visit.words(now_s)}")
    for words in bench.doubts.words(now_s):
        say(f"the link said stop: {words}")
    hits = 0
    if bench.truth:
        bench.truth.step()
        judge = bench.truth.judge
        hits = len(judge.collisions)
        say(f"{hits} collisions; driven {judge.driven_m:.1f} m")
        for contact in judge.collisions:
            say(f"  {contact.words()}")
    else:
        say("collisions are not judged: the robot that moves is no simulated one")
    taken = bench.log.real_time
    fifo = "taken" if taken.get("sched_fifo") else "not permitted"
    locked = "locked" if taken.get("memory_locked") else "not locked"
    say(f"{bench.log.words}; SCHED_FIFO {fifo}, memory {locked}")
    say(maps[0])
    given_up = any(visit.why for visit in tour.visits)
    return hits == 0 and not given_up and not maps[1]


def run(config: RigConfig, options: argparse.Namespace, console: Console) -> int:
    if options.seconds is None and not has_screen(console):
        options.seconds = SECONDS_WITHOUT_SCREEN
    try:
        with folder_kept_on_failure() as folder, Stop().on_signals() as stop:
            say(f'setting up "{config.world.scene}" (seed {config.world.seed})')
            with contextlib.closing(Bench(config, options, folder)) as bench, bench.robot.ended():
                say(bench.form.remark or f"planner: {bench.form.words}")
                for name, port in config.devices.real.items():
                    say(f"{name}: the real one at {port}")
                bench.start(stop)
                watch(
                    bench.end,
                    console,
                    lambda now_s: stop.wanted or bench.done(now_s),
                    lambda now_s: "\n".join(bench.words()),
                )
                maps = bench.compared_maps()
                now_s = bench.end.step(0.0)
            well = summary(bench, console, now_s, maps)
    except RIG_ERRORS as error:
        print(f"mapod: {error}", file=sys.stderr, flush=True)
        return 1
    say("all processes have ended")
    return 0 if well else 1


def main(arguments: list[str]) -> int:
    """Exit status; 2 for settings that can't be used."""
    parser = argparse.ArgumentParser(prog="python -m tools.rig.live", description=__doc__)
    parser.add_argument("--config", default=str(ROOT / "rig.toml"), help="the bench")
    parser.add_argument("--seconds", type=float, help="end after so long; 60 without a terminal")
    parser.add_argument("--scene", help="instead of the file's")
    parser.add_argument("--seed", type=int, help="instead of the file's")
    parser.add_argument("--planner", help="instead of the file's: board, host, or a port")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="DEVICE.NAME@..",
        help="of a fake; repeatable",
    )
    options = parser.parse_args(arguments)
    given = {
        "world.scene": options.scene,
        "world.seed": options.seed,
        "devices.planner": options.planner,
    }
    try:
        changes = {name: value for name, value in given.items() if value is not None}
        config = load_rig_file(Path(options.config), changes)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 2
    return run(config, options, Console())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
