"""What cells keep of the returns, against slow and obvious models: a dict, and a plain filter."""

import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.mapping.beams.carving import FLOOR_AGAIN
from core.mapping.beams.classifier import ENOUGH
from core.mapping.beams.elevation import (
    DRIFT_M2_PER_S,
    GATE_SIGMA,
    NEW_HEIGHT,
    RELIEF_M,
    RISING_M,
    SIGMA_ANGLE_RAD,
    SIGMA_PLACE_M,
    SIGMA_RANGE_M,
)
from core.mapping.beams.ground_plane import Ground
from core.mapping.rays import MIN_RANGE_M, Sweep
from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import examples
from tests.support.cell_rig import CELL_M, HEIGHT_M, LENS, CellRig, H, Point, floor_around, sweep_to

LOST: Point = (2.1, 0.1, 0.0)
HOUSING: Point = (0.5, 0.1, 0.9)
COORDINATE = st.floats(-4.5, 4.5)
POINT = st.tuples(COORDINATE, COORDINATE, st.floats(-0.6, 1.6))
SCANS = st.lists(st.lists(POINT, min_size=1, max_size=40), min_size=1, max_size=6)


def in_window(x: float, y: float) -> bool:
    return all(-20 <= math.floor(part / CELL_M) <= 20 for part in (x, y))


def whole_cell(x: float, y: float) -> list[Point]:
    """A floor return in each part of the cell whose corner this is."""
    return [(x + 0.025 + 0.05 * a, y + 0.025 + 0.05 * b, 0.0) for a in range(4) for b in range(4)]


def is_far(place: Point) -> bool:
    """Not nearer to the lens than the scanner's own housing, and no vertical beam."""
    return math.dist(place, LENS) > MIN_RANGE_M + 0.01 and math.hypot(*place[:2]) > 0.01


@settings(max_examples=examples(30))
@given(scans=SCANS)
def test_what_a_cell_keeps_equals_a_dict_model(scans: list[list[Point]]) -> None:
    rig = CellRig()
    seen: dict[tuple[int, int], list[float]] = defaultdict(list)
    looks, above, below = (defaultdict[tuple[int, int], int](int) for _ in range(3))
    for scan in scans:
        # two beams to each place: nothing stands alone (core/mapping/beams/isolated.py)
        places = [place for place in scan if is_far(place) for _ in range(2)]
        sweep = sweep_to([*places, LOST, HOUSING])
        sweep.ranges_m[0, -2:] = math.nan, MIN_RANGE_M / 2
        assert rig.fill(sweep) == len(places)
        points = [p for p in sweep.points() if in_window(p[0], p[1]) and p[2] <= HEIGHT_M]
        of_scan: dict[tuple[int, int], list[float]] = defaultdict(list)
        for x, y, z in points:
            of_scan[math.floor(x / CELL_M), math.floor(y / CELL_M)].append(float(z))
        for cell, heights in of_scan.items():
            seen[cell] += heights
            looks[cell] += 1
            above[cell] += max(heights) >= H
            below[cell] += min(heights) <= -H
    cells = rig.cells.cells
    assert int(cells["count"].sum()) == sum(map(len, seen.values()))
    for (i, j), heights in seen.items():
        cell = cells[j % 41, i % 41]
        floor = [h for h in heights if -H < h < H]
        rising = [h for h in heights if h > RISING_M]
        assert (cell["count"], cell["floor_count"]) == (len(heights), len(floor))
        assert (cell["looks"], cell["above"]) == (looks[i, j], above[i, j])
        assert cell["below"] == below[i, j]
        assert cell["mean_m"] == pytest.approx(np.mean(heights), abs=1e-9)
        assert cell["var_m2"] == pytest.approx(np.var(heights), abs=1e-9)
        assert cell["z_m"] == pytest.approx(np.mean(heights), abs=1e-9)
        assert cell["floor_m"] == pytest.approx(np.mean(floor) if floor else 0.0, abs=1e-9)
        assert (cell["z_low_m"], cell["z_high_m"]) == (min(heights), max(heights))
        assert cell["low_m"] == min(rising, default=math.inf)
        assert cell["top_m"] == max(rising, default=-math.inf)
        assert cell["soft"] + cell["hard"] == len(rising)


