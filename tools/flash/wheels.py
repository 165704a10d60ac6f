"""The wheels of a bundle: of the libraries, for the robot's machine, and of mapod itself.

Libraries come from the package index once and stay in `build/wheels`; later they are taken from
there where their hashes still hold, so that a second flash needs no network. Nothing is compiled,
so a bundle for another processor is made as easily.
"""

import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from tools.cli.options import ROOT
from tools.deps.lock import FILE, LockError, closure, locked, pins_from_text

LIBC = range(17, 29)  # glibc 2.17 to 2.28: Debian 10, Ubuntu 20.04 and whatever is newer
LIST = "wheels.json"
ROOMS = ("mapod", "mapod_link", "core", "recording", "hw", "robots", "tools", "fakes")
BUILD = "from setuptools import build_meta; print(build_meta.build_wheel('dist'))"
EPOCH = "315532800"  # 1980: the time of files in a wheel, so that it is the same each time
SETUPTOOLS = 77
BUILDER = "setuptools"


class BundleError(Exception):
    """A bundle can't be made; the text says why."""


@dataclass(frozen=True)
class Target:
    """What a bundle is for."""

    arch: str = "x86_64"  # as `uname -m` says it
    python: str = "311"

    def __str__(self) -> str:
        return f"{self.arch}-cp{self.python}"


def needs() -> dict[str, list[str]]:
    """What the lock has, with hashes: to run, and to build."""
    if not (ROOT / "pyproject.toml").exists():
        raise BundleError("a bundle is made from the source tree: see its README")
    try:
        pins = pins_from_text(FILE.read_text(encoding="utf-8"))
        run, build = locked(), closure(pins, [BUILDER])
    except (LockError, OSError) as error:
        raise BundleError(f"the libraries are not locked: {error}") from None
    return {"run": [str(pin) for pin in run], "build": [str(pin) for pin in build]}


def sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def libraries(target: Target, cache: Path) -> list[Path]:
    """The libraries' wheels, from the cache or the index. Raises BundleError."""
    return _cached(cache / str(target), needs()["run"], _options_of(target))


def _cached(folder: Path, wanted: list[str], options: list[str]) -> list[Path]:
    listed = folder / LIST
    if listed.exists():
        known = json.loads(listed.read_text(encoding="utf-8"))
        found = [folder / name for name in known["wheels"]]
        if known["needs"] == wanted and all(
            path.exists() and sha256(path) == known["wheels"][path.name] for path in found
        ):
            return found
    print(f"downloading the libraries to {folder} (once)", file=sys.stderr, flush=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as name:
        fresh = Path(name, "wheels")
        _download(wanted, options, fresh)
        found = sorted(fresh.glob("*.whl"))
        known = {"needs": wanted, "wheels": {path.name: sha256(path) for path in found}}
        (fresh / LIST).write_text(json.dumps(known, indent=1), encoding="utf-8")
        shutil.rmtree(folder, ignore_errors=True)
        fresh.rename(folder)
    return [folder / path.name for path in found]


def _options_of(target: Target) -> list[str]:
    tags = [f"manylinux_2_{minor}_{target.arch}" for minor in LIBC]
    options = [f"--platform={tag}" for tag in [*tags, f"manylinux2014_{target.arch}"]]
    options += [f"--abi={abi}" for abi in (f"cp{target.python}", "abi3", "none")]
    return [*options, "--implementation=cp", f"--python-version={target.python}"]


def _download(wanted: list[str], options: list[str], folder: Path) -> None:
    """By pip, which checks the hashes of the lock; wheels only. Raises BundleError."""
    if importlib.util.find_spec("pip") is None:
        raise BundleError("needs pip to download the libraries: apt install python3-pip")
    command = [sys.executable, "-m", "pip", "download", "--disable-pip-version-check"]
    command += ["--only-binary=:all:", *options, "--dest", str(folder)]
    command += ["--no-deps", "--require-hashes", "--requirement", "/dev/stdin"]
    shown, pins = sys.stderr if sys.stderr.isatty() else subprocess.DEVNULL, "\n".join(wanted)
    done = subprocess.run(
        command, input=pins, stdout=shown, stderr=subprocess.PIPE, text=True, check=False
    )
    errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
    if done.returncode:
        why = (errors or ["ERROR: pip failed"])[-1].removeprefix("ERROR: ")
        raise BundleError(f"can't download the libraries: {why}")


def own_wheel(cache: Path, folder: Path) -> Path:
    """mapod's wheel, built from a copy of the checkout. Raises BundleError."""
    source = folder / "source"
    ignored = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    for room in ROOMS:
        shutil.copytree(ROOT / room, source / room, ignore=ignored)
    for pattern in ("*.py", "*.toml", "*.md", "LICENSE", "NOTICE"):
        for path in ROOT.glob(pattern):
            shutil.copy(path, source)
    env = {**os.environ, "SOURCE_DATE_EPOCH": EPOCH, "PYTHONPATH": _build_tools(cache, folder)}
    command = [sys.executable, "-c", BUILD]
    done = subprocess.run(command, cwd=source, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BundleError(f"can't build mapod's wheel: {(done.stderr.splitlines() or ['?'])[-1]}")
    return source / "dist" / done.stdout.splitlines()[-1]


def _build_tools(cache: Path, folder: Path) -> str:
    """Where setuptools lies, if this Python's own is too old: as PYTHONPATH."""
    try:
        if int(metadata.version("setuptools").partition(".")[0]) >= SETUPTOOLS:
            return ""
    except metadata.PackageNotFoundError:
        pass
    for wheel in _cached(cache / "build", needs()["build"], []):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder / "setuptools")
    return str(folder / "setuptools")


def libc_of(wheels: list[Path]) -> str:
    """The oldest glibc that all of them run with: 2.28."""
    least = 17
    for wheel in wheels:
        minors = [int(minor) for minor in re.findall(r"manylinux_2_(\d+)_", wheel.name)]
        least = max(least, min(minors, default=17))
    return f"2.{least}"
