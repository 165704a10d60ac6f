"""What a score counts, on maps that are drawn by hand; and the truth, there and back."""

import math
from pathlib import Path

import numpy as np
import pytest

from core.records import FREE, I8, OBSTACLE, UNKNOWN
from tests import ROOT
from tools.sweep.look import Look
from tools.sweep.scores import AWAY_S, SCORES, Memory, Tally, lone_cells, sight_of, undecided_share
from tools.sweep.truth import DriveTruth, Ground, TruthError, truth_metadata

SIZE, CELL_M = 101, 0.2
CORNER = -50
AT = (50, 60)  # row, column of a cell two metres ahead of a robot at the origin


def look(t_s: float, cells: I8, pose: tuple[float, float, float] = (0.1, 0.1, 0.0)) -> Look:
    return Look(t_s, cells, CORNER, CORNER, CELL_M, pose)


def cells_with(state: int, around: int = UNKNOWN) -> I8:
    cells = np.full((SIZE, SIZE), around, dtype=np.int8)
    cells[AT] = state
    return cells


def seen(memory: Memory, *states: int, from_s: float = 0.0, every_s: float = 0.2) -> None:
    for k, state in enumerate(states):
        memory.take(look(from_s + k * every_s, cells_with(state)))


def test_a_cell_that_turns_within_two_seconds_flips_over_unknown_too() -> None:
    memory = Memory(CELL_M)
    seen(memory, FREE, FREE, OBSTACLE, UNKNOWN, FREE)
    assert memory.flips == 2
    seen(memory, FREE, OBSTACLE, from_s=10.0, every_s=2.5)
    assert memory.flips == 2, "long after is no flip"


@pytest.mark.parametrize(
    ("before", "after", "changed"), [(FREE, OBSTACLE, 1), (OBSTACLE, OBSTACLE, 0)]
)
def test_a_cell_that_is_another_when_seen_again_is_a_changed_revisit(
    before: int, after: int, changed: int
) -> None:
    memory, behind = Memory(CELL_M), (0.1, 0.1, math.pi)
    visit = [before] * 8
    seen(memory, *visit)
    for k in range(5):  # the robot looks the other way
        memory.take(look(2.0 + k * AWAY_S / 4, cells_with(UNKNOWN), behind))
    seen(memory, UNKNOWN, *[after] * 8, from_s=2.0 + 1.2 * AWAY_S)
    memory.end()
    assert (memory.revisits, memory.changed) == (1, changed)


def test_what_is_only_looked_away_from_for_a_moment_is_no_revisit() -> None:
    memory = Memory(CELL_M)
    seen(memory, *[FREE] * 8)
    seen(memory, *[OBSTACLE] * 8, from_s=4.0)
    memory.end()
    assert memory.revisits == 0


def test_a_robot_sees_what_lies_ahead_whichever_way_it_looks() -> None:
    for yaw in (0.0, 1.0, -2.5):
        ahead = sight_of(look(0.0, cells_with(FREE), (0.1, 0.1, yaw)))
        x, y = 4.0 * math.cos(yaw), 4.0 * math.sin(yaw)
        column, row = int(x / CELL_M) + 50, int(y / CELL_M) + 50
        assert ahead[row, column]
        assert not ahead[100 - row, 100 - column], "behind"
        assert 0.30 < ahead.sum() * CELL_M**2 / (math.pi * 100.0) < 0.34, "120 of 360 degrees"


def test_undecided_is_a_share_of_the_ground_near_whatever_the_size_of_cells() -> None:
    assert undecided_share(look(0.0, cells_with(FREE, around=FREE))) == pytest.approx(0.0, abs=0.01)
    half = cells_with(UNKNOWN)
    half[:50] = FREE
    assert undecided_share(look(0.0, half)) == pytest.approx(0.5, abs=0.03)
    small = Look(0.0, np.full((10, 10), FREE, dtype=np.int8), -5, -5, CELL_M, (0.0, 0.0, 0.0))
    assert undecided_share(small) == pytest.approx(1.0 - 4.0 / (math.pi * 25.0), abs=0.01)