def test_heights_are_told_over_near_and_far_ground_and_kept_in_the_map_frame_too() -> None:
    rig = CellRig()
    rig.ground = Ground(0.3, 0.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 3.0, 0.0)  # level from x = 3 on
    rig.add((2.1, 0.1, 0.21), (3.5, 0.1, 0.30))
    for x in (2.1, 3.5):
        assert rig.cell(x, 0.1)["mean_m"] == pytest.approx(0.0)
    rig = CellRig()
    rig.ground = Ground(0.5, 0.1, 0.0, 0.5, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0)  # z = 0.5 + 0.1 x
    rig.add((2.1, 0.1, 0.75), (3.1, 0.1, 0.81), lens=(0.0, 0.0, 1.58))
    assert rig.cell(2.1, 0.1)["mean_m"] == pytest.approx(0.04)
    assert rig.cell(2.1, 0.1)["z_m"] == pytest.approx(0.75)
    assert rig.cell(3.1, 0.1)["mean_m"] == pytest.approx(0.0)


def test_what_hangs_higher_than_the_robot_is_not_in_the_map_and_floor_under_it_is_free() -> None:
    rig = CellRig()
    for _ in range(3):
        over = (2.1, 0.1, HEIGHT_M + 0.01), (3.1, 0.1, HEIGHT_M + 0.01)
        rig.add(*over, (2.1, 1.1, HEIGHT_M - 0.01), (3.1, 0.1, 0.0), *floor_around(3.1, 0.1))
    assert rig.cell(2.1, 0.1)["count"] == 0
    assert [rig.state(2.1, 0.1), rig.state(3.1, 0.1)] == [UNKNOWN, FREE]
    assert rig.state(2.1, 1.1) == OBSTACLE


def test_relief_within_a_cell_of_one_scan_says_that_something_rises() -> None:
    for relief, rises in ((RELIEF_M - 0.002, 0), (RELIEF_M + 0.002, 1)):
        rig = CellRig()
        rig.add((2.05, 0.1, 0.0), (2.15, 0.1, relief))
        assert rig.cell(2.1, 0.1)["rising"] == rises
    rig = CellRig()  # the same, in two scans, is the attitude's error
    rig.add((2.05, 0.1, 0.0))
    rig.add((2.15, 0.1, RELIEF_M + 0.002))
    assert rig.cell(2.1, 0.1)["rising"] == 0


def test_floor_alone_for_long_ends_what_a_wrong_line_has_said() -> None:
    rig = CellRig()
    for _ in range(ENOUGH):
        rig.add((2.1, 0.1, -0.2))
    assert rig.state(2.1, 0.1) == OBSTACLE
    for k in range(FLOOR_AGAIN):
        assert rig.state(2.1, 0.1) == OBSTACLE, k
        rig.add(*whole_cell(2.0, 0.0), *floor_around(2.1, 0.1))
    assert rig.cell(2.1, 0.1)["below"] == 0
    assert rig.cell(2.1, 0.1)["mean_m"] == pytest.approx(0.0, abs=1e-9)
    assert rig.state(2.1, 0.1) == FREE


def test_floor_beside_a_hole_does_not_end_it_while_parts_lack_floor() -> None:
    rig = CellRig()
    for _ in range(ENOUGH):
        rig.add_silent(*[(2.125, 0.025 + 0.05 * k, 0.0) for k in range(4)])
    for _ in range(3 * FLOOR_AGAIN):
        rig.add(*[(2.025, 0.025 + 0.05 * k, 0.0) for k in range(4)])
    assert rig.cell(2.1, 0.1)["miss"] > 0
    assert rig.state(2.1, 0.1) == OBSTACLE


# The filter


class PlainFilter:
    """The equations of one cell, written down once more."""

    def __init__(self) -> None:
        self.height, self.variance, self.t_s = math.nan, math.nan, 0.0
        self.disbelieved = 0

    def take(self, place: Point, t_s: float) -> None:
        """A return at a place, seen from LENS."""
        r = math.dist(place, LENS)
        fall = (LENS[2] - place[2]) / r  # sine of how steeply the beam comes down
        noise = (
            (SIGMA_RANGE_M * fall) ** 2
            + SIGMA_ANGLE_RAD**2 * r**2 * (1 - fall**2)
            + SIGMA_PLACE_M**2
        )
        if math.isnan(self.height):
            self.height, self.variance = place[2], noise
        else:
            self._weigh(place[2], noise, DRIFT_M2_PER_S * (t_s - self.t_s))
        self.t_s = t_s

    def _weigh(self, height: float, noise: float, drift: float) -> None:
        before = self.variance + drift
        if (height - self.height) ** 2 > GATE_SIGMA**2 * (before + noise):
            self.disbelieved += 1
            if self.disbelieved == NEW_HEIGHT:
                self.height, self.variance, self.disbelieved = height, noise, 0
            return
        self.disbelieved = 0
        self.height = (self.height / before + height / noise) / (1 / before + 1 / noise)
        self.variance = 1 / (1 / before + 1 / noise)


