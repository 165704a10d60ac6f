"""What a cell means: Definition 1, contradictions, holes, and what waits for its neighbours."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.grid.window import ObstacleWindow
from core.mapping.beams.classifier import ENOUGH, LOOKED_AGAIN, NEW_S
from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import examples
from tests.support.cell_rig import CELL_M, NEW_LOOKS, CellRig, H, Point, floor_around


def rows(x: float, z: float = 0.0) -> list[Point]:
    """Returns side by side across one cell, as close as beams are."""
    return [(x, 0.025 + 0.05 * k, z) for k in range(4)]


@given(z=st.floats(-0.5, 0.5).filter(lambda z: abs(abs(z) - H) > 1e-9))  # the next one's
def test_definition_1_with_a_cell_at_a_bound_an_obstacle(z: float) -> None:
    rig = CellRig()
    rig.add((2.1, 0.1, z), *floor_around(2.1, 0.1))
    assert rig.state(2.1, 0.1) == (FREE if -H < z < H else OBSTACLE)
    assert rig.state(2.1, 0.9) == UNKNOWN


def test_a_cell_at_the_very_bound_is_an_obstacle() -> None:
    rig = CellRig()
    for z, y in ((H, 0.1), (-H, 0.5)):
        rig.add((2.1, y, z), lens=(0.0, y, z))  # a level beam, so that the height is exact
    assert rig.state(2.1, 0.1) == rig.state(2.1, 0.5) == OBSTACLE


def test_the_edge_of_a_box_is_not_averaged_away_by_the_floor_in_its_cell() -> None:
    rig = CellRig()
    for _ in range(ENOUGH):
        rig.add(*[(2.1, 0.1, 0.0)] * 500, (2.15, 0.1, 0.15))
    assert abs(rig.cell(2.1, 0.1)["mean_m"]) < 0.01
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_the_mouth_of_a_ditch_is_not_averaged_away_by_the_floor_in_its_cell() -> None:
    rig = CellRig()
    for _ in range(ENOUGH):
        rig.add(*[(2.1, 0.1, 0.0)] * 500, (2.15, 0.1, -0.15))
    assert abs(rig.cell(2.1, 0.1)["mean_m"]) < 0.01
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_a_single_stray_return_holds_a_cell_unknown_until_the_laser_has_looked_again() -> None:
    rig = CellRig()
    rig.add((2.1, 0.1, 0.0), (2.1, 0.1, 0.12), *floor_around(2.1, 0.1))
    assert rig.state(2.1, 0.1) == UNKNOWN
    for _ in range(LOOKED_AGAIN):
        rig.add((2.1, 0.1, 0.0))
    assert rig.state(2.1, 0.1) == FREE


def test_where_a_beam_passed_below_the_ground_is_a_hole_not_floor() -> None:
    """A ditch from x = 2.03 to 3.53 m: beams that clear its near edge end on its far wall."""
    rig = CellRig()
    slope = 1.08 / 2.035  # the steepest beam that passes the near edge
    for _ in range(NEW_LOOKS):
        rig.add(*[place for k in range(13) for place in rows(1.9 + 0.01 * k)])
    assert rig.state(2.01, 0.1) == FREE
    for _ in range(ENOUGH):
        rig.add(*rows(3.53, 1.08 - slope * 3.53))
    for x in (2.05, 2.3, 2.9, 3.3, 3.53):
        assert rig.state(x, 0.1) == OBSTACLE, x
    assert rig.state(1.9, 0.1) == FREE


def test_floor_that_gives_no_return_is_a_hole_as_well() -> None:
    """A drop, a black floor, a pane of glass in the floor: nothing comes back."""
    rig = CellRig()
    for _ in range(NEW_LOOKS):
        rig.add(*rows(2.1))
    silent = [(x, y, 0.0) for x in np.arange(2.42, 2.6, 0.04) for y in (0.03, 0.1, 0.17)]
    for _ in range(ENOUGH):
        rig.add_silent(*silent)
    assert rig.state(2.5, 0.1) == OBSTACLE
    assert rig.state(2.1, 0.1) == FREE
    assert rig.state(2.9, 0.1) == UNKNOWN


def test_floor_hidden_behind_something_is_unknown_and_no_hole() -> None:
    rig = CellRig()
    for _ in range(30):
        rig.add(*rows(2.1, 0.4))  # those beams would have met the floor at 3.34 m
    assert rig.state(2.1, 0.1) == OBSTACLE
    for x in (2.3, 2.9, 3.3, 3.5):
        assert rig.state(x, 0.1) == UNKNOWN, x


def test_a_return_just_below_the_ground_digs_no_hole() -> None:
    rig = CellRig()
    rig.add(*[(2.1, 0.1, -0.09)] * 3, *floor_around(2.1, 0.1))
    cells = rig.cells.cells
    assert int(cells["above"].sum() + cells["below"].sum()) == 0
    assert rig.state(2.1, 0.1) == FREE


def test_changes_are_told_once_and_only_when_the_meaning_changed() -> None:
    rig = CellRig()
    rig.add((2.1, 0.1, 0.0), *floor_around(2.1, 0.1), (2.1, 1.1, 0.3))
    told = set(rig.window.take_changed().tolist())
    known = np.flatnonzero(rig.window.cells.ravel() != UNKNOWN)
    assert told == set(known.tolist())
    assert len(told) == 3  # with the cell in front, which is free as well
    rig.add((2.1, 0.1, 0.01), (2.1, 1.1, 0.3))
    assert len(rig.window.take_changed()) == 0
    rig.add(*[(2.1, 0.1, 0.5)] * 3)
    [at] = rig.window.take_changed()
    assert rig.window.cells.ravel()[at] == OBSTACLE


@pytest.mark.parametrize("period_s", [0.02, 0.04, 0.1])
def test_a_cell_that_is_hit_for_a_second_is_free_though_nothing_lies_behind_it(
    period_s: float,
) -> None:
    """A robot that stands still: the laser draws one line across the floor."""
    rig = CellRig(period_s=period_s)
    for k in range(round(NEW_S / period_s)):
        assert rig.state(2.1, 0.1) == UNKNOWN, k
        rig.add((2.1, 0.1, 0.0))
    assert rig.state(2.1, 0.1) == FREE


def test_the_foot_of_a_wall_is_not_free_while_its_height_is_not_seen_yet() -> None:
    """A wall at x = 2.07 m: as the robot comes near, beams climb it by 3 mm a scan."""
    rig = CellRig()
    for k in range(60):
        wall = (2.07, 0.1, 0.003 * k)
        rig.add(wall, *[(2.03, 0.1 + dy, 0.0) for dy in (-0.2, 0.0, 0.2)])
        assert rig.state(2.1, 0.1) != FREE, k
    assert rig.state(2.1, 0.1) == OBSTACLE


def test_a_wall_alongside_is_not_free_where_the_scan_climbs_it_within_one_cell() -> None:
    rig = CellRig()
    climb = [(2.05 + 0.02 * k, 0.1, 0.003 * (6 - k)) for k in range(7)]
    for _ in range(2 * NEW_LOOKS):
        rig.add(*climb)
    assert rig.state(2.1, 0.1) == UNKNOWN


@settings(max_examples=examples(25))
@given(
    steps=st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=12),
    window=st.integers(5, 41),
)
def test_a_smaller_window_always_shows_what_the_elevation_map_knows(
    steps: list[tuple[float, float]], window: int
) -> None:
    rig = CellRig(41, window)
    x = y = 0.0
    for k, (dx, dy) in enumerate(steps):
        x, y = x + dx, y + dy
        rig.follow(x, y)
        rig.add((x + 1.0, y, 0.0), (x, y + 1.5, 0.3), (x - dx, y - dy, -0.02 * k))
    whole = ObstacleWindow(window, CELL_M)
    whole.grid.corner_i, whole.grid.corner_j = rig.window.grid.corner_i, rig.window.grid.corner_j
    rig.classifier_into(whole).decide(np.arange(41 * 41, dtype=np.int32))
    np.testing.assert_array_equal(rig.window.cells, whole.cells)


def test_changes_that_nobody_takes_are_each_kept_once() -> None:
    rig = CellRig(41, 5)
    for k in range(40):
        rig.add(*[(0.1, 0.1, 0.3 * (k % 2))] * 3)
        rig.cells.grid.erase()
        rig.window.grid.erase()
    assert len(rig.window.take_changed()) == 1
