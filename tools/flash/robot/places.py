"""Where everything lies on the robot, and the few ways in which it is changed.

Three symlinks in /opt/mapod tell all: `current` names the version that runs, `previous` the one
to roll back to, and `trial`, which is there only while a new version has to show that it works, the
one to go back to by itself. Each change of them is one rename: a power cut finds old or new.
"""

import ctypes
import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FORM = 1  # of the folders and links below; a robot with a higher one refuses an older bundle


class FlashError(Exception):
    """The flash can't go on; the text says why, in one line."""


class Places:
    """Paths under a root: / on the robot itself, a folder for an image or a second root."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.home = root / "opt/mapod"
        self.versions = self.home / "versions"
        self.current, self.previous = self.home / "current", self.home / "previous"
        self.trial, self.lock, self.form = (self.home / name for name in ("trial", "lock", "form"))
        self.etc = root / "etc/mapod"
        self.toml, self.settings = self.etc / "mapod.toml", self.etc / "settings"
        self.units = root / "etc/systemd/system"

    def settings_of(self, name: str) -> Path:
        return self.settings / f"{name}.toml"

    def version(self, link: Path) -> str | None:
        """The name of the version that a link names, if it is there."""
        if not link.is_symlink():
            return None
        name = Path(os.readlink(link)).name
        return name if (self.versions / name).is_dir() else None

    def follow(self, path: str) -> str:
        """What a link outside /opt/mapod says to lead to a file of whatever version is current."""
        return f"opt/mapod/current/{path}"


def relative(link: Path, target: Path) -> str:
    """What a link has to say, so that it holds under any root."""
    at = os.path.realpath(link.parent)
    return os.path.relpath(os.path.join(os.path.realpath(target.parent), target.name), at)


def put_link(link: Path, says: str) -> None:
    """Makes a symlink, or changes one, in one step that outlasts a power cut."""
    new = link.with_name(f".{link.name}.new")
    new.unlink(missing_ok=True)
    new.symlink_to(says)
    os.replace(new, link)
    sync(link.parent)


def put_file(path: Path, content: bytes, mode: int = 0o644) -> None:
    """Writes a file, or changes one, in one step that outlasts a power cut."""
    new = path.with_name(f".{path.name}.new")
    with new.open("wb") as file:
        file.write(content)
        file.flush()
        os.fchmod(file.fileno(), mode)
        os.fsync(file.fileno())
    os.replace(new, path)
    sync(path.parent)


def move(old: Path, new: Path) -> None:
    os.replace(old, new)
    sync(new.parent)


def sync(folder: Path) -> None:
    """The names in a folder are on the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_all(folder: Path) -> None:
    """Thousands of files at once: all of their file system. Raises OSError."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        if ctypes.CDLL(None, use_errno=True).syncfs(handle):
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number), str(folder))
    finally:
        os.close(handle)


@contextmanager
def locked(places: Places, who: str) -> Iterator[None]:
    """Nobody else flashes meanwhile. Raises FlashError: somebody does, and who."""
    places.home.mkdir(parents=True, exist_ok=True)
    with open(places.lock, "a+", opener=_for_root_alone) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            raise FlashError(f"another flash is at work: {file.read().strip()}") from None
        file.truncate(0)
        file.write(f"{who}, process {os.getpid()}, since {time.strftime('%H:%M:%S')}\n")
        file.flush()
        yield


def _for_root_alone(path: str, flags: int) -> int:
    """Who may open a lock may also hold it."""
    return os.open(path, flags, 0o600)


def is_locked(places: Places) -> bool:
    """Looks only: a lock that were tried here would be in the way of `recover`."""
    if not places.lock.exists():
        return False
    inode = f":{places.lock.stat().st_ino}"
    locks = [line.split() for line in Path("/proc/locks").read_text().splitlines()]
    return any("FLOCK" in words and any(w.endswith(inode) for w in words) for words in locks)


def check_form(places: Places) -> None:
    """Raises FlashError: a newer mapod has laid out this robot's folders."""
    if places.form.exists() and int(places.form.read_text()) > FORM:
        raise FlashError("this robot was flashed by a newer mapod: flash a newer bundle")
