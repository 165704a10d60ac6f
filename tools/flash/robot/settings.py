"""The robot's settings: a file for each version, so that the one link that switches takes it along.

/etc/mapod/mapod.toml leads through `current` to /etc/mapod/settings/VERSION.toml. A file that
somebody has put in its place is the robot's settings too: it is taken over, whole.
"""

import difflib
import itertools
import os
from pathlib import Path

from tools.flash.robot.places import Places, put_file, put_link, relative, sync

AS_FLASHED = "settings-as-flashed.toml"  # in a version's folder: what its settings were at first


def ours(places: Places) -> str:
    """What the link at /etc/mapod/mapod.toml says where it is ours."""
    return relative(places.toml, places.current) + "/mapod.toml"


def is_ours(places: Places) -> bool:
    return places.toml.is_symlink() and os.readlink(places.toml) == ours(places)


def settings_now(places: Places) -> Path | None:
    """The file that holds the robot's settings; None where it has none."""
    current = places.version(places.current)
    if places.toml.exists() and not is_ours(places):
        return places.toml
    if current and places.settings_of(current).exists():
        return places.settings_of(current)
    return None


def adopt(places: Places) -> str:
    """Takes over a file that stands in the place of our link; says so. Nothing is lost on the way:
    first the copy is on the disk, then the link takes the file's place.
    """
    current = places.version(places.current)
    if current is None or not places.toml.exists() or is_ours(places):
        return ""
    content, target = places.toml.read_bytes(), places.settings_of(current)
    if target.exists() and target.read_bytes() != content:
        os.link(target, next_free(places.settings, current))
        sync(places.settings)
    put_file(target, content)
    put_link(places.toml, ours(places))
    return f"/etc/mapod/mapod.toml is a link now, to your settings in settings/{target.name}"


def next_free(folder: Path, name: str) -> Path:
    """NAME.1.toml, or the next number that nobody has."""
    numbered = (folder / f"{name}.{number}.toml" for number in itertools.count(1))
    return next(path for path in numbered if not path.exists())


def difference(before: bytes, after: bytes, old_name: str, new_name: str) -> list[str]:
    """A unified diff, line by line; empty where they are the same."""
    old, new = (text.decode("utf-8", "replace").splitlines() for text in (before, after))
    return list(difflib.unified_diff(old, new, old_name, new_name, n=0, lineterm=""))


def edits(places: Places, name: str) -> list[str]:
    """What somebody has changed in a version's settings since it was flashed."""
    flashed, now = places.versions / name / AS_FLASHED, places.settings_of(name)
    if not flashed.exists() or not now.exists():
        return []
    return difference(flashed.read_bytes(), now.read_bytes(), "as flashed", f"settings/{now.name}")
