"""The demo behind `make run`: a simulated robot, the unchanged app, and a planner that draws.

World and fakes are one process, the app is another; they speak over TCP and ptys, and the app's
obstacle map comes back over UDP. With --drive the keyboard drives the robot, through app and
controller. Ctrl-C, or the end of --seconds, ends all of them.
"""

import argparse
import contextlib
import ctypes
import functools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.wires import UdpWire
from tools.bench.planner_end import PlannerEnd, PtyWire
from tools.cli.screen import has_screen
from tools.cli.steer import Steering, keys_of
from tools.cli.view import ACK_EVERY, Stop, print_summary, watch

ROOT = Path(__file__).resolve().parents[2]
SECONDS_WITHOUT_SCREEN = 20.0
WORLD_READY_S, FIRST_MAP_S = 60.0, 120.0  # compiling the kernels anew fits in
GRACE_S = 5.0  # to end when asked to
TAIL_LINES = 25
SERIAL_BAUD = 115_200
PR_SET_PDEATHSIG = 1
DRIVEN = {"robot.enable_motors": True, "robot.start_clear_m": 9.0}  # the corridor begins clear
DRIVEN_MPS, DRIVEN_RADPS = 0.5, 0.6
DRIVEN_WORLD = ("--no-driver", "--drive-mode", "rs232_watchdog")
ENDED_WELL = (0, 130, -signal.SIGINT)
LIBC = ctypes.CDLL(None)


class RunError(Exception):
    """The demo cannot go on; says why."""


@dataclass(frozen=True, slots=True)
class Commands:
    """What is started; the app's configuration file is appended to `app`."""

    fakes: list[str]
    app: list[str]


def rewritten(toml: str, values: Mapping[str, str | float | list[str]]) -> str:
    """The text with the values at "section.key" replaced, comments and all else as they were.

    Raises:
        RunError: a key is not there.
    """
    lines, section, left = toml.splitlines(keepends=True), "", dict(values)
    for i, line in enumerate(lines):
        if head := re.match(r"\s*\[([\w.]+)\]", line):
            section = head[1]
        elif entry := re.match(r'(\s*(\w+)\s*=\s*)("[^"]*"|[\w.+-]+)', line):
            value = left.pop(f"{section}.{entry[2]}", None)
            if value is not None:
                lines[i] = f"{entry[1]}{json.dumps(value)}{line[entry.end() :]}"
    if left:
        raise RunError(f"the configuration has no {', '.join(sorted(left))}")
    return "".join(lines)


class Child:
    """A process of ours, its words in a file. It dies with us, however we die."""

    def __init__(self, name: str, argv: list[str], folder: Path) -> None:
        self.name, self.out, self.log = name, folder / f"{name}.out", folder / f"{name}.log"
        die_with_us = functools.partial(LIBC.prctl, PR_SET_PDEATHSIG, signal.SIGKILL)
        with self.out.open("wb") as out, self.log.open("wb") as log:
            self._process = subprocess.Popen(
                argv,
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=log,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                start_new_session=True,  # Ctrl-C is ours alone; we pass it on in order
                preexec_fn=die_with_us,
            )

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    def check_alive(self) -> None:
        """Raises RunError with its last words if it has ended."""
        status = self._process.poll()
        if status is not None:
            raise RunError(f"the {self.name} ended with status {status}:\n{self.last_words()}")

    def last_words(self) -> str:
        """The end of what it wrote."""
        lines = [
            line
            for path in (self.out, self.log)
            for line in path.read_text(errors="replace").splitlines()[-TAIL_LINES:]
        ]
        return "\n".join(f"    {line}" for line in lines) or "    (it said nothing)"

    def end(self) -> str:
        """Asks it to end, waits, insists; gives a complaint if it did not end well."""
        ended_before = self._process.poll() is not None
        if not ended_before:
            self._process.send_signal(signal.SIGINT)
        try:
            status = self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            return f"the {self.name} did not end within {GRACE_S:.0f} s and was killed"
        if status not in ENDED_WELL and not ended_before:
            return f"the {self.name} ended with status {status}:\n{self.last_words()}"
        return ""


