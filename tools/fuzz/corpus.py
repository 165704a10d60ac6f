"""The inputs that are kept: tests/vectors/fuzz/TARGET, as few as walk through the same code.

An input stays if it takes a step from line to line, in what is watched of its target, that no
smaller one took. `make test` runs all of them.
"""

import hashlib
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from tools.fuzz.targets import TARGETS

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "tests" / "vectors" / "fuzz"
MOST_KEPT, MOST_INPUT = 14_000, 4096  # bytes, of a target and of one input
Steps = set[tuple[str, int, int]]  # file, from line, to line


def kept(target: str) -> list[Path]:
    """The inputs of a target, by name."""
    return sorted((FOLDER / target).glob("*"))


def steps_of(target: str, data: bytes) -> Steps:
    """From line to line, in what is watched. Raises what the target raises."""
    folders = tuple(str(ROOT / name.replace(".", "/")) for name in TARGETS[target].marked)
    steps: Steps = set()

    def called(frame: FrameType, event: str, _: Any) -> Any:
        if event != "call" or not frame.f_code.co_filename.startswith(folders):
            return None
        path, last = frame.f_code.co_filename, 0

        def moved(frame: FrameType, event: str, _: Any) -> Any:
            nonlocal last
            if event == "line":
                steps.add((path, last, frame.f_lineno))
                last = frame.f_lineno
            return moved

        return moved

    before = sys.gettrace()
    sys.settrace(called)
    try:
        TARGETS[target].run(data)
    finally:
        sys.settrace(before)
    return steps


def fewest(target: str, inputs: Iterable[bytes]) -> list[bytes]:
    """As many as take a step that none before has taken, smallest first."""
    seen: Steps = set()
    chosen, size = list[bytes](), 0
    for data in sorted(set(inputs), key=lambda data: (len(data), data)):
        if len(data) > MOST_INPUT or size + len(data) > MOST_KEPT:
            break
        steps = steps_of(target, data)
        if not steps <= seen:
            seen |= steps
            chosen.append(data)
            size += len(data)
    return chosen


def keep(target: str, folders: Sequence[Path]) -> int:
    """Renew the inputs that are kept, from these and those before; how many there are."""
    paths = [*kept(target), *(path for folder in folders for path in folder.glob("*"))]
    chosen = fewest(target, [path.read_bytes() for path in paths if path.is_file()])
    for path in kept(target):
        path.unlink()
    (FOLDER / target).mkdir(parents=True, exist_ok=True)
    for data in chosen:
        (FOLDER / target / hashlib.sha256(data).hexdigest()[:12]).write_bytes(data)
    return len(chosen)
