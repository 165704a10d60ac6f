"""Whether a robot can do what a scene asks: what is found wrong with places made for it."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest

from fakes.scenes.reach import Ground, check_place
from fakes.scenes.reach_kernels import flood, grown, is_clear, seen, ways_to
from fakes.scenes.scene import Scene, Solid, problems
from fakes.scenes.solids import BLACK, GLASS, Pillar, Shape, bump, soft
from fakes.world.crowd import Walker
from fakes.world.kinematic import KinematicWorld
from fakes.world.rotations import R_from_angles
from fakes.world.trajectory import held

F64 = npt.NDArray[np.float64]
FLOOR = Solid("floor", (-14.0, 40.0), (-14.0, 14.0), (-1.0, 0.0))


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Solid:
    return Solid("thing", x, y, z)


def found(*solids: Shape, goal: tuple[float, float] = (16.0, 0.0), clear_m: float = 9.0) -> str:
    """The first thing that is wrong with a floor on which something stands; "" if nothing."""
    return "; ".join(check_place((FLOOR, *solids), [goal], (), clear_m)[:1])


def walls_about(x: float, gap_m: float) -> tuple[Solid, Solid]:
    """A wall across the floor with a gap about y = 0."""
    return (
        box((x, x + 0.2), (-14.0, -gap_m / 2), (-1.0, 2.5)),
        box((x, x + 0.2), (gap_m / 2, 14.0), (-1.0, 2.5)),
    )


ACROSS = (-14.0, 14.0)


@pytest.mark.parametrize(
    ("things", "says"),
    [
        # things that leave a wide way
        ([box((12.0, 13.0), (-0.5, 0.5), (0.0, 0.2))], ""),
        ([Pillar("post", (12.0, 0.0), 0.1, (0.0, 2.0))], ""),
        (walls_about(12.0, 2.0), ""),
        # a doorway is wide enough from 1.6 m on
        (walls_about(12.0, 1.8), ""),
        (walls_about(12.0, 1.4), "no way"),
        # a start that is not free
        ([box((-0.2, 0.2), (0.4, 0.6), (0.0, 2.0))], "the start is not free"),
        ([Solid("drop", (0.5, 0.9), (-0.2, 0.2), (0.3, 0.4))], "the start is not free"),
        # what nobody should drive over: a kerb right across, ..., a table as wide as the hall
        ([box((12.0, 12.3), ACROSS, (0.0, 0.16))], "goal 16.00, 0.00"),
        ([Solid("", (12.0, 12.02), ACROSS, (0.0, 2.0), material=GLASS)], "goal 16.00, 0.00"),
        ([Solid("", (12.0, 14.0), ACROSS, (0.0, 0.004), material=BLACK)], "goal 16.00, 0.00"),
        ([Solid("", (12.0, 13.0), ACROSS, (0.0, 0.3), material=soft(5.0))], "goal 16.00, 0.00"),
        ([box((12.0, 13.0), ACROSS, (0.7, 0.72))], "goal 16.00, 0.00"),
        # cables, what hangs high, bumps and ramps bar nothing
        ([box((12.0, 12.2), ACROSS, (0.0, 0.006))], ""),
        ([box((12.0, 13.0), ACROSS, (1.6, 1.8))], ""),
        ([bump("bump", (12.0, 12.8), ACROSS, 0.03)], ""),
        ([Solid("", (11.0, 20.0), ACROSS, (-1.0, 0.0), rise_x_rad=math.radians(2.0))], ""),
        # a goal needs a metre around it
        ([box((16.8, 17.0), (-0.3, 0.3), (0.0, 0.3))], "not free"),
        ([box((17.2, 17.4), (-0.3, 0.3), (0.0, 0.3))], ""),
    ],
)
def test_what_is_wrong_with_a_place_is_said(things: Sequence[Shape], says: str) -> None:
    assert says in found(*things)
    assert bool(says) is bool(found(*things))


@pytest.mark.parametrize(
    "thing",
    [
        box((5.0, 5.5), (2.0, 2.5), (0.0, 0.5)),
        box((-5.0, -4.5), (2.0, 2.5), (0.0, 0.9)),
        box((5.0, 6.0), (2.0, 2.5), (0.7, 1.3)),  # a top without legs
        Solid("glass", (5.0, 7.0), (2.0, 2.02), (0.0, 2.0), material=GLASS),
        Solid("mat", (5.0, 7.0), (2.0, 3.0), (0.0, 0.004), material=BLACK),
    ],
)
def test_what_is_hard_to_see_must_not_stand_in_the_clear_start(thing: Solid) -> None:
    assert "within the clear start" in found(thing)
    assert "clear start" not in found(thing, clear_m=2.0)


def test_tall_things_may_stand_in_the_clear_start_and_hide_what_is_behind_and_no_edge() -> None:
    assert found(box((5.0, 5.5), (2.0, 2.5), (0.0, 1.3))) == ""
    wall = box((-14.0, 12.0), (3.0, 3.2), (-1.0, 1.3))
    low_behind = box((4.0, 5.0), (3.3, 3.6), (0.0, 0.3))
    assert "clear start" in found(low_behind)
    narrow = Solid("floor", (-14.0, 40.0), (-14.0, 4.0), (-1.0, 0.0))
    end = box((12.0, 12.2), (3.0, 4.0), (-1.0, 1.3))
    assert check_place([narrow, wall, end, low_behind], [(16.0, 0.0)], (), 9.0) == []
    assert "clear start" in check_place([narrow], [(16.0, 0.0)], (), 9.0)[0]


@pytest.mark.parametrize(
    ("half_m", "begin_m", "end_m", "goal", "says"),
    [
        (1.5, 12.0, 15.0, (13.5, 6.0), "the laser does not see"),  # from 8.45 m away
        (3.5, 11.5, 18.5, (15.0, 8.0), ""),  # on a detour
    ],
)
def test_a_bend_can_be_looked_into_where_it_is_wide(
    half_m: float, begin_m: float, end_m: float, goal: tuple[float, float], says: str
) -> None:
    walls = (
        box((-14.0, begin_m), (half_m, 14.0), (-1.0, 2.5)),
        box((-14.0, end_m + 0.2), (-14.0, -half_m), (-1.0, 2.5)),
        box((end_m, end_m + 0.2), (-half_m, 14.0), (-1.0, 2.5)),
    )
    assert says in found(*walls, goal=goal)
    assert bool(says) is bool(found(*walls, goal=goal))


def test_the_lasers_line_is_where_the_world_has_it() -> None:
    """Beams of the simulated laser end on places that count as seen, and a step nearer do not."""
    random = np.random.default_rng(4)
    pillar = Pillar("post", (5.0, 1.0), 0.3, (0.0, 2.0))
    ground = Ground((FLOOR, pillar), [(12.0, 0.0)])
    corner = (*ground.raster.low, 0.1)
    for yaw in random.uniform(-0.5, 0.5, 8):
        world = KinematicWorld(Scene("some", (FLOOR, pillar)), held(place=(0.0, 0.0, yaw)))
        world.step_to(1000.0)
        bearings = np.radians(np.linspace(-48.0, 48.0, 97))
        ranges = world.ranges_m(np.full(97, 1000.0), bearings)
        rays = np.stack([np.cos(bearings), np.sin(bearings), np.zeros(97)], -1)
        tilt = R_from_angles(np.array([yaw]), np.radians([7.5]), np.zeros(1))[0]
        ends = ranges[:, None] * (rays @ tilt.T)
        ends[:, 0] += 0.25 * math.cos(yaw)
        ends[:, 1] += 0.25 * math.sin(yaw)
        on_floor = ends[:, 2] < -1.07
        near = (abs(ends[:, :2]) < 9.8).all(axis=1) & on_floor
        eyes = np.array([[0.0, 0.0, yaw, 0.0, 0.0]])
        targets = np.column_stack([ends[:, :2], np.zeros(97)])

        def ask(places: F64, turn_rad: float) -> npt.NDArray[np.bool_]:
            return seen(
                ground.raster.tops_m,
                corner,
                eyes,  # noqa: B023
                places,
                np.array([turn_rad]),
                np.ones(len(places), dtype=np.int64),
            )

        edges = np.convolve(on_floor, np.ones(5), "same") < 5  # a cell beside the pillar's shadow
        assert ask(targets[near & ~edges], 0.02).mean() > 0.95  # the raster is a little too wide
        assert not ask(targets[near] * [0.9, 0.9, 1.0], 0.02).any()
        behind = targets[~on_floor] * [3.0, 3.0, 0.0]
        assert len(behind) == 0 or not ask(behind, 0.5)[1:-1].any()


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (((1.0, 0.0), (8.0, 0.0)), "stands on the start"),
        (((10.0, -5.0), (10.0, 5.0)), "something in the way"),
        (((10.0, -5.0), (14.0, -5.0)), ""),
    ],
)
def test_people_need_a_free_way_that_does_not_begin_at_the_robot(
    points: tuple[tuple[float, float], ...], says: str
) -> None:
    post = Pillar("post", (10.5, 0.0), 0.2, (0.0, 2.0))
    scene = Scene("some", (FLOOR, post), goals=((16.0, 0.0),), walkers=(Walker("who", points),))
    assert says in "; ".join(problems(scene))
    assert bool(says) is bool(problems(scene))


def test_ways_on_a_raster_are_the_shortest_ones() -> None:
    """Against Dijkstra's, cell by cell."""
    random = np.random.default_rng(8)
    for _ in range(10):
        closed = random.random((12, 15)) < 0.3
        closed[3, 4] = False
        lengths = ways_to(closed, 3, 4)
        known, open_cells = {(3, 4): 0.0}, {(3, 4)}
        while open_cells:
            cell = min(open_cells, key=lambda c: known[c])
            open_cells.remove(cell)
            for dj in (-1, 0, 1):
                for di in (-1, 0, 1):
                    b, a = cell[0] + dj, cell[1] + di
                    if not (0 <= b < 12 and 0 <= a < 15) or closed[b, a]:
                        continue
                    length = known[cell] + math.hypot(dj, di)
                    if length < known.get((b, a), math.inf) - 1e-9:
                        known[b, a] = length
                        open_cells.add((b, a))
        for j in range(12):
            for i in range(15):
                assert lengths[j, i] == pytest.approx(known.get((j, i), math.inf))


def test_growing_and_flooding_do_what_they_say() -> None:
    random = np.random.default_rng(9)
    flags = random.random((20, 25)) < 0.05
    flags[5:12, 8:14] = True
    wider = grown(flags, 2.5)
    set_j, set_i = np.nonzero(flags)
    for j in range(20):
        for i in range(25):
            assert wider[j, i] == (np.hypot(set_j - j, set_i - i).min() <= 2.5)
    heights = np.zeros((6, 6))
    heights[:, 3] = 0.1
    assert flood(heights, 0, 0, 0.05).sum() == 18
    assert flood(heights, 0, 0, 0.2).all()
    assert is_clear(heights > 0, 0.5, 0.5, 2.5, 5.5)
    assert not is_clear(heights > 0, 0.5, 0.5, 4.5, 5.5)
