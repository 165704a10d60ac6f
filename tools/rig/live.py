"""The live rig behind `make rig`: real processes, real sockets and ptys, real time.

World and fakes are one process, the unchanged main.py is another, the planner is C on an emulated
Cortex-M3; rig.toml says which of them are real devices instead. A second receiver shows the map as
it comes, and what the planner is about. Ctrl-C, or the end of --seconds, ends all of them, and a
summary tells of goals, collisions in truth, lost ticks, and whether the planner's map is the app's.
"""

import argparse
import math
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from core.config import ConfigError
from fakes.planner import FakePlanner
from fakes.scene import Scene, load_scene
from mapod_link.wires import UdpWire
from tools.planner_end import PlannerEnd
from tools.rig.c_build import MissingToolError
from tools.rig.c_planner import PlannerSettings
from tools.rig.config import DEVICES, SHEET, RigConfig, load_rig_file
from tools.rig.followed import Followed
from tools.rig.forms import form_of
from tools.rig.live_picture import show
from tools.rig.story import AppLog, Doubts, Tour
from tools.rig.watch import STATES
from tools.run import (
    FIRST_MAP_S,
    ROOT,
    Child,
    RunError,
    folder_kept_on_failure,
    ports_of,
    rewritten,
    say,
)
from tools.screen import BAD, POOR, has_screen, labelled
from tools.view import ACK_EVERY, Stop, print_summary, watch

SECONDS_WITHOUT_SCREEN = 60.0
LOOK_S = 0.2  # how often goals, truth and log are looked at
STANDING_S = 1.5  # from "halt" to a robot that stands
DRAIN_S, ATTEMPTS = 0.3, 5  # for what is under way to arrive; to find both maps alike


@dataclass(slots=True)
class Outcome:
    """What is to be said at the end."""

    map_words: str = ""
    map_differs: bool = False


