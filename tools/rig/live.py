"""The live rig behind `make rig`: real processes, real sockets and ptys, real time.

World and fakes are one process, the unchanged main.py is another, the planner is C on an emulated
Cortex-M3; rig.toml says which of them are real devices instead. A second receiver shows the map as
it comes, and what the planner is about. Ctrl-C, or the end of --seconds, ends all of them, and a
summary tells of goals, collisions in truth, lost ticks, and whether the planner's map is the app's.
"""

import argparse
import contextlib
import math
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from rich.console import Console

from config_file import load_config
from core.config import ConfigError
from fakes.scenes.scene import load_scene
from mapod_link.receiver import Receiver
from mapod_link.wires import UdpWire
from tools.cli.options import ROOT
from tools.cli.view import print_summary, watch
from tools.rig.planner.board import BoardError, EmulatedBoard
from tools.rig.planner.build import CompileError, MissingToolError, robot_from_config
from tools.rig.planner.host import CPlanner, PlannerSettings, PlannerState
from tools.rig.real_time.rig_file import BOARD, DEVICES, HOST, OF_SCENE, RigConfig, load_rig_file
from tools.rig.real_time.story import AppLog, Doubts, Tour, TruthLog
from tools.settings import NotThereError, lens_of
from tools.terminal.planner_end import PlannerEnd, WatchingReceiver
from tools.terminal.processes import (
    RUNNING,
    RunError,
    SimulatedRobot,
    Stop,
    folder_kept_on_failure,
    say,
)
from tools.terminal.screen import has_screen

Window = tuple[npt.NDArray[np.uint8], tuple[int, int]]  # (height, width), and its lowest cell
ASK_EVERY_S = 0.2  # what a board is about
ON_HOST = "the planner's C on this machine, over UDP"
ON_BOARD = "the planner's firmware on an emulated Cortex-M3, its UART on a pty"
DEVICES_S = 45.0  # for all devices to deliver, a scanner that is just being switched on among them
LOOK_S = 0.2  # how often goals, truth and log are looked at
STANDING_S = 1.5  # from "halt" to a robot that stands
DRAIN_S, ATTEMPTS = 0.3, 5  # for what is under way to arrive; to find both maps alike
SECONDS_WITHOUT_SCREEN = 60.0
RIG_ERRORS = (
    RunError, NotThereError, BoardError, MissingToolError, CompileError, ConfigError, ValueError,
    OSError,
)  # fmt: skip


class Form:
    """A planner at work. Without one of ours it is a real MCU: driven by itself, or by nobody."""

    def __init__(
        self,
        url: str,
        words: str = "a real planner",
        planner: CPlanner | EmulatedBoard | None = None,
        wire: UdpWire | None = None,
    ) -> None:
        self.url, self.words = url, words  # the port that the app opens
        self.remark = ""  # why it is another one than was asked for
        self.state: PlannerState | None = None  # as last heard; None: it does not say
        self._planner, self._wire = planner, wire
        self._asked_s = float("-inf")

    def step(self, now_s: float) -> None:
        if isinstance(self._planner, EmulatedBoard):
            if now_s - self._asked_s >= ASK_EVERY_S:
                self._asked_s, self.state = now_s, self._planner.state()
        elif self._planner and self._wire:
            self._wire.feed(cast(Receiver, self._planner))  # it asks for no more than datagrams
            for frame in self._planner.poll(now_s):
                self._wire.write(frame)
            self.state = self._planner.state(now_s)

    def goal(self, x_m: float, y_m: float) -> None:
        if self._planner:
            self._planner.goal(x_m, y_m)

    def halt(self) -> None:
        if self._planner:
            self._planner.halt()

    def maybe_map(self) -> Window | None:
        return self._planner.snapshot() if self._planner else None

    def close(self) -> None:
        if isinstance(self._planner, EmulatedBoard):
            self._planner.close()
        if self._wire:
            self._wire.close()


