"""The stop zone against slow, obvious models: corners, finite steps, all cells of the window."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from core.driving.stop_zone import (
    LONGEST_M,
    NOTHING,
    SLACK_M,
    SLOWEST_MPS,
    STANDING_MPS,
    Motion,
    Obstruction,
    Place,
    Rect,
    StopZone,
    cells_near,
    clearance,
    drift_m,
    gap_to,
    is_in_way,
    leaves,
    read_row,
)
from core.grid.ring import RingGrid
from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import examples

F64 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int8]
FRONT_M, REAR_M, WIDTH_M, MARGIN_M, BRAKE_MPS2 = 0.5, 0.2, 0.6, 0.15, 0.8
RECT: Rect = (FRONT_M, REAR_M, WIDTH_M / 2)
CELL_M, SIZE, REACTION_S = 0.2, 41, 0.45
STEP_M = CELL_M / 2
NOWHERE = (0.0, 0.0, 0.0)
PLACES = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.2, 3.2))


def zone(rect: Rect = RECT) -> StopZone:
    front_m, rear_m, side_m = rect
    return StopZone(front_m, rear_m, 2 * side_m, MARGIN_M, BRAKE_MPS2, REACTION_S)


def ground(
    *marks: tuple[float, float, int], cell_m: float = CELL_M, at: tuple[float, float] = (0.0, 0.0)
) -> tuple[RingGrid, I8]:
    """A free window about a place but for some cells, by a point in each."""
    grid = RingGrid(SIZE, cell_m)
    grid.follow(*at)
    cells: I8 = grid.layer(np.int8, UNKNOWN)
    cells[...] = FREE
    for x, y, mark in marks:
        i, j = grid.cell_of(x, y)
        cells[j % SIZE, i % SIZE] = mark
    return grid, cells


def look(
    motion: Motion,
    *marks: tuple[float, float, int],
    place: Place = NOWHERE,
    clear: Place = NOWHERE,
    from_mps: float = 1.6,
) -> Obstruction:
    grid, cells = ground(*marks)
    return zone().look(grid, cells, place, motion, clear, from_mps, 0.0)


# Cells


def corners(ahead: tuple[float, float], aside: tuple[float, float], place: Place) -> F64:
    """Of a rectangle in its own frame, in the map."""
    c, s = math.cos(place[2]), math.sin(place[2])
    return np.array(
        [[place[0] + c * a - s * b, place[1] + s * a + c * b] for a in ahead for b in aside]
    )


def meets(cx: float, cy: float, half: float, place: Place, rect: Rect, grow: float) -> bool:
    """Whether no line parts a cell from the rectangle, grown to all sides."""
    body = corners((-rect[1] - grow, rect[0] + grow), (-rect[2] - grow, rect[2] + grow), place)
    cell = corners((-half, half), (-half, half), (cx, cy, 0.0))
    for angle in (0.0, math.pi / 2, place[2], place[2] + math.pi / 2):
        along = np.array([math.cos(angle), math.sin(angle)])
        if (body @ along).min() > (cell @ along).max() or (cell @ along).min() > (
            body @ along
        ).max():
            return False
    return True


@given(PLACES, st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(0.0, 0.6))
def test_a_gap_is_what_the_footprint_must_grow_by_to_meet_a_cell(
    place: Place, cx: float, cy: float, rear: float
) -> None:
    rect = (FRONT_M, rear, 0.3)
    gap = gap_to(cx, cy, 0.1, place, rect)
    assert meets(cx, cy, 0.1, place, rect, gap + 1e-6)
    if gap > -(rear + FRONT_M) / 2 + 0.01 and gap > -0.29:
        assert not meets(cx, cy, 0.1, place, rect, gap - 1e-6)


@pytest.mark.parametrize("at", [(0.0, 0.0), (7.3, -5.6)])
def test_a_row_is_what_the_window_says_and_unknown_outside_it(at: tuple[float, float]) -> None:
    grid = RingGrid(5, 0.25)
    grid.follow(*at)
    cells: I8 = grid.layer(np.int8, UNKNOWN)
    low_i, low_j = grid.corner_i, grid.corner_j
    truth = {}
    for k, (i, j) in enumerate((i, j) for i in range(5) for j in range(5)):
        state = (OBSTACLE, FREE, FREE)[k % 3]
        truth[low_i + i, low_j + j] = cells[(low_j + j) % 5, (low_i + i) % 5] = state
    for j in range(low_j - 3, low_j + 9):
        for i in range(low_i - 9, low_i + 9):
            for count in range(12):
                states: I8 = np.full(count, 5, dtype=np.int8)
                read_row(i, j, cells, (low_i, low_j, 5), states)
                assert states.tolist() == [truth.get((i + k, j), UNKNOWN) for k in range(count)]


def test_unknown_ground_that_somebody_vouches_for_is_not_in_the_way() -> None:
    middle = (3.5 * 0.25, -2.5 * 0.25, 0.5)  # just the cells two off: vouched for
    for i in range(-3, 9):
        for j in range(-9, 3):
            vouched = math.hypot(i - 3, j + 3) <= 2
            assert is_in_way(UNKNOWN, i, j, 0.25, middle) is not vouched
            assert is_in_way(UNKNOWN, i, j, 0.25, (0.0, 0.0, math.inf)) is False
            assert is_in_way(OBSTACLE, i, j, 0.25, middle) is True
            assert is_in_way(FREE, i, j, 0.25, (9.0, 9.0, 0.0)) is False


def outward_mps(ahead: float, aside: float, v: float, w: float) -> float:
    """How fast a cell under the footprint comes nearer to the edge that is nearest to it."""
    to_front, to_rear, to_side = FRONT_M - ahead, REAR_M + ahead, WIDTH_M / 2 - abs(aside)
    if to_side <= min(to_front, to_rear):
        return -w * ahead * (1 if aside > 0 else -1)
    return -v + w * aside if to_front <= to_rear else v - w * aside


@given(
    place=PLACES,
    ahead=st.floats(-REAR_M, FRONT_M),
    aside=st.floats(-0.3, 0.3).filter(lambda aside: abs(aside) > 1e-3),
    v=st.sampled_from([-0.5, -0.01, 0.0, 0.01, 0.5]),
    w=st.sampled_from([-2.0, -0.5, 0.0, 0.5, 2.0]),
)
def test_a_cell_leaves_over_the_edge_that_it_is_nearest_to(
    place: Place, ahead: float, aside: float, v: float, w: float
) -> None:
    c, s = math.cos(place[2]), math.sin(place[2])
    x, y = place[0] + c * ahead - s * aside, place[1] + s * ahead + c * aside
    out_mps = outward_mps(ahead, aside, v, w)
    if abs(out_mps) > 1e-5 and abs(abs(aside) - 0.3 + min(FRONT_M - ahead, REAR_M + ahead)) > 1e-6:
        assert leaves(x, y, place, RECT, v, w) is (out_mps > 0.0)


@pytest.mark.parametrize(
    ("x", "y", "rect", "motion", "out"),
    [
        (0.25, 0.25, (0.5, 0.5, 0.5), (0.0, -1.0), True),  # as near to the side as to the front
        (-0.25, 0.25, (0.5, 0.5, 0.5), (0.0, 1.0), True),  # and as to the rear
        (0.0, 0.0, (0.5, 0.5, 9.0), (-1.0, 0.0), True),  # as near to the front as to the rear
        (0.0, 0.0, (0.5, 0.5, 9.0), (1.0, 0.0), False),
        (0.1, 0.0, (0.5, 0.5, 9.0), (0.0, 0.0), False),
        (-0.1, 0.0, (0.5, 0.5, 9.0), (0.0, 0.0), False),
        (0.1, 0.0, (0.5, 0.5, 9.0), (-0.5, 0.0), True),  # over the front, slowly
        (-0.1, 0.0, (0.5, 0.5, 9.0), (0.5, 0.0), True),  # and over the rear
        (0.1, 0.2, (0.5, 0.5, 0.25), (0.5, 0.0), False),
        (0.25, 0.25, (0.5, 0.5, 0.5), (0.0, -4e-9), False),  # as good as at rest
    ],
)
def test_of_two_edges_the_side_comes_first_then_the_front_and_what_rests_does_not_leave(
    x: float, y: float, rect: Rect, motion: Motion, out: bool
) -> None:
    assert leaves(x, y, NOWHERE, rect, *motion) is out


@settings(max_examples=examples(40))
@given(
    place=PLACES,
    marks=st.dictionaries(
        st.tuples(st.integers(-7, 7), st.integers(-7, 7)),
        st.sampled_from([OBSTACLE, UNKNOWN]),
        max_size=30,
    ),
    within=st.floats(0.0, 0.4),
    clear=st.sampled_from([NOWHERE, (0.5, 0.2, 0.6)]),
)
def test_the_cells_that_are_near_are_listed_row_by_row(
    place: Place, marks: dict[tuple[int, int], int], within: float, clear: Place
) -> None:
    grid, cells = ground()
    for (i, j), state in marks.items():
        cells[j % SIZE, i % SIZE] = state
    window = (grid.corner_i, grid.corner_j, SIZE)
    found = cells_near(cells, window, CELL_M, place, RECT, within, clear)
    assert found.tolist() == [
        [i, j, state]
        for (i, j), state in sorted(marks.items(), key=lambda mark: mark[0][::-1])
        if gap_to((i + 0.5) * CELL_M, (j + 0.5) * CELL_M, CELL_M / 2, place, RECT) < within
        and is_in_way(state, i, j, CELL_M, clear)
    ]


# The way


def test_how_far_the_edge_gets_is_more_than_what_a_gap_can_shrink_by() -> None:
    assert drift_m((1.5, 0.2, 0.3), 0.25, (-0.4, 0.5), 2.0) == pytest.approx(2.55)
    assert drift_m((0.2, 0.5, 0.9), 0.1, (0.4, -0.5), 2.0) == pytest.approx(1.8)


@settings(max_examples=examples(200))
@given(
    place=PLACES,
    rect=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.05, 1.0)),
    motion=st.tuples(st.floats(-1.0, 1.0), st.sampled_from([-1.0, -0.3, 0.0, 0.4])),
    for_s=st.floats(-0.3, 0.3),
    cell=st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)),
)
def test_what_comes_within_the_margin_was_near_it_before(
    place: Place, rect: Rect, motion: Motion, for_s: float, cell: tuple[float, float]
) -> None:
    then = gap_to(*cell, 0.1, after(place, motion, for_s), rect)
    if then < MARGIN_M:
        most_m = MARGIN_M + drift_m(rect, MARGIN_M, motion, abs(for_s))
        assert gap_to(*cell, 0.1, place, rect) < most_m + 1e-9


def slow_clearance(
    marks: dict[tuple[int, int], int], place: Place, rect: Rect, cell_m: float
) -> float:
    """The margin; or what a cell outside the footprint leaves, less some slack.

    In the order of rows, a cell that is nearer by no more than the slack counts as the same.
    """
    least = MARGIN_M
    for i, j in sorted(marks, key=lambda cell: cell[::-1]):
        gap = gap_to((i + 0.5) * cell_m, (j + 0.5) * cell_m, cell_m / 2, place, rect)
        if 0.0 <= gap < least - SLACK_M:
            least = gap
    return MARGIN_M if least == MARGIN_M else max(0.0, least - SLACK_M)


def after(place: Place, motion: Motion, t: float) -> Place:
    """Where an arc has led, by the middle of its circle."""
    (x, y, yaw), (v, w) = place, motion
    if w == 0.0:
        return x + v * t * math.cos(yaw), y + v * t * math.sin(yaw), yaw
    mx, my = x - v / w * math.sin(yaw), y + v / w * math.cos(yaw)
    return (
        mx + v / w * math.sin(yaw + w * t),
        my - v / w * math.cos(yaw + w * t),
        yaw + w * t,
    )


def slow_way_m(
    marks: dict[tuple[int, int], int],
    place: Place,
    rect: Rect,
    motion: Motion,
    length_m: float,
    cell_m: float,
) -> float:
    """How far it is free, each cell by itself, each sixteenth of a cell of the way."""
    rate, kept = zone(rect=rect).rate_mps(*motion), slow_clearance(marks, place, rect, cell_m)
    best, step_m, most_m = math.inf, cell_m / 16, length_m + cell_m / 2 + MARGIN_M
    for (i, j), state in marks.items():
        cx, cy = (i + 0.5) * cell_m, (j + 0.5) * cell_m

        def gap(s: float, cx: float = cx, cy: float = cy) -> float:
            return gap_to(cx, cy, cell_m / 2, after(place, motion, s / rate), rect)

        now = gap(0.0)
        limit, less = (kept, 0.0) if now >= MARGIN_M else (0.0, MARGIN_M)
        if now < -1e-9 and state == UNKNOWN:
            continue
        if now < -1e-9 and leaves(cx, cy, place, rect, *motion):
            limit = now - SLACK_M if now <= -SLACK_M else -SLACK_M
        elif now < -1e-9:
            best = 0.0
            continue
        for k in range(1, 8 * math.floor(most_m / (8 * step_m)) + 1):
            if gap(k * step_m) < limit:
                low, high = (k - 1) * step_m, k * step_m
                for _ in range(3):
                    half = (low + high) / 2
                    low, high = (low, half) if gap(half) < limit else (half, high)
                best = min(best, max(0.0, low - less))
                break
    return best


def marks_within(cells: int, count: int) -> st.SearchStrategy[dict[tuple[int, int], int]]:
    place = st.integers(-cells, cells)
    return st.dictionaries(
        st.tuples(place, place), st.sampled_from([OBSTACLE, UNKNOWN]), min_size=1, max_size=count
    )


FINE_M, FINE_SIZE = 0.05, 165  # so fine that a stride of the sweep has several steps


@settings(max_examples=examples(160))
@given(
    place=PLACES,
    rect=st.sampled_from([RECT, (0.2, 0.5, 0.3), (0.06, 0.04, 0.05)]),
    motion=st.tuples(
        st.sampled_from([-0.6, 0.0, 0.3, 1.0]), st.sampled_from([-1.0, -0.3, 0.0, 0.4])
    ).filter(any),
    drawn=st.one_of(
        st.tuples(st.just(CELL_M), st.one_of(marks_within(9, 6), marks_within(5, 3))),
        st.tuples(st.just(FINE_M), st.one_of(marks_within(36, 6), marks_within(20, 3))),
    ),
    from_mps=st.sampled_from([0.0, 0.7, 1.5]),
)
@example(  # out over the rear in no time, but the edge at the side is nearer
    place=(-0.005, -0.096, 0.0),
    rect=RECT,
    motion=(0.3, 0.0),
    drawn=(CELL_M, {(-2, 1): 1}),
    from_mps=0.0,
)
@example(  # pokes in a little, leaves, and gets deeper as the rear swings out
    place=(0.05, -0.095, 0.0),
    rect=RECT,
    motion=(0.5, -1.0),
    drawn=(CELL_M, {(0, 1): 1}),
    from_mps=1.5,
)
@example(  # the same where it touches
    place=(0.05, -0.1, 0.0),
    rect=RECT,
    motion=(0.5, -1.0),
    drawn=(CELL_M, {(0, 1): 1}),
    from_mps=1.5,
)
@example(  # within the margin, and met later than a new one that leaves more way
    place=(-0.0734, 0.0, 0.2),
    rect=RECT,
    motion=(0.3, 0.0),
    drawn=(CELL_M, {(3, 0): 1, (3, -1): 1}),
    from_mps=0.7,
)
@example(  # met in the first step of a stride alone, and far from the middle of it
    place=(-0.41628, -0.232627, 0.960485),
    rect=RECT,
    motion=(0.0, -0.3),
    drawn=(CELL_M, {(1, 1): 1}),
    from_mps=1.5,
)
def test_the_free_way_is_that_of_the_slow_model(
    place: Place,
    rect: Rect,
    motion: Motion,
    drawn: tuple[float, dict[tuple[int, int], int]],
    from_mps: float,
) -> None:
    cell_m, marks = drawn
    grid = RingGrid(SIZE if cell_m == CELL_M else FINE_SIZE, cell_m)
    cells: I8 = grid.layer(np.int8, FREE)
    for (i, j), state in marks.items():
        cells[j % grid.size, i % grid.size] = state
    window = (grid.corner_i, grid.corner_j, grid.size)
    kept_m = clearance(cells, window, cell_m, place, rect, MARGIN_M, NOWHERE)
    assert kept_m == pytest.approx(slow_clearance(marks, place, rect, cell_m), abs=1e-9)
    of = zone(rect=rect)
    found = of.look(grid, cells, place, motion, NOWHERE, from_mps, 0.0)
    way_m = of.stop_m(max(from_mps, of.rate_mps(*motion)))
    slow_m = slow_way_m(marks, place, rect, motion, way_m, cell_m)
    assert found.free_m == pytest.approx(slow_m, abs=1e-7)
    if found is not NOTHING:
        assert marks[found.i, found.j] == found.state


SHARP = StopZone(0.5, 0.25, 0.5, 0.125, 0.8, REACTION_S)  # all of it in whole cells' halves


@pytest.mark.parametrize(
    ("i", "j", "state", "motion", "free_m"),
    [
        (8, 3, OBSTACLE, (0.5, 0.0), math.inf),  # touches the margin's side, and goes on to
        (8, 2, OBSTACLE, (0.5, 0.0), 0.375),
        (5, 0, OBSTACLE, (0.5, 0.0), 0.0),  # touches the margin's front
        (-4, 0, OBSTACLE, (-0.5, 0.0), 0.0),
        (-4, 0, OBSTACLE, (0.5, 0.0), math.inf),
        (4, 3, OBSTACLE, (0.5, 0.1), 0.0),  # touches its side, and the robot turns to it
        (4, 0, UNKNOWN, (0.5, 0.0), 0.0),  # touches the footprint
    ],
)
def test_what_touches_the_margin_is_not_in_it(
    i: int, j: int, state: int, motion: Motion, free_m: float
) -> None:
    """Cells of an eighth of a metre, a footprint and a margin of whole eighths."""
    grid, cells = ground((i / 8 + 0.05, j / 8 + 0.05, state), cell_m=0.125)
    found = SHARP.look(grid, cells, NOWHERE, motion, NOWHERE, 1.0, 0.0)
    assert found.free_m == pytest.approx(free_m, abs=0.002)


@pytest.mark.parametrize("rect", [(0.2, 0.2, 0.6), (0.6, 0.2, 0.2), (0.2, 0.6, 0.2)])
def test_a_robot_that_turns_on_the_spot_sweeps_with_its_farthest_corners(rect: Rect) -> None:
    """They reach 83 cm from the axle's middle; the cells begin 78 and 98 cm from it."""
    for y, is_met in ((-0.7, True), (-0.9, False)):
        grid, cells = ground((0.1, y, OBSTACLE))
        found = [
            zone(rect=rect).look(grid, cells, (0.0, 0.18, 0.0), (0.0, w), NOWHERE, 1.8, 0.0)
            for w in (0.5, -0.5)
        ]
        assert any(one is not NOTHING for one in found) is is_met


