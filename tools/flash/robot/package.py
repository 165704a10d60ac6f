"""The bundle, read on the robot: a zip with a manifest, wheels, unit, rules, settings, licences.

A file is believed only when its length and SHA-256 are those of the manifest, and the manifest when
they make its own id. `contents_id` and `is_kept` also serve who builds a bundle.
"""

import hashlib
import json
import shutil
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import IO, Any

from tools.flash.robot.places import FORM, FlashError

MANIFEST = "manifest.json"
WHEELS = "wheels/"
NEVER_RUN = (".pyi", ".pxd", ".h", ".c", ".a", ".hpp")  # for who builds against a library
OUR_HEADERS = "mapod/hw/mcu/"  # which a planner's author copies


def contents_id(files: Mapping[str, Mapping[str, Any]]) -> str:
    """The same files give the same 10 digits, on every machine."""
    lines = [f"{name} {files[name]['sha256']}\n" for name in sorted(files)]
    return hashlib.sha256("".join(lines).encode()).hexdigest()[:10]


def sha256(file: IO[bytes]) -> str:
    whole = hashlib.sha256()
    while piece := file.read(1 << 20):
        whole.update(piece)
    return whole.hexdigest()


def is_kept(member: str) -> bool:
    """Whether a wheel's file is put on the robot: not its tests, headers, scripts."""
    parts = PurePosixPath(member).parts
    if member.endswith("/") or parts[0].endswith(".data"):
        return False
    if parts[0].endswith(".dist-info") or member.startswith(OUR_HEADERS):
        return True
    return "tests" not in parts[:-1] and not member.endswith(NEVER_RUN)


class Package:
    """An open bundle."""

    def __init__(self, path: Path) -> None:
        """Raises FlashError: it is damaged."""
        self.path = path
        try:
            self._zip = zipfile.ZipFile(path)
            self.manifest: dict[str, Any] = json.loads(self._zip.read(MANIFEST))
        except (zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
            raise FlashError(f"{path} is no bundle, or a damaged one: {error}") from None
        if self.manifest.get("form") != FORM:
            raise FlashError(f"{path} is a bundle of another mapod: flash with that one")
        self.files: dict[str, dict[str, Any]] = self.manifest["files"]

    @property
    def name(self) -> str:
        return f"{self.manifest['version']}-{self.manifest['id']}"

    def close(self) -> None:
        self._zip.close()

    def check(self) -> None:
        """Raises FlashError: a file of it is not what was put into it."""
        if contents_id(self.files) != self.manifest["id"]:
            raise FlashError(f"{self.path} is damaged: its manifest; copy it again")
        for name, entry in self.files.items():
            try:
                with self._zip.open(name) as file:
                    found = sha256(file)
            except (zipfile.BadZipFile, KeyError, OSError, EOFError):
                found = ""
            if found != entry["sha256"]:
                raise FlashError(f"{self.path} is damaged: {name}; copy it again")

    def read(self, name: str) -> bytes:
        return self._zip.read(name)

    def code(self) -> list[str]:
        """The files that run on the robot before anything is installed: this one among them."""
        return [name for name in self.files if name.endswith(".py")]

    def unpack_wheels(self, lib: Path, tell: Callable[[str], None]) -> None:
        """What a robot needs of each wheel, side by side. Raises FlashError, OSError."""
        for name in sorted(self.files):
            if name.startswith(WHEELS):
                tell(name.removeprefix(WHEELS))
                with self._zip.open(name) as file, zipfile.ZipFile(file) as wheel:
                    for member in filter(is_kept, wheel.namelist()):
                        _extract(wheel, member, lib)

    def unpack_rest(self, folder: Path) -> None:
        """Unit, rules, documents, licences: all that is neither wheel nor code."""
        for name in self.files:
            if not name.startswith(WHEELS) and not name.endswith(".py"):
                _extract(self._zip, name, folder)
        (folder / MANIFEST).write_bytes(self._zip.read(MANIFEST))


def _extract(archive: zipfile.ZipFile, member: str, folder: Path) -> None:
    if ".." in PurePosixPath(member).parts or member.startswith("/"):
        raise FlashError(f"the bundle has a file that would lie elsewhere: {member}")
    path = folder / member
    path.parent.mkdir(parents=True, exist_ok=True)
    with archive.open(member) as source, path.open("wb") as target:
        shutil.copyfileobj(source, target, 1 << 20)
