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
    "touched.py": {"VOTED", "SAW_FLOOR", "WENT_UNDER", "NEWLY_TIED"},
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


def constants_of_code() -> dict[Key, object]:
    """All numbers, and tuples of numbers, that the files keep under a name in capitals."""
    found = {}
    for path in FILES:
        module = importlib.import_module(
            ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        )
        for name in names_assigned(path.read_text(encoding="utf-8")):
            value = getattr(module, name)
            numbers = value if type(value) is tuple else (value,)
            if all(type(number) in (int, float) for number in numbers):
                found[path.name, name] = value
    return found


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


CODE, PAPER = constants_of_code(), constants_of_paper()
NAMED = {key for key in CODE if key[1] not in EXEMPT.get(key[0], ())}


def test_the_paper_names_each_constant_of_the_code_and_no_other() -> None:
    assert set(PAPER) == NAMED


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
        assert names <= {name for where, name in CODE if where == file}