class Bench:
    """All that `make rig` starts, in a folder of its own."""

    def __init__(self, config: RigConfig, options: argparse.Namespace, folder: Path) -> None:
        self._config, self._options, self._folder = config, options, folder
        self._children: list[Child] = []
        self.scene: Scene = load_scene(config.scene, config.seed)
        clear_m = config.start_clear_m
        self._clear_m = self.scene.start_clear_m if clear_m is None else clear_m
        self.log = AppLog(folder / "app.log")
        self.followed: Followed | None = None
        self.doubts, self.outcome = Doubts(), Outcome()
        self._wire = UdpWire("127.0.0.1", 0)
        self.end = PlannerEnd(self._wire, FakePlanner(config.seed, None, ACK_EVERY))
        settings = PlannerSettings(start_clear_m=self._clear_m, unknown_mps=config.unknown_mps)
        self.form, self.remark = form_of(config, settings, folder)
        self.tour = Tour(config.goals or self.scene.goals, self.form.goal)
        self._looked_s = self._until_s = float("-inf")
        self._overdue_s = float("inf")

    def start(self, stop: Stop) -> None:
        """Fakes, then the app on their ports, on those of the real devices and on the planner's.

        Raises:
            RunError: one of them fails.
        """
        ports = self._config.real
        if len(ports) < len(DEVICES):
            told = ports_of(self._start("fakes", self._fakes_words(ports)), stop)
            if told is None:
                return
            ports = told | ports
        config = self._folder / "mapod.toml"
        config.write_text(rewritten(Path(self._config.config).read_text(), self._values(ports)))
        self._app = self._start("app", [str(ROOT / "main.py"), "--config", str(config)])
        self._overdue_s = time.monotonic() + FIRST_MAP_S

    def _fakes_words(self, real: dict[str, str]) -> list[str]:
        config = self._config
        words = ["-m", "fakes", "--scene", config.scene, "--seed", str(config.seed)]
        words += ["--no-driver", "--drive-mode", "rs232_watchdog"]
        words += ["--sheet-errors"] if config.sensors == SHEET else []
        for name in real:
            words += ["--leave-out", name]
        for fault in self._options.fault:
            words += ["--fault", fault]
        if "drive" not in real:  # else the world's robot stands, and nothing of it is true
            truth = self._folder / "truth.jsonl"
            words += ["--truth", str(truth)]
            self.followed = Followed(truth, self.scene)
        return words

    def _values(self, ports: dict[str, str]) -> dict[str, Any]:
        """What the app's settings become."""
        values: dict[str, Any] = {f"{name}.port": port for name, port in ports.items()}
        values["planner.port"] = [self.form.url, self._wire.url]
        values["robot.enable_motors"] = True
        values["robot.start_clear_m"] = self._clear_m
        if self._config.unknown_mps > 0:
            values["robot.unknown_stops"] = False
        return values | {"log.level": "debug", "log.format": "json"}

    def _start(self, name: str, words: list[str]) -> Child:
        self._children.append(Child(name, [sys.executable, *words], self._folder))
        return self._children[-1]

    # While it runs

    def done(self, now_s: float) -> bool:
        """Move all on; True once it has run for as long as it should.

        Raises:
            RunError: it cannot go on.
        """
        self.form.step(now_s)
        planner = self.end.planner
        self.doubts.step(now_s, *planner.advice(now_s))
        if now_s - self._looked_s < LOOK_S:
            return False
        self._looked_s = now_s
        for child in self._children:
            child.check_alive()
        self.log.step()
        if self.followed:
            self.followed.step()
        if self._is_running:
            if self._overdue_s < float("inf"):
                self._overdue_s = float("inf")
                self._until_s = now_s + (self._options.seconds or float("inf"))
            self.tour.step(now_s, self.form.state, self._gap_m)
        elif now_s > self._overdue_s:
            raise RunError(f"no map within {FIRST_MAP_S:.0f} s:\n{self._app.last_words()}")
        over = self.tour.is_over and self.tour.total > 0 and self._options.seconds is not None
        return over or (self._until_s > 0 and now_s >= self._until_s)

    @property
    def _is_running(self) -> bool:
        planner = self.end.planner
        running = not planner.blank and planner.pose is not None and planner.pose.mode == 1
        return running or self._overdue_s == float("inf")

    def _gap_m(self, x_m: float, y_m: float) -> float:
        return self.followed.gap_m(x_m, y_m) if self.followed else float("nan")

    def lines(self, now_s: float) -> list[Text]:
        """What the rig itself knows, one thing a line."""
        state, visit = self.form.state, self.tour.now
        told = [Text(f"{self._config.scene}, seed {self._config.seed}", "bold")]
        if state is None:
            told.append(labelled("planner", "does not say what it is about"))
        else:
            told.append(labelled("planner", f"{state.state} {state.why}", STATES[state.state]))
            told.append(labelled("asks", f"{state.v_mps:+.2f} m/s  {state.w_radps:+.2f} rad/s"))
        if visit is not None:
            told.append(labelled("goal", f"{self._goal_words(visit.goal)}"))
        blocked = self.log.blocked_by
        told.append(labelled("mapod", blocked or "no objection", POOR if blocked else ""))
        if self.followed:
            hits = self.followed.hits
            told.append(labelled("truth", f"{hits} collisions", BAD if hits else ""))
        told.append(labelled("ticks", self.log.words, POOR if self.log.missed else ""))
        return told

    def _goal_words(self, goal: tuple[float, float]) -> str:
        words = f"{len(self.tour.visits)} of {self.tour.total} at ({goal[0]:.1f}, {goal[1]:.1f}) m"
        pose = self.end.planner.pose
        if pose is None:
            return words
        return f"{words}, {math.hypot(goal[0] - pose.x_m, goal[1] - pose.y_m):.1f} m off"

    def words(self, now_s: float) -> str:
        """The same in a line, where there is no screen."""
        return "; ".join(" ".join(line.plain.split()) for line in self.lines(now_s))

    @property
    def goal(self) -> tuple[float, float] | None:
        """The goal under way."""
        return None if self.tour.now is None else self.tour.now.goal

    # At the end

    def compare_maps(self) -> None:
        """Halt, then hold the app still, and compare both receivers' maps cell for cell."""
        self.form.halt()
        self.run(STANDING_S)
        for _ in range(ATTEMPTS):
            os.kill(self._app.pid, signal.SIGSTOP)
            try:
                self.run(DRAIN_S)
                self.outcome = self._compared()
            finally:
                os.kill(self._app.pid, signal.SIGCONT)
            if not self.outcome.map_differs:
                return
            self.run(DRAIN_S)

    def _compared(self) -> Outcome:
        told = self.form.maybe_map()
        if told is None:
            return Outcome("the planner does not tell its map")
        window, origin = told
        ours, planner = self.end.planner.window(), self.end.planner
        if planner.origin != origin or window.shape != ours.shape:
            where = f"its window lies at {origin}, ours at {planner.origin}"
            return Outcome(f"the planner's map differs: {where}", True)
        wrong = int((window != ours).sum())
        if wrong:
            return Outcome(f"the planner's map differs in {wrong} of {ours.size} cells", True)
        return Outcome(f"the planner's map equals the app's in all {ours.size} cells")

    def run(self, seconds: float) -> None:
        """Serve all ends for so long."""
        until_s = time.monotonic() + seconds
        while (now_s := self.end.step(0.02)) < until_s:
            self.form.step(now_s)

    def close(self) -> list[str]:
        """End the app, the fakes and the planner; what did not end well."""
        complaints = [child.end() for child in reversed(self._children)]
        self.form.close()
        self._wire.close()
        return [complaint for complaint in complaints if complaint]


