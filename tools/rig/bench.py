"""All that `make rig` starts: fakes and app as processes, the planner, a receiver that looks on.

It serves them, follows what they tell, and at the end holds the app still and compares maps.
"""

import argparse
import math
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

from fakes.scenes.scene import load_scene
from mapod_link.wires import UdpWire
from tools.cli.demo import FIRST_MAP_S
from tools.cli.options import ROOT
from tools.rig.config import DEVICES, OF_SCENE, RigConfig
from tools.rig.forms import form_of
from tools.rig.story import AppLog, Doubts, Tour, TruthLog
from tools.settings import rewritten
from tools.terminal.planner_end import PlannerEnd, WatchingReceiver
from tools.terminal.processes import Child, RunError, Stop, ports_of

DEVICES_S = 45.0  # for all devices to deliver, a scanner that is just being switched on among them
LOOK_S = 0.2  # how often goals, truth and log are looked at
STANDING_S = 1.5  # from "halt" to a robot that stands
DRAIN_S, ATTEMPTS = 0.3, 5  # for what is under way to arrive; to find both maps alike


class Bench:
    """All that `make rig` starts, in a folder of its own."""

    def __init__(self, config: RigConfig, options: argparse.Namespace, folder: Path) -> None:
        self._config, self._options, self._folder = config, options, folder
        self._children: list[Child] = []
        scene, is_real = load_scene(config.world.scene, config.world.seed), config.devices.real
        clear_m = config.planner.start_clear_m
        self._clear_m = scene.start_clear_m if clear_m == OF_SCENE else float(clear_m)
        self.log, self.doubts = AppLog(folder / "app.log"), Doubts()
        # with a real drive the world's robot stands, and nothing of it is true
        self.truth = None if "drive" in is_real else TruthLog(folder / "truth.jsonl", scene)
        self.end = PlannerEnd(UdpWire("127.0.0.1", 0), WatchingReceiver())
        self.form = form_of(config, self._clear_m, folder)
        self.tour = Tour(config.world.goals or (scene.goals if self.truth else ()), self.form.goal)
        self._looked_s = float("-inf")
        self._until_s = self._overdue_s = float("inf")
        self._started_s: float | None = None  # when the app was seen to have started

    def start(self, stop: Stop) -> None:
        """Fakes, then the app on their ports, on those of the real devices and on the planner's.

        Raises:
            RunError: one of them fails.
        """
        ports = self._config.devices.real
        if len(ports) < len(DEVICES):
            told = ports_of(self._start("fakes", self._fakes_words()), stop)
            if told is None:
                return
            ports = told | ports
        config, shipped = self._folder / "mapod.toml", Path(self._config.robot.config).read_text()
        config.write_text(rewritten(shipped, self.values(ports)))
        self._start("app", [str(ROOT / "main.py"), "--config", str(config)])
        self._overdue_s = time.monotonic() + FIRST_MAP_S

    def _fakes_words(self) -> list[str]:
        world, real = self._config.world, self._config.devices.real
        words = ["-m", "fakes", "--scene", world.scene, "--seed", str(world.seed)]
        words += ["--no-driver", "--drive-mode", "rs232_watchdog"]
        words += ["--sheet-errors"] if world.sensors == "sheet" else []
        for name in real:
            words += ["--leave-out", name]
        for fault in self._options.fault:
            words += ["--fault", fault]
        words += ["--truth", str(self._folder / "truth.jsonl")] if self.truth else []
        return words

    def values(self, ports: dict[str, str]) -> dict[str, Any]:
        """What the app's settings become."""
        values: dict[str, Any] = {f"{name}.port": port for name, port in ports.items()}
        values["planner.port"] = [self.form.url, self.end.wire.url]
        values["robot.start_clear_m"] = self._clear_m
        if self.truth:  # else the file's own word counts
            values["robot.enable_motors"] = True
        if self._config.planner.unknown_mps > 0:
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
        self.doubts.step(now_s, *self.end.planner.advice(now_s))
        if now_s - self._looked_s < LOOK_S:
            return False
        self._looked_s = now_s
        for child in self._children:
            child.check_alive()
        self.log.step()
        if self.truth:
            self.truth.step()
        if self._has_run():
            if self._overdue_s < float("inf"):
                self._overdue_s = float("inf")
                self._until_s = now_s + (self._options.seconds or float("inf"))
            gap_m = self.truth.gap_m if self.truth else lambda x_m, y_m: math.nan
            self.tour.step(now_s, self.form.state, gap_m)
        else:
            self._check_patience(now_s)
        over = self.tour.is_over and self.tour.total > 0 and self._options.seconds is not None
        return over or now_s >= self._until_s

    def _has_run(self) -> bool:
        planner = self.end.planner
        runs = not planner.blank and planner.pose is not None and planner.pose.mode == 1
        return runs or self._overdue_s == float("inf")

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

    def words(self) -> list[str]:
        """What the rig itself knows, one thing a line."""
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
        """Halt, then hold the app still, and compare both receivers' maps cell for cell.

        What is found, in words; and whether the maps differ.
        """
        app = self._children[-1] if self._children else None
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

    def close(self) -> list[str]:
        """End the app, the fakes and the planner; what did not end well."""
        complaints = [child.end() for child in reversed(self._children)]
        self.form.close()
        self.end.wire.close()
        return [complaint for complaint in complaints if complaint]
