"""The rows of a sweep in its folder: one line of JSON each, on disk before anybody hears of it.

    sweep.json     what the sweep is: started again with anything else, it is refused
    rows.jsonl     a row a line, as jobs end; one that power loss cut goes at the next start

A row is kept under its key, a digest of all that decides it. The newest row of a key counts.
"""

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

Row = dict[str, Any]
FORM = 1
ABOUT, ROWS = "sweep.json", "rows.jsonl"
OWN = {ROWS, f".{ABOUT}.part"}  # all there is where the first start broke off early
FAILED = "failed"  # key of a row that holds a cause instead of figures


class FolderError(Exception):
    """The folder cannot take the rows; the text says why."""


class Rows:
    """A context. Raises FolderError, OSError.

    Args:
        what: what decides the sweep, as JSON gives it back.
    """

    def __init__(self, folder: Path, what: Mapping[str, Any]) -> None:
        self.kept: dict[str, Row] = {}  # by key: the rows of earlier starts that have figures
        folder.mkdir(parents=True, exist_ok=True)
        about, others = folder / ABOUT, [path.name for path in folder.iterdir()]
        if others and not about.exists() and not set(others) <= OWN:
            other = min(set(others) - OWN)
            raise FolderError(f"{folder} holds other things ({other}): name a new folder")
        self._file = (folder / ROWS).open("a+b")
        try:
            self._begin(folder, what)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> "Rows":
        return self

    def __exit__(self, *what: object) -> None:
        self._file.close()

    def _begin(self, folder: Path, what: Mapping[str, Any]) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FolderError(f"{folder}: another process writes rows into it just now") from None
        _check_same(folder, {"mapod_sweep": FORM, **what})
        self._file.seek(0)
        for line in self._file.read().splitlines(keepends=True):
            row = _maybe_row(line)
            if row is not None:
                key = str(row.pop("key"))
                self.kept.pop(key, None)
                if FAILED not in row:  # what failed is tried again
                    self.kept[key] = row
        self._cut_torn_line()

    def _cut_torn_line(self) -> None:
        size = self._file.seek(0, os.SEEK_END)
        if size:
            self._file.seek(0)
            whole = self._file.read().rfind(b"\n") + 1
            if whole < size:
                self._file.truncate(whole)

    def add(self, key: str, row: Row) -> None:
        line = json.dumps({"key": key, **row}, allow_nan=False) + "\n"
        self._file.write(line.encode())
        self._file.flush()
        os.fsync(self._file.fileno())


def _maybe_row(line: bytes) -> Row | None:
    """None for what is no row: a torn or damaged line."""
    try:
        row = json.loads(line)
    except ValueError:
        return None
    return row if line.endswith(b"\n") and isinstance(row, dict) and "key" in row else None


def _check_same(folder: Path, what: Mapping[str, Any]) -> None:
    """Write down what the sweep is, or compare."""
    about = folder / ABOUT
    if about.exists():
        try:
            before = json.loads(about.read_text(encoding="utf-8"))
        except ValueError:
            before = None
        if not isinstance(before, dict) or "mapod_sweep" not in before:
            raise FolderError(f"{about} is none of ours: name another folder")
        for name in dict.fromkeys([*before, *what]):
            if before.get(name) != what.get(name):
                raise FolderError(
                    f"{folder} holds another sweep: its {name} is {_short(before.get(name))}, "
                    f"not {_short(what.get(name))}; name another folder"
                )
        return
    put(about, (json.dumps(what, indent=1) + "\n").encode())


def _short(value: object, most: int = 60) -> str:
    text = json.dumps(value)
    return text if len(text) <= most else f"{text[:most]}..."


def put(path: Path, content: bytes) -> None:
    """The whole file or the one before, whatever happens meanwhile. Raises OSError."""
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)