def test_of_cells_that_are_equally_near_the_first_is_told() -> None:
    wall = [(2.1, 0.2 * k + 0.1, OBSTACLE) for k in range(-1, 1)]
    found = look((0.5, 0.0), *wall)
    assert (found.i, found.j, found.state) == (10, -1, OBSTACLE)
    assert found.free_m == pytest.approx(2.0 - FRONT_M - MARGIN_M, abs=STEP_M / 32)


@pytest.mark.parametrize("yaw", [-0.05, 0.05])
def test_of_cells_that_one_step_meets_the_nearest_counts(yaw: float) -> None:
    place = (-0.13, 0.0, yaw)
    wall = [(2.1, 0.2 * k + 0.1, OBSTACLE) for k in range(-2, 2)]
    alone = [look((0.5, 0.0), cell, place=place).free_m for cell in wall]
    assert len(set(alone)) > 1
    assert max(alone) - min(alone) < STEP_M
    assert look((0.5, 0.0), *wall, place=place).free_m == min(alone)


def test_of_cells_within_the_margin_that_one_step_meets_the_nearest_counts() -> None:
    place, motion = (0.03, 0.05, 1.0), (0.5, 0.5)
    cells = [(-0.1, 0.9, OBSTACLE), (0.1, 0.9, OBSTACLE)]
    later, sooner = (look(motion, cell, place=place).free_m for cell in cells)
    assert later - STEP_M < sooner < later - 0.05
    assert look(motion, *cells, place=place).free_m == sooner