def summary(bench: Bench, console: Console, now_s: float) -> bool:
    """Tell how it went; whether it went well."""
    print_summary(bench.end, console, now_s)
    tour = bench.tour
    say(f"{tour.reached} of {tour.total} goals reached")
    for visit in tour.visits:
        say(f"  {visit.words(now_s)}")
    for words in bench.doubts.words(now_s):
        say(f"the link said stop: {words}")
    hits = 0
    if bench.followed:
        bench.followed.step()
        judge, hits = bench.followed.judge, bench.followed.hits
        say(f"{hits} collisions; driven {judge.driven_m:.1f} m")
        for contact in judge.collisions:
            say(f"  {contact.words()}")
    else:
        say("collisions are not judged: the robot that moves is no simulated one")
    taken = bench.log.real_time
    fifo = "taken" if taken.get("sched_fifo") else "not permitted"
    locked = "locked" if taken.get("memory_locked") else "not locked"
    say(f"{bench.log.words}; SCHED_FIFO {fifo}, memory {locked}")
    say(bench.outcome.map_words or "the maps were not compared")
    return hits == 0 and not bench.outcome.map_differs


def watch_it(bench: Bench, console: Console, stop: Stop) -> None:
    """The picture, or a line now and then, for as long as it runs."""

    def done(now_s: float) -> bool:
        return stop.wanted or bench.done(now_s)

    if has_screen(console):
        show(bench.end, console, done, bench.lines, lambda: bench.goal)
    else:
        watch(bench.end, console, done, bench.words)


def run(config: RigConfig, options: argparse.Namespace, console: Console) -> int:
    """The rig from start to end; exit status."""
    if options.seconds is None and not has_screen(console):
        options.seconds = SECONDS_WITHOUT_SCREEN
    well = False
    try:
        with folder_kept_on_failure() as folder, Stop().on_signals() as stop:
            say(f'setting up "{config.scene}" (seed {config.seed})')
            bench = Bench(config, options, folder)
            try:
                say(bench.remark or f"planner: {bench.form.words}")
                for name, port in config.real.items():
                    say(f"{name}: the real one at {port}")
                bench.start(stop)
                watch_it(bench, console, stop)
                bench.compare_maps()
                now_s = bench.end.step(0.0)
            except RunError as error:
                raise RunError(f"{error}\nall that was said is in {folder}") from None
            finally:
                complaints = bench.close()
            if complaints:
                raise RunError("\n".join([*complaints, f"all that was said is in {folder}"]))
            bench.log.step()
            well = summary(bench, console, now_s)
    except (RunError, MissingToolError, ValueError, OSError) as error:
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