def form_of(config: RigConfig, clear_m: float, folder: Path) -> Form:
    """The planner that the bench asks for; the one here, where there is no emulator.

    Args:
        clear_m: how far around the start the operator vouches for the ground.

    Raises:
        MissingToolError: not even this machine's compiler is there.
        ConfigError: the robot of the settings is none that the planner in C can drive.
    """
    wanted, remark = config.devices.planner, ""
    if wanted not in (BOARD, HOST):
        return Form(wanted)
    robot = robot_from_config(load_config(Path(config.robot.config).read_text(encoding="utf-8")))
    settings = PlannerSettings(clear_m, config.planner.unknown_mps, robot)
    if wanted == BOARD:
        try:
            (folder / "board").mkdir(exist_ok=True)
            board = EmulatedBoard(settings, folder / "board", link="pty")
            url = f"serial://{board.link_path}?baud={config.planner.board_baud}"
            return Form(url, ON_BOARD, board)
        except MissingToolError as missing:
            remark = f"{missing}; taking the planner's C on this machine instead"
    wire = UdpWire("127.0.0.1", 0)
    form = Form(wire.url, ON_HOST, CPlanner(settings, config.world.seed + 1), wire)
    form.remark = remark
    return form


class Bench:
    """All that `make rig` starts, in a folder of its own."""

    def __init__(self, config: RigConfig, options: argparse.Namespace, folder: Path) -> None:
        self._config, self._options, self.robot = config, options, SimulatedRobot(folder)
        scene, is_real = load_scene(config.world.scene, config.world.seed), config.devices.real
        clear_m = config.planner.start_clear_m
        self._clear_m = scene.start_clear_m if clear_m == OF_SCENE else float(clear_m)
        self.log, self.doubts = AppLog(folder / "app.log"), Doubts()
        # with a real drive the world's robot stands, and nothing of it is true
        self.truth = None if "drive" in is_real else TruthLog(folder / "truth.jsonl", scene)
        self.end = PlannerEnd(UdpWire("127.0.0.1", 0), WatchingReceiver())
        self.form = form_of(config, self._clear_m, folder)
        self.tour = Tour(config.world.goals or (scene.goals if self.truth else ()), self.form.goal)
        self._looked_s = -math.inf
        self._started_s: float | None = None  # when the app was seen to have started

    def start(self, stop: Stop) -> None:
        """Fakes, then the app on their ports, on those of the real devices and on the planner's."""
        world = [] if len(self._config.devices.real) == len(DEVICES) else self._fakes_words()
        self.robot.start(world, Path(self._config.robot.config), self.values(), stop)

    def _fakes_words(self) -> list[str]:
        world, real = self._config.world, self._config.devices.real
        words = [sys.executable, "-m", "fakes", "--scene", world.scene, "--seed", str(world.seed)]
        settings = load_config(Path(self._config.robot.config).read_text(encoding="utf-8"))
        words += ["--lens", *map(str, lens_of(settings))]
        words += ["--no-driver", "--drive-mode", "rs232_watchdog"]
        words += ["--sheet-errors"] if world.sensors == "sheet" else []
        for name in real:
            words += ["--leave-out", name]
        for fault in self._options.fault:
            words += ["--fault", fault]
        words += ["--truth", str(self.robot.folder / "truth.jsonl")] if self.truth else []
        return words

    def values(self) -> dict[str, Any]:
        real = self._config.devices.real
        values: dict[str, Any] = {f"{name}.port": port for name, port in real.items()}
        values["planner.port"] = [self.form.url, self.end.wire.url]
        values["robot.start_clear_m"] = self._clear_m
        if self.truth:  # else the file's own word counts
            values["robot.enable_motors"] = True
        if self._config.planner.unknown_mps > 0:
            values["robot.unknown_stops"] = False
        return values | {"log.level": "debug", "log.format": "json"}

    # While it runs

    def done(self, now_s: float) -> bool:
        """Move all on; True once it has run for as long as it should.

        Raises:
            RunError: it cannot go on.
        """
        self.form.step(now_s)
        self.doubts.step(now_s, *self.end.planner.advice(now_s))
        if now_s - self._looked_s < LOOK_S:
            return False
        self._looked_s = now_s
        self.log.step()
        if self.truth:
            self.truth.step()
        if not self.robot.has_map(now_s, self.end.planner, RUNNING):
            self._check_devices(now_s)
            return False
        gap_m = self.truth.gap_m if self.truth else lambda x_m, y_m: math.nan
        self.tour.step(now_s, self.form.state, gap_m)
        seconds = self._options.seconds
        over = self.tour.is_over and self.tour.total > 0 and seconds is not None
        return over or now_s >= self.robot.mapped_s + (seconds or math.inf)

    def _check_devices(self, now_s: float) -> None:
        """Raises RunError once they have been waited for long enough."""
        if self.log.has_started and self._started_s is None:
            self._started_s = now_s
        if self._started_s is not None and now_s - self._started_s > DEVICES_S:
            missing = self.log.missing or "all devices deliver"
            raise RunError(f"no map {DEVICES_S:.0f} s after the app's start; {missing}")

    def words(self) -> list[str]:
        state, visit, pose = self.form.state, self.tour.now, self.end.planner.pose
        told = [f"{self._config.world.scene}, seed {self._config.world.seed}"]
        if state is None:
            told.append("planner does not say what it is about")
        else:
            told.append(f"planner {state.state} {state.why}".rstrip())
            told.append(f"asks {state.v_mps:+.2f} m/s {state.w_radps:+.2f} rad/s")
        if visit is not None:
            x_m, y_m = visit.goal
            place = f"goal {len(self.tour.visits)} of {self.tour.total} at ({x_m:.1f}, {y_m:.1f}) m"
            off_m = math.nan if pose is None else math.hypot(x_m - pose.x_m, y_m - pose.y_m)
            told.append(f"{place}, {off_m:.1f} m off")
        told.append(f"mapod {self.log.blocked_by or 'no objection'}")
        told += [f"waits {self.log.missing}"] if self.log.missing else []
        told += [f"truth {len(self.truth.judge.collisions)} collisions"] if self.truth else []
        return [*told, self.log.words]

    # At the end

    def compared_maps(self) -> tuple[str, bool]:
        """Halts, holds the app still, compares both receivers' maps: words, whether they differ."""
        app = self.robot.children[-1] if self.robot.children else None
        if app is None or app.name != "app":  # told to end before it was started
            return "the maps were not compared", False
        self.form.halt()
        self.run(STANDING_S)
        self.log.step()  # held still, it loses some more ticks
        found = "", True
        for _ in range(ATTEMPTS):
            os.kill(app.pid, signal.SIGSTOP)
            try:
                self.run(DRAIN_S)
                found = self._difference()
            finally:
                os.kill(app.pid, signal.SIGCONT)
            if not found[1]:
                break
            self.run(DRAIN_S)
        return found

    def _difference(self) -> tuple[str, bool]:
        told, planner = self.form.maybe_map(), self.end.planner
        if told is None:
            return "the planner does not tell its map", False
        (window, at), ours, origin = told, planner.window(), planner.origin
        if at != origin or window.shape != ours.shape:
            return f"the planner's map differs: its window lies at {at}, ours at {origin}", True
        wrong, size = int((window != ours).sum()), ours.size
        if wrong:
            return f"the planner's map differs in {wrong} of {size} cells", True
        equal = f"the planner's map equals the second receiver's in all {size} cells"
        digest = "is" if planner.needs.digest_ok else "was not"
        return f"{equal}, whose digest {digest} the app's", planner.needs.full

    def run(self, seconds: float) -> None:
        until_s = time.monotonic() + seconds
        while (now_s := self.end.step(0.02)) < until_s:
            self.form.step(now_s)

    def close(self) -> None:
        self.form.close()
        self.end.wire.close()


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
    add = parser.add_argument
    add("--config", default=str(ROOT / "rig.toml"), help="the bench")
    add("--seconds", type=float, help="end after so long; 60 without a terminal")
    add("--scene", help="instead of the file's")
    add("--seed", type=int, help="instead of the file's")
    add("--planner", help="instead of the file's: board, host, or a port")
    add(
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
