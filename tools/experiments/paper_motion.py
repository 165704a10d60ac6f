"""The paper's sections 5.4 and 5.6: straight with slipping wheels, and a left turn of 92 deg."""

import math
from pathlib import Path

import numpy as np

from app import App
from core.records import OBSTACLE
from fakes.scenes.scene import Scene
from fakes.world.slip import Slip
from fakes.world.trajectory import Way, stand, straight, turn
from tools.experiments import metrics
from tools.experiments.report import Outcome
from tools.experiments.scenes import COMPASS_RAD, corridor, hall, scene
from tools.experiments.trial import BOTH, LEAD_S, Trial, methods
from tools.experiments.views import MapView

DRIVES = ((4.2, 4.4), (20.0, 21.41))  # metres driven, and counted by the wheels
AHEAD_M = 3.07  # from where the drive ends to the wall at the end
STANDS_M = 0.10
FINE = {"cells": 201, "cell_m": 0.1}  # for smears of less than the shipped cell


def straight_drives(quick: bool, folder: Path) -> Outcome:
    outcome = Outcome(
        "5.4 straight, wheels slip",
        "Corridor of 4.1 m, 4.2 m and 20 m straight at 0.2 m/s towards the wall at its end, "
        "which is 3 m away then; the wheels count 4.4 m and 21.41 m. Distance: what the "
        "method believes to have gone. Cells of 0.1 m. "
        "Holes: floor cells without a height in the midst of cells that have one. Smear: mean "
        "depth, along the way, of the obstacle cells of the end wall, beyond one cell. The "
        "wall's distance: from the axle, to the nearest obstacle cell ahead.",
    )
    for way_m, counted_m in DRIVES[: 1 if quick else 2]:
        share = counted_m / way_m - 1.0
        wall_m = way_m + AHEAD_M
        way = Way(stand(LEAD_S), straight(way_m, 0.6 if quick else 0.2))
        place = Scene(
            "corridor",
            tuple(corridor(wall_m)),
            x_axis_east_of_north_rad=COMPASS_RAD,
            slips=(Slip(share, share),),
        )
        test = Trial(place, way, methods(map=FINE, obstacle={"window_cells": FINE["cells"]}))
        test.run(way.duration_s + 0.5)
        _measure_straight(f"{way_m:g} m", way_m, wall_m, test, outcome)
        caption = f"5.4: after {way_m:g} m straight, with slip"
        file, views = folder / f"5.4-straight-{way_m:g}.png", test.views(*BOTH)
        outcome.draw(file, caption, views, (way_m - 10, way_m + 6), (-3, 3))
    return outcome


def _measure_straight(
    name: str, way_m: float, wall_m: float, test: Trial, outcome: Outcome
) -> None:
    apps = test.apps.items()
    distance = {kind: 100.0 * abs(_gone_m(app, kind, test) - way_m) for kind, app in apps}
    smear = {}
    for view in test.views():
        wall = view.part((wall_m - 3.0, wall_m + 3.0), (-1.5, 1.5)) & (view.states == OBSTACLE)
        smear[view.name] = 100.0 * max(0.0, metrics.extent_m(wall, view.cell_m, 1) - view.cell_m)
    paper = {"4.2 m": "20", "20 m": "141"}[name]
    left_m = wall_m - test.rig.world.pose()[0]
    ahead = {view.name: 100.0 * abs(_wall_ahead_m(view) - left_m) for view in test.views()}
    outcome.tell(f"{name}: distance error, cm", distance, digits=1, paper=paper)
    outcome.tell(f"{name}: holes in the floor, cells", test.holes(), digits=0)
    outcome.tell(f"{name}: smear of the end wall, cm", smear, digits=0)
    outcome.tell(f"{name}: error of the wall's distance ahead, cm", ahead, digits=0)


def _gone_m(app: App, kind: str, test: Trial) -> float:
    """How far the robot has gone: what the wheels count, or the place in the map."""
    if kind == "reference_plane":
        return app.mapper.odometry.place_at(app.mapper.newest_scan_s)[3]
    return test.view(kind).pose[0]


def _wall_ahead_m(view: MapView) -> float:
    """From the axle to the middle of the nearest obstacle cells of the robot's lane; inf: none."""
    x_m, y_m, _ = view.pose
    lane = view.part((x_m + 0.5, x_m + 6.0), (y_m - 0.5, y_m + 0.5)) & (view.states == OBSTACLE)
    columns = np.nonzero(lane)[1]
    return float(view.centres_m()[0][columns].min() - x_m) if columns.size else float("inf")


def left_turn(quick: bool, folder: Path) -> Outcome:
    rate_radps = 0.6 if quick else 0.3
    way = Way(
        stand(LEAD_S),
        straight(2.0, 0.5),
        stand(0.5),
        turn(math.radians(92.0), rate_radps),
        stand(0.5),
    )
    test = Trial(scene("hall", hall()), way, methods())
    test.run(way.duration_s)
    growth, walls, floors = {}, {}, {}
    for view in test.views():
        seen = test.seen(view)
        known = np.isfinite(view.heights_m)
        tall = (seen.hits > 0) & (seen.high_m >= STANDS_M)
        growth[view.name] = 100.0 * abs(metrics.area_growth(known, seen.hits > 0))
        walls[view.name] = 100.0 * metrics.area_growth(view.states == OBSTACLE, tall)
        floors[view.name] = float((known & (seen.hits == 0)).sum())
    outcome = Outcome(
        "5.6 left turn of 92 deg",
        "Hall as in 5.1; 2 m ahead, then 92 deg to the left on the spot at 0.3 rad/s. Growth: "
        "cells with a height against cells in which a beam truly ended, by how much they are "
        "more or fewer; of walls: obstacle cells against cells where a beam truly ended 0.10 m "
        "or more above the floor. Position error: from each obstacle cell to the nearest true "
        "one, centre to centre.",
    )
    outcome.tell("growth of the mapped area, % of what was seen", growth, digits=1)
    outcome.tell("growth of walls and pillars, %", walls, digits=1)
    outcome.tell("cells mapped that no beam met", floors, digits=0)
    walls_cm = test.per_app(lambda view, cells: 100.0 * metrics.wall_error_m(view, cells))
    outcome.tell("position error of walls, mean cm", walls_cm, digits=1)
    outcome.tell("empty cells in mapped floor", test.holes(), digits=0)
    outcome.tell("false obstacle cells", test.per_app(metrics.false_obstacles), digits=0)
    outcome.tell("obstacle cells missed", test.missed(), digits=0)
    caption = "5.6: after a left turn of 92 degrees"
    outcome.draw(folder / "5.6-left-turn.png", caption, test.views(*BOTH), (-6, 15), (-5.3, 4.6))
    return outcome
