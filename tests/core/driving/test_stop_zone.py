"""The stop zone against a slow, obvious model: a fine-stepped footprint and points in each cell."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.driving.stop_zone import (
    NOTHING,
    SLOWEST_MPS,
    Obstruction,
    Place,
    StopZone,
    clearance,
)
from core.grid.ring import RingGrid
from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import examples

FRONT_M, REAR_M, WIDTH_M, MARGIN_M, BRAKE_MPS2 = 0.5, 0.2, 0.6, 0.15, 0.8
CELL_M, SIZE = 0.2, 41
REACTION_S = 0.45
NOWHERE = (0.0, 0.0, 0.0)
I8 = npt.NDArray[np.int8]


def zone(unknown_stops: bool = True) -> StopZone:
    return StopZone(FRONT_M, REAR_M, WIDTH_M, MARGIN_M, BRAKE_MPS2, unknown_stops, REACTION_S)


def ground(*marks: tuple[float, float, int], state: int = FREE) -> tuple[RingGrid, I8]:
    """A window about the origin, all of one state but for some cells, by a point in each."""
    grid = RingGrid(SIZE, CELL_M)
    cells: I8 = grid.layer(np.int8, UNKNOWN)
    cells[...] = state
    for x, y, mark in marks:
        i, j = grid.cell_of(x, y)
        cells[j % SIZE, i % SIZE] = mark
    return grid, cells


def look(
    motion: tuple[float, float],
    *marks: tuple[float, float, int],
    place: Place = NOWHERE,
    clear: Place = NOWHERE,
    unknown_stops: bool = True,
    from_mps: float = 1.6,
) -> Obstruction:
    grid, cells = ground(*marks)
    return zone(unknown_stops).look(grid, cells, place, motion, clear, from_mps)


def test_on_free_ground_nothing_is_in_the_way() -> None:
    for motion in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.5, -0.5), (0.0, 0.0)):
        assert look(motion, from_mps=0.0) == NOTHING


def test_the_way_ends_a_margin_before_an_obstacle() -> None:
    found = look((0.5, 0.0), (2.1, 0.1, OBSTACLE))
    assert 2.0 - FRONT_M - MARGIN_M - CELL_M <= found.free_m <= 2.0 - FRONT_M - MARGIN_M
    assert (found.i, found.j, found.state) == (10, 0, OBSTACLE)


def test_what_is_farther_than_the_way_to_stop_does_not_matter() -> None:
    assert look((0.5, 0.0), (2.1, 0.1, OBSTACLE), from_mps=0.0) == NOTHING
    assert look((0.5, 0.0), (-2.1, 0.1, OBSTACLE)) == NOTHING
    assert look((0.5, 0.0), (1.5, 0.75, OBSTACLE)) == NOTHING
    assert look((-0.5, 0.0), (-2.1, 0.1, OBSTACLE)).free_m < 1.7


def test_turning_on_the_spot_sweeps_the_corners_only() -> None:
    corner = math.hypot(FRONT_M + MARGIN_M, WIDTH_M / 2 + MARGIN_M)
    assert look((0.0, 0.5), (0.1, corner - 0.05, OBSTACLE)).state == OBSTACLE
    assert look((0.0, 0.5), (0.1, corner + 0.25, OBSTACLE)) == NOTHING


def test_an_arc_is_followed() -> None:
    ahead, aside = 1.5 * math.sin(1.0), 1.5 * (1 - math.cos(1.0))
    assert look((0.5, 1 / 3), (ahead, aside, OBSTACLE)).state == OBSTACLE
    assert look((0.5, -1 / 3), (ahead, aside + 0.3, OBSTACLE)) == NOTHING


def test_unknown_ground_stops_as_a_wall_does_unless_somebody_vouches_for_it() -> None:
    hole = (1.5, 0.1, UNKNOWN)
    assert look((0.5, 0.0), hole).state == UNKNOWN
    assert look((0.5, 0.0), hole, unknown_stops=False) == NOTHING
    assert look((0.5, 0.0), hole, clear=(0.0, 0.0, 1.6)) == NOTHING
    assert look((0.5, 0.0), hole, clear=(0.0, 0.0, 1.4)).state == UNKNOWN
    assert look((0.5, 0.0), (1.5, 0.1, OBSTACLE), clear=(0.0, 0.0, 5.0)).state == OBSTACLE


def test_beyond_the_window_all_is_unknown() -> None:
    edge_m = SIZE // 2 * CELL_M
    found = look((0.5, 0.0), place=(edge_m - 1.0, 0.0, 0.0))
    assert found.state == UNKNOWN
    assert found.free_m < 0.6


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
    x: float, y: float, leaving: tuple[float, float], entering: tuple[float, float]
) -> None:
    mark = (x, y, OBSTACLE)
    assert look(leaving, mark, from_mps=0.0) == NOTHING
    found = look(entering, mark, from_mps=0.0)
    assert zone().allowed_mps(found.free_m) == 0.0
    assert found.free_m < 0.05


def test_past_a_wall_within_the_margin_it_may_go_along() -> None:
    wall = [(0.2 * k + 0.1, 0.5, OBSTACLE) for k in range(-5, 15)]
    assert look((0.5, 0.0), *wall, place=(0.0, 0.0, 0.0)) == NOTHING
    assert look((0.5, 0.3), *wall).free_m < 0.5


def test_the_ground_under_the_robot_needs_not_to_have_been_seen() -> None:
    assert look((0.5, 0.0), (0.1, 0.1, UNKNOWN), (-0.1, -0.1, UNKNOWN)) == NOTHING


@given(st.floats(0.0, 5.0))
def test_the_allowed_speed_is_one_from_which_it_stops_in_time(free_m: float) -> None:
    allowed = zone().allowed_mps(free_m)
    assert allowed == 0.0 or allowed >= SLOWEST_MPS
    assert allowed * REACTION_S + allowed**2 / (2 * BRAKE_MPS2) <= free_m + 1e-9
    assert zone().stop_m(allowed) <= free_m + 1e-9


def test_the_way_to_a_stop_is_reaction_and_braking() -> None:
    assert zone().stop_m(1.0) == pytest.approx(REACTION_S + 1 / (2 * BRAKE_MPS2))
    assert zone().allowed_mps(zone().stop_m(0.7)) == pytest.approx(0.7)
    assert zone().allowed_mps(math.inf) == math.inf


# The slow model

POINTS = np.linspace(0.01, 0.99, 15)


def touches(place: Place, grow_m: float, at: tuple[float, float, float], i: int, j: int) -> bool:
    """Whether some point of a cell lies under the footprint after a motion (ahead, aside, turn)."""
    c, s = math.cos(place[2]), math.sin(place[2])
    x, y = place[0] + c * at[0] - s * at[1], place[1] + s * at[0] + c * at[1]
    c, s = math.cos(place[2] + at[2]), math.sin(place[2] + at[2])
    dx = (i + POINTS)[:, None] * CELL_M - x
    dy = (j + POINTS)[None, :] * CELL_M - y
    ahead, aside = c * dx + s * dy, c * dy - s * dx
    under = (ahead > -REAR_M - grow_m) & (ahead < FRONT_M + grow_m)
    return bool((under & (np.abs(aside) < WIDTH_M / 2 + grow_m)).any())


def free_way_m(
    place: Place, v: float, w: float, marks: list[tuple[int, int]], upto_m: float
) -> float:
    """Way of the fastest point until the margin first meets a cell that it did not meet before."""
    rate, t = zone().rate_mps(v, w), 0.0
    here = (0.0, 0.0, 0.0)
    far = [mark for mark in marks if not touches(place, MARGIN_M, here, *mark)]
    while t * rate < upto_m:
        turn = w * t
        ahead = v * t if w == 0 else v / w * math.sin(turn)
        aside = 0.0 if w == 0 else v / w * (1 - math.cos(turn))
        if any(touches(place, MARGIN_M, (ahead, aside, turn), *mark) for mark in far):
            return t * rate
        t += 0.02 / rate
    return math.inf


@settings(max_examples=examples(40))
@given(
    place=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.2, 3.2)),
    v=st.sampled_from([-0.6, 0.0, 0.3, 1.0]),
    w=st.sampled_from([-1.0, -0.3, 0.0, 0.4]),
    marks=st.lists(st.tuples(st.integers(-12, 11), st.integers(-12, 11)), min_size=1, max_size=3),
)
def test_the_free_way_is_that_of_the_slow_model_and_never_longer(
    place: Place, v: float, w: float, marks: list[tuple[int, int]]
) -> None:
    here = (0.0, 0.0, 0.0)
    if (v, w) == (0.0, 0.0) or any(touches(place, MARGIN_M + 0.02, here, *mark) for mark in marks):
        return
    grid, cells = ground()
    for i, j in marks:
        cells[j % SIZE, i % SIZE] = OBSTACLE
    found = zone().look(grid, cells, place, (v, w), NOWHERE, 1.5)
    way_m = zone().stop_m(max(1.5, zone().rate_mps(v, w)))
    model_m = free_way_m(place, v, w, marks, way_m)
    if math.isfinite(model_m):
        assert found.free_m <= model_m + 0.05
    if math.isfinite(found.free_m):  # a corner of a cell may escape the model's points
        longer = free_way_m(place, v, w, marks, found.free_m + 2.5 * CELL_M)
        grazes = any(
            touches(place, MARGIN_M + 0.03, at, *mark)
            for mark in marks
            for at in _poses(v, w, found.free_m + 2 * CELL_M)
        )
        assert math.isfinite(longer) or grazes


def _poses(v: float, w: float, upto_m: float) -> list[tuple[float, float, float]]:
    rate = zone().rate_mps(v, w)
    poses = []
    for t in np.arange(0.0, upto_m / rate, 0.02 / rate):
        turn = w * float(t)
        ahead = v * float(t) if w == 0 else v / w * math.sin(turn)
        poses.append((ahead, 0.0 if w == 0 else v / w * (1 - math.cos(turn)), turn))
    return poses


def test_what_lies_beyond_the_longest_sweep_is_not_thought_free() -> None:
    grid = RingGrid(301, 0.2)
    cells: I8 = grid.layer(np.int8, FREE)
    found = zone().look(grid, cells, (0.0, 0.0, 0.0), (20.0, 0.0), (0.0, 0.0, 0.0))
    assert found.free_m == 10.0
    assert zone().allowed_mps(found.free_m) < 20.0


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_a_cell_that_only_the_farthest_corner_comes_near_to_counts(quarter: int) -> None:
    """The corner of footprint and margin points straight at the edge of a cell, 4 cm beyond it."""
    corner_rad = math.atan2(WIDTH_M / 2 + MARGIN_M, FRONT_M + MARGIN_M)
    away = math.hypot(WIDTH_M / 2 + MARGIN_M, FRONT_M + MARGIN_M) - 0.04
    c, s = round(math.cos(quarter * math.pi / 2)), round(math.sin(quarter * math.pi / 2))
    x, y = -2.0 + 0.1 * s * s, -2.0 + 0.1 * c * c
    place = (x - away * c, y - away * s, quarter * math.pi / 2 - corner_rad)
    at = (x + 0.05 * c, y + 0.05 * s)
    rect = (FRONT_M, REAR_M, WIDTH_M / 2)
    for marks, is_less in (((), False), (((*at, OBSTACLE),), True)):
        grid, cells = ground(*marks)
        window = (grid.corner_i, grid.corner_j, SIZE)
        kept_m = clearance(cells, window, CELL_M, place, rect, MARGIN_M, NOWHERE)
        assert (kept_m < MARGIN_M - 0.02) is is_less
