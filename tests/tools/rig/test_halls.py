"""The table of halls: what is true of a hall, and that it goes on where it ended."""

import json
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
import shapely

from config_file import load_config
from fakes.scenes.halls import hall_of
from tools.rig import halls
from tools.rig.cleaning.run import MACHINE, REACH_CLEAR_M, HallRun
from tools.rig.cleaning.truth import Truth, band_of, gap_of, map_worth

SMALL = (28.0, 30.0)
PEOPLE = np.zeros((0, 3))


def test_the_floor_that_the_tool_reaches_keeps_off_all_that_stands_there() -> None:
    for seed in (2, 3):
        truth = Truth(hall_of(seed))
        free, reachable = truth.free_at(0.0), truth.reachable_at(0.0, MACHINE, REACH_CLEAR_M)
        assert reachable.difference(free).area < 1e-9
        assert 0.7 * free.area < reachable.area < free.area
        assert reachable.distance(truth.bars_at(0.0)) > REACH_CLEAR_M


def test_a_gap_is_measured_to_boxes_pillars_and_people() -> None:
    boxes = np.array([[1.0, 2.0, -1.0, 1.0, 0.0], [-3.5, -2.5, -0.5, 0.5, 0.5]])
    assert gap_of((0.0, 0.0, 1.0), boxes, PEOPLE)[0] == pytest.approx(1.0)
    assert gap_of((-2.0, 0.0, 1.0), boxes, PEOPLE)[0] == pytest.approx(0.5)
    gap_m, what = gap_of((0.0, 0.0, 1.0), boxes, np.array([[9.0, 0.0, 0.2], [0.0, 0.6, 0.22]]))
    assert gap_m == pytest.approx(0.38)
    assert what == "person 2"


def test_somebody_is_in_view_where_nothing_stands_between_him_and_the_lens() -> None:
    """The lens is ahead of the machine's middle: what hides him from the one may not from both."""
    (x0, x1), (y0, y1) = hall_of(2).things[0].shapes[0].x, hall_of(2).things[0].shapes[0].y
    truth, beside = Truth(hall_of(2)), (x0 - 0.05, y0 - 0.6, math.pi / 2)
    at = x1, y1 + 1.0
    assert not truth.is_in_view(beside, (beside[0], y0 - 0.3), at, 0.0)
    assert truth.is_in_view(beside, (x0 - 0.05, y1 + 0.3), at, 0.0)
    assert not truth.is_in_view((*beside[:2], 0.0), (x0 - 0.05, y1 + 0.3), at, 0.0), "aside"
    assert not truth.is_in_view(beside, (x0 - 0.05, y1 + 0.3), (x1, y1 + 4.0), 0.0), "far"


def test_a_box_that_was_carried_away_stands_where_it_was_put() -> None:
    hall = hall_of(3)
    truth, (before, after) = Truth(hall), hall.moved
    first, last = (shapely.Point(one.waypoints[0]) for one in (before, after))
    for t_s, there in ((0.0, (True, False)), (before.until_s, (False, False))):
        bars = truth.bars_at(t_s)
        assert (bars.covers(first), bars.covers(last)) == there
    assert truth.bars_at(after.from_s).covers(last)


def test_the_band_is_what_the_tool_swept_and_no_more() -> None:
    steps = [np.array([k * 0.1, 0.0, (k + 1) * 0.1, 0.0]) for k in range(20)]
    steps += [np.array([3.0, 1.0, 3.0, 2.0])]
    rounds = np.pi * 0.3**2
    assert band_of(steps, 0.6).area == pytest.approx(0.6 * 3.0 + 2 * rounds, rel=0.01)


def test_a_map_of_the_truth_is_without_fault_and_a_false_object_counts() -> None:
    truth = Truth(hall_of(2))
    outlines = truth.outlines(0.0)
    worth = map_worth(truth, outlines, PEOPLE)
    assert (worth.missed, worth.false, worth.fragments) == (0, 0, 0)
    ghost = shapely.box(0.5, -0.2, 0.9, 0.2)
    person = np.array([[0.7, 0.0, 0.22]])
    worth = map_worth(truth, [*outlines[1:], outlines[1], ghost], person)
    assert (worth.missed, worth.false, worth.fragments, worth.of_people) == (1, 1, 1, 1)


def test_a_machine_whose_camera_shows_no_floor_stands_and_says_so() -> None:
    run = HallRun(hall_of(2, SMALL), load_config(halls.SHIPPED.read_text(encoding="utf-8")), 2)
    run.camera.faults.all_invalid = True
    while not run.is_over and run.now_s < 120.0:
        run.step()
    assert (run.task.goal, run.task.why) == ("stuck", "no frame shows floor")
    assert math.hypot(*run.world.place[:2]) < 0.01


def test_a_hall_that_was_run_before_is_read_and_not_run_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row = halls.Row(
        7, SMALL, 25.0, True, 0.98, 0.05, [], 0.04, True, 300.0, 50.0, 12.0, 2, 0, 2, 0, 0, 0, 9, 0,
        40.0, "",
    )  # fmt: skip
    path = tmp_path / "rows.jsonl"
    path.write_text(json.dumps(msgspec.to_builtins(row)) + '\n{"seed": 8, "cov')
    words = ["--seed", "7", "--runs", "1", "--rows", str(path), "--area", "28", "30"]
    assert halls.main(words) == 0
    told = capsys.readouterr()
    assert halls.line_of(row) in told.out
    away = msgspec.structs.replace(row, is_home=False, why="there is no way to the dock")
    assert "| there is no way to the dock |" in halls.line_of(away)
    hit = msgspec.structs.replace(row, collisions=["person 1, after 3.0 s"])
    path.write_text(json.dumps(msgspec.to_builtins(hit)) + "\n")
    assert halls.main(words) == 1
    assert "hall 7, collision with person 1, after 3.0 s\n" in capsys.readouterr().out
    assert "with people: 98.0 % covered at least, overlap 5.0 % at most, 40 mm" in told.out
    assert "a line is left out" in told.err
    with pytest.raises(SystemExit):
        halls.main(["--area", "5", "3"])