def test_what_is_farther_than_the_way_to_stop_does_not_matter() -> None:
    for motion in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.5, -0.5), (0.0, 0.0)):
        assert look(motion, from_mps=0.0) == NOTHING
    assert look((0.5, 0.0), (2.1, 0.1, OBSTACLE), from_mps=0.0) == NOTHING
    assert look((0.5, 0.0), (-2.1, 0.1, OBSTACLE)) == NOTHING
    assert look((0.5, 0.0), (1.5, 0.75, OBSTACLE)) == NOTHING
    assert look((-0.5, 0.0), (-2.1, 0.1, OBSTACLE)).free_m < 1.7


def test_unknown_ground_stops_as_a_wall_does_unless_somebody_vouches_for_it() -> None:
    hole = (1.5, 0.1, UNKNOWN)
    assert look((0.5, 0.0), hole).state == UNKNOWN
    assert look((0.5, 0.0), hole, clear=(0.0, 0.0, math.inf)) == NOTHING
    assert look((0.5, 0.0), hole, clear=(0.0, 0.0, 1.6)) == NOTHING
    assert look((0.5, 0.0), hole, clear=(0.0, 0.0, 1.4)).state == UNKNOWN
    assert look((0.5, 0.0), (1.5, 0.1, OBSTACLE), clear=(0.0, 0.0, 5.0)).state == OBSTACLE


