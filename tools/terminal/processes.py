"""Processes that a command starts, what they say, and the folder where that is kept."""

import contextlib
import ctypes
import functools
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType

from mapod_link.receiver import Receiver
from tools.cli.options import ROOT, configured
from tools.settings import rewritten
from tools.terminal.compiling import Patience

READY_S = 60.0  # or since the newest kernel was compiled
FIRST_MAP_S = 120.0  # of an app, likewise
GRACE_S = 15.0  # to end when asked to: an app waits 3 s for its writer, and others may be busy here
TAIL_LINES = 25
PR_SET_PDEATHSIG = 1
ENDED_WELL = (0, 130, -signal.SIGINT)
LIBC = ctypes.CDLL(None)
APP = (sys.executable, str(ROOT / "main.py"), "--config")
DEVICES = ("scanner", "ahrs", "drive")
MODES = range(1, 256)  # all but booting
RUNNING = (1,)


class RunError(Exception):
    """The demo cannot go on; says why."""


class Stop:
    """Set by Ctrl-C, a request to end, or a closed terminal."""

    def __init__(self) -> None:
        self.wanted = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.wanted = True

    @contextlib.contextmanager
    def on_signals(self) -> Iterator["Stop"]:
        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        before = [signal.signal(number, self) for number in numbers]
        try:
            yield self
        finally:
            for number, handler in zip(numbers, before, strict=True):
                signal.signal(number, handler)


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
        return self._process.pid

    def check_alive(self) -> None:
        """Raises RunError with its last words if it has ended."""
        status = self._process.poll()
        if status is not None:
            raise RunError(f"the {self.name} ended with status {status}:\n{self.last_words()}")

    def last_words(self) -> str:
        lines = [
            line
            for path in (self.out, self.log)
            for line in path.read_text(errors="replace").splitlines()[-TAIL_LINES:]
        ]
        return "\n".join(f"    {line}" for line in lines) or "    (it said nothing)"

    def end(self) -> str:
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


def first_lines_of(child: Child, count: int, stop: Stop) -> list[str]:
    """Its first lines; []: the wait was broken off. Raises RunError: they don't come."""
    patience = Patience(time.monotonic(), READY_S, say)
    while not stop.wanted:
        lines = child.out.read_text(errors="replace").split("\n")
        if len(lines) > count:
            return lines[:count]
        child.check_alive()
        if patience.is_over(time.monotonic()):
            raise RunError(f"the {child.name} is not ready after {READY_S:.0f} s")
        time.sleep(0.02)
    return []


def first_words_of(child: Child, stop: Stop) -> dict[str, str]:
    """The JSON of its first line; {}: the wait was broken off. Raises RunError: none comes."""
    for first in first_lines_of(child, 1, stop):
        try:
            return {name: str(value) for name, value in json.loads(first).items()}
        except (ValueError, AttributeError):
            raise RunError(f"the {child.name}'s first line names no ports: {first}") from None
    return {}


def with_positioning(values: Mapping[str, object], url: str) -> Mapping[str, object]:
    """Settings of which a positioning system's end of the link is one more planner; "": none."""
    planner = values.get("planner.port")
    if not url or planner is None:
        return values
    return {**values, "planner.port": [*(planner if isinstance(planner, list) else [planner]), url]}


class SimulatedRobot:
    """The world with its fakes, and the unchanged app on their ports, in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.children: list[Child] = []
        self.mapped_s = math.inf  # when the first map was there
        self._patience: Patience | None = None  # with the app

    def start(
        self,
        world: list[str],
        settings: Path,
        values: Mapping[str, object],
        stop: Stop,
        app: Sequence[str] = APP,
    ) -> None:
        """World (none where it is empty) and app; without the app if the wait was broken off.

        Args:
            values: in the app's settings at "section.key"; those of ports win over the fakes' own.
                What its flight recorder keeps goes into the folder, too.

        Raises:
            RunError, NotThereError: one does not start; the settings have no such key.
        """
        ports: dict[str, object] = {}
        if world:
            child = Child("world", world, self.folder)
            self.children.append(child)
            told = first_words_of(child, stop)
            if stop.wanted:
                return
            if not set(DEVICES) <= told.keys():
                raise RunError(f"the world's first line names no ports: {told}")
            ports = {f"{name}.port": told[name] for name in DEVICES}
            if "depth" in told:
                ports["depth.port"] = told["depth"]
            if not configured(settings).drive.port:  # a robot that has no drive
                ports["drive.port"] = ""
            values = with_positioning(values, told.get("positioning", ""))
        config = self.folder / "mapod.toml"
        kept = {"record.flight": str(self.folder / "flight")}
        config.write_text(rewritten(settings.read_text(), kept | ports | dict(values)))
        self.children.append(Child("app", [*app, str(config)], self.folder))
        self._patience = Patience(time.monotonic(), FIRST_MAP_S, lambda words: None)

    def has_map(self, now_s: float, planner: Receiver, modes: Container[int] = MODES) -> bool:
        """Whether a planner has got a map from an app in one of these modes by now.

        Raises:
            RunError: a process has ended, or there is no map in time.
        """
        for child in self.children:
            child.check_alive()
        if self.mapped_s < math.inf:
            return True
        if not planner.blank and planner.pose is not None and planner.pose.mode in modes:
            self.mapped_s = now_s
        elif self._patience is not None and self._patience.is_over(now_s):
            words = self.children[-1].last_words()
            raise RunError(f"no map within {FIRST_MAP_S:.0f} s; the app's last words:\n{words}")
        return self.mapped_s < math.inf

    def end(self) -> list[str]:
        return [complaint for child in reversed(self.children) if (complaint := child.end())]

    @contextlib.contextmanager
    def ended(self) -> Iterator[None]:
        """All end with the block; a RunError of it, or of their end, names the folder."""
        where = f"all that was said is in {self.folder}"
        try:
            yield
        except RunError as error:
            raise RunError(f"{error}\n{where}") from None
        finally:
            complaints = self.end()
        if complaints:
            raise RunError("\n".join([*complaints, where]))


@contextlib.contextmanager
def folder_kept_on_failure(wanted: Path | None = None) -> Iterator[Path]:
    """For logs: the wanted one, or one that stays if this fails. Raises OSError."""
    if wanted is not None:
        wanted.mkdir(parents=True, exist_ok=True)
        yield wanted.resolve()  # our processes run in another folder
        return
    folder = Path(tempfile.mkdtemp(prefix="mapod-run-"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def say(words: str) -> None:
    print(f"mapod: {words}", flush=True)
