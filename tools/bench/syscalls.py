"""System calls of a process, by name; what it opens as it starts. By strace, which slows it.

Source: strace(1), options -c and -f.
"""

import contextlib
import re
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

MISSING = "strace is not there (apt install strace)"
ATTACH_S, END_S = 10.0, 10.0
ATTACHED = re.compile(r"Process \d+ attached")
OPENED = re.compile(r'open(?:at)?\([^"]*"([^"]*)".*\)\s+=\s+\d+')
MACHINE_CODE = ".nbc"  # Numba's name for a compiled kernel on disk


class StraceError(Exception):
    """strace does not do it; says why."""


def calls_per_s(
    pid: int, run: Callable[[], None], prefer: Callable[[int], object]
) -> dict[str, float]:
    """By name, most first, while `run` runs.

    Args:
        prefer: gives strace's process its priority: it answers for the process at each call.

    Raises:
        StraceError: it may not look at that process.
    """
    _check_there()
    with tempfile.TemporaryDirectory(prefix="mapod-strace-") as folder:
        out, said = Path(folder) / "counts", Path(folder) / "said"
        with said.open("wb") as file:
            tracer = subprocess.Popen(
                ["strace", "-c", "-f", "-S", "calls", "-o", str(out), "-p", str(pid)], stderr=file
            )
        prefer(tracer.pid)
        try:
            _wait_attached(tracer, said)
            begun_s = time.monotonic()
            run()
            seconds = time.monotonic() - begun_s
        finally:
            _end(tracer)
        return {name: count / seconds for name, count in counts_from_text(out.read_text()).items()}


def counts_from_text(text: str) -> dict[str, int]:
    """Calls by name out of a table of `strace -c`."""
    counts = {}
    for line in text.splitlines():
        words = line.split()
        if len(words) in (5, 6) and words[3].isdigit() and words[-1] != "total":
            counts[words[-1]] = int(words[3])
    return counts


def kernels_loaded(argv: Sequence[str], folder: Path) -> int:
    """Files of machine code that a program opens until it ends. Raises StraceError."""
    _check_there()
    with tempfile.TemporaryDirectory(prefix="mapod-strace-") as temporary:
        out = Path(temporary) / "opened"
        traced = ["strace", "-f", "-qq", "-e", "trace=open,openat", "-o", str(out), *argv]
        done = subprocess.run(traced, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise StraceError(done.stderr.strip() or f"strace ended with {done.returncode}")
        opened = {found[1] for found in map(OPENED.search, out.read_text().splitlines()) if found}
    return sum(name.endswith(MACHINE_CODE) for name in opened)


def _check_there() -> None:
    if shutil.which("strace") is None:
        raise StraceError(MISSING)


def _wait_attached(tracer: "subprocess.Popen[bytes]", said: Path) -> None:
    overdue_s = time.monotonic() + ATTACH_S
    while not ATTACHED.search(words := said.read_text(errors="replace")):
        if tracer.poll() is not None or time.monotonic() > overdue_s:
            raise StraceError(words.strip() or "strace does not attach")
        time.sleep(0.01)


def _end(tracer: "subprocess.Popen[bytes]") -> None:
    with contextlib.suppress(ProcessLookupError):
        tracer.send_signal(signal.SIGINT)
    try:
        tracer.wait(END_S)
    except subprocess.TimeoutExpired:
        tracer.kill()
        tracer.wait()