def test_beyond_the_window_all_is_unknown() -> None:
    edge_m = SIZE // 2 * CELL_M
    found = look((0.5, 0.0), place=(edge_m - 1.0, 0.0, 0.0))
    assert found.state == UNKNOWN
    assert found.free_m == pytest.approx(1.0 + CELL_M - FRONT_M - MARGIN_M, abs=STEP_M / 32)


@pytest.mark.parametrize(
    ("x", "y", "leaving", "entering"),
    [
        (0.55, 0.1, (-0.3, 0.0), (0.3, 0.0)),  # within the margin ahead
        (-0.29, 0.1, (0.3, 0.0), (-0.3, 0.0)),  # behind
        (0.5, 0.35, (0.0, -0.5), (0.0, 0.5)),  # beside the nose
        (0.47, 0.1, (-0.3, 0.0), (0.3, 0.0)),  # under the footprint
    ],
)
def test_from_what_is_too_near_already_the_robot_may_only_go_away(
    x: float, y: float, leaving: Motion, entering: Motion
) -> None:
    mark = (x, y, OBSTACLE)
    assert look(leaving, mark, from_mps=0.0) == NOTHING
    found = look(entering, mark, from_mps=0.0)
    assert zone().allowed_mps(found.free_m) == 0.0
    assert found.free_m < 0.05


