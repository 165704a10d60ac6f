"""Papers in docs that tell every constant of some files, held against the code."""

import ast
import importlib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from tests import ROOT

ROW = re.compile(r"^\| `([A-Z][A-Z0-9_]*)` \| `(\w+\.py)` \| (\S+) \| ([^|]*) \| ([^|]+) \|$")

Key = tuple[str, str]  # file, name


class Told(NamedTuple):
    """A row of the table."""

    value: float
    unit: str
    origin: str


def names_assigned(text: str) -> list[str]:
    """Constants that a module assigns itself, alone or several in a line."""
    found = []
    for node in ast.parse(text).body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign):
            targets = [node.target]
        for target in targets:
            parts = target.elts if isinstance(target, ast.Tuple) else [target]
            found += [part.id for part in parts if isinstance(part, ast.Name)]
    return [name for name in found if name.isupper()]


def constants_of_code(files: Iterable[Path]) -> dict[Key, object]:
    """All numbers, and tuples of numbers, that the files keep under a name in capitals."""
    found = {}
    for path in files:
        module = importlib.import_module(
            ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        )
        for name in names_assigned(path.read_text(encoding="utf-8")):
            value = getattr(module, name)
            numbers = value if type(value) is tuple else (value,)
            if all(type(number) in (int, float) for number in numbers):
                found[path.name, name] = value
    return found


def constants_of_paper(text: str, section: int) -> dict[Key, Told]:
    """The rows of the table in a section; a row twice is a fault."""
    found: dict[Key, Told] = {}
    for line in text.split(f"\n## {section} ")[1].split("\n## ")[0].splitlines():
        if not line.startswith("| `"):
            continue
        row = ROW.match(line)
        assert row, line
        name, file, value, unit, origin = row.groups()
        assert (file, name) not in found, line
        found[file, name] = Told(float(value), unit.strip(), origin.strip())
    return found
