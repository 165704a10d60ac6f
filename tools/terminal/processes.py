"""Processes that a command starts, what they say, and the folder where that is kept."""

import contextlib
import ctypes
import functools
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from tools.cli.options import ROOT

READY_S = 60.0  # compiling the kernels anew fits in
GRACE_S = 5.0  # to end when asked to
TAIL_LINES = 25
PR_SET_PDEATHSIG = 1
ENDED_WELL = (0, 130, -signal.SIGINT)
LIBC = ctypes.CDLL(None)


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


def first_words_of(child: Child, stop: Stop) -> dict[str, str]:
    """The JSON on the first line of fakes, which names their ports; {} if the wait was broken off.

    Raises:
        RunError: none comes.
    """
    overdue_s = time.monotonic() + READY_S
    while not stop.wanted:
        first, end, _ = child.out.read_text(errors="replace").partition("\n")
        if end:
            try:
                return {name: str(value) for name, value in json.loads(first).items()}
            except (ValueError, AttributeError):
                raise RunError(f"the {child.name}'s first line names no ports: {first}") from None
        child.check_alive()
        if time.monotonic() > overdue_s:
            raise RunError(f"the {child.name} is not ready after {READY_S:.0f} s")
        time.sleep(0.02)
    return {}


def ports_of(fakes: Child, stop: Stop) -> dict[str, str] | None:
    """Where the fakes of a world are; None if the wait was broken off."""
    ports = first_words_of(fakes, stop)
    if stop.wanted:
        return None
    try:
        return {name: ports[name] for name in ("scanner", "ahrs", "drive")}
    except KeyError:
        raise RunError(f"the {fakes.name}'s first line names no ports: {ports}") from None


@contextlib.contextmanager
def folder_kept_on_failure(wanted: Path | None = None) -> Iterator[Path]:
    """A folder for logs: the one that is wanted, else a temporary one that stays if this fails.

    Raises:
        OSError: there can be no such folder.
    """
    if wanted is not None:
        wanted.mkdir(parents=True, exist_ok=True)
        yield wanted
        return
    folder = Path(tempfile.mkdtemp(prefix="mapod-run-"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def say(words: str) -> None:
    print(f"mapod: {words}", flush=True)