def test_what_a_corner_pokes_into_ends_what_goes_deeper_though_it_seems_to_leave() -> None:
    mark, place = (0.5, 0.3, OBSTACLE), (1.1506, 0.1851, 2.393)  # its middle is off the corner
    assert -SLACK_M < gap_to(0.5, 0.3, CELL_M / 2, place, RECT) < -0.01
    assert leaves(0.5, 0.3, place, RECT, 0.5, -0.3)
    into = look((0.5, -0.3), mark, place=place, from_mps=0.0)
    assert zone().allowed_mps(into.free_m) == 0.0
    assert look((-0.5, -0.3), mark, place=place, from_mps=0.0) == NOTHING


@pytest.mark.parametrize(
    ("place", "w"),
    [
        ((0.30209528, 0.47686293, -0.09490425), 0.24),  # beside it, and beside it again: 2.2 cm in
        ((0.26961172, -0.73615716, -0.42295909), -0.04),  # 1.7 cm in, on its way out: 2.3 cm in
    ],
)
def test_what_a_corner_clips_between_two_steps_ends_the_way(place: Place, w: float) -> None:
    marks = [(0.7, 0.1), (0.9, 0.1)] if w > 0.0 else [(0.7, -1.3)]
    grid, cells = ground(*((x, y, OBSTACLE) for x, y in marks))
    one = zone(rect=(0.52, REAR_M, WIDTH_M / 2))
    found = one.look(grid, cells, place, (0.0, w), NOWHERE, 0.0, 0.0)
    assert one.allowed_mps(found.free_m) == 0.0


