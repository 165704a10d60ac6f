"""The whole app with method `certainty` over the fake URG-04LX: box and kerbs against the truth."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from config_file import load_config, with_changes
from core.config import Config
from core.mapping.certainty.maps import CertaintyMaps
from core.records import FREE, OBSTACLE, UNKNOWN
from fakes.scenes.scene import Scene
from fakes.scenes.solids import Solid
from tests import ROOT
from tests.support.robot.closed_loop import ClosedLoop, heights_of

SOLIDS = (
    Solid("pavement", (-5.0, 30.0), (-1.63, 1.63), (-1.0, 0.0)),
    Solid("lawn, a kerb higher", (-5.0, 30.0), (1.63, 8.0), (-1.0, 0.16)),
    Solid("road, a kerb lower", (-5.0, 30.0), (-8.0, -1.63), (-1.0, -0.16)),
    Solid("box", (6.23, 6.83), (-1.27, -0.67), (0.0, 0.4)),
)
FLOOR, BOX, LAWN, ROAD = (-1e-3, 1e-3), (0.39, 0.41), (0.15, 0.17), (-0.17, -0.15)
Mask = npt.NDArray[np.bool_]


def config_of(filtered: bool, **certainty: Any) -> Config:
    text = (ROOT / "robots" / "urg04lx.toml").read_text(encoding="utf-8")
    return with_changes(
        load_config(text),
        map={"method": "certainty"},
        certainty=certainty,
        shadow_filter={"methods": ["certainty"] if filtered else []},
    )


class Seen:
    """A map after a drive, with the truth of each of its cells, row by row from the corner."""

    def __init__(self, filtered: bool = True, **certainty: Any) -> None:
        scene = Scene("street", SOLIDS, waypoints=((4.2, 0.0),), speed_mps=0.3)
        self.loop = ClosedLoop(config_of(filtered, **certainty), scene)
        self.loop.run(16.0)
        maps = self.loop.app.mapper.maps
        assert isinstance(maps, CertaintyMaps)
        grid = maps.window.grid
        self.states = self.loop.map_now()
        truth_m = heights_of(self.loop)[1:-1, 1:-1]
        self.low_m, self.high_m = truth_m.min(-1), truth_m.max(-1)
        self.heights_m = np.roll(maps.heights_m(), (-grid.corner_j, -grid.corner_i), (0, 1))

    def of(self, low_m: float, high_m: float) -> Mask:
        """Cells all of which lies between two heights."""
        return np.asarray((self.low_m >= low_m) & (self.high_m <= high_m))

    def told(self, where: Mask) -> list[int]:
        """How many cells are free, and how many obstacles."""
        return [int((self.states[where] == state).sum()) for state in (FREE, OBSTACLE)]


@pytest.fixture(scope="module")
def seen() -> Seen:
    return Seen()


def test_what_is_flat_is_free_and_box_and_kerbs_up_and_down_are_obstacles(seen: Seen) -> None:
    free, obstacles = seen.told(seen.of(*FLOOR))
    assert free > 300
    assert obstacles <= 0.01 * free  # mixed pixels beside the box
    for bounds_m, least in ((BOX, 5), (LAWN, 500), (ROAD, 300)):
        free, obstacles = seen.told(seen.of(*bounds_m))
        assert free == 0
        assert obstacles >= least
    assert (seen.states[np.isnan(seen.heights_m)] == UNKNOWN).all()


def test_heights_are_true_to_a_centimetre(seen: Seen) -> None:
    known = np.isfinite(seen.heights_m) & (seen.states != UNKNOWN)
    flat = known & (seen.high_m - seen.low_m < 1e-3)
    errors_m = (seen.heights_m - seen.low_m)[flat]
    assert errors_m.size > 2000
    assert float(np.quantile(np.abs(errors_m), 0.95)) < 0.01
    assert abs(float(errors_m.mean())) < 0.005


def test_the_planner_holds_that_map_and_nothing_was_lost(seen: Seen) -> None:
    meant = np.array([0, 2, 1], dtype=np.uint8)[seen.states]  # unknown, obstacle, free
    assert int((seen.loop.planner.window() != meant).sum()) <= 20  # of this very tick's scan
    counts = seen.loop.app.mapper.counts
    assert (counts.scans_dropped, counts.erased) == (0, 0)
    assert counts.scans_added > 130


@pytest.mark.slow
def test_each_step_before_the_map_takes_out_some_of_what_is_wrong_beside_edges() -> None:
    off = {"min_group": 1, "three_scans": False, "cas": False}
    bare, groups, shadows = (
        Seen(filtered=False, **off),
        Seen(filtered=False, **{**off, "min_group": 3}),
        Seen(filtered=True, **off),
    )
    wrong = [one.told(one.of(*FLOOR))[1] for one in (bare, groups, shadows)]
    assert wrong[0] > wrong[1] > wrong[2]  # floor told as an obstacle
    assert [one.told(one.of(*BOX))[0] + one.told(one.of(*LAWN))[0] for one in (bare, shadows)] == (
        [0, 0]
    )
    assert bare.told(bare.of(*ROAD))[0] <= 1
    assert shadows.told(shadows.of(*ROAD))[0] == 0


def test_nothing_that_stands_is_free_around_a_robot_that_turns() -> None:
    boxes = ((3.2, -0.3), (2.2, 2.2), (-0.3, 3.1), (-2.7, 1.9), (2.5, -2.9))
    solids = [Solid("box", (x, x + 0.6), (y, y + 0.6), (0.0, 0.4)) for x, y in boxes]
    solids.append(Solid("floor", (-9.0, 9.0), (-9.0, 9.0), (-1.0, 0.0)))
    solids.append(Solid("wall", (-6.0, 6.0), (4.6, 4.9), (0.0, 2.0)))
    ways = (0.8, 0.0), (0.8, 0.8), (0.0, 0.8)
    loop = ClosedLoop(config_of(True), Scene("turns", tuple(solids), waypoints=ways, speed_mps=0.4))
    obstacles = 0
    for _ in range(6):
        loop.run(2.5)
        stands = heights_of(loop)[1:-1, 1:-1].min(-1) > 0.3
        assert not (loop.map_now()[stands] == FREE).any()
        obstacles = int((loop.map_now()[stands] == OBSTACLE).sum())
    assert obstacles > 150
    assert (loop.map_now() == FREE).sum() > 800
