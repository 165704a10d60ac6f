"""Single values of a settings file changed in place; all else stays as it is, to the byte."""

import json
import os
import re
import shutil
import tempfile
from codecs import BOM_UTF8
from collections.abc import Mapping
from pathlib import Path

from config_file import load_config, with_changes
from core.config import Config


class NotThereError(Exception):
    """The file can't be changed so; the text says why."""


def lens_of(config: Config) -> tuple[float, float, float, float]:
    """Where the scanner sits: x, y, z (m), and how much it looks down (deg), as fakes take it."""
    return *config.scanner.mount_xyz_m, config.scanner.mount_tilt_deg


def camera_of(config: Config) -> tuple[float, float, float, float] | None:
    """The same of the depth camera; None: there is none."""
    depth = config.depth
    if depth is None or not config.has_camera:
        return None
    return *depth.mount_xyz_m, depth.mount_tilt_deg


def wheels_of(config: Config) -> tuple[float, float]:
    """Radius of the drive wheels, and between their contacts (m): by them fakes know the robot."""
    return config.robot.wheel_radius_m, config.robot.track_width_m


def rewritten(text: str, values: Mapping[str, object]) -> str:
    """ "section.key" replaced, all else as it was. Raises NotThereError: no line of its own."""
    return _replaced(text, {key: json.dumps(value) for key, value in values.items()})


def checked(text: str, section: str, values: Mapping[str, str]) -> Config:
    """The settings with these numbers, or lists of them. Raises ConfigError: out of range."""
    numbers = {key: json.loads(value, parse_int=float) for key, value in values.items()}
    return with_changes(load_config(text), **{section: numbers})


def with_values(text: str, section: str, values: Mapping[str, str]) -> str:
    """The text with numbers, or lists of them, at some keys of a section replaced, digit for digit.

    Raises:
        NotThereError: a key is not there on a line of its own.
        ConfigError: a number is out of range.
    """
    changed = _replaced(text, {f"{section}.{key}": value for key, value in values.items()})
    if load_config(changed) != checked(text, section, values):
        raise NotThereError(f"[{section}] {', '.join(values)}: not on a line of its own")
    return changed


def _replaced(text: str, literals: Mapping[str, str]) -> str:
    lines, section, left = text.splitlines(keepends=True), "", dict(literals)
    for i, line in enumerate(lines):
        if head := re.match(r"\s*\[\s*([\w.]+)\s*\]", line):
            section = head[1]
        elif entry := re.match(r'(\s*(\w+)\s*=\s*)("[^"]*"|\[[^][]*\]|[\w.+-]+)', line):
            value = left.pop(f"{section}.{entry[2]}", None)
            if value is not None:
                lines[i] = f"{entry[1]}{value}{line[entry.end() :]}"
    if left:
        raise NotThereError(f"the settings have no {', '.join(sorted(left))} on a line of its own")
    return "".join(lines)


def rewrite(path: Path, before: str, after: str) -> None:
    """In one step, keeping the mode, and the mark that some editors put first.

    Raises:
        NotThereError: `before` is not there.
        OSError
    """
    path = path.resolve()  # a link stays a link
    content = path.read_bytes()
    mark = BOM_UTF8 if content.startswith(BOM_UTF8) else b""
    if content != mark + before.encode():
        raise NotThereError(f"{path} has been changed meanwhile: nothing is written")
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(mark + after.encode())
            file.flush()
            os.fsync(file.fileno())
        shutil.copymode(path, name)
        os.replace(name, path)
    finally:
        Path(name).unlink(missing_ok=True)
