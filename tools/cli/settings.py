"""Single values of a settings file changed in place; all else stays as it is, to the byte.

A value is replaced only where that leaves a file which loads and differs in nothing else.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from config_file import load_config, with_changes


class NotThereError(Exception):
    """The file can't be changed so; the text says why."""


def with_values(text: str, section: str, values: Mapping[str, str]) -> str:
    """The text with the numbers at some keys of a section replaced by others.

    Raises:
        NotThereError: a key is not there on a line of its own.
        ConfigError: a number is out of range.
    """
    lines, here, left = text.splitlines(keepends=True), "", dict(values)
    for i, line in enumerate(lines):
        if head := re.match(r"\s*\[\s*([\w.]+)\s*\]", line):
            here = head[1]
        elif here == section and (entry := re.match(r"(\s*(\w+)\s*=\s*)([+\-.\w]+)", line)):
            value = left.pop(entry[2], None)
            if value is not None:
                lines[i] = entry[1] + value + line[entry.end() :]
    changed = "".join(lines)
    wanted = with_changes(load_config(text), **{section: {k: float(values[k]) for k in values}})
    if left or load_config(changed) != wanted:
        raise NotThereError(f"[{section}] {', '.join(left or values)}: not on a line of its own")
    return changed


def rewrite(path: Path, before: str, after: str) -> None:
    """Put a text in place of the one that the file holds, in one step; keeps the file's mode.

    Raises:
        NotThereError: the file does not hold `before` any more.
        OSError: it can't be written; it is as it was.
    """
    path = path.resolve()  # a link stays a link
    if path.read_bytes() != before.encode():
        raise NotThereError(f"{path} has been changed meanwhile: nothing is written")
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(after.encode())
            file.flush()
            os.fsync(file.fileno())
        shutil.copymode(path, name)
        os.replace(name, path)
    finally:
        Path(name).unlink(missing_ok=True)
