"""Which rule decides a cell: each by a cell made for it, and what free always means."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.mapping import causes
from core.mapping.causes import (
    AGED,
    BEYOND_STEP,
    EARLIER_RUN,
    FEW,
    FLOOR,
    GUESSED,
    NO_FLOOR,
    STANDS,
    UNREACHED,
    UNSEEN,
    UNSHOWN,
    state_of,
)
from core.mapping.surface.cells import APART, BLANK, CELL, LOOSE, TIED
from core.mapping.surface.decision import LIKELY, rule_of
from core.mapping.surface.error import GATE
from core.mapping.surface.evidence import CLEAR
from core.records import FREE, OBSTACLE, UNKNOWN
from jit import Record, records
from tests.support.ground_cells import LIMITS

NOISE_M2, OLDEST_S = 1e-4, 100.0  # 1 cm; 3 sigma with a cell's own: 3.1 cm
ALL = 0xFFFF  # parts of a cell
GOOD = {"var_m2": 1e-5, "looks": 3, "floor_s": 110.0, "stands": CLEAR, "tied": TIED}
GOOD |= {"floor_parts": ALL}


def cell_of(**fields: float) -> Record:
    made = records(CELL)
    made[:] = BLANK
    for name, value in fields.items():
        made[name][0] = value
    return made[0]


def cause_of(cell: Record, shown: int = UNKNOWN, seen_s: float = OLDEST_S) -> int:
    return int(rule_of(cell, shown, seen_s, OLDEST_S, LIMITS, NOISE_M2))


AHEAD = {"looks": 0, "floor_s": -math.inf}  # expected there, not met
CASES: list[tuple[str, int, dict[str, Any]]] = [
    ("floor", FLOOR, {}),
    ("nothing known", UNSEEN, {"var_m2": math.inf}),
    ("nothing known, whatever else is said", UNSEEN, {"var_m2": math.inf, "under_m": -1.0}),
    ("too deep", NO_FLOOR, {"under_m": -0.10}),
    ("too deep, not met", NO_FLOOR, {"under_m": -0.10} | AHEAD),
    ("an edge, ground a step lower", NO_FLOOR, {"under_m": -0.01, "far_m": -0.1} | AHEAD),
    ("a hole: the ground beyond is as high", NO_FLOOR, {"under_m": -0.06, "far_m": 0.0} | AHEAD),
    ("floor was met, a beam went under it", NO_FLOOR, {"under_m": -0.06}),
    ("ground that falls on", UNSHOWN, {"under_m": -0.06, "far_m": -0.05} | AHEAD),
    ("under it, and nothing beyond yet", UNSHOWN, {"under_m": -0.06} | AHEAD),
    ("under it by no more than noise", FLOOR, {"under_m": -0.03}),
    ("never met", UNSHOWN, AHEAD),
    ("it stands", STANDS, {"stands": LIKELY, "top_m": 0.3}),
    ("it stands where floor was never met", STANDS, {"stands": LIKELY, "top_m": 0.3} | AHEAD),
    ("it may stand", FEW, {"stands": LIKELY - 0.1, "top_m": 0.3}),
    ("no higher than noise", GUESSED, {"stands": LIKELY, "top_m": 0.02}),
    ("on a guess", GUESSED, {"stands": LIKELY, "top_m": 0.3, "var_m2": 0.04}),
    ("beyond a step", BEYOND_STEP, {"tied": APART}),
    ("not reached", UNREACHED, {"tied": LOOSE}),
    ("too few passed", FEW, {"stands": CLEAR + 0.01}),
    ("floor in a row of its parts alone", UNSHOWN, {"floor_parts": 0x000F}),
    ("floor in more than a row", FLOOR, {"floor_parts": 0x001F}),
    ("under it in half a row without floor", UNSHOWN, {"floor_parts": 0xFFF0, "under_parts": 0x3}),
    ("under it in one part without floor", FLOOR, {"floor_parts": 0xFFF0, "under_parts": 0x1}),
]


@pytest.mark.parametrize(("cause", "fields"), [pytest.param(*c[1:], id=c[0]) for c in CASES])
def test_each_cell_is_decided_by_its_rule(cause: int, fields: dict[str, Any]) -> None:
    assert causes.CAUSES[cause_of(cell_of(**(GOOD | fields)))] == causes.CAUSES[cause]


@pytest.mark.parametrize(
    ("seen_s", "cause"), [(OLDEST_S, FLOOR), (OLDEST_S - 0.01, AGED), (-math.inf, EARLIER_RUN)]
)
def test_floor_that_was_not_seen_lately_is_not_free(seen_s: float, cause: int) -> None:
    assert cause_of(cell_of(**GOOD), seen_s=seen_s) == cause
    assert (state_of(cause) == FREE) == (cause == FLOOR)


def test_an_obstacle_stays_one_until_nothing_speaks_for_it() -> None:
    rises = GOOD | {"top_m": 0.3}
    assert cause_of(cell_of(**rises | {"stands": 0.1}), OBSTACLE) == STANDS
    assert cause_of(cell_of(**rises | {"stands": 0.1}), FREE) == FEW
    assert cause_of(cell_of(**rises | {"stands": 0.0}), OBSTACLE) == FEW
    assert cause_of(cell_of(**rises | {"stands": CLEAR}), OBSTACLE) == FLOOR


HEIGHTS = st.one_of(st.just(math.inf), st.just(-math.inf), st.floats(-0.5, 0.5))
RECORDS = st.fixed_dictionaries(
    {
        "var_m2": st.sampled_from([1e-6, 1e-5, 1e-3, 0.1, math.inf]),
        "under_m": st.one_of(st.just(math.inf), st.floats(-0.5, 0.0)),
        "far_m": HEIGHTS,
        "low_m": HEIGHTS,
        "top_m": HEIGHTS,
        "stands": st.one_of(st.sampled_from([-3.0, CLEAR, 0.0, LIKELY]), st.floats(-3.0, 4.5)),
        "looks": st.integers(0, 3),
        "tied": st.sampled_from([LOOSE, TIED, TIED, APART]),
    }
)


@given(
    fields=RECORDS,
    shown=st.sampled_from([FREE, UNKNOWN, OBSTACLE]),
    seen_s=st.one_of(st.just(-math.inf), st.floats(OLDEST_S - 1, OLDEST_S + 1)),
)
def test_free_is_what_was_seen_lately_can_be_reached_and_has_nothing_on_it(
    fields: dict[str, float], shown: int, seen_s: float
) -> None:
    cause = cause_of(cell_of(**fields, floor_parts=ALL), shown, seen_s)
    assert cause in causes.CAUSES
    is_good = (
        fields["looks"] > 0
        and fields["tied"] == TIED
        and fields["stands"] <= CLEAR
        and seen_s >= OLDEST_S
        and np.isfinite(fields["var_m2"])
    )
    if state_of(cause) == FREE:
        assert is_good
        doubt_m = GATE * math.sqrt(fields["var_m2"] + NOISE_M2)
        assert fields["under_m"] >= -doubt_m
        assert fields["under_m"] > LIMITS.h_neg_m
    elif is_good and fields["under_m"] == math.inf:
        pytest.fail(f"floor is told as {causes.CAUSES[cause].word}")
