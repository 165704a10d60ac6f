"""All experiments by name, and how they are run: each in a process, as many at once as cores."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from tools.experiments import (
    beyond_ground,
    beyond_things,
    paper_ground,
    paper_maps,
    paper_motion,
)
from tools.experiments.report import Outcome

LONG = ("5.4", "5.3", "5.1", "5.5")  # these begin first, so that none runs alone at the end
Experiment = Callable[[bool, Path], Outcome]


def experiments() -> dict[str, Experiment]:
    """All, by number and name, in the order of the table; parts of one run beside each other."""
    named: dict[str, Experiment] = {
        "5.1 hall": paper_maps.hall_with_pillars,
        "5.2 flat floor": paper_maps.flat_floor,
        "5.3 ramp": paper_ground.ramp,
        "5.4 straight": paper_motion.straight_drives,
        "5.5 standing on objects": paper_ground.standing_on_objects,
        "5.6 left turn": paper_motion.left_turn,
        "7 bumps": beyond_ground.speed_bumps,
        "7 pitching": beyond_ground.pitching,
    }
    for angle_deg in beyond_ground.ANGLES_DEG:
        for sign, word in ((1, "up"), (-1, "down")):
            run = partial(beyond_ground.ramps, sign * angle_deg)
            named[f"7 ramps {angle_deg:g} deg {word}"] = run
    named["7 ramps 4 deg up at once"] = beyond_ground.ramp_at_once
    for wide_m in beyond_ground.DITCHES_M:
        named[f"7 ditch {wide_m:g} m"] = partial(beyond_ground.ditch, wide_m)
    for height_m in beyond_ground.KERBS_M:
        named[f"7 kerb {height_m:+g} m"] = partial(beyond_ground.kerb, height_m)
    return named | {
        "7 table": beyond_things.table,
        "7 person": beyond_things.person_crossing,
        "7 moved box": beyond_things.moved_away,
        "7 glass": beyond_things.glass,
        "7 steel door": beyond_things.steel_door,
    }


def _run(name: str, quick: bool, folder: Path) -> tuple[str, Outcome, float]:
    begun_s = time.monotonic()
    return name, experiments()[name](quick, folder), time.monotonic() - begun_s


def run_all(names: list[str], quick: bool, folder: Path) -> list[Outcome]:
    outcomes: dict[str, Outcome] = {}
    order = sorted(names, key=lambda name: not name.startswith(LONG))
    with ProcessPoolExecutor(os.cpu_count() or 1, get_context("spawn")) as pool:
        running = [pool.submit(_run, name, quick, folder) for name in order]
        for k, result in enumerate(as_completed(running), 1):
            name, outcome, took_s = result.result()
            outcomes[name] = outcome
            print(f"mapod: {k}/{len(names)} {name}: {took_s:.0f} s", flush=True)
    return [outcomes[name] for name in names]
