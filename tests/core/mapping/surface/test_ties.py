"""Ground is reached over a front as wide as a robot, and over no step."""

import pytest

from core.grid.touched import touch
from core.mapping.surface.cells import APART, LOOSE, TIED
from core.mapping.surface.constants import FRONT
from core.mapping.surface.evidence import NEWLY_TIED, spread_ties, tie
from tests.support.maps.ground_cells import GroundCells


class Sides:
    """Reached ground where i < 0, along `front` cells; beyond it ground of another height."""

    def __init__(self, rise_m: float, front: range, behind: int = LOOSE) -> None:
        self.ground = GroundCells()
        for i in range(-6, 0):
            for j in front:
                at = self.ground.lay(i, j, 0.0)
                slot = touch(at, self.ground.touched)
                self.ground.touched.bits[slot] |= NEWLY_TIED
        self.beyond = [
            self.ground.lay(i, j, rise_m, tied=behind) for i in range(12) for j in range(-10, 11)
        ]

    def spread(self) -> set[int]:
        """How ground beyond is tied after a scan."""
        spread_ties(self.ground.surface)
        return {int(tied) for tied in self.ground.cells["tied"][self.beyond]}


WIDE, AS_A_ROBOT = range(-10, 11), range(FRONT)


@pytest.mark.parametrize("rise_m", [-0.2, 0.2, 0.1, -0.1])
def test_ground_beyond_a_step_is_not_reached(rise_m: float) -> None:
    assert Sides(rise_m, WIDE).spread() == {LOOSE}
    assert Sides(rise_m, WIDE, APART).spread() == {APART}


@pytest.mark.parametrize("rise_m", [0.0, 0.08, -0.08])
@pytest.mark.parametrize("front", [WIDE, AS_A_ROBOT])
def test_ground_beyond_a_front_as_wide_as_a_robot_is_reached_all_of_it(
    rise_m: float, front: range
) -> None:
    assert Sides(rise_m, front).spread() == {TIED}


@pytest.mark.parametrize("cells", range(1, FRONT))
def test_a_bridge_narrower_than_a_robot_reaches_nothing(cells: int) -> None:
    assert Sides(0.0, range(cells)).spread() == {LOOSE}


def test_what_has_not_been_tied_now_ties_nothing_on() -> None:
    sides = Sides(0.0, WIDE)
    sides.ground.touched.bits[:] = 0
    assert sides.spread() == {LOOSE}


def test_ground_among_more_that_lies_apart_is_apart_as_well() -> None:
    sides = Sides(-0.2, WIDE, APART)
    at = sides.ground.lay(5, 5, -0.2, tied=LOOSE)
    tie(at, 5, 5, sides.ground.surface)
    assert sides.ground.cells["tied"][at] == APART


def test_a_ledge_half_way_down_a_drop_is_no_way_over_it() -> None:
    """Each step is small enough, but two cells on the ground is a step off."""
    sides = Sides(-0.16, WIDE)
    for j in WIDE:
        sides.ground.lay(0, j, -0.08, tied=LOOSE)
    at = [sides.ground.at(i, j) for i in range(1, 12) for j in WIDE]
    sides.spread()
    assert not (sides.ground.cells["tied"][at] == TIED).any()
