"""Planners side by side on the floor plans of real robots: `make coverage-plans`.

Writes the table of docs/coverage.md, and its picture. The other planner takes minutes.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import shapely

from core.paths.coverage.measures import Motion, measures_of
from core.paths.coverage.plan import plan_coverage
from core.paths.records import CoveragePlan, Machine, Segment
from tools.docs.pictures import PICTURES, ROOT, record, with_neighbours
from tools.floorplans.baselines import driven, other_planner, plain_rows
from tools.floorplans.picture import MISSED, REACHED, drawn
from tools.floorplans.plan_file import load_plan
from tools.floorplans.records import FloorPlan

PLANS = ROOT / "tests" / "vectors" / "floorplans"
PAGE = ROOT / "docs" / "coverage.md"
BEGIN, END = "<!-- planners -->\n", "<!-- end -->\n"
VACUUM = Machine(radius_m=0.15, clearance_m=0.0, width_m=0.3, overlap_m=0.0)
MOTION = Motion(speed_mps=0.3, accel_mps2=0.5, turn_radps=1.5)
HEAD = """| floor plan | planner | covered % | ratio | travel m | planned in s | off the floor m2 |
|---|---|---|---|---|---|---|
"""
DRAWN, PICTURE = "d9_clutter", "coverage-d9.png"
OF = [
    *with_neighbours("core/paths/coverage/plan.py"),
    *with_neighbours("core/paths/geometry/ways.py"),
    "core/paths/records.py",
    "tools/floorplans/picture.py",
]


def ours(plan: FloorPlan) -> CoveragePlan:
    return plan_coverage(plan.free, VACUUM)


def row(
    name: str,
    planner: str,
    plan: FloorPlan,
    reach: shapely.MultiPolygon,
    make: Callable[[], Sequence[Segment]],
) -> str:
    """One line of the table; seconds are those of this process's core."""
    begin_s = time.process_time()
    segments = make()
    took_s = time.process_time() - begin_s
    m = measures_of(segments, plan.free, reach, VACUUM, MOTION)
    figures = (
        f"{100 * m.covered_of_reachable:.1f} | {m.length_ratio:.2f} | {max(0.0, m.travel_m):.1f} | "
        f"{took_s:.1f} | {m.outside_m2:.3f}"
    )
    return f"| {name} | {planner} | {figures} |\n"


def lines(path: Path) -> str:
    """All planners on one floor plan."""
    plan = load_plan(path)
    made = ours(plan)
    ours(plan)  # kernels are there now
    if path.stem == DRAWN:
        layers = [(made.reachable, REACHED), (made.uncovered, MISSED)]
        image = drawn(plan.free, layers, made.segments, 800)
        image.save(PICTURES / PICTURE, format="PNG")
        record([PICTURE], "make coverage-plans", OF)
    planners: list[tuple[str, Callable[[], Sequence[Segment]]]] = [
        ("mapod", lambda: ours(plan).segments),
        (
            "mapod, lanes as laid",
            lambda: plan_coverage(plan.free, VACUUM, is_refined=False).segments,
        ),
        ("plain rows", lambda: plain_rows(plan.free, VACUUM)),
        ("coverage-path-planner, lines", lambda: other_planner(plan.free, VACUUM, 0)),
        ("the same, 1 lap of borders", lambda: other_planner(plan.free, VACUUM, 1)),
    ]
    if plan.driven is not None:
        path_driven = plan.driven
        planners.append(("the robot itself", lambda: driven(path_driven)))
    return "".join(row(path.stem, name, plan, made.reachable, make) for name, make in planners)


def main() -> None:
    """Writes the table."""
    text = HEAD
    for path in sorted(PLANS.glob("*.json")):
        text += lines(path)
        print(text.splitlines()[-1], flush=True)
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(before + BEGIN + text + END + after, encoding="utf-8")


if __name__ == "__main__":
    main()
