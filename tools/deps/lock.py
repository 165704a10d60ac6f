"""The lock: of every library the one version that is installed, and the hashes of its files.

`requirements.lock` is what `make lock` writes: pip's form, with a comment for who needs what. This
gives the part of it that some extras need, for `pip install --no-deps --require-hashes`: a file
with another hash is not installed. It runs before anything is installed: standard library alone.

    python -m tools.deps.lock sim test
"""

import re
import sys
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "requirements.lock"
OWN = "mapod"  # who needs what pyproject.toml names
PINNED = re.compile(r"([\w.-]+)==([\w.!+]+)(?: ; ([^\\]+?))?(?: \\)?")
HASH = re.compile(r"    --hash=sha256:([0-9a-f]{64})(?: \\)?")
NEEDED_BY = re.compile(r"    #(?: via|  ) ([\w.-]+)(?: \(.*\))?")
BOUND = "-c (workspace)"  # a bound of pyproject.toml, and nobody's need


class LockError(Exception):
    """The lock can't be used; the text says why."""


@dataclass(slots=True)
class Pin:
    """One library."""

    name: str  # as the index writes it, in small letters
    version: str
    marker: str  # where it is needed; "" everywhere
    hashes: list[str] = field(default_factory=list)  # SHA-256 of each file of that version
    needed_by: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        marker = f" ; {self.marker}" if self.marker else ""
        hashes = [f"    --hash=sha256:{digest}" for digest in self.hashes]
        return " \\\n".join([f"{self.name}=={self.version}{marker}", *hashes])


def normal(name: str) -> str:
    """The name of a library as the index compares it.

    >>> normal("foxglove_SDK>=0.25")
    'foxglove-sdk'
    """
    found = re.match(r"[\w.-]+", name)
    return re.sub(r"[-_.]+", "-", found[0] if found else "").lower()


def pins_from_text(text: str) -> dict[str, Pin]:
    """By name. Raises LockError: a line that is none of a lock, or a library without a hash."""
    pins: dict[str, Pin] = {}
    pin: Pin | None = None
    for number, line in enumerate(text.splitlines(), 1):
        if not line or line.startswith("#") or BOUND in line:
            continue
        if found := PINNED.fullmatch(line):
            pin = pins[normal(found[1])] = Pin(normal(found[1]), found[2], found[3] or "")
        elif pin and (found := HASH.fullmatch(line)):
            pin.hashes.append(found[1])
        elif pin and (found := NEEDED_BY.fullmatch(line)):
            pin.needed_by.append(normal(found[1]))
        elif line.strip() not in ("#", "# via"):
            raise LockError(f"{FILE.name}:{number}: is no line of a lock: {line}")
    for pin in pins.values():
        if not pin.hashes or not pin.needed_by:
            raise LockError(f"{FILE.name}: {pin.name} has no hash, or nobody needs it")
    return pins


def wanted_of(project: Mapping[str, Any], extras: Iterable[str]) -> list[str]:
    """The names that pyproject.toml has for these extras, and for all. Raises LockError."""
    known = project["optional-dependencies"]
    lines = list(project["dependencies"])
    for extra in extras:
        if extra not in known:
            raise LockError(f"there is no extra {extra!r}; there are {', '.join(known)}")
        lines += known[extra]
    return sorted({normal(line) for line in lines} - {OWN})  # an extra may name others


def closure(pins: Mapping[str, Pin], wanted: Iterable[str]) -> list[Pin]:
    """These libraries and all that they need, by name. Raises LockError: one is not locked."""
    found, due = set[str](), list(wanted)
    while due:
        name = due.pop()
        if name not in pins:
            raise LockError(f"{FILE.name}: {name} is missing: make lock")
        if name not in found:
            found.add(name)
            due += [pin.name for pin in pins.values() if name in pin.needed_by]
    return [pins[name] for name in sorted(found)]


def project() -> dict[str, Any]:
    """The table [project] of pyproject.toml."""
    table = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return dict(table["project"])


def locked(*extras: str) -> list[Pin]:
    """What some extras need, pinned. Raises LockError, OSError."""
    pins = pins_from_text(FILE.read_text(encoding="utf-8"))
    return closure(pins, wanted_of(project(), extras))


def main() -> int:
    try:
        print("\n".join(str(pin) for pin in locked(*sys.argv[1:])))
    except (LockError, OSError) as error:
        print(f"mapod: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