def test_a_lone_cell_has_no_other_beside_it_and_free_ground_around() -> None:
    assert lone_cells(cells_with(OBSTACLE, around=FREE)) == 1
    assert lone_cells(cells_with(OBSTACLE)) == 0, "unknown around"
    wall = cells_with(OBSTACLE, around=FREE)
    wall[AT[0] + 1, AT[1] + 1] = OBSTACLE
    assert lone_cells(wall) == 0


def metadata(people: tuple[tuple[float, float, float], ...] = ()) -> dict[str, str]:
    """Floor of 20 m x 20 m, and a box of a metre, 0.5 m high, from x = 2 m on, left of the way."""
    heights = np.zeros((400, 400))
    heights[210:230, 240:260] = 0.5
    heights[:5] = np.nan
    path = np.array([[t, t * 0.1, 0.0, 0.0] for t in range(11)], dtype=float)
    return truth_metadata(
        "test", 1, Ground(heights, -10.0, -10.0), path, [np.array(people).reshape(-1, 3)] * 11
    )


def test_a_map_is_held_against_the_truth_where_the_robot_truly_stands() -> None:
    cells = np.full((SIZE, SIZE), FREE, dtype=np.int8)
    truth = DriveTruth(metadata())
    # at 5 s the robot is at x = 0.5 m and believes to be at the origin, turned by a quarter
    found = truth.figures(look(5.0, cells, (0.0, 0.0, math.pi / 2)))
    assert found["free_on_danger_m2"] == pytest.approx(1.0 + 0.2 * 20.0, abs=1.5)
    assert math.sqrt(found["place_error_m squared"]) == pytest.approx(0.5)
    # the box lies ahead and to the left of it: in its own map, along y and at lower x
    column, row = 50 + int(-1.0 / CELL_M), 50 + int(2.0 / CELL_M)
    obstacle = np.full((SIZE, SIZE), UNKNOWN, dtype=np.int8)
    obstacle[row, column] = OBSTACLE
    assert truth.figures(look(5.0, obstacle, (0.0, 0.0, math.pi / 2)))["false_obstacle_m2"] == 0.0
    obstacle[row, 100 - column] = OBSTACLE
    wrong = truth.figures(look(5.0, obstacle, (0.0, 0.0, math.pi / 2)))
    assert wrong["false_obstacle_m2"] == pytest.approx(CELL_M**2)
    assert truth.figures(look(99.0, cells)) == {}, "nobody knows"


def test_somebody_who_walks_there_is_no_false_obstacle() -> None:
    cells = np.full((SIZE, SIZE), UNKNOWN, dtype=np.int8)
    cells[50, 35] = OBSTACLE  # at (-2.9, 0.1) m
    told = look(0.0, cells, (0.0, 0.0, 0.0))
    assert DriveTruth(metadata()).figures(told)["false_obstacle_m2"] > 0.0
    assert DriveTruth(metadata(((-2.6, 0.3, 0.1),))).figures(told)["false_obstacle_m2"] == 0.0


@pytest.mark.parametrize(
    "damage",
    [
        {"form": "2"},
        {"ground": "AAAA"},
        {"ground": "not base64!"},
        {"rows": "99999999"},
        {"columns": "-1"},
        {"path": "[]"},
        {"path": "[[0, 1e300, 0, 0]]"},
        {"path": "[[0, NaN, 0, 0]]"},
        {"path": "{"},
        {"people": "[[[1, 2]]]"},
        {"x_m": "inf"},
    ],
    ids=str,
)
def test_truth_that_is_damaged_is_told(damage: dict[str, str]) -> None:
    with pytest.raises(TruthError):
        DriveTruth(metadata() | damage)


def test_scores_of_a_drive_with_nothing_to_judge_it_by_are_none() -> None:
    tally = Tally(CELL_M, None)
    tally.take(look(0.0, cells_with(FREE)))
    found = tally.scores()
    assert found["revisit_share"] is None
    assert found["flips_m2_per_min"] is None
    assert "place_error_m" not in found


def test_the_document_defines_every_score_in_the_words_of_the_code() -> None:
    text = Path(ROOT / "docs" / "sweep.md").read_text(encoding="utf-8")
    for score in SCORES:
        assert f"| `{score.name}` | {score.unit} | {score.about} |" in text
