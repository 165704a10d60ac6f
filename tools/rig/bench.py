"""All that `make rig` starts: fakes and app as processes, the planner, a receiver that looks on.

It serves them, follows what they tell, and at the end holds the app still and compares maps.
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

from rich.text import Text

from fakes.scenes.scene import Scene, load_scene
from mapod_link.wires import UdpWire
from tools.cli.demo import FIRST_MAP_S
from tools.cli.options import ROOT
from tools.rig.c_planner import PlannerSettings
from tools.rig.config import DEVICES, SHEET, RigConfig
from tools.rig.followed import Followed
from tools.rig.forms import form_of
from tools.rig.story import AppLog, Doubts, Tour
from tools.rig.watch import STATES
from tools.settings import rewritten
from tools.terminal.planner_end import PlannerEnd, WatchingReceiver
from tools.terminal.processes import Child, RunError, Stop, ports_of
from tools.terminal.screen import BAD, POOR, labelled

DEVICES_S = 45.0  # for all devices to deliver, a scanner that is just being switched on among them
LOOK_S = 0.2  # how often goals, truth and log are looked at
STANDING_S = 1.5  # from "halt" to a robot that stands
DRAIN_S, ATTEMPTS = 0.3, 5  # for what is under way to arrive; to find both maps alike


@dataclass(slots=True)
class Outcome:
    """What is to be said at the end."""

    ticks: str = ""
    map_words: str = "the maps were not compared"
    map_differs: bool = False


class Bench:
    """All that `make rig` starts, in a folder of its own."""

    def __init__(self, config: RigConfig, options: argparse.Namespace, folder: Path) -> None:
        self._config, self._options, self._folder = config, options, folder
        self._children: list[Child] = []
        self._app: Child | None = None
        self.scene: Scene = load_scene(config.scene, config.seed)
        clear_m = config.start_clear_m
        self._clear_m = self.scene.start_clear_m if clear_m is None else clear_m
        self.log = AppLog(folder / "app.log")
        self.followed: Followed | None = None
        self.doubts, self.outcome = Doubts(), Outcome()
        self._wire = UdpWire("127.0.0.1", 0)
        self.end = PlannerEnd(self._wire, WatchingReceiver())
        settings = PlannerSettings(start_clear_m=self._clear_m, unknown_mps=config.unknown_mps)
        self.form, self.remark = form_of(config, settings, folder)
        of_scene = () if "drive" in config.real else self.scene.goals
        self.tour = Tour(config.goals or of_scene, self.form.goal)
        self._looked_s = self._until_s = float("-inf")
        self._overdue_s = float("inf")
        self._started_s: float | None = None  # when the app was seen to have started

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
        config.write_text(rewritten(Path(self._config.config).read_text(), self.values(ports)))
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

    def values(self, ports: dict[str, str]) -> dict[str, Any]:
        """What the app's settings become."""
        values: dict[str, Any] = {f"{name}.port": port for name, port in ports.items()}
        values["planner.port"] = [self.form.url, self._wire.url]
        values["robot.start_clear_m"] = self._clear_m
        if "drive" not in self._config.real:  # else the file's own word counts
            values["robot.enable_motors"] = True
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
        else:
            self._check_patience(now_s)
        over = self.tour.is_over and self.tour.total > 0 and self._options.seconds is not None
        return over or (self._until_s > 0 and now_s >= self._until_s)

    def _check_patience(self, now_s: float) -> None:
        """Raises RunError once the first map has been waited for long enough."""
        if self.log.has_started and self._started_s is None:
            self._started_s = now_s
        if self._started_s is not None and now_s - self._started_s > DEVICES_S:
            missing = self.log.missing or "all devices deliver"
            raise RunError(f"no map {DEVICES_S:.0f} s after the app's start; {missing}")
        if now_s > self._overdue_s:
            words = self._children[-1].last_words()
            raise RunError(f"no map within {FIRST_MAP_S:.0f} s; the app's last words:\n{words}")

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
        if self.log.missing:
            told.append(labelled("waits", self.log.missing, BAD))
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
        app = self._app
        if app is None:  # told to end before it was started
            return
        self.form.halt()
        self.run(STANDING_S)
        self.log.step()
        self.outcome.ticks = self.log.words  # of now: held still, it loses some more
        for _ in range(ATTEMPTS):
            os.kill(app.pid, signal.SIGSTOP)
            try:
                self.run(DRAIN_S)
                self._compare()
            finally:
                os.kill(app.pid, signal.SIGCONT)
            if not self.outcome.map_differs:
                return
            self.run(DRAIN_S)

    def _compare(self) -> None:
        told, ours, end = self.form.maybe_map(), self.end.planner.window(), self.outcome
        if told is None:
            end.map_words = "the planner does not tell its map"
            return
        window, origin = told
        if self.end.planner.origin != origin or window.shape != ours.shape:
            where = f"its window lies at {origin}, ours at {self.end.planner.origin}"
            end.map_words, end.map_differs = f"the planner's map differs: {where}", True
            return
        wrong, size = int((window != ours).sum()), ours.size
        end.map_differs = wrong > 0 or self.end.planner.need_full
        digest = "is" if self.end.planner.digest_ok else "was not"
        end.map_words = (
            f"the planner's map differs in {wrong} of {size} cells"
            if wrong
            else f"the planner's map equals the second receiver's in all {size} cells, whose "
            f"digest {digest} the app's"
        )

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
