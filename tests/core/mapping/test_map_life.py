"""The map through any life: scans in any order, pauses, moves, loss. It never says free unseen."""

import math

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from core.mapping.freshness import SWEEP_S
from core.mapping.rays import Sweep
from core.records import FREE, OBSTACLE, UNKNOWN
from tests.support.cases import examples
from tests.support.maps.cell_rig import LENS_M, SCAN_S, CellRig, Point, sweep_to
from tests.support.robot.shipped import shipped

MAX_AGE_S = 4.0
SIZE, WINDOW = 31, 21
ROBOT = shipped().robot
REACH_M = math.hypot(max(ROBOT.front_m, ROBOT.rear_m), ROBOT.width_m / 2)  # of its footprint
PLACES = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
HEIGHTS = st.sampled_from([0.0, 0.0, 0.0, 0.01, 0.15, 0.6, -0.05, -0.3, ROBOT.height_m + 0.2])


class MapLife(RuleBasedStateMachine):
    """What beams could know of each cell, kept in a plain dict beside the map."""

    @initialize(window=st.sampled_from([WINDOW, SIZE]))
    def begin(self, window: int) -> None:
        self.rig = CellRig(SIZE, window, MAX_AGE_S)
        self.met_s: dict[tuple[int, int], float] = {}  # newest return that fell into a cell
        self.watched_s: dict[tuple[int, int], float] = {}  # a beam ended in, or passed over it

    def _take(self, sweep: Sweep) -> None:
        rig = self.rig
        rig.take(sweep)
        self._forget_outside()
        for origin, ray, r in zip(sweep.origins, sweep.rays, sweep.ranges_m[0], strict=True):
            if not r >= 0.15:
                continue
            x, y, _ = origin + r * ray
            at = rig.grid.cell_of(x, y)
            self.met_s[at] = self.watched_s[at] = sweep.t_s
            for share in np.arange(0.0, r, 0.04):
                x, y, _ = origin + share * ray
                self.watched_s[rig.grid.cell_of(x, y)] = sweep.t_s
        for dx in np.arange(-REACH_M, REACH_M, 0.1):
            for dy in np.arange(-REACH_M, REACH_M, 0.1):
                x, y = rig.place
                self.watched_s[rig.grid.cell_of(x + dx, y + dy)] = sweep.t_s

    def _forget_outside(self) -> None:
        grid = self.rig.grid
        for i, j in list(self.met_s):
            if not (0 <= i - grid.corner_i < grid.size and 0 <= j - grid.corner_j < grid.size):
                del self.met_s[i, j]

    def _sweep(self, places: list[Point], returns: bool = True) -> None:
        """A sweep to places that are told from where the robot stands."""
        (x, y), t_s = self.rig.place, self.rig.t_s
        points = [(x + dx, y + dy, z) for dx, dy, z in places]
        self._take(sweep_to(points, (x, y, LENS_M), t_s, returns))

    @rule(
        places=st.lists(st.tuples(PLACES, HEIGHTS), min_size=1, max_size=6), times=st.integers(1, 9)
    )
    def see(self, places: list[tuple[tuple[float, float], float]], times: int) -> None:
        for _ in range(times):
            self._sweep([(*place, z) for place, z in places])

    @rule(place=PLACES, rows=st.integers(1, 20))
    def sweep_floor(self, place: tuple[float, float], rows: int) -> None:
        """A strip of floor, five cells wide, line by line away from the robot."""
        far_m = math.hypot(*place) or 1.0
        ahead = place[0] / far_m, place[1] / far_m
        for row in range(rows):
            along = far_m + 0.05 * row
            line = [
                (
                    along * ahead[0] - 0.05 * k * ahead[1],
                    along * ahead[1] + 0.05 * k * ahead[0],
                    0.0,
                )
                for k in range(-10, 10)
            ]
            self._sweep(line)

    @rule(places=st.lists(PLACES, min_size=3, max_size=6))
    def lose(self, places: list[tuple[float, float]]) -> None:
        """A scan of beams that never come back."""
        self._sweep([(*place, 0.0) for place in places], returns=False)

    @rule(seconds=st.floats(0.0, 2 * MAX_AGE_S))
    def wait(self, seconds: float) -> None:
        """The scanner is silent; then a scan that shows nothing."""
        self.rig.t_s += seconds
        self._sweep([])

    @rule(dx=st.floats(-2.0, 2.0), dy=st.floats(-2.0, 2.0))
    def move(self, dx: float, dy: float) -> None:
        x, y = self.rig.place
        self.rig.follow(x + dx, y + dy)
        self._sweep([])

    @rule()
    def erase(self) -> None:
        """The pose was lost."""
        self.rig.maps.erase()
        self.met_s.clear()

    @invariant()
    def free_is_what_a_beam_met_and_nothing_came_in_since(self) -> None:
        """Never free what no beam saw, nor what nobody watched for too long."""
        rig = self.rig
        grid = rig.window.grid
        for row, column in np.argwhere(rig.window.cells == FREE):
            i = grid.corner_i + (column - grid.corner_i) % grid.size
            j = grid.corner_j + (row - grid.corner_j) % grid.size
            at = int(i), int(j)
            assert at in self.met_s, f"{at} is free, and no beam ever met it"
            age_s = rig.t_s - self.watched_s[at]
            assert age_s <= MAX_AGE_S + SWEEP_S + 2 * SCAN_S, f"{at} was seen {age_s} s ago"

    @invariant()
    def states_are_states_and_changes_are_told_once(self) -> None:
        window = self.rig.window
        assert np.isin(window.cells, (FREE, UNKNOWN, OBSTACLE)).all()
        changed = window.changed[: window.used]
        assert len(set(changed.tolist())) == len(changed)
        assert (window.marked[changed] == 1).all()
        assert int(window.marked.sum()) == len(changed)


MapLife.TestCase.settings = settings(max_examples=examples(8), stateful_step_count=12)
test_a_map_lives_any_life = MapLife.TestCase


def test_a_life_has_free_ground() -> None:
    """Else the above would prove nothing."""
    life = MapLife()
    life.begin(WINDOW)
    life.sweep_floor((1.5, 1.0), 20)
    assert (life.rig.window.cells == FREE).sum() >= 4
    life.free_is_what_a_beam_met_and_nothing_came_in_since()
    life.wait(2 * MAX_AGE_S)
    assert not (life.rig.window.cells == FREE).any()
