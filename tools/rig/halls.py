"""Halls that a simulated machine maps and cleans in closed loop, each judged by the truth.

    python -m tools.rig.halls --runs 40 --seed 0 --rows hall_rows.jsonl
    python -m tools.rig.halls --runs 1 --seed 2 --area 28 30

Hall k has the seed `seed` + k; odd seeds have people and a box that is carried elsewhere. A hall is
the same in whatever order. With --rows what was run before is read, not run again. The last line is
of all halls. Exit status 1: a collision, a machine that did not come back to its dock, or a crash.
"""

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct
from rich.console import Console
from shapely import Polygon

from config_file import load_config
from fakes.scenes.halls import AREA_M2, hall_of
from tools.rig.cleaning.run import MACHINE, REACH_CLEAR_M, HallRun
from tools.rig.cleaning.truth import band_of, map_worth
from tools.sweep.jobs import Failure, with_bar
from tools.sweep.local import LocalProcesses

SHIPPED = Path(__file__).parents[2] / "mapod.toml"
HOME_M = 0.15  # from the dock: nearer is back
COLUMNS = (
    "hall", "m2", "people", "covered %", "overlap %", "collisions", "least gap mm", "at dock",
    "min", "things missed", "false", "person not told, frames", "s of CPU",
)  # fmt: skip
HEAD = f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}"
FILE_COLUMNS = 200  # of a line that goes to no screen


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


def cleaned(task: tuple[int, tuple[float, float]]) -> Row:
    """Run a hall, by its seed and area, to its end, and judge it."""
    seed, area_m2 = task
    config = load_config(SHIPPED.read_text(encoding="utf-8"))
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


def line_of(row: Row) -> str:
    """A row of the table."""
    cells = (
        row.seed, f"{row.reachable_m2:.0f}", "yes" if row.is_lively else "no",
        f"{100 * row.covered:.1f}", f"{100 * row.overlap:.1f}", len(row.collisions),
        f"{1000 * row.least_gap_m:.0f}", "yes" if row.is_home else row.why or "no",
        f"{row.time_s / 60:.0f}", f"{row.missed} of {row.things}", f"{row.false} of {row.objects}",
        f"{row.people_missed} of {row.people_seen}", f"{row.cpu_s:.0f}",
    )  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"


def summary(rows: Sequence[Row]) -> str:
    """The map's recall and precision over all halls, and the worst of each figure."""
    things, missed = sum(row.things for row in rows), sum(row.missed for row in rows)
    objects, false = sum(row.objects for row in rows), sum(row.false for row in rows)
    parts = [f"recall {1 - missed / max(1, things):.3f}"]
    parts += [f"precision {1 - false / max(1, objects):.3f}"]
    for name, kind in (("still", False), ("with people", True)):
        covered = [row.covered for row in rows if row.is_lively == kind]
        if covered:
            parts.append(f"{name}: {100 * min(covered):.1f} % covered at least")
    if rows:
        parts.append(f"overlap {100 * max(row.overlap for row in rows):.1f} % at most")
        parts.append(f"{1000 * min(row.least_gap_m for row in rows):.0f} mm from anything at least")
    return f"{len(rows)} halls: " + ", ".join(parts)


def known_rows(path: Path | None) -> list[Row]:
    """Of a file of rows, if there is one; a last line that was cut off is none."""
    found = []
    for line in path.read_bytes().splitlines() if path and path.exists() else []:
        try:
            found.append(msgspec.json.decode(line, type=Row))
        except msgspec.DecodeError as error:
            print(f"{path}: a line is left out: {error}", file=sys.stderr)
    return found


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 all well, 1 not, 2 wrong use."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="of the first hall")
    parser.add_argument("--rows", type=Path, help="a file that keeps what was run")
    parser.add_argument(
        "--area", type=float, nargs=2, default=AREA_M2, metavar=("FROM", "TO"), help="m2 of a hall"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    given = parser.parse_args(arguments)
    if given.runs < 1 or given.seed < 0 or not 20.0 <= given.area[0] <= given.area[1] <= 5000.0:
        parser.error("--runs: 1 or more; --seed: 0 or more; --area: 20 to 5000 m2, from <= to")
    if given.jobs < 1:
        parser.error(f"--jobs: must be 1 or more, is {given.jobs}")
    tasks = [(given.seed + k, (given.area[0], given.area[1])) for k in range(given.runs)]
    before = {(row.seed, row.area_m2): row for row in known_rows(given.rows)}
    rows = {task: before[task] for task in tasks if task in before}
    for row in _run([task for task in tasks if task not in rows], given.jobs):
        rows[row.seed, row.area_m2] = row
        if given.rows:
            with given.rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps(msgspec.to_builtins(row)) + "\n")
    table = [rows[task] for task in tasks if task in rows]
    print(HEAD, *map(line_of, table), sep="\n")
    for row in table:
        for words in row.collisions:
            print(f"hall {row.seed}, collision with {words}")
    print(summary(table))
    crashed = len(table) < len(tasks)
    return int(crashed or any(row.collisions or not row.is_home for row in table))


def _run(tasks: Sequence[tuple[int, tuple[float, float]]], jobs: int) -> Iterator[Row]:
    """Their rows, as they end; one that crashes is told, and has none."""
    console = Console(stderr=True)
    if not console.is_terminal:
        console = Console(stderr=True, width=FILE_COLUMNS)
    found = LocalProcesses(jobs).results(cleaned, tasks)
    for at, row in with_bar(console, len(tasks), found, lambda _: "", noun="halls"):
        if isinstance(row, Failure):
            print(f"hall {tasks[at][0]} crashed: {row.cause}", file=sys.stderr)
        else:
            yield row


if __name__ == "__main__":
    sys.exit(main())
