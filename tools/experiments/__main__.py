"""Runs the paper's experiments and more: `python -m tools.experiments [--only 5.3] [--quick]`.

Writes docs/experiments.md and docs/pictures. With --only the table of what was run is printed, and
only its pictures are written; with --quick they go to a temporary folder.
"""

import argparse
import os
import sys
import tempfile
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
from tools.experiments.report import Outcome, document, merged, table
from tools.terminal.progress import quiet

LONG = ("5.4", "5.3", "5.1", "5.5")  # these begin first, so that none runs alone at the end
Experiment = Callable[[bool, Path], Outcome]
ROOT = Path(__file__).resolve().parents[2]
DOCUMENT, PICTURES = ROOT / "docs" / "experiments.md", ROOT / "docs" / "pictures"


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
    quiet()
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


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tools.experiments", description=__doc__)
    parser.add_argument("--only", default="", help="those whose name begins so: 5.3, '7 ramps'")
    parser.add_argument("--quick", action="store_true", help="short drives; writes no document")
    options = parser.parse_args(arguments)
    names = [name for name in experiments() if name.startswith(options.only)]
    if not names:
        print(f"no experiment begins with {options.only!r}: there are", *experiments(), sep="\n  ")
        return 2
    print(f"mapod: {len(names)} experiments, both methods on the same bytes; some minutes")
    folder = Path(tempfile.mkdtemp(prefix="mapod-pictures-")) if options.quick else PICTURES
    outcomes = merged(run_all(names, options.quick, folder))
    if options.only or options.quick:
        print("\n".join(table([row for outcome in outcomes for row in outcome.rows])))
        print(f"mapod: pictures in {folder}")
    else:
        DOCUMENT.write_text(document(outcomes), encoding="utf-8")
        drawn = {file for outcome in outcomes for file, _ in outcome.pictures}
        for path in PICTURES.glob("*.png"):
            if path.name not in drawn:
                path.unlink()
        print(f"mapod: written to {DOCUMENT.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