NEAR_FLOOR = st.floats(-0.09, 0.09)
JUMP = st.floats(
    0.21, 0.9
)  # floor that is seen again ends what was lower: core/mapping/beams/carving.py


@settings(max_examples=examples(25))
@given(
    returns=st.lists(
        st.tuples(st.one_of(NEAR_FLOOR, NEAR_FLOOR, JUMP), st.floats(0, 30)),
        min_size=1,
        max_size=30,
    ),
    x=st.floats(2.01, 2.19),
)
def test_the_filter_equals_a_plain_transcription_of_its_equations(
    returns: list[tuple[float, float]], x: float
) -> None:
    rig, plain, t_s = CellRig(filters=True), PlainFilter(), 0.0
    for z, waited_s in returns:
        t_s += waited_s
        rig.fill(sweep_to([(x, 0.1, z)], t_s=t_s))
        plain.take((x, 0.1, z), t_s)
        cell = rig.cell(2.1, 0.1)
        assert cell["mean_m"] == pytest.approx(plain.height, abs=1e-9)
        assert cell["var_m2"] == pytest.approx(plain.variance, rel=1e-6)
        assert cell["outliers"] == plain.disbelieved


def test_four_outliers_in_a_row_are_taken_and_each_is_a_contradiction() -> None:
    """The filter keeps the height, the evidence keeps the obstacle: one does not hide the other."""
    rig = CellRig(filters=True)
    for _ in range(10):
        rig.add((2.1, 0.1, 0.0), *floor_around(2.1, 0.1))
    for z, mean_m in (*[(0.5, 0.0)] * (NEW_HEIGHT - 1), (0.0, 0.0), (0.5, 0.0)):
        rig.add((2.1, 0.1, z))
        assert rig.cell(2.1, 0.1)["mean_m"] == pytest.approx(mean_m, abs=1e-9)
    assert rig.state(2.1, 0.1) == OBSTACLE
    for _ in range(NEW_HEIGHT - 1):
        rig.add((2.1, 0.1, 0.5))
    assert rig.cell(2.1, 0.1)["mean_m"] == pytest.approx(0.5)


def test_both_echoes_fall_in_and_the_first_one_alone_may_be_soft() -> None:
    rig = CellRig()
    one = sweep_to([(2.1, 0.1, 0.3)] * 3)
    rig.take(Sweep(0.0, one.origins, one.rays, np.stack([one.ranges_m[0], one.ranges_m[0] + 0.5])))
    cell = rig.cell(2.1, 0.1)
    assert int(rig.cells.cells["count"].sum()) == 6
    assert (cell["soft"], cell["doubles"], cell["hard"]) == (1, 1, 2)  # the outer two: who knows


def test_while_the_ground_is_not_sure_nothing_is_a_drop_but_what_stands_still_stands() -> None:
    rig = CellRig()
    for _ in range(3):
        low = sweep_to([(2.1, 0.1, -0.3), (2.1, 0.5, 0.3), (2.1, 0.9, 0.0)])
        rig.take(low, (False, True, True))
    assert rig.cell(2.1, 0.1)["count"] == 0
    assert not rig.cells.cells["miss"].any()
    assert rig.state(2.1, 0.1) == UNKNOWN
    assert rig.state(2.1, 0.5) == OBSTACLE


def test_while_the_height_is_not_sure_shallow_misses_do_not_count_and_deep_ones_do() -> None:
    for depth_m, calm, missed in ((0.06, True, True), (0.06, False, False), (0.3, False, True)):
        rig = CellRig()
        for x in (1.5, 1.7, 1.9):
            rig.add((x, 0.1, 0.0))
        rig.take(sweep_to([(2.25, 0.1, -depth_m)]), (True, calm, True))
        assert bool(rig.cells.cells["miss"].any()) is missed


def test_over_ground_that_is_a_guess_only_what_stands_high_or_near_counts() -> None:
    near, far = 3.1, 6.1
    for x_m, h_m, counts in ((far, 0.15, 0), (far, 0.0, 0), (far, 0.4, 1), (near, 0.15, 1)):
        rig = CellRig(81, 81)
        for _ in range(3):
            rig.take(sweep_to([(x_m, y_m, h_m) for y_m in (0.1, 0.3, 0.5)]), (False, False, False))
        assert (rig.cell(x_m, 0.3)["count"] > 0) == bool(counts)
    rig = CellRig()
    for _ in range(ENOUGH):
        assert rig.add((0.0, 0.0, -0.03)) == 1  # straight down: no floor before it
    assert int(rig.cell(0.1, 0.1)["miss"]) == 0
