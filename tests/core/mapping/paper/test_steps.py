"""Each step of the paper's method by itself, with numbers worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core.mapping.paper.grid import PaperGrid, put_height
from core.mapping.paper.steps import PaperSettings, ReferencePlane
from core.records import FREE, OBSTACLE, UNKNOWN

LENS = PaperSettings(
    lens_height_m=1.0,
    tilt_rad=math.radians(30),
    max_range_m=20.0,
    cells=41,
    cell_m=0.1,
    h_pos_m=0.1,
    h_neg_m=-0.1,
    epsilon_rad=math.radians(80),
    eta_rad=math.radians(0.1),
    compensated=True,
)
MIDDLE = 20  # row and column of the laser
FLOOR_ROW = 37  # straight ahead, floor is seen at Y = sqrt(3) = 1.732, in the cell around 1.7


def ahead(settings: PaperSettings = LENS) -> ReferencePlane:
    """A robot with a single beam, straight ahead: 2 m to flat floor."""
    return ReferencePlane(settings, np.array([math.pi / 2]))


def look(
    plane: ReferencePlane,
    range_m: float,
    yaw_deg: float = 0.0,
    pitch_deg: float = 0.0,
    travel_m: float = 0.0,
) -> int:
    """One scan of one beam, without roll."""
    yaw_rad, pitch_rad = math.radians(yaw_deg), math.radians(pitch_deg)
    return plane.add(np.array([range_m]), yaw_rad, pitch_rad, 0.0, travel_m)


def seen(plane: ReferencePlane) -> list[tuple[int, int]]:
    """Cells (row, column) that hold information."""
    return [(int(row), int(column)) for row, column in np.argwhere(plane.grid.count > 0)]


@pytest.mark.parametrize(
    ("tilt_deg", "sigma_deg", "reference_m"),
    [
        (30.0, [30.0, 90.0, 120.0], [3.0, 2.0, 4 / math.sqrt(3)]),
        (30.0, [-40.0, 0.0, 200.0], [3.0] * 3),  # from the horizon back
        (0.0, [90.0], [3.0]),  # does not look down
        (-5.0, [90.0], [3.0]),
    ],
)
def test_the_reference_is_longer_to_the_sides_and_ends_at_the_maximum_range(
    tilt_deg: float, sigma_deg: list[float], reference_m: list[float]
) -> None:
    settings = replace(LENS, max_range_m=3.0, tilt_rad=math.radians(tilt_deg))
    plane = ReferencePlane(settings, np.radians(sigma_deg))
    np.testing.assert_allclose(plane.reference_m, reference_m)
    with pytest.raises(ValueError, match="do not fit"):
        ahead(replace(LENS, max_range_m=1.0))  # the ground is beyond it


def test_a_box_and_a_hole_have_their_heights_in_their_cells_and_floor_is_free() -> None:
    plane = ahead()
    assert look(plane, 1.5) == 1  # rho 60 deg: H = 0.5 * (2 - 1.5), Y = 1.5 * 0.866 = 1.299
    assert plane.elevation_m[33, MIDDLE] == pytest.approx(0.25)
    look(plane, 1.45)  # H = 0.275, Y = 1.256, the same cell
    assert plane.elevation_m[33, MIDDLE] == pytest.approx(0.2625)
    assert plane.grid.count[33, MIDDLE] == 2
    look(plane, 2.0)
    look(plane, 2.3)  # H = -0.15, Y = 1.992
    assert plane.elevation_m[40, MIDDLE] == pytest.approx(-0.15)
    assert seen(plane) == [(33, MIDDLE), (FLOOR_ROW, MIDDLE), (40, MIDDLE)]
    assert plane.obstacles[[33, FLOOR_ROW, 40], MIDDLE].tolist() == [OBSTACLE, FREE, OBSTACLE]
    assert np.count_nonzero(plane.obstacles == UNKNOWN) == 41 * 41 - 3


@pytest.mark.parametrize(
    ("height_m", "state"),
    [(0.25, OBSTACLE), (0.2499, FREE), (-0.25, OBSTACLE), (-0.2499, FREE), (0.0, FREE)],
)
def test_an_average_at_a_bound_is_an_obstacle(height_m: float, state: int) -> None:
    grid = PaperGrid(3, 1.0, 0.25, -0.25)
    put_height(grid.average_m, grid.count, 1, 2, height_m)
    grid.decide(np.array([5], dtype=np.int32))
    assert grid.states.tolist() == [[0, 0, 0], [0, 0, state], [0, 0, 0]]


@pytest.mark.parametrize("range_m", [3.0, 3.5, math.inf])
def test_beyond_the_maximum_is_nothing_where_floor_is_not_due_and_a_drop_where_it_is(
    range_m: float,
) -> None:
    plane = ReferencePlane(replace(LENS, max_range_m=3.0, cells=81), np.radians([30.0, 90.0]))
    assert plane.add(np.array([range_m, range_m]), 0.0, 0.0, 0.0, 0.0) == 1
    assert seen(plane) == [(40 + 26, 40)]  # Y = 3 * 0.866 = 2.598
    assert plane.elevation_m[66, 40] == pytest.approx(-0.5)


def test_rows_scroll_by_whole_cells_the_rest_is_carried_on_and_what_leaves_is_gone() -> None:
    plane = ahead()
    look(plane, 2.0)
    rows = []
    for travel_m in (0.09, 0.25, 0.31, 0.34, 0.05):
        look(plane, math.nan, travel_m=travel_m)
        rows += [row for row, _ in seen(plane)]
    # 0.09 is less than a cell; 0.25 is 2 and 0.05 over; with 0.06 more 1 and 0.01 over; then 0.04;
    # back by 0.29 from there leaves -0.25 since the last scroll's rest: 2 rows back
    assert rows == [37, 35, 34, 34, 36]
    assert plane.obstacles[36, MIDDLE] == FREE
    assert plane.elevation_m[36, MIDDLE] == pytest.approx(0.0)
    look(plane, math.nan, travel_m=-0.45)
    assert (plane.obstacles == UNKNOWN).all()


def test_the_maps_turn_once_the_nearest_cell_ahead_moves_by_more_than_a_cell() -> None:
    plane = ahead()
    look(plane, 2.0, yaw_deg=178.0)
    look(plane, math.nan, yaw_deg=-178.7)  # 1.7 * sin 3.3 deg = 0.098
    assert seen(plane) == [(FLOOR_ROW, MIDDLE)]
    look(plane, math.nan, yaw_deg=-178.5)  # 1.7 * sin 3.5 deg = 0.104: floor goes to the right
    assert seen(plane) == [(FLOOR_ROW, MIDDLE + 1)]
    assert plane.turns == 1
    assert plane.obstacles[FLOOR_ROW, MIDDLE + 1] == FREE


@pytest.mark.parametrize(
    ("changes", "pitches_deg", "reference_m"),
    [
        # the point at 1.732 turns to (1.70574, 0.30077), its line meets ground at 2.43944
        ({}, (0.0, -10.0, -10.0), 2.63645),
        ({}, (7.0, 7.0, 7.0), 2.0),  # only the change counts
        ({}, (0.0, -40.0), 20.0),  # a line above the horizon
        ({"max_range_m": 2.5}, (0.0, -10.0, 0.0), 1.8989),  # it met the maximum: not 2 again
        ({"compensated": False}, (0.0, -10.0), 2.0),
    ],
)
def test_the_reference_turns_with_the_body(
    changes: dict[str, float], pitches_deg: tuple[float, ...], reference_m: float
) -> None:
    plane = ahead(replace(LENS, **changes))  # type: ignore[arg-type]
    for pitch_deg in pitches_deg:
        look(plane, math.nan, pitch_deg=pitch_deg)
    assert plane.reference_m == pytest.approx([reference_m], abs=1e-4)


def test_left_is_left_on_the_map_and_right_side_down_shortens_the_right() -> None:
    plane = ReferencePlane(LENS, np.radians([120.0]))
    look(plane, 1.0)  # d = 2, R = 2.309, cos rho 0.433, R_xy 0.9014: X = -0.4507, Y = 0.7806
    assert seen(plane) == [(28, 15)]
    look(plane, math.nan, yaw_deg=60.0, travel_m=0.3)  # cos 60 deg * 0.3 = 0.15, and no turn
    assert seen(plane) == [(27, 15)]
    plane = ReferencePlane(LENS, np.radians([30.0, 150.0]))
    for roll_deg in (0.0, 5.0):
        plane.add(np.full(2, np.nan), 0.0, 0.0, math.radians(roll_deg), 0.0)
    # (3.3541, 1.9365, 0) turns to (3.3413, 1.9365, -0.2923), its line meets (2.5855, 1.4985, 0)
    assert plane.reference_m[0] == pytest.approx(3.1512, abs=1e-4)
    assert plane.reference_m[1] > 4.0


def test_a_slow_change_beyond_epsilon_is_another_ground() -> None:
    plane = ahead(replace(LENS, epsilon_rad=math.radians(0.5)))
    look(plane, 1.5)
    look(plane, math.nan, pitch_deg=0.45)
    look(plane, math.nan, pitch_deg=0.65)  # beyond epsilon, but it came quickly
    assert plane.restarts == 0
    assert len(seen(plane)) == 1
    look(plane, 2.0, 3.0, pitch_deg=0.70, travel_m=0.09)  # 0.05 since the last scan
    assert plane.restarts == 1
    assert plane.reference_m == pytest.approx([2.0])
    assert seen(plane) == [(FLOOR_ROW, MIDDLE)]  # this scan's alone
    look(plane, 2.0, 5.0, pitch_deg=1.15, travel_m=0.15)  # yaw and travel count anew
    look(plane, 2.0, 5.0, pitch_deg=1.17, travel_m=0.15)  # 0.47 since the restart
    assert (FLOOR_ROW, MIDDLE) in seen(plane)
    assert (plane.restarts, plane.turns) == (1, 0)
    look(plane, 2.0, 5.0, pitch_deg=1.22, travel_m=0.15)
    assert plane.restarts == 2


def test_erasing_counts_yaw_and_travel_anew_and_keeps_the_plane() -> None:
    plane = ahead()
    look(plane, 2.0)
    look(plane, 2.0, pitch_deg=-10.0)
    plane.erase()
    assert seen(plane) == []
    look(plane, 2.0, yaw_deg=50.0, pitch_deg=-10.0, travel_m=30.0)
    assert plane.reference_m == pytest.approx([2.63645], abs=1e-5)
    look(plane, math.nan, yaw_deg=50.0, pitch_deg=-10.0, travel_m=30.09)
    assert len(seen(plane)) == 1
    assert plane.turns == 0
