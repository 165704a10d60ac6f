"""The constants that docs/method.md tells are those of the code: all of them, and no other."""

import math
import re

from tests import ROOT
from tests.support.paper import constants_of_code, constants_of_paper, derived_of_paper

BESIDE = [ROOT / "core" / place for place in ("grid/places.py", "mapping/along.py")]
ROOMS = "core/mapping/surface", "core/mapping/heights"
FILES = sorted([*(file for room in ROOMS for file in ROOT.glob(f"{room}/*.py")), *BESIDE])
EXEMPT = {  # numbers that tell kinds or bits apart, or count what is written out beside them
    "along.py": {"MOST_PLACES"},
    "cells.py": {
        "LOOSE",
        "TIED",
        "APART",
        "PART_BITS",
        "ALL_PARTS",
        "MOST_LOOKS",
        "PLANES",
        "STATES",
    },
    "evidence.py": {"VOTED", "SAW_FLOOR", "WENT_UNDER", "NEWLY_TIED"},
    "fill.py": {"WAYS"},
    "places.py": {"MOST_PARTS"},  # as many as the bits of a cell are for
    "sweep.py": {"NONE", "FLOOR", "ABOVE", "BELOW", "HIGH"},
}
UNITS = {"M": "m", "M2": "m2", "S": "s", "MPS2": "m/s2", "RAD": "deg", "DEG": "deg"}
TEXT = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
(CODE, DERIVED), PAPER = constants_of_code(FILES), constants_of_paper(TEXT, 6)
NAMED = {key for key in CODE if key[1] not in EXEMPT.get(key[0], ())}


def test_the_paper_names_each_constant_of_the_code_and_no_other() -> None:
    assert set(PAPER) == NAMED


def test_the_paper_has_what_follows_from_other_constants_as_the_code_works_it_out() -> None:
    known = {key: by for key, by in DERIVED.items() if key[1] not in EXEMPT.get(key[0], ())}
    assert derived_of_paper(TEXT, 6) == known


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
    assert re.findall(r"(\d+) constants", TEXT) == [str(len(NAMED))]


def test_what_is_exempt_is_there() -> None:
    for file, names in EXEMPT.items():
        assert names <= {name for where, name in [*CODE, *DERIVED] if where == file}