def test_past_a_wall_within_the_margin_it_may_go_along() -> None:
    wall = [(0.2 * k + 0.1, 0.5, OBSTACLE) for k in range(-5, 15)]
    assert look((0.5, 0.0), *wall) == NOTHING
    assert look((0.5, 0.3), *wall).free_m < 0.5


def test_the_ground_under_the_robot_needs_not_to_have_been_seen() -> None:
    assert look((0.5, 0.0), (0.1, 0.1, UNKNOWN), (-0.1, -0.1, UNKNOWN)) == NOTHING


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
@pytest.mark.parametrize("rect", [RECT, (REAR_M, FRONT_M, WIDTH_M / 2)])
def test_a_cell_that_only_the_farthest_corner_comes_near_to_counts(
    quarter: int, rect: Rect
) -> None:
    """The corner of footprint and margin points straight at the edge of a cell, 4 cm beyond it."""
    ahead, aside = FRONT_M + MARGIN_M, WIDTH_M / 2 + MARGIN_M
    corner_rad = math.atan2(aside, ahead) + (0.0 if rect[0] > rect[1] else math.pi)
    away = math.hypot(aside, ahead) - 0.04
    c, s = round(math.cos(quarter * math.pi / 2)), round(math.sin(quarter * math.pi / 2))
    x, y = -2.0 + 0.1 * s * s, 1.0 + 0.1 * c * c
    place = (x - away * c, y - away * s, quarter * math.pi / 2 - corner_rad)
    grid, cells = ground((x + 0.05 * c, y + 0.05 * s, OBSTACLE))
    window = (grid.corner_i, grid.corner_j, SIZE)
    assert clearance(cells, window, CELL_M, place, rect, MARGIN_M, NOWHERE) < MARGIN_M - 0.02


