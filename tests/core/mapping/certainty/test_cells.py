"""(9) to (11), the CAS filter and what cells mean: the kernels against a plain transcription."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.grid.ring import RingGrid
from core.grid.touched import Touched
from core.grid.window import ObstacleWindow
from core.mapping.body import BodyPose
from core.mapping.causes import (
    AGED,
    BESIDE,
    BRINK,
    CORRUPT,
    EDGE,
    FLOOR,
    FREE_BEFORE,
    OUTSIDE,
    RESET,
    TOO_HIGH,
    TOO_LOW,
    UNCERTAIN,
    UNSEEN,
)
from core.mapping.certainty.cas import heights_at, mark, median_about
from core.mapping.certainty.cells import Cells, Pass, Rules, gather, update, widen
from core.mapping.certainty.decision import cause_at, decide, list_causes
from core.records import F64, FREE, U8, UNKNOWN
from tests.support.cases import examples
from tests.support.maps.slow_certainty import Reading, SlowCertainty, SlowSettings

SIZE, CELL_M = 7, 0.1
LEVEL = BodyPose(0.0, 0.0, 0.0, (1.0, 0.0), (0.0, 0.0), 0.0)


class Map:
    """The kernels as the maps call them, about the origin."""

    def __init__(self, given: SlowSettings) -> None:
        self.grid, count = RingGrid(SIZE, CELL_M), SIZE * SIZE
        self.cells = Cells(
            height_m=self.grid.layer(np.float64, math.nan).reshape(-1),
            low_m=self.grid.layer(np.float64, math.nan).reshape(-1),
            certainty=self.grid.layer(np.int32, 0).reshape(-1),
            marks=self.grid.layer(np.uint8, 0).reshape(-1),
            seen_s=self.grid.layer(np.float64, -math.inf).reshape(-1),
            ring=self.grid.ring,
        )
        self.rules = Rules(
            given.gain,
            given.most,
            given.free_from,
            given.cas,
            given.cas_certainty,
            given.cas_height_m,
            given.h_pos_m,
            given.h_neg_m,
            given.robot_m,
        )
        low_m, limit_m = np.zeros((2, count))
        self.one = Pass(Touched.none(count), low_m, limit_m, np.zeros(count, np.int32))
        self.near = Touched.none(count)

    def add(self, scan: list[Reading], t_s: float = 1.0) -> int:
        points = np.array([reading[:3] for reading in scan]).reshape(-1, 3)
        limits_m = np.array([reading[3] for reading in scan])
        kept, ring = np.ones(len(scan), np.uint8), self.cells.ring
        used = gather(points, limits_m, kept, LEVEL, self.rules, ring, self.one)
        update(self.one, t_s, self.cells, self.rules)
        widen(self.one.met, ring, self.near)
        mark(self.near, self.cells, self.rules)
        return used

    def at(self, i: int, j: int) -> int:
        return j % SIZE * SIZE + i % SIZE

    def height(self, i: int, j: int) -> float:
        found: F64 = np.empty(1)
        heights_at(np.array([self.at(i, j)]), self.cells, True, found)
        return float(found[0])

    def cause(self, i: int, j: int, oldest_s: float = 0.0, body: BodyPose = LEVEL) -> int:
        return cause_at(self.at(i, j), i, j, self.cells, body, oldest_s, self.rules)


PLACE = st.floats(-0.55, 0.55)
READING = st.tuples(PLACE, PLACE, st.floats(-0.3, 1.2), st.floats(0.01, 0.2))
GIVEN = st.builds(
    SlowSettings,
    gain=st.integers(1, 3),
    most=st.integers(3, 8),
    free_from=st.integers(1, 3),
    cas=st.booleans(),
    cas_certainty=st.integers(1, 4),
    cas_height_m=st.floats(0.02, 0.2),
)


@settings(max_examples=examples(100), deadline=None)
@given(given=GIVEN, scans=st.lists(st.lists(READING, max_size=60), max_size=8), calm=st.booleans())
def test_the_kernels_agree_with_the_equations_written_down_a_second_time(
    given: SlowSettings, scans: list[list[Reading]], calm: bool
) -> None:
    fast, slow = Map(given), SlowCertainty(given, CELL_M)
    if calm:  # flat enough that most readings agree
        scans = [[(x, y, 0.15 * z, limit) for x, y, z, limit in scan] for scan in scans]
    for scan in scans:
        inside = [r for r in scan if max(abs(math.floor(v / CELL_M)) for v in r[:2]) <= 3]
        assert fast.add(scan) == sum(z <= given.robot_m for _, _, z, _ in inside)
        slow.add(inside)
    for i in range(-3, 4):
        for j in range(-3, 4):
            assert fast.cells.certainty[fast.at(i, j)] == slow.certainties.get((i, j), 0)
            assert fast.cause(i, j) == slow.cause((i, j))
            told, meant = fast.height(i, j), slow.filled((i, j))
            assert told == pytest.approx(meant, abs=1e-9, nan_ok=True)


def flat(i: int, j: int, z: float = 0.0, limit: float = 0.05) -> Reading:
    return (i + 0.5) * CELL_M, (j + 0.5) * CELL_M, z, limit


EVERYWHERE = [(i, j) for i in range(-3, 4) for j in range(-3, 4)]


def on_floor(given: SlowSettings, *but: tuple[int, int]) -> Map:
    """After four scans of flat floor, that some cells lack."""
    one = Map(given)
    for _ in range(4):
        one.add([flat(*at) for at in EVERYWHERE if at not in but])
    return one


@pytest.mark.parametrize(("weights", "median"), [((4, 1, 3), 0.00), ((3, 1, 4), 0.02)])
def test_the_lower_weighted_median_and_its_tie(
    weights: tuple[int, int, int], median: float
) -> None:
    one = Map(SlowSettings(most=9))
    heights = zip(((-1, 0), (0, 1), (1, 0)), (0.00, 0.02, 0.10), weights, strict=True)
    one.add([flat(i, j, z) for (i, j), z, weight in heights for _ in range(weight)])
    assert median_about(0, 0, one.cells, 0) == (median, 3)
    assert one.height(0, 0) == median
    assert one.cause(0, 0) == UNSEEN


def test_ground_is_free_once_it_is_certain_and_never_because_it_was_filled() -> None:
    one = Map(SlowSettings())
    for k in range(1, 4):
        one.add([flat(*at) for at in EVERYWHERE if at != (0, 0)])
        assert one.cause(1, 1) == (FLOOR if k >= 3 else UNCERTAIN)
    assert one.height(0, 0) == 0.0
    assert one.cause(0, 0) == UNSEEN
    assert one.cause(1, 1, oldest_s=1.0) == FLOOR
    assert one.cause(1, 1, oldest_s=1.1) == AGED


def test_the_foot_of_a_wall_is_not_free_for_nothing_behind_it_is_known() -> None:
    hidden = [(i, j) for i in (2, 3) for j in range(-3, 4)]
    one = on_floor(SlowSettings(), *hidden, (-1, 0))
    assert [one.cause(i, 0) for i in (1, 0)] == [EDGE, FLOOR]  # one hole is no edge
    assert [one.cause(3, 0), one.cause(0, 3)] == [UNSEEN, EDGE]  # nor is what lies outside known


def test_what_stands_in_free_ground_ends_free_at_once_and_is_soon_an_obstacle() -> None:
    for cas, before in ((False, [RESET]), (True, [RESET, CORRUPT, CORRUPT])):
        one = on_floor(SlowSettings(cas=cas))
        for z, cause in ((0.4, TOO_HIGH), (-0.2, TOO_LOW)):
            for expected in (*before, cause):
                one.add([flat(0, 0, z)])
                assert one.cause(0, 0) == expected


def test_at_a_bound_it_is_an_obstacle() -> None:
    for z, cause in ((0.1, TOO_HIGH), (-0.1, TOO_LOW), (0.0999, BRINK), (-0.0999, UNCERTAIN)):
        one = on_floor(SlowSettings(cas=False), (0, 0), (0, 1))
        one.add([flat(0, 0, z), flat(0, 1, -0.0002)])
        assert one.cause(0, 0) == cause


def test_a_mixed_pixel_goes_and_a_real_edge_stays() -> None:
    one = Map(SlowSettings(cas_certainty=2))
    floor = [flat(i, j) for i in (-3, -2, -1, 0) for j in range(-3, 4)]
    box = [flat(i, j, 0.3) for i in (1, 2) for j in range(-3, 4)]
    for _ in range(3):
        one.add(floor + box)
    one.add([flat(3, 0, 0.09), flat(3, 1, 0.3)])
    assert one.cause(3, 0) == CORRUPT  # halfway between the box and the floor behind it
    assert one.height(3, 0) == pytest.approx(0.3)
    assert one.cause(3, 1) == TOO_HIGH
    assert [one.cause(1, j) for j in range(-3, 4)] == [TOO_HIGH] * 7
    for i, cause in ((0, BESIDE), (-1, FLOOR)):  # it may reach into the cell before it
        assert [one.cause(i, j) for j in range(-2, 3)] == [cause] * 5


@pytest.mark.parametrize(("h_pos_m", "h_neg_m"), [(0.1, -0.2), (0.2, -0.1)])
def test_a_brink_within_the_bounds_is_an_obstacle_on_its_higher_side_alone(
    h_pos_m: float, h_neg_m: float
) -> None:
    one = Map(SlowSettings(h_pos_m=h_pos_m, h_neg_m=h_neg_m))
    for _ in range(4):
        one.add([flat(i, j, -0.05 if i > 0 else 0.05) for i, j in EVERYWHERE])
    assert [one.cause(i, 0) for i in range(-1, 3)] == [FLOOR, BRINK, BESIDE, FLOOR]
    one = on_floor(SlowSettings(), *((i, 2) for i in range(-3, 4)))
    for _ in range(4):
        one.add([flat(i, 2, -0.0999) for i in range(-3, 4)] + [flat(0, 0, 0.04)])
    assert [one.cause(0, j) for j in (-1, 0, 1)] == [FLOOR] * 3  # none beside it is lower by that


@pytest.mark.parametrize(("cas", "cause"), [(False, BRINK), (True, FLOOR)])
def test_one_reading_beside_it_makes_a_brink_unless_it_is_corrupt(cas: bool, cause: int) -> None:
    one, around = Map(SlowSettings(cas=cas)), [at for at in EVERYWHERE if at != (0, 0)]
    for _ in range(4):
        one.add([flat(i, j, 0.05) for i, j in around])
    one.add([flat(i, j, 0.05) for i, j in around] + [flat(0, 0, -0.08)])
    assert one.cause(1, 0) == cause


@pytest.mark.parametrize("z", [0.1, -0.1])
def test_ground_beside_an_obstacle_is_not_free_for_it_may_reach_into_the_cell(z: float) -> None:
    one = on_floor(SlowSettings(cas=False), (0, 0))
    for _ in range(4):
        one.add([flat(*at) for at in EVERYWHERE if at != (0, 0)] + [flat(0, 0, z)])
    around = [(i, j) for i, j in EVERYWHERE if max(abs(i), abs(j)) == 1]
    expected = {BRINK} if z < 0.0 else {BESIDE}
    assert {one.cause(*at) for at in around} == expected
    second = [(i, j) for i, j in EVERYWHERE if max(abs(i), abs(j)) == 2]
    assert {one.cause(*at) for at in second} == {FLOOR}


@pytest.mark.parametrize(("z", "cause"), [(0.3, BESIDE), (0.04, FLOOR)])
def test_one_reading_of_an_obstacle_bars_what_lies_beside_it(z: float, cause: int) -> None:
    one, around = Map(SlowSettings(cas=False)), [at for at in EVERYWHERE if at != (0, 0)]
    for _ in range(4):
        one.add([flat(*at) for at in around])
    one.add([flat(*at) for at in around] + [flat(0, 0, z)])
    assert {one.cause(*at) for at in around if max(map(abs, at)) == 1} == {cause}


def test_six_known_neighbours_are_enough_however_uncertain() -> None:
    holes, ring = [(2, 2), (2, 1)], [(i, j) for i in range(3) for j in range(3)]
    for count, cause in ((2, FLOOR), (1, FLOOR), (3, EDGE)):
        one, lacks = Map(SlowSettings(cas=False)), [*holes, (1, 2)][:count]
        one.add([flat(*at) for at in ring if at not in lacks] + [flat(1, 1)] * 2)
        assert one.cause(1, 1) == cause


@pytest.mark.parametrize("axis", [0, 1])
def test_the_plane_of_a_robot_that_leans_is_held_against_the_middle_of_a_cell(axis: int) -> None:
    at, slopes = ((2, 0), (0.5, 0.0)) if axis == 0 else ((0, 2), (0.0, 0.5))
    leant = LEVEL._replace(slopes=slopes)  # there it lies at 0.125
    for z, cause in ((0.02, TOO_LOW), (0.03, BESIDE)):  # the next one lies beyond the bound
        one = Map(SlowSettings(cas=False))
        for _ in range(4):
            one.add([flat(i, j, z) for i, j in EVERYWHERE])
        assert one.cause(*at, body=leant) == cause


def test_a_robot_that_leans_takes_no_lower_road_for_flat() -> None:
    one = on_floor(SlowSettings(), (2, 0), (-3, 0))
    for _ in range(4):
        one.add([flat(2, 0, -0.15, 0.01), flat(-3, 0, 0.15, 0.01)])
    for slope in (0.0, -0.6, 0.6):  # that plane goes through both, or past them
        leant = LEVEL._replace(slopes=(slope, 0.0))
        assert one.cause(2, 0, body=leant) in (TOO_LOW, TOO_HIGH)
        assert one.cause(-3, 0, body=leant) in (TOO_LOW, TOO_HIGH)
        assert one.cause(0, 2, body=leant) == FLOOR
    assert one.cause(0, 2, body=LEVEL._replace(z_m=-0.1)) == TOO_HIGH


def test_a_drop_at_whose_edge_a_cell_lies_is_not_hidden_by_its_highest_reading() -> None:
    one = Map(SlowSettings())
    for _ in range(4):
        one.add([flat(0, 0, -0.09, 0.1), flat(0, 0, -0.15, 0.1)])
    assert one.height(0, 0) == -0.09
    assert one.cause(0, 0) == TOO_LOW


@pytest.mark.parametrize("size", [3, 9])
def test_a_window_of_another_size_shows_what_lies_in_both(size: int) -> None:
    one, window = on_floor(SlowSettings()), ObstacleWindow(size, CELL_M)
    one.add([flat(1, 0, 0.3)])
    one.add([flat(1, 0, 0.3)])
    listed = np.arange(SIZE * SIZE, dtype=np.int32)
    used = decide(listed, one.cells, LEVEL, 0.0, one.rules, window.shown, 0)
    shown = {at: int(window.cells[at[1] % size, at[0] % size]) for at in EVERYWHERE}
    rim = 1 if size == 3 else 2  # what has no neighbours is not free
    assert shown[0, 0] == FREE
    assert shown[-rim, rim] == FREE
    assert used == np.count_nonzero(window.cells) == (2 * rim + 1) ** 2 - 1
    assert window.cells[0, 1] == UNKNOWN  # one.cause(1, 0) == CORRUPT
    told: U8 = np.zeros(4, np.uint8)
    i, j = np.array([0, 1, 4, 9]), np.zeros(4, np.int64)
    list_causes(i, j, one.cells, LEVEL, 0.0, one.rules, window.shown, told)
    beyond = OUTSIDE if size == 3 else UNSEEN
    assert told.tolist() == [FLOOR, CORRUPT, beyond, OUTSIDE]
    list_causes(i, j, one.cells, LEVEL, 2.0, one.rules, window.shown, told)
    assert told[0] == FREE_BEFORE  # it is too old by now, and has not been decided since
