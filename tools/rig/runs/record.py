"""A run on disk: every byte of every wire, the true way, what happened, and a picture.

A folder of its own holds, instants in simulated seconds since the first tick:

    run.json            what decided the run, and what came of it
    drive.mcap          the app's own recording, with the truth in it: see docs/sweep.md
    WIRE_d2h.bin        what the app heard of scanner, ahrs, drive and planner
    WIRE_h2d.bin        what it said to them
    WIRE_index.csv      when: t_s, dir, offset, length (and name, empty: nobody looked inside)
    path.csv            the truth: t_s, x_m, y_m, yaw_rad, pitch_rad, roll_rad, z_m
    events.jsonl        goals, states of the planner, reasons of the app, faults, contacts
    map.npz             the app's obstacle map at the end: cells [j, i], corner, cell_m
    picture.png         all of it from above

Pictures can be drawn again: `python -m tools.rig.draw FOLDER`. The drive can be played: `mapod
replay FOLDER/drive.mcap`.
"""

import contextlib
import csv
import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np

from app import App, Ports
from fakes.scenes.scene import Scene
from recorder import Recorder as AppRecorder
from recording.direct import DirectTap
from tools.rig.runs.loop import SESSION, START_S, Loop
from tools.rig.runs.one_run import Pilot, Run, RunResult, RunSpec
from tools.rig.runs.picture import draw_run
from tools.rig.truth.ground import TruthLog
from tools.sweep.truth import NAME as TRUTH
from version import version

WIRES = ("scanner", "ahrs", "drive", "planner")
PATH_COLUMNS = ("t_s", "x_m", "y_m", "yaw_rad", "pitch_rad", "roll_rad", "z_m")
INDEX_COLUMNS = ("t_s", "dir", "offset", "length", "name")


class RecordedLoop(Loop):
    """A loop whose app is recorded. Raises OSError."""

    def __init__(self, path: Path, *arguments: Any, **named: Any) -> None:
        self.tap, self.now_s = DirectTap(path, lambda: self.now_s), START_S
        super().__init__(*arguments, **named)

    def _new_app(self, key: bytes | None) -> App:
        recorder = AppRecorder(self.config, version(), self.tap)
        scanner, ahrs, drive = self.ports.values()
        ports = recorder.ports(Ports(scanner, ahrs, drive, self.link_port))
        return recorder.begin(App(self.config, ports, session=SESSION, key=key), bool(key), None)

    def finish(self, truth: Mapping[str, str]) -> None:
        self.tap.metadata(TRUTH, truth)
        self.tap.end(0.0)


def recorded_run(spec: RunSpec, folder: Path, pilot: Pilot | None = None) -> Run:
    """A run whose app is recorded in the folder. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    return Run(spec, pilot, new_loop=partial(RecordedLoop, folder / "drive.mcap"))


class Recorder:
    """A context; call it after every tick, and `finish` with the result. Raises OSError."""

    def __init__(self, run: Run, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._run, self.folder = run, folder
        self._stack = contextlib.ExitStack()
        self._bytes: dict[tuple[str, str], IO[bytes]] = {}
        self._index: dict[str, Any] = {}
        for wire in WIRES:
            for way in ("d2h", "h2d"):
                path = folder / f"{wire}_{way}.bin"
                self._bytes[wire, way] = self._stack.enter_context(path.open("wb"))
            self._index[wire] = self._rows(f"{wire}_index.csv", INDEX_COLUMNS)
        self._path = self._rows("path.csv", PATH_COLUMNS)
        events = folder / "events.jsonl"
        self._events = self._stack.enter_context(events.open("w", encoding="utf-8"))
        self._before: dict[str, Any] = {}
        self._told = {"faults": 0, "collisions": 0, "bumps": 0, "stops": 0}
        self._truth_s = -1.0
        self._truth_log = TruthLog(run.scene, run.spec.seed, START_S)
        run.loop.listen(self._note_bytes)

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *what: object) -> None:
        self._stack.close()

    def _rows(self, name: str, columns: tuple[str, ...]) -> Any:
        file = (self.folder / name).open("w", encoding="ascii", newline="")
        rows = csv.writer(self._stack.enter_context(file))
        rows.writerow(columns)
        return rows

    def _note_bytes(self, wire: str, way: str, data: bytes) -> None:
        out = self._bytes[wire, way]
        at = out.tell()
        out.write(data)
        now_s = f"{self._run.since_begin_s:.3f}"
        self._index[wire].writerow((now_s, way, at, len(data), ""))

    def _event(self, event: str, **facts: Any) -> None:
        line = {"t_s": round(self._run.since_begin_s, 3), "event": event, **facts}
        self._events.write(json.dumps(line) + "\n")

    def __call__(self, run: Run) -> None:
        truth = run.judge.truth
        if truth.since_s != self._truth_s:
            self._truth_s = truth.since_s
            self._truth_log.take(truth)
            numbers = (*truth.place, truth.pitch_rad, truth.roll_rad, truth.height_m)
            self._path.writerow([f"{truth.since_s:.3f}", *(f"{x:.5f}" for x in numbers)])
            self._changed("planner_changed", state=run.state.state, why=run.state.why)
            self._changed("app_changed", blocked_by=run.loop.app.pilot.control.blocked_by)
            self._changed("goal_changed", number=run.goals.at + 1, reached=run.goals.reached)
        for name, told in (
            ("faults", [{"fault": said} for _, said in run.loop.happened]),
            ("collisions", [asdict(contact) for contact in run.judge.collisions]),
            ("bumps", [asdict(contact) for contact in run.judge.bumps]),
            ("stops", [asdict(stop) for stop in run.watch.stops]),
        ):
            for facts in told[self._told[name] :]:
                self._event(f"{name[:-1]}_noted", **facts)
            self._told[name] = len(told)

    def _changed(self, event: str, **facts: Any) -> None:
        if self._before.get(event) != facts:
            self._before[event] = facts
            self._event(event, **facts)

    def finish(self, result: RunResult) -> None:
        self._event("run_ended", why=result.ended)
        self._stack.close()
        run = self._run
        if isinstance(run.loop, RecordedLoop):
            run.loop.finish(self._truth_log.metadata())
        scene = None if isinstance(run.spec.scene, Scene) else str(run.spec.scene)
        facts = {"scene_file": scene, "limit_s": run.spec.limit_s}
        facts |= facts_of(result)
        (self.folder / "run.json").write_text(json.dumps(facts, indent=1), encoding="utf-8")
        grid = run.loop.app.mapper.maps.window.grid
        np.savez_compressed(
            self.folder / "map.npz",
            cells=run.loop.map_now(),
            corner=np.array([grid.corner_i, grid.corner_j]),
            cell_m=np.array(grid.cell_m),
        )
        draw_run(self.folder, run.scene)


def result_from_facts(facts: dict[str, Any]) -> RunResult:
    """The result that `facts_of` told."""
    gap_m = facts["least_gap_m"]
    known = facts | {"least_gap_m": math.inf if gap_m is None else gap_m}
    return msgspec.convert(known, RunResult)


def facts_of(result: RunResult) -> dict[str, Any]:
    facts = asdict(result)
    facts["false_stops"] = len(result.false_stops)
    return {key: None if value == float("inf") else value for key, value in facts.items()}