# Speeds


@given(st.floats(0.0, 5.0))
def test_the_allowed_speed_is_one_from_which_it_stops_in_time(free_m: float) -> None:
    allowed = zone().allowed_mps(free_m)
    assert allowed == 0.0 or allowed >= SLOWEST_MPS
    assert allowed * REACTION_S + allowed**2 / (2 * BRAKE_MPS2) <= free_m + 1e-9
    assert zone().stop_m(allowed) <= free_m + 1e-9


def test_the_way_to_a_stop_is_reaction_and_braking() -> None:
    assert zone().stop_m(1.0) == pytest.approx(REACTION_S + 1 / (2 * BRAKE_MPS2))
    for mps in (1.01 * SLOWEST_MPS, 0.7):
        assert zone().allowed_mps(zone().stop_m(mps)) == pytest.approx(mps)
    assert zone().allowed_mps(zone().stop_m(0.99 * SLOWEST_MPS)) == 0.0
    assert zone().allowed_mps(math.inf) == math.inf


@pytest.mark.parametrize(("front_m", "rear_m"), [(0.3, 0.2), (0.2, 0.3)])
def test_the_fastest_point_is_the_farthest_corner(front_m: float, rear_m: float) -> None:
    of = StopZone(front_m, rear_m, 0.8, 0.1, 1.0, 0.1)
    assert of.rate_mps(-0.7, -2.0) == pytest.approx(0.7 + 2.0 * 0.5)


