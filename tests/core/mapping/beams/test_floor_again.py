"""Floor that is seen again: what it takes away, and what stays however often it is seen."""

import pytest

from core.mapping.beams.carving import FLOOR_FOR_LONG, LOW_M
from core.records import FREE, OBSTACLE
from tests.support.cell_rig import CELL_M, CellRig, Point, floor_around

X, Y = 4.1, 0.1  # middle of a cell


def line(h: float, part: float = 0.0) -> list[Point]:
    """Beams side by side across the cell, in one of its rows of parts, at a height."""
    x = X - 0.5 * CELL_M + 0.025 + 0.05 * part
    return [(x, Y - 0.075 + 0.05 * k, h) for k in range(4)]


def lifted(h: float = 0.13) -> CellRig:
    """A cell in whose first row of parts something was seen, in three scans."""
    rig = CellRig()
    for _ in range(30):
        rig.add(*floor_around(X, Y), *line(0.0, 1.0))
    for _ in range(3):
        rig.add(*line(h))
    assert rig.state(X, Y) == OBSTACLE
    return rig


def test_a_floor_that_was_lifted_for_a_moment_is_free_again() -> None:
    rig = lifted()
    for k in range(FLOOR_FOR_LONG):
        assert rig.state(X, Y) == OBSTACLE, k
        rig.add(*line(0.0), *floor_around(X, Y))
    assert rig.state(X, Y) == FREE


BESIDE = [*line(0.0, 1.0), *line(0.0, 2.0), *line(0.0, 3.0), *line(0.0)[:3]]


@pytest.mark.parametrize(
    ("h", "floor"), [(0.13, BESIDE), (LOW_M + 0.01, line(0.0)), (0.7, line(0.0))]
)
def test_floor_beside_it_or_under_what_is_higher_proves_nothing(
    h: float, floor: list[Point]
) -> None:
    rig = lifted(h)
    for _ in range(10 * FLOOR_FOR_LONG):
        rig.add(*floor)
    assert rig.state(X, Y) == OBSTACLE


def test_what_is_seen_now_and_then_stays() -> None:
    rig = lifted()
    for _ in range(10):
        for _ in range(FLOOR_FOR_LONG - 1):
            rig.add(*line(0.0))
        rig.add(*line(0.13)[:2])
        assert rig.state(X, Y) == OBSTACLE


def test_floor_that_is_seen_where_it_was_missed_leaves_what_stands_high_beside_it() -> None:
    rig = CellRig()
    for _ in range(3):
        rig.add(*line(0.7))
        rig.add_silent(*line(0.0, 1.0))
    assert rig.cell(X, Y)["miss_bits"] != 0
    mean_m = rig.cell(X, Y)["mean_m"]
    for _ in range(FLOOR_FOR_LONG):
        rig.add(*line(0.0, 1.0))
    assert rig.cell(X, Y)["miss_bits"] == rig.cell(X, Y)["miss"] == 0
    assert 0.0 < rig.cell(X, Y)["mean_m"] < mean_m  # its average goes on
    assert rig.state(X, Y) == OBSTACLE
