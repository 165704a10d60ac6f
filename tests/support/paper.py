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


def assigned(text: str) -> dict[str, ast.expr]:
    """What a module assigns to its constants, alone or several in a line."""
    found: dict[str, ast.expr] = {}
    for node in ast.parse(text).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            parts = target.elts if isinstance(target, ast.Tuple) else [target]
            values = [node.value] * len(parts)
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                values = node.value.elts
            for part, value in zip(parts, values, strict=True):
                if isinstance(part, ast.Name) and part.id.isupper():
                    found[part.id] = value
    return found


def follows(value: ast.expr) -> bool:
    """Whether a constant follows from others."""
    return any(isinstance(node, ast.Name) and node.id.isupper() for node in ast.walk(value))


def constants_of_code(files: Iterable[Path]) -> tuple[dict[Key, object], dict[Key, str]]:
    """All numbers, and tuples of numbers, that the files keep under a name in capitals.

    Returns:
        Those that stand for themselves, and the expressions of those that follow from others.
    """
    found: dict[Key, object] = {}
    derived: dict[Key, str] = {}
    for path in files:
        module = importlib.import_module(
            ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        )
        for name, by in assigned(path.read_text(encoding="utf-8")).items():
            value = getattr(module, name)
            numbers = value if type(value) is tuple else (value,)
            if not all(type(number) in (int, float) for number in numbers):
                continue
            if follows(by):
                derived[path.name, name] = ast.unparse(by)
            else:
                found[path.name, name] = value
    return found, derived


def constants_of_paper(text: str, section: int) -> dict[Key, Told]:
    """The rows of the table in a section; a row twice is a fault."""
    found: dict[Key, Told] = {}
    for line in section_of(text, section).splitlines():
        if not line.startswith("| `"):
            continue
        row = ROW.match(line)
        assert row, line
        name, file, value, unit, origin = row.groups()
        assert (file, name) not in found, line
        found[file, name] = Told(float(value), unit.strip(), origin.strip())
    return found


def section_of(text: str, section: int) -> str:
    return text.split(f"\n## {section} ")[1].split("\n## ")[0]


def derived_of_paper(text: str, section: int) -> dict[Key, str]:
    """The second table: what follows, and from what."""
    told = section_of(text, section)
    rows = re.findall(r"^\| ([A-Z_0-9]+) \| `(\w+\.py)` \| `([^`]+)` \|", told, re.MULTILINE)
    return {(file, name): ast.unparse(ast.parse(by)) for name, file, by in rows}
