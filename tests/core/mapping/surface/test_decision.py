"""Which rule decides a cell: each by a cell made for it, and what free always means."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.grid.window import ObstacleWindow
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
from core.mapping.surface.constants import CLEAR, GATE, LIKELY
from core.mapping.surface.decision import decide_cells, is_framed, list_causes, rule_of
from core.records import FREE, OBSTACLE, UNKNOWN
from jit import Record, records
from tests.support.maps.ground_cells import LIMITS, NOISE_M2, GroundCells, packed

OLDEST_S = 100.0  # NOISE_M2 is of 1 cm; 3 sigma with a cell's own: 3.1 cm
ALL = 0xFFFF  # parts of a cell
GOOD = {"var_m2": 1e-5, "looks": 3, "floor_s": 110.0, "stands": CLEAR, "tied": TIED}
GOOD |= {"floor_parts": ALL}


def cell_of(**fields: float) -> Record:
    made = records(CELL)
    made[:] = BLANK
    for name, value in packed(fields).items():
        made[name][0] = value
    return made[0]


def cause_of(cell: Record, shown: int = UNKNOWN, seen_s: float = OLDEST_S) -> int:
    return int(rule_of(cell, shown, seen_s, OLDEST_S, LIMITS, False, LIMITS.row))


AHEAD = {"looks": 0, "floor_s": -math.inf}  # expected there, not met
CASES: list[tuple[str, int, dict[str, Any]]] = [
    ("floor", FLOOR, {}),
    ("nothing known", UNSEEN, {"var_m2": math.inf}),
    ("nothing known, whatever else is said", UNSEEN, {"var_m2": math.inf, "under_m": -1.0}),
    ("too deep", NO_FLOOR, {"under_m": -0.10}),
    ("too deep, not met", NO_FLOOR, {"under_m": -0.10} | AHEAD),
    ("an edge, ground a step lower", NO_FLOOR, {"under_m": -0.01, "floor_m": -0.1} | AHEAD),
    ("a hole: the ground beyond is as high", NO_FLOOR, {"under_m": -0.06, "floor_m": 0.0} | AHEAD),
    ("floor was met, a beam went under it", NO_FLOOR, {"under_m": -0.06}),
    ("floor was met once, a beam went under it", NO_FLOOR, {"under_m": -0.06, "looks": 1}),
    ("ground that falls on", UNSHOWN, {"under_m": -0.06, "floor_m": -0.05} | AHEAD),
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
    ("under it in two parts without floor", UNSHOWN, {"floor_parts": 0xFFF0, "under_parts": 0x3}),
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


FRAMED = [  # floor by parts along x, of three cells; the same for all y
    ("xxxx x... xxxx", False),
    ("xxxx xx.. xxxx", True),
    ("xxxx ..xx xxxx", True),
    ("xxx. .xx. xxxx", True),
    ("xx.. .xxx xxxx", False),
    ("xxxx xxx. ..xx", False),
    ("xxxx xx.. .xxx", False),
    ("x... xxxx ...x", True),  # what lacks beside it is not its own
    ("xxxx .... xxxx", False),
]


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("seen", "is_narrow"), FRAMED)
def test_floor_may_lack_in_a_narrow_gap(seen: str, is_narrow: bool, turned: bool) -> None:
    ground = GroundCells(size=5)
    for n, parts in enumerate(seen.split()):
        bits = sum(1 << (4 * row + k) for k in range(4) for row in range(4) if parts[k] == "x")
        if turned:
            bits = sum(1 << (4 * k + row) for k in range(4) for row in range(4) if parts[k] == "x")
        for beside in (-1, 0, 1):
            i, j = (beside, n - 1) if turned else (n - 1, beside)
            ground.lay(i, j, 0.0, floor_parts=bits, looks=1)
    assert is_framed(0, 0, ground.surface) is is_narrow


def test_a_ditch_that_runs_aslant_frames_nothing() -> None:
    """30 cm wide, its middle at any place: no cell with its own middle in it is framed."""
    for shift in np.linspace(0.0, 0.28, 15):
        ground, part = GroundCells(size=9), 0.05
        for i, j in itertools.product(range(-3, 4), repeat=2):
            xs = [(i * 4 + k + 0.5) * part for k in range(4)]
            ys = [(j * 4 + k + 0.5) * part for k in range(4)]
            bits = sum(
                1 << (4 * row + k)
                for (k, x), (row, y) in itertools.product(enumerate(xs), enumerate(ys))
                if abs(x + y - shift) / math.sqrt(2.0) > 0.15
            )
            ground.lay(i, j, 0.0, floor_parts=bits, looks=int(bits > 0))
            if abs((i + j + 1) * 0.2 - shift) / math.sqrt(2.0) < 0.15:
                assert not is_framed(i, j, ground.surface)


def test_beside_what_is_not_known_nothing_is_framed() -> None:
    for expected in (False, True):
        ground = GroundCells(size=5)
        for i, j in itertools.product((-1, 0, 1), repeat=2) if expected else ():
            ground.lay(i, j, 0.0, floor_parts=ALL, looks=0)
        ground.lay(0, 0, 0.0, floor_parts=0x0FFF)
        assert not is_framed(0, 0, ground.surface)


@pytest.mark.parametrize(
    ("parts", "is_floor"),
    [(0x0102, True), (0x0020, True), (0x0660, True), (0x0001, False), (0x0000, False)],
)
def test_floor_in_few_parts_is_enough_where_what_lacks_is_narrow(
    parts: int, is_floor: bool
) -> None:
    """Of the first cell of map and window, and of the one behind it."""
    for i, j in ((0, 0), (1, 1)):
        ground = GroundCells(size=5)
        for di, dj in itertools.product((-1, 0, 1), repeat=2):
            ground.lay(i + di, j + dj, 0.0, floor_parts=ALL)
        ground.lay(i, j, 0.0, floor_parts=parts)
        window = ObstacleWindow(3, 0.2)
        window.follow((i + 0.5) * 0.2, (j + 0.5) * 0.2)
        listed = np.array([ground.at(i, j)], dtype=np.int32)
        assert decide_cells(listed, ground.surface, window.shown, 0) == is_floor
        at = j % 3 * 3 + i % 3
        assert int(window.cells.reshape(-1)[at]) == (FREE if is_floor else UNKNOWN)
        assert (np.count_nonzero(window.cells)) == is_floor
        told, places = np.zeros(2, np.uint8), np.array([[i, j], [i + 2, j]])
        list_causes(places[:, 0].copy(), places[:, 1].copy(), ground.surface, window.shown, told)
        assert told.tolist() == [FLOOR if is_floor else UNSHOWN, causes.OUTSIDE]


@pytest.mark.parametrize(
    ("parts", "beside", "is_floor"),
    [
        (0x0FFF, {"under_m": -0.2}, False),
        (0x1FFF, {"under_m": -0.2}, True),
        (0x0FFF, {"under_m": -0.06} | AHEAD, False),  # there may be none
        (0x0FFF, {"under_m": -0.01} | AHEAD, False),
        (0x0FFF, AHEAD, True),
        (0x0FFF, {"under_m": -0.01}, True),
        (0x0FFF, {"under_m": -0.2, "var_m2": math.inf}, True),
        (0x0FFF, {}, True),
    ],
)
def test_beside_missing_ground_all_but_a_row_of_a_cell_must_have_floor(
    parts: int, beside: dict[str, Any], is_floor: bool
) -> None:
    """Missing in each of the cells around, the first of the map among them, and farther off."""
    for i, j in itertools.product(range(-1, 4), repeat=2):
        ground, window = GroundCells(size=7), ObstacleWindow(7, 0.2)
        ground.lay(1, 1, 0.0, floor_parts=parts)
        ground.lay(i, j, 0.0, **beside) if (i, j) != (1, 1) else None
        is_beside = max(abs(i - 1), abs(j - 1)) == 1
        decide_cells(np.array([ground.at(1, 1)], np.int32), ground.surface, window.shown, 0)
        state = FREE if is_floor or not is_beside else UNKNOWN
        assert int(window.cells[1, 1]) == state


def test_what_the_map_does_not_hold_is_unseen_or_outside_of_the_window() -> None:
    ground, window, told = GroundCells(size=5), ObstacleWindow(9, 0.2), np.zeros(2, np.uint8)
    list_causes(np.array([3, 5]), np.array([0, 0]), ground.surface, window.shown, told)
    assert told.tolist() == [UNSEEN, causes.OUTSIDE]


def test_what_lies_just_at_a_bound_is_beyond_it() -> None:
    """A bound that single precision holds exactly."""
    limits = LIMITS._replace(h_neg_m=-0.125)
    for fields, cause in (
        ({"under_m": -0.125}, NO_FLOOR),
        ({"under_m": -0.125, "var_m2": 0.01}, UNSHOWN),
        ({"under_m": -0.01, "floor_m": -0.125} | AHEAD, NO_FLOOR),
        ({"under_m": -0.0625, "floor_m": -0.125} | AHEAD, NO_FLOOR),
    ):
        cell = cell_of(**GOOD | fields)
        assert rule_of(cell, UNKNOWN, OLDEST_S, OLDEST_S, limits, False, limits.row) == cause


def test_a_framed_cell_is_free_with_floor_in_some_part_of_it() -> None:
    for fields, cause in (({"floor_parts": 0x1}, FLOOR), ({"floor_parts": 0}, UNSHOWN)):
        cell = cell_of(**GOOD | fields)
        assert rule_of(cell, UNKNOWN, OLDEST_S, OLDEST_S, LIMITS, False, 0) == cause
    under = cell_of(**GOOD | {"floor_parts": 0x1, "under_parts": 0x6})
    assert rule_of(under, UNKNOWN, OLDEST_S, OLDEST_S, LIMITS, False, 0) == UNSHOWN


HEIGHTS = st.one_of(st.just(math.inf), st.just(-math.inf), st.floats(-0.5, 0.5))
RECORDS = st.fixed_dictionaries(
    {
        "var_m2": st.sampled_from([1e-6, 1e-5, 1e-3, 0.1, math.inf]),
        "under_m": st.one_of(st.just(math.inf), st.floats(-0.5, 0.0)),
        "floor_m": HEIGHTS,
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