class Demo:
    """World, app and planner of one run, in a folder of its own."""

    def __init__(self, options: argparse.Namespace, commands: Commands, folder: Path) -> None:
        self._options, self._commands, self._folder = options, commands, folder
        self._children: list[Child] = []
        self.wire = PtyWire(SERIAL_BAUD) if options.serial else UdpWire("127.0.0.1", 0)
        self.end = PlannerEnd(self.wire, FakePlanner(options.seed, None, ACK_EVERY))
        self.driven: bool = options.drive
        self._until_s = float("inf")
        self._overdue_s = float("inf")

    def start(self, stop: Stop) -> None:
        """Start the world, and the app on its ports."""
        fakes = self._start("world", self._commands.fakes)
        ports = ports_of(fakes, stop)
        if ports is None:
            return
        values: dict[str, str | float] = {
            f"{name}.port": ports[name] for name in ("scanner", "ahrs", "drive")
        }
        values |= DRIVEN if self._options.drive else {}
        shipped = Path(self._options.config).read_text()
        config = self._folder / "mapod.toml"
        config.write_text(rewritten(shipped, {**values, "planner.port": self.wire.url}))
        self._start("app", [*self._commands.app, str(config)])
        self._overdue_s = time.monotonic() + FIRST_MAP_S

    def done(self, now_s: float) -> bool:
        """True once it has run for as long as it should. Raises RunError if it cannot go on."""
        for child in self._children:
            child.check_alive()
        planner = self.end.planner
        running = not planner.blank and planner.pose is not None and planner.pose.mode != 0
        if running and self._overdue_s < float("inf"):
            self._overdue_s = float("inf")
            self._until_s = now_s + (self._options.seconds or float("inf"))
        if now_s > self._overdue_s:
            words = self._children[-1].last_words()
            raise RunError(f"no map within {FIRST_MAP_S:.0f} s; the app's last words:\n{words}")
        return now_s >= self._until_s

    def close(self) -> list[str]:
        """End the app, then the world; what did not end well."""
        complaints = [child.end() for child in reversed(self._children)]
        self.wire.close()
        return [complaint for complaint in complaints if complaint]

    def _start(self, name: str, argv: list[str]) -> Child:
        self._children.append(Child(name, argv, self._folder))
        return self._children[-1]


def ports_of(fakes: Child, stop: Stop) -> dict[str, str] | None:
    """The line in which the fakes name their ports; None if the wait was broken off."""
    overdue_s = time.monotonic() + WORLD_READY_S
    while not stop.wanted:
        first, end, _ = fakes.out.read_text(errors="replace").partition("\n")
        if end:
            try:
                ports = json.loads(first)
                return {name: str(ports[name]) for name in ("scanner", "ahrs", "drive")}
            except (ValueError, KeyError, TypeError):
                raise RunError(f"the world's first line names no ports: {first}") from None
        fakes.check_alive()
        if time.monotonic() > overdue_s:
            raise RunError(f"the world is not ready after {WORLD_READY_S:.0f} s")
        time.sleep(0.02)
    return None


@contextlib.contextmanager
def folder_kept_on_failure() -> Iterator[Path]:
    """A temporary folder that stays, with the logs in it, if something fails."""
    folder = Path(tempfile.mkdtemp(prefix="mapod-run-"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def run(options: argparse.Namespace, commands: Commands, console: Console) -> int:
    """The demo from start to end; exit status."""
    if options.seconds is None and not has_screen(console):
        options.seconds = SECONDS_WITHOUT_SCREEN
    try:
        with folder_kept_on_failure() as folder, Stop().on_signals() as stop:
            demo = Demo(options, commands, folder)
            try:
                say(f'starting the world "{options.scene}" (seed {options.seed})')
                demo.start(stop)
                say(f"the app is starting; its map comes to {demo.wire.url}; Ctrl-C ends all")
                show(demo, stop, console)
                now_s = demo.end.step(0.0)
            except RunError as error:
                raise RunError(f"{error}\nall that was said is in {folder}") from None
            finally:
                complaints = demo.close()
            if complaints:
                raise RunError("\n".join([*complaints, f"all that was said is in {folder}"]))
            print_summary(demo.end, console, now_s)
    except (RunError, ValueError) as error:
        print(f"mapod: {error}", file=sys.stderr, flush=True)
        return 1
    say("all processes have ended")
    return 0


def show(demo: Demo, stop: Stop, console: Console) -> None:
    """The picture until the end, with the keyboard where it drives."""
    with contextlib.ExitStack() as stack:
        steering = None
        if demo.driven:
            fd = stack.enter_context(keys_of(sys.stdin.fileno()))
            steering = Steering(demo.end.planner, fd, DRIVEN_MPS, DRIVEN_RADPS)

        def done(now_s: float) -> bool:
            if steering:
                steering.step(now_s)
            return stop.wanted or demo.done(now_s)

        watch(demo.end, console, done, steering.words if steering else None)


def say(words: str) -> None:
    """A line of progress."""
    print(f"mapod: {words}", flush=True)


def main(arguments: list[str]) -> int:
    """Exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.cli.demo", description=__doc__)
    parser.add_argument("--seconds", type=float, help="end after so long; 20 without a terminal")
    parser.add_argument("--seed", type=int, default=1, help="of all that is random in the world")
    parser.add_argument("--scene", default="corridor", help="which world")
    parser.add_argument("--config", default=str(ROOT / "mapod.toml"), help="the robot")
    parser.add_argument("--serial", action="store_true", help="planner on a pty, not on UDP")
    parser.add_argument("--drive", action="store_true", help="drive with the keyboard")
    options = parser.parse_args(arguments)
    python = sys.executable
    world = ["--scene", options.scene, "--seed", str(options.seed)]
    world += DRIVEN_WORLD if options.drive else ()
    commands = Commands(
        fakes=[python, "-m", "fakes", *world],
        app=[python, str(ROOT / "main.py"), "--config"],
    )
    return run(options, commands, Console())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
