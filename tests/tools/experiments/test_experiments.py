"""The experiments in their short forms: the bounds that judge the maps, and the measures."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.records import FREE, OBSTACLE, UNKNOWN
from fakes.scenes.scene import Scene, Solid
from fakes.world.world import F64
from tools.experiments import metrics
from tools.experiments.beyond_ground import ditch, ramps, speed_bumps
from tools.experiments.paper_motion import left_turn
from tools.experiments.pictures import elevation_pixels, obstacle_pixels, upright
from tools.experiments.report import Outcome, Row, document, merged, stale_pictures, verdict
from tools.experiments.runner import Experiment, experiments
from tools.experiments.scenes import corridor, hall, ramp_corridor
from tools.experiments.truth import Truth
from tools.experiments.views import MapView


def figures(outcome: Outcome, quantity: str) -> tuple[float, float]:
    """What (reference_plane, surface) got in the row whose quantity holds these words."""
    [row] = [row for row in outcome.rows if quantity in row.quantity]
    return row.values["reference_plane"], row.values["surface"]


@pytest.mark.slow
def test_a_turn_leaves_no_hole_and_no_false_obstacle(tmp_path: Path) -> None:
    outcome = left_turn(True, tmp_path)
    theirs, ours = figures(outcome, "growth of the mapped area")
    assert ours <= 3.0
    assert theirs > 10.0
    for words in ("empty cells", "false obstacle", "missed"):
        assert figures(outcome, words)[1] == 0
    [(file, _)] = outcome.pictures  # shows both methods and is small
    path = tmp_path / file
    assert path.stat().st_size < 60_000
    with Image.open(path) as image:
        assert image.width > 600
        colours = {colour for _, colour in image.convert("RGB").getcolors() or []}
    assert {(40, 90, 220), (60, 170, 75), (215, 40, 40), (250, 165, 60)} <= colours


@pytest.mark.slow
@pytest.mark.parametrize("experiment", [speed_bumps, partial(ramps, 2.0)], ids=["bumps", "ramp"])
def test_uneven_ground_makes_ten_times_fewer_false_obstacles(
    experiment: Experiment, tmp_path: Path
) -> None:
    theirs, ours = figures(experiment(True, tmp_path), "false obstacle cells, mean")
    assert theirs > 5.0
    assert ours <= theirs / 10


@pytest.mark.slow
def test_a_ditch_of_60_cm_bars_the_way_long_before_the_robot_is_there(tmp_path: Path) -> None:
    outcome = ditch(0.6, True, tmp_path)
    assert figures(outcome, "bars the way")[1] > 5.0
    assert figures(outcome, "free cells in it")[1] == 0


class Place:
    """A world that is nothing but its scene."""

    def __init__(self, *solids: Solid) -> None:
        self._scene = Scene("place", solids)

    def height_at(self, x: F64, y: F64) -> F64:
        return self._scene.height_at(x, y)


def test_a_box_is_an_obstacle_and_a_slab_and_a_ramp_are_floor() -> None:
    floor = Solid("floor", (-2.0, 8.0), (-2.0, 2.0), (-1.0, 0.0))
    box = Solid("box", (2.03, 2.57), (-0.57, 0.57), (0.0, 0.3))
    slab = Solid("slab", (4.03, 4.57), (-0.57, 0.57), (0.0, 0.05))
    truth = Truth(Place(floor, box, slab), (-2.0, 8.0), (-2.0, 2.0)).cells(-10, -10, 50, 0.2)
    assert truth.obstacle[10, 21]  # x 2.2, y 0
    assert truth.danger[10, 21] == 1.0
    assert not truth.obstacle[10, 31]
    assert truth.danger[10, 31] == 0.0
    ramp = Place(*ramp_corridor(2.07, 4.0, np.radians(8.0), 12.07))
    on_it = Truth(ramp, (-2.0, 8.0), (-2.0, 2.0)).cells(-10, -5, 10, 0.2)
    beyond = Truth(ramp, (-2.0, 12.0), (-2.0, 2.0)).cells(40, -5, 10, 0.2)
    assert not on_it.obstacle.any()
    assert not beyond.obstacle.any()
    assert beyond.high_m.max() == pytest.approx(4.0 * np.tan(np.radians(8.0)), abs=1e-6)


def test_floor_beyond_a_ditch_is_floor_only_if_the_scene_says_so() -> None:
    parts = [
        Solid("floor", (-2.0, 2.0), (-1.0, 1.0), (-1.0, 0.0)),
        Solid("ditch", (2.0, 3.0), (-1.0, 1.0), (-1.0, -0.5)),
        Solid("beyond", (3.0, 6.0), (-1.0, 1.0), (-1.0, 0.0)),
    ]
    span = ((-2.0, 6.0), (-1.0, 1.0))
    alone = Truth(Place(*parts), *span).cells(20, -2, 4, 0.2)
    said = Truth(Place(*parts), *span, floors_m=((0.0, 0.0), (5.0, 0.0))).cells(20, -2, 4, 0.2)
    assert alone.obstacle.all()
    assert not said.obstacle.any()


def flat_view(size: int = 20) -> MapView:
    """A map of free floor at height 0, all of it seen; its corner is world cell (0, 0)."""
    states = np.full((size, size), FREE, dtype=np.int8)
    return MapView("map", 0, 0, 0.2, states, np.zeros((size, size)), (0.0, 0.0, 0.0))


def flat_truth(*solids: Solid) -> Truth:
    floor = Solid("floor", (-1.0, 5.0), (-1.0, 5.0), (-1.0, 0.0))
    return Truth(Place(floor, *solids), (-1.0, 5.0), (-1.0, 5.0), ((0.5, 0.5),))


BOX = Solid("box", (2.0, 2.4), (2.0, 2.4), (0.0, 0.5))  # cells 10 and 11


def test_an_obstacle_cell_is_false_beyond_two_cells_of_a_true_one() -> None:
    view, cells = flat_view(), flat_truth(BOX).cells(0, 0, 20, 0.2)
    view.states[10, 7] = OBSTACLE  # a step's edge is a true one too: cell 9 has a sample of it
    assert metrics.false_obstacles(view, cells) == 0
    view.states[10, 4] = OBSTACLE
    assert metrics.false_obstacles(view, cells) == 1
    view = flat_view()
    view.states[10, 10] = OBSTACLE
    assert metrics.wall_error_m(view, cells) == 0.0
    view.states[10, 15] = OBSTACLE  # the box's edge reaches into cell 12 at most
    assert metrics.wall_error_m(view, cells) == pytest.approx(0.3, abs=0.11)


def test_a_danger_is_missed_unless_it_or_a_neighbour_is_told() -> None:
    view, cells = flat_view(), flat_truth(BOX).cells(0, 0, 20, 0.2)
    hits, low_m, high_m = np.full((20, 20), 9), np.zeros((20, 20)), np.zeros((20, 20))
    high_m[10, 10] = 0.4
    dangers = metrics.seen_dangers(cells, hits.astype(np.int32), low_m, high_m)
    assert dangers.sum() == 1
    assert metrics.missed(view, dangers) == 1
    assert metrics.free_on_danger(view, cells) == 4
    view.states[11, 11] = OBSTACLE
    assert metrics.missed(view, dangers) == 0
    assert metrics.free_on_danger(view, cells) == 3


def test_a_hole_has_heights_on_all_four_sides_and_heights_lie_within_the_band() -> None:
    view, cells = flat_view(), flat_truth().cells(0, 0, 20, 0.2)
    view.heights_m[5, 5] = np.nan
    view.heights_m[12:, :] = np.nan
    hits = np.ones((20, 20), dtype=np.int32)
    assert metrics.holes(view, cells, hits) == 1
    assert metrics.holes(view, cells, 0 * hits) == 0  # nothing was to be seen there
    view.heights_m[...] = 0.05
    view.heights_m[0:2, :] = -0.07
    assert metrics.share_within(view, cells) == pytest.approx(0.9)
    assert metrics.floor_error_m(view, cells) == pytest.approx(
        np.sqrt(0.9 * 0.05**2 + 0.1 * 0.07**2)
    )


def test_heights_and_states_have_the_papers_colours_and_ahead_is_up() -> None:
    heights = elevation_pixels(np.array([[0.0, -0.2, 0.2, 3.0, np.nan]]))
    assert heights[0, 0].tolist() == [40, 90, 220]  # the ground's band is blue,
    assert heights[0, 1].tolist() == [245, 210, 40]  # below it yellow,
    assert len(set(heights[0, 2].tolist())) == 1  # above it grey
    assert heights[0, 3].tolist() == [0, 0, 0]  # to black
    states = obstacle_pixels(np.array([[FREE, OBSTACLE, UNKNOWN]], dtype=np.int8))
    assert [pixel.tolist() for pixel in states[0]] == [[60, 170, 75], [215, 40, 40], [250, 165, 60]]
    cells = np.zeros((3, 4, 3), dtype=np.uint8)  # [j, i]
    cells[2, 3] = 9  # farthest ahead, farthest left
    assert upright(cells).shape == (4, 3, 3)
    assert upright(cells)[0, 0, 0] == 9


@pytest.mark.parametrize(
    ("theirs", "ours", "aim", "judged"),
    [
        (10.0, 1.0, "less", "better"),
        (1.0, 10.0, "less", "worse"),
        (1.0, 10.0, "more", "better"),
        (100.0, 99.0, "less", "same"),
        (float("inf"), 0.5, "less", "better"),
        (0.5, float("inf"), "less", "worse"),
        (float("inf"), float("inf"), "less", "same"),
        (float("nan"), 1.0, "less", ""),
        (10.0, 1.0, "none", ""),
    ],
)
def test_a_row_says_which_is_better(theirs: float, ours: float, aim: str, judged: str) -> None:
    row = Row("5.0", "things", {"reference_plane": theirs, "surface": ours}, aim)  # type: ignore[arg-type]
    assert verdict(row) == judged


def test_the_document_has_the_table_what_does_not_hold_and_the_pictures() -> None:
    worse = Row("5.9 test", "cells", {"reference_plane": 1.0, "surface": 2.0}, digits=0, paper="7")
    perfect = Row("5.9 test", "holes", {"reference_plane": 0.0, "surface": 0.0})
    part = Outcome("5.9 test", "", [Row("5.9 test", "more", {"surface": float("inf")}), perfect])
    part.tell("nothing", {"surface": float("nan")})
    whole = Outcome("5.9 test", "Done.", [worse], [("a.png", "first")])
    text = document(merged([whole, part]))
    assert "- **5.9 test**: Done." in text
    assert "| 5.9 test | cells | 7 | 1 | 2 | **worse** |" in text
    assert "- worse: 5.9 test, cells: 2 against 1" in text
    assert "In 1 more rows" in text
    assert "![first](pictures/a.png)" in text
    assert "| never |" in text
    assert "| nothing" not in text


def test_only_old_pictures_of_experiments_go(tmp_path: Path) -> None:
    for name in ("live.png", "7-table.png", "7-gone.png"):
        (tmp_path / name).touch()
    outcome = Outcome("7 table")
    outcome.pictures.append(("7-table.png", "a table"))
    assert [path.name for path in stale_pictures(tmp_path, [outcome])] == ["7-gone.png"]


def test_all_seven_experiments_are_there_and_places_are_closed() -> None:
    numbers = {name.partition(" ")[0] for name in experiments()}
    assert numbers == {"5.1", "5.2", "5.3", "5.4", "5.5", "5.6", "7"}
    assert len(corridor(10.0)) == 5
    assert sum("pillar" in solid.name for solid in hall()) == 6