@pytest.mark.parametrize(
    ("v_mps", "from_mps", "for_s", "free_m"),
    [
        (20.0, 0.0, 0.0, LONGEST_M),  # what lies beyond the longest sweep is not thought free
        (0.5, 20.0, 0.0, LONGEST_M),
        (0.5, 0.0, 100.0, math.inf),  # but nobody asked for more
        (0.5, 0.0, 0.0, math.inf),
        (0.99 * STANDING_MPS, 20.0, 0.0, math.inf),  # it stands
        (STANDING_MPS, 20.0, 0.0, LONGEST_M),
    ],
)
def test_no_more_is_looked_at_than_the_longest_sweep(
    v_mps: float, from_mps: float, for_s: float, free_m: float
) -> None:
    grid = RingGrid(301, 0.2)
    cells: I8 = grid.layer(np.int8, FREE)
    found = zone().look(grid, cells, NOWHERE, (v_mps, 0.0), NOWHERE, from_mps, for_s)
    is_free = math.isinf(free_m)
    assert found == (NOTHING if is_free else Obstruction(LONGEST_M, 0, 0, UNKNOWN))


def test_the_way_of_some_seconds_is_looked_at_where_it_is_longer_than_that_to_a_stop() -> None:
    grid, cells = ground((3.1, 0.1, OBSTACLE))
    free_m = 3.0 - FRONT_M - MARGIN_M
    for seconds, is_seen in ((free_m / 0.5 - 1.0, False), (free_m / 0.5, True)):
        found = zone().look(grid, cells, NOWHERE, (0.5, 0.0), NOWHERE, 0.0, seconds)
        assert math.isfinite(found.free_m) is is_seen


def test_what_is_just_within_the_margin_takes_nothing_of_it() -> None:
    grid, cells = ground((0.9, 0.1, OBSTACLE))
    place = (0.8 - FRONT_M - MARGIN_M + 0.5 * SLACK_M, 0.1, 0.0)
    window = (grid.corner_i, grid.corner_j, SIZE)
    assert clearance(cells, window, CELL_M, place, RECT, MARGIN_M, NOWHERE) == MARGIN_M


@pytest.mark.parametrize("k", range(14, 20))
@pytest.mark.parametrize("side", range(-8, 9, 2))
def test_fine_cells_that_are_listed_for_many_steps_at_once_are_met_where_they_are(
    k: int, side: int
) -> None:
    grid, cells = ground(((k + 0.5) * 0.05, (side + 0.5) * 0.05, OBSTACLE), cell_m=0.05)
    found = zone().look(grid, cells, (0.0, 0.0, 0.0), (0.5, 0.0), NOWHERE, 0.5, 0.0)
    assert found.free_m == pytest.approx(k * 0.05 - FRONT_M - MARGIN_M, abs=0.002)
