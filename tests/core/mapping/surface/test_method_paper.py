"""The constants that docs/method.md tells are those of the code: all of them, and no other."""

import ast
import importlib
import math
import re
from typing import NamedTuple

from tests import ROOT

BESIDE = [
    ROOT / "core" / place for place in ("grid/places.py", "mapping/along.py", "motion/lean.py")
]
FILES = sorted([*ROOT.glob("core/mapping/surface/*.py"), *BESIDE])
EXEMPT = {  # numbers that tell kinds or bits apart, or count what is written out beside them
    "along.py": {"MOST_PLACES"},
    "cells.py": {"LOOSE", "TIED", "APART", "PART_BITS", "ALL_PARTS", "MOST_LOOKS", "PLANES"},
    "error.py": {"STATES"},
    "evidence.py": {"VOTED", "SAW_FLOOR", "WENT_UNDER", "NEWLY_TIED"},
    "places.py": {"MOST_PARTS"},  # as many as the bits of a cell are for
    "sweep.py": {"NONE", "FLOOR", "ABOVE", "BELOW", "HIGH"},
}
UNITS = {"M": "m", "M2": "m2", "S": "s", "MPS2": "m/s2", "RAD": "deg", "DEG": "deg"}
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


def constants_of_code() -> tuple[dict[Key, object], dict[Key, str]]:
    """All numbers, and tuples of numbers, that the files keep under a name in capitals.

    Returns:
        Those that stand for themselves, and the expressions of those that follow from others.
    """
    found: dict[Key, object] = {}
    derived: dict[Key, str] = {}
    for path in FILES:
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


def constants_of_paper() -> dict[Key, Told]:
    """The rows of the table; a row twice is a fault."""
    found: dict[Key, Told] = {}
    text = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
    section = text.split("\n## 6 ")[1].split("\n## ")[0]
    for line in section.splitlines():
        if not line.startswith("| `"):
            continue
        row = ROW.match(line)
        assert row, line
        name, file, value, unit, origin = row.groups()
        assert (file, name) not in found, line
        found[file, name] = Told(float(value), unit.strip(), origin.strip())
    return found


def derived_of_paper() -> dict[Key, str]:
    """The second table: what follows, and from what."""
    text = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
    section = text.split("\n## 6 ")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([A-Z_0-9]+) \| `(\w+\.py)` \| `([^`]+)` \|", section, re.MULTILINE)
    return {(file, name): ast.unparse(ast.parse(by)) for name, file, by in rows}


(CODE, DERIVED), PAPER = constants_of_code(), constants_of_paper()
NAMED = {key for key in CODE if key[1] not in EXEMPT.get(key[0], ())}


def test_the_paper_names_each_constant_of_the_code_and_no_other() -> None:
    assert set(PAPER) == NAMED


def test_the_paper_has_what_follows_from_other_constants_as_the_code_works_it_out() -> None:
    known = {key: by for key, by in DERIVED.items() if key[1] not in EXEMPT.get(key[0], ())}
    assert derived_of_paper() == known


def test_the_paper_has_the_values_of_the_code() -> None:
    for (file, name), told in PAPER.items():
        value = math.radians(told.value) if name.endswith("_RAD") else told.value
        assert value == CODE[file, name], (file, name)


def test_the_paper_has_the_units_that_the_names_say_and_tells_origins() -> None:
    for (file, name), told in PAPER.items():
        unit = UNITS.get(name.rpartition("_")[2]) if "_" in name else None
        assert unit is None or told.unit == unit, (file, name)
        assert told.origin, (file, name)


def test_the_paper_counts_its_constants() -> None:
    text = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
    assert re.findall(r"(\d+) constants", text) == [str(len(NAMED))]


def test_what_is_exempt_is_there() -> None:
    for file, names in EXEMPT.items():
        assert names <= {name for where, name in [*CODE, *DERIVED] if where == file}
