"""(9) to (11), the CAS filter and what cells mean: the kernels against a plain transcription."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.grid.ring import RingGrid
from core.grid.touched import Touched
from core.mapping.body import BodyPose
from core.mapping.causes import BRINK, CORRUPT, FLOOR, RESET, TOO_HIGH, TOO_LOW, UNCERTAIN, UNSEEN
from core.mapping.certainty.cas import heights_at, mark, median_about
from core.mapping.certainty.cells import Cells, Pass, Rules, gather, update, widen
from core.mapping.certainty.decision import cause_at
from core.records import F64
from tests.support.cases import examples
from tests.support.slow_certainty import Reading, SlowCertainty, SlowSettings

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
    ring = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    for k in range(1, 4):
        one.add([flat(*at) for at in ring])
        assert one.cause(1, 1) == (FLOOR if k >= 3 else UNCERTAIN)
    assert one.height(0, 0) == 0.0
    assert one.cause(0, 0) == UNSEEN
    assert one.cause(1, 1, oldest_s=2.0) != FLOOR


def test_what_stands_in_free_ground_ends_free_at_once_and_is_an_obstacle_with_the_next_scan() -> (
    None
):
    one = Map(SlowSettings())
    for _ in range(4):
        one.add([flat(0, 0)])
    assert one.cause(0, 0) == FLOOR
    one.add([flat(0, 0, 0.4), flat(0, 0)])
    assert one.cause(0, 0) == RESET
    one.add([flat(0, 0, 0.4), flat(0, 0)])
    assert one.cause(0, 0) == TOO_HIGH
    one.add([flat(0, 0, -0.2)])
    one.add([flat(0, 0, -0.2)])
    assert one.cause(0, 0) == TOO_LOW


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
    assert [one.cause(0, j) for j in range(-3, 4)] == [FLOOR] * 7


def test_a_brink_within_the_bounds_is_an_obstacle_on_its_higher_side_alone() -> None:
    one = Map(SlowSettings())
    for _ in range(4):
        one.add([flat(i, 0, -0.06 if i > 0 else 0.06) for i in range(-2, 3)])
    assert [one.cause(i, 0) for i in range(-1, 2)] == [FLOOR, BRINK, FLOOR]


def test_a_robot_that_leans_takes_no_lower_road_for_flat() -> None:
    one = Map(SlowSettings())
    for _ in range(4):
        one.add([flat(2, 0, -0.15, 0.01), flat(-3, 0, 0.15, 0.01), flat(0, 2)])
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
