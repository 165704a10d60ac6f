"""Lone returns in the air: what is left out, and what counts at once or a scan later."""

import pytest

from core.mapping.beams.isolated import SOON_S
from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cell_rig import LENS, SCAN_S, CellRig, Point, floor_around, sweep_to

SOON = round(SOON_S / SCAN_S)  # scans
BEHIND: list[Point] = [(3.1, 0.02 * k, 0.0) for k in range(-4, 5)]  # floor, beam beside beam


def speck(rig: CellRig, x: float = 1.5, y: float = 0.0, wide: int = 1) -> None:
    """A scan of nine beams to the floor, of which the middle ones end in the air."""
    points = list(BEHIND)
    for k in range(wide):
        points[4 + k] = (x, y + 0.01 * k, 0.54)
    rig.take(sweep_to(points, LENS, rig.t_s))


def test_a_grain_of_dust_leaves_nothing() -> None:
    rig = CellRig()
    for _ in range(5):
        speck(rig)
        assert rig.state(1.5, 0.0) == UNKNOWN
        assert rig.cell(1.5, 0.0)["count"] == 0
        for _ in range(SOON):
            rig.add(*BEHIND)


def test_on_free_ground_it_takes_no_freedom() -> None:
    rig = CellRig()
    for _ in range(40):
        rig.add((1.5, 0.01, 0.0), *floor_around(1.5, 0.01))
    assert rig.state(1.5, 0.0) == FREE
    speck(rig)
    assert rig.state(1.5, 0.0) == FREE


@pytest.mark.parametrize(
    ("scans_between", "period_s"), [(0, SCAN_S), (SOON - 1, SCAN_S), (2 * SOON - 1, SCAN_S / 2)]
)
def test_what_comes_again_within_half_a_second_is_there(
    scans_between: int, period_s: float
) -> None:
    rig = CellRig(period_s=period_s)
    speck(rig)
    for _ in range(scans_between):
        rig.add(*BEHIND)
    speck(rig)
    speck(rig)
    assert rig.state(1.5, 0.0) == OBSTACLE


def test_what_is_as_wide_as_two_beams_counts_at_once() -> None:
    rig = CellRig()
    speck(rig, wide=2)
    assert rig.cell(1.5, 0.0)["above"] == 1
    speck(rig, wide=2)
    assert rig.state(1.5, 0.0) == OBSTACLE


def test_a_lone_beam_that_meets_the_floor_counts() -> None:
    rig = CellRig()
    points = [(4.1, 0.0, 1.0), (1.5, 0.0, 0.0), (4.1, 0.1, 1.0)]
    rig.take(sweep_to(points, LENS, rig.t_s))
    assert rig.cell(1.5, 0.0)["count"] == 1


def test_the_floor_behind_a_grain_is_not_said_to_be_missing() -> None:
    rig = CellRig()
    speck(rig)
    assert all(rig.cell(x, y)["miss"] == 0 for x, y, _ in BEHIND)
