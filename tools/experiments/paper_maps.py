"""The paper's sections 5.1 and 5.2: a hall mapped in four resolutions, and flat floor."""

import time
from pathlib import Path

import numpy as np

from core.config import Config
from core.mapping.method import Maps
from core.mapping.paper.maps import ReferencePlaneMaps
from core.mapping.surface.maps import SurfaceMaps
from core.records import OBSTACLE
from fakes.world.trajectory import Way, stand, straight
from tools.experiments import metrics
from tools.experiments.pictures import rendered
from tools.experiments.report import Outcome
from tools.experiments.scenes import (
    FIRST_PILLAR_GAP_M,
    HALL_Y,
    PILLAR_M,
    PILLARS_X_M,
    corridor,
    hall,
    scene,
)
from tools.experiments.trial import BOTH, LEAD_S, Trial, methods
from tools.experiments.views import MapView

SIZES = {41: "0.863", 101: "4.838", 201: "24.095", 401: "85.074"}  # cells over 20 m: ms to draw
OVER_M = 20.0
PILLAR_X_M = PILLARS_X_M[0]
TIMES = 7  # drawn so often; the quickest counts


def hall_with_pillars(quick: bool, folder: Path) -> Outcome:
    sizes = [41, 101] if quick else list(SIZES)
    configs: dict[str, Config] = {}
    for cells in sizes:
        keys = {"cells": cells, "cell_m": OVER_M / (cells - 1)}
        both = methods(map=keys, obstacle={"window_cells": cells})
        configs |= {f"{name} {cells}": both[name] for name in BOTH}
    way = Way(stand(LEAD_S), straight(4.5, 0.5))
    test = Trial(scene("hall", hall()), way, configs)
    test.run(way.duration_s + 0.2)
    outcome = Outcome(
        "5.1 hall with pillars",
        "Hall of 9 m with two rows of pillars, the first 1.7 m from the left wall; 4.5 m at "
        "0.5 m/s; the same bytes to all maps. Gap: from the pillar's outermost cell to the "
        "mean of the wall's cells. Memory: of all arrays that a method keeps per cell. "
        "Drawing: both maps to pictures, a pixel a cell; ~: measured on the machine's clock.",
    )
    for cells in sizes:
        views = {kind: test.view(f"{kind} {cells}") for kind in BOTH}
        label = f"{cells} x {cells} cells"
        gaps = {kind: abs(100.0 * (pillar_gap_m(view) - 1.7)) for kind, view in views.items()}
        maps = {kind: test.apps[f"{kind} {cells}"].mapper.maps for kind in views}
        sizes_kb = {kind: memory_kb(part) for kind, part in maps.items()}
        drawn = {kind: draw_ms(view) for kind, view in views.items()}
        outcome.tell(f"{label}: error of the pillar-wall gap, cm", gaps, digits=1)
        for k, part in enumerate(("elevation", "obstacle")):
            kept = {kind: both[k] for kind, both in sizes_kb.items()}
            outcome.tell(f"{label}: {part} map, kB", kept, digits=0)
        outcome.tell(f"{label}: drawing, ms", drawn, paper=SIZES[cells], timed=True)
        file, caption = folder / f"5.1-hall-{cells}.png", f"5.1: hall with pillars, {label}"
        shown = list(views.values())
        outcome.draw(file, caption, shown, (-2, 15), (-5.3, 4.5))
    return outcome


def pillar_gap_m(view: MapView) -> float:
    """From the pillar's outermost obstacle cell to the middle of the wall's, centre to centre."""
    near_m = HALL_Y[1] - FIRST_PILLAR_GAP_M
    beside = view.part((PILLAR_X_M - 0.5, PILLAR_X_M + 1.0), (near_m - PILLAR_M, HALL_Y[1] + 0.5))
    rows = np.nonzero(beside & (view.states == OBSTACLE))[0]
    y = view.centres_m()[1][rows]
    wall, pillar = y[y > HALL_Y[1] - 0.75], y[y < near_m + 0.75]
    return float(wall.mean() - pillar.max()) if wall.size and pillar.size else float("nan")


def memory_kb(maps: Maps) -> tuple[float, float]:
    """(elevation, obstacle) map: bytes of the arrays that hold something of each cell, in kB."""
    if isinstance(maps, ReferencePlaneMaps):
        grid = maps.plane.grid
        elevation = grid.average_m.nbytes + grid.count.nbytes
        return 2 * elevation / 1000.0, 2 * grid.states.nbytes / 1000.0  # turning needs a copy
    assert isinstance(maps, SurfaceMaps)
    return maps.cells.nbytes / 1000.0, maps.window.cells.nbytes / 1000.0


def draw_ms(view: MapView) -> float:
    took_s = []
    for _ in range(TIMES):
        begun_s = time.perf_counter()
        rendered(view.heights_m, view.states)
        took_s.append(time.perf_counter() - begun_s)
    return 1000.0 * min(took_s)


def flat_floor(quick: bool, folder: Path) -> Outcome:
    way = Way(stand(LEAD_S), straight(2.0 if quick else 8.0, 0.5))
    configs = methods(scanner={"first_deg": 45.0, "last_deg": 135.0})
    test = Trial(scene("flat", corridor(26.37, 8.12)), way, configs)
    test.run(way.duration_s + 0.2)
    note = "Corridor of 8 m, beams from 45 to 135 deg, 8 m at 0.5 m/s."
    outcome = Outcome("5.2 flat floor", note)
    within = test.per_app(lambda view, cells: 100.0 * metrics.share_within(view, cells))
    outcome.tell("floor cells within +-6 cm, %", within, "more", digits=1)
    error = test.per_app(lambda view, cells: 100.0 * metrics.floor_error_m(view, cells))
    outcome.tell("height error of floor cells, rms cm", error)
    file, views = folder / "5.2-flat-floor.png", test.views(*BOTH)
    outcome.draw(file, "5.2: flat floor", views, (-3, 19), (-5, 5))
    return outcome
