"""Halls that a simulated machine maps and cleans in closed loop, each judged by the truth.

    python -m tools.rig.halls --runs 40 --seed 0 --rows hall_rows.jsonl
    python -m tools.rig.halls --runs 1 --seed 2 --area 28 30

Hall k has the seed `seed` + k; odd seeds have people and a box that is carried elsewhere. A hall is
the same in whatever order. With --rows what was run before is read, not run again. The last line is
of all halls. Exit status 1: a collision, or a machine that did not come back to its dock.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct
from shapely import Polygon

from config_file import load_config
from core.config import Config
from fakes.scenes.halls import AREA_M2, hall_of
from tools.rig.cleaning.run import MACHINE, REACH_CLEAR_M, HallRun
from tools.rig.cleaning.truth import band_of, map_worth

SHIPPED = Path(__file__).parents[2] / "mapod.toml"
HOME_M = 0.15  # from the dock: nearer is back
COLUMNS = (
    "hall", "m2", "lively", "covered %", "overlap %", "collisions", "least gap m", "at dock", "min",
    "swept m", "travel m", "things", "missed", "objects", "false", "pieces", "people seen, missed",
    "in map", "s of CPU",
)  # fmt: skip
HEAD = f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}"


class Row(Struct, frozen=True):
    """One hall: what became of it. Metres, seconds; shares of 1."""

    seed: int
    area_m2: tuple[float, float]  # that was asked for
    reachable_m2: float
    is_lively: bool
    covered: float  # of the floor that the tool gets to
    overlap: float  # swept twice, of what is swept
    collisions: list[str]
    least_gap_m: float
    is_home: bool
    time_s: float
    swept_m: float
    travel_m: float
    things: int
    missed: int
    objects: int
    false: int
    fragments: int
    of_people: int
    people_seen: int
    people_missed: int
    cpu_s: float
    why: str  # it stopped away from its dock


def cleaned(seed: int, area_m2: tuple[float, float], config: Config) -> Row:
    """Run a hall to its end, and judge it."""
    begin_s = time.process_time()
    hall = hall_of(seed, area_m2)
    run = HallRun(hall, config, seed)
    while not run.is_over:
        run.step()
    tally, truth = run.tally, run.truth
    reachable = truth.reachable_at(run.now_s, MACHINE, REACH_CLEAR_M)
    band = band_of(tally.swept, MACHINE.width_m)
    crowd = run.world.crowd
    people = np.zeros((0, 3)) if crowd is None else crowd.people()
    found = [Polygon(one.polygon) for one in run.map.objects()]
    worth = map_worth(truth, found, people, run.now_s)
    return Row(
        seed, area_m2, reachable.area, bool(hall.moved),
        band.intersection(reachable).area / reachable.area,
        max(0.0, tally.swept_m * MACHINE.width_m - band.area) / max(band.area, 1e-9),
        tally.collisions, tally.least_gap_m,
        run.task.goal == "done" and math.hypot(*run.world.place[:2]) < HOME_M,
        run.now_s, tally.swept_m, tally.travel_m,
        worth.things, worth.missed, worth.objects, worth.false, worth.fragments, worth.of_people,
        tally.people_seen, tally.people_missed, time.process_time() - begin_s,
        "it took too long" if run.task.goal not in ("done", "stuck") else run.task.why,
    )  # fmt: skip


def line_of(row: Row, name: str) -> str:
    """A row of the table."""
    return (
        f"| {name} | {row.reachable_m2:.0f} | {'yes' if row.is_lively else 'no'} |"
        f" {100 * row.covered:.1f} | {100 * row.overlap:.1f} | {len(row.collisions)} |"
        f" {row.least_gap_m:.3f} | {'yes' if row.is_home else row.why or 'no'} |"
        f" {row.time_s / 60:.1f} |"
        f" {row.swept_m:.0f} | {row.travel_m:.0f} | {row.things} | {row.missed} | {row.objects} |"
        f" {row.false} | {row.fragments} | {row.people_seen}, {row.people_missed} |"
        f" {row.of_people} | {row.cpu_s:.0f} |"
    )


def summary(rows: Sequence[Row]) -> str:
    """Recall and precision of the map over all halls, and the least coverage of both kinds."""
    things, missed = sum(row.things for row in rows), sum(row.missed for row in rows)
    objects, false = sum(row.objects for row in rows), sum(row.false for row in rows)
    parts = [f"recall {1 - missed / max(1, things):.3f}"]
    parts += [f"precision {1 - false / max(1, objects):.3f}"]
    for name, kind in (("still", False), ("lively", True)):
        covered = [row.covered for row in rows if row.is_lively == kind]
        if covered:
            parts.append(f"{name}: {100 * min(covered):.1f} % covered at least")
    return f"{len(rows)} halls: " + ", ".join(parts)


def known_rows(path: Path) -> list[Row]:
    """Of a file of rows; a last line that was cut off is none."""
    found = []
    for line in path.read_bytes().splitlines() if path.exists() else []:
        try:
            found.append(msgspec.json.decode(line, type=Row))
        except msgspec.DecodeError as error:
            print(f"{path}: a line is left out: {error}", file=sys.stderr)
    return found


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 all well, 1 a collision or a machine that did not come back, 2 wrong use."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="of the first hall")
    parser.add_argument("--rows", type=Path, help="a file that keeps what was run")
    parser.add_argument(
        "--area", type=float, nargs=2, default=AREA_M2, metavar=("FROM", "TO"), help="m2 of a hall"
    )
    given = parser.parse_args(arguments)
    if given.runs < 1 or given.seed < 0 or not 20.0 <= given.area[0] <= given.area[1] <= 5000.0:
        parser.error("--runs: 1 or more; --seed: 0 or more; --area: 20 to 5000 m2, from <= to")
    area_m2 = given.area[0], given.area[1]
    config = load_config(SHIPPED.read_text(encoding="utf-8"))
    before = known_rows(given.rows) if given.rows else []
    there = {row.seed: row for row in before if row.area_m2 == area_m2}
    print(HEAD, flush=True)
    rows = []
    for seed in range(given.seed, given.seed + given.runs):
        row = there.get(seed)
        if row is None:
            row = cleaned(seed, area_m2, config)
            if given.rows:
                with given.rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(msgspec.to_builtins(row)) + "\n")
        rows.append(row)
        print(line_of(row, str(seed)), flush=True)
    for row in rows:
        for words in row.collisions:
            print(f"hall {row.seed}, collision with {words}")
    print(summary(rows))
    return int(any(row.collisions or not row.is_home for row in rows))


if __name__ == "__main__":
    sys.exit(main())
