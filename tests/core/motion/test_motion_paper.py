"""The constants that docs/motion.md tells are those of the code: all of them, and no other."""

import math
import re
from collections.abc import Callable

from tests import ROOT
from tests.support.paper import constants_of_code, constants_of_paper

FILES = [
    ROOT / "core" / "motion" / f"{name}.py"
    for name in ("error_state", "orientation", "tilt", "lean", "rest", "compass", "gravity")
]
PAPER_TEXT = (ROOT / "docs" / "motion.md").read_text(encoding="utf-8")
(CODE, DERIVED), PAPER = constants_of_code(FILES), constants_of_paper(PAPER_TEXT, 3)
STATES = {name for file, name in CODE if file == "error_state.py" and type(CODE[file, name]) is int}
FROM_UNIT: dict[str, Callable[[float], float]] = {
    "deg": math.radians,
    "deg/s": math.radians,
    "deg/s/sqrt(s)": lambda told: math.radians(told) ** 2,
    "deg/sqrt(turn)": lambda told: math.radians(told) ** 2 / (2 * math.pi),
}
UNITS = {"S": {"s"}, "MPS2": {"m/s2"}, "RAD": {"deg", "rad"}, "RADPS": {"deg/s", "rad/s"}}


def test_the_paper_names_each_constant_of_the_code_and_no_other() -> None:
    named = {key for key in CODE if key[1] not in STATES}
    assert set(PAPER) == named
    assert re.findall(r"(\d+) constants", PAPER_TEXT) == [str(len(named))]


def test_the_paper_has_the_values_of_the_code_and_the_units_that_the_names_say() -> None:
    for (file, name), told in PAPER.items():
        value = FROM_UNIT.get(told.unit, float)(told.value)
        assert math.isclose(value, float(str(CODE[file, name]))), (file, name)
        units = UNITS.get(name.rpartition("_")[2], {told.unit})
        assert told.unit in units, (file, name)
        assert told.origin, (file, name)


def test_the_states_are_counted_where_they_stand() -> None:
    assert {"SIZE", "X", "Y", "YAW", "TILT", "BIAS", "CASE"} <= STATES
