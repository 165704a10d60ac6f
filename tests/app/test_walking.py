"""A robot with legs in a closed loop: its map of centimetres, by external poses of its own sway."""

import math

import numpy as np
import pytest

from config_file import load_config, with_changes
from core.config import Config
from core.mapping.footing import USUAL
from core.mapping.layers import maybe_values
from core.records import F64, FREE, I64, OBSTACLE
from fakes.scenes.scene import load_scene
from fakes.scenes.solids import Shape
from tests import ROOT
from tests.support.robot.closed_loop import ClosedLoop
from tools.experiments.terrain.feet import true_step_m

MESSOR = with_changes(
    load_config((ROOT / "robots" / "messor.toml").read_text(encoding="utf-8")),
    planner={"port": "udp://127.0.0.1:9750"},  # the loop's planner is the positioning system, too
)
CELL_M = MESSOR.map.cell_m
STONES = load_scene("stones")
BOXES = [solid for solid in STONES.solids if solid.name.startswith("box")]
FREE_TOLD = 1  # a cell of the planner's window
LOOK_S = 0.25
NEAR_M = 0.015


def cells_on(shape: Shape, cell_m: float = CELL_M) -> tuple[I64, I64]:
    """World indices (n,), (n,) of all cells that lie wholly on an upright box."""
    i, j = (
        np.arange(math.ceil(low / cell_m - 1e-6), math.floor(high / cell_m + 1e-6), dtype=np.int64)
        for low, high in (shape.x, shape.y)
    )
    all_i, all_j = np.meshgrid(i, j)
    return all_i.ravel(), all_j.ravel()


def free_cells(loop: ClosedLoop) -> set[tuple[str, int, int]]:
    """Cells of boxes that the map holds, or the planner has been told, to be free."""
    grid, states, found = loop.app.mapper.maps.window.grid, loop.map_now(), set()
    for box in BOXES:
        for i, j in zip(*(part.tolist() for part in cells_on(box, grid.cell_m)), strict=True):
            col, row = i - grid.corner_i, j - grid.corner_j
            if not (0 <= col < grid.size and 0 <= row < grid.size):
                continue
            told = loop.planner.cell_at((i + 0.5) * grid.cell_m, (j + 0.5) * grid.cell_m)
            if states[row, col] == FREE or told == FREE_TOLD:
                found.add((box.name, i, j))
    return found


def footholds_and_their_true_steps(loop: ClosedLoop) -> tuple[F64, list[float]]:
    """Of 0.9 x 1 m with both boxes: all (n,), and the steps under each fifth of the good ones."""
    i, j = (part.ravel() for part in np.meshgrid(np.arange(50, 140), np.arange(-50, 50)))
    told = maybe_values(loop.app.mapper.maps, "foothold", i, j)
    assert told is not None
    x_m, y_m = ((part[told > 0.0][::5] + 0.5) * CELL_M for part in (i, j))
    steps_m = [true_step_m(STONES, x, y) for x, y in zip(x_m.tolist(), y_m.tolist(), strict=True)]
    return told, steps_m


def walked(config: Config) -> tuple[ClosedLoop, set[tuple[str, int, int]]]:
    """A loop after the walk past both boxes; and what was free of them at any time."""
    loop = ClosedLoop(config, STONES)
    system = loop.positioning
    usual = system.sigma_m, system.sigma_z_m, system.sigma_rad
    system.sigma_m = system.sigma_z_m = system.sigma_rad = 1e-3  # until the map has its frame
    while not loop.app.mapper.odometry.started:
        loop.run(0.1)
    system.sigma_m, system.sigma_z_m, system.sigma_rad = usual
    wrong: set[tuple[str, int, int]] = set()
    while loop.since_begin_s < 14.0:
        loop.run(LOOK_S)
        wrong |= free_cells(loop)
    return loop, wrong


@pytest.mark.slow
def test_a_walking_robot_tells_the_heights_of_boxes_and_none_of_their_cells_is_free() -> None:
    loop, wrong = walked(MESSOR)
    maps = loop.app.mapper.maps
    for box in BOXES:
        cells = cells_on(box)
        told_m = maybe_values(maps, "z", *cells)
        assert told_m is not None
        known_m = told_m[np.isfinite(told_m)]
        assert len(known_m) > 0.6 * len(told_m), box.name
        [top_m] = STONES.height_at([sum(box.x) / 2], [sum(box.y) / 2])
        assert float(np.median(known_m)) == pytest.approx(top_m, abs=NEAR_M), box.name
        states = maybe_values(maps, "state", *cells)
        assert states is not None
        assert int((states == OBSTACLE).sum()) > 0.2 * len(states), box.name
    assert wrong == set()
    footholds, steps_m = footholds_and_their_true_steps(loop)
    assert float(np.isfinite(footholds).mean()) > 0.5
    assert len(steps_m) > 500
    assert sum(step_m > USUAL.step_m for step_m in steps_m) < 0.01 * len(steps_m)
    assert int((loop.map_now() == FREE).sum()) > 200  # most floor was looked at once only
    assert loop.app.mapper.counts.erased == 0


@pytest.mark.slow
def test_in_cells_of_five_millimetres_a_third_is_known_to_a_few_millimetres() -> None:
    cell_m = 0.005
    fine = {"cells": 401, "cell_m": cell_m}
    loop, wrong = walked(with_changes(MESSOR, map=fine, obstacle={"window_cells": 401}))
    maps = loop.app.mapper.maps
    assert wrong == set()
    for box in BOXES:
        told_m = maybe_values(maps, "z", *cells_on(box, cell_m))
        assert told_m is not None
        [top_m] = STONES.height_at([sum(box.x) / 2], [sum(box.y) / 2])
        assert float(np.nanmedian(told_m)) == pytest.approx(top_m, abs=0.004), box.name
    i, j = (part.ravel() for part in np.meshgrid(np.arange(100, 280), np.arange(-100, 100)))
    told_m = maybe_values(maps, "z", i, j)
    assert told_m is not None
    off_m = np.abs(told_m - STONES.height_at((i + 0.5) * cell_m, (j + 0.5) * cell_m))
    known = np.isfinite(off_m)
    assert float(known.mean()) > 0.3  # two scans lie a centimetre apart
    middle_m, most_m = np.quantile(off_m[known], (0.5, 0.9))
    assert middle_m < 0.0025
    assert most_m < 0.007
