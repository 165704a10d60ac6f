"""Plans on a floor plan: a path that sweeps all of it, or the shortest way from A to B.

FILE is GeoJSON in metres (polygons; `kind` obstacle, wall or room, lines are walls), a DXF drawing
of its walls, or a map that Valetudo stores of a vacuum robot (versions 1 and 2). Metres; x to the
right, y up. Start and dock are those of the file unless they are given. It opens no port.
"""

import argparse
import importlib.util
import json
import math
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tools.cli.options import cannot_be_written, fail, number_in, parser_of, value_of

if TYPE_CHECKING:
    from shapely import LineString, MultiPolygon

    from core.paths.coverage.measures import Measures
    from core.paths.geometry.shaped_ways import Shape
    from core.paths.records import CoveragePlan, Machine
    from tools.floorplans.records import FloorPlan

NOT_INSTALLED = "needs the library of polygons: pip install 'mapod[objects]'"
NO_DXF = "a DXF drawing needs the library that reads it: pip install 'mapod[drawings]'"
UNITS = ("mm", "cm", "dm", "m", "in", "ft")
NEITHER = None, None
Point = tuple[float, float]


def a_point(text: str) -> Point:
    def pair(given: str) -> Point:
        x, y = given.split(",")
        return float(x), float(y)

    def is_finite(point: Point) -> bool:
        return all(math.isfinite(value) for value in point)

    return value_of(text, pair, is_finite, "two numbers X,Y in m")


def an_end(text: str) -> tuple[Point, float | None]:
    """A point, and the heading there in rad, if one is given."""

    def place(given: str) -> tuple[Point, float | None]:
        x, y, *degrees = map(float, given.split(","))
        if len(degrees) > 1:
            raise ValueError
        return (x, y), math.radians(degrees[0]) if degrees else None

    def is_finite(end: tuple[Point, float | None]) -> bool:
        return all(math.isfinite(value) for value in (*end[0], end[1] or 0.0))

    return value_of(text, place, is_finite, "two or three numbers X,Y[,DEG] in m and deg")


def a_footprint(text: str) -> list[Point]:
    def corners(given: str) -> list[Point]:
        return [a_point(each) for each in given.split()]

    return value_of(text, corners, lambda c: len(c) >= 3, "three or more corners 'X,Y X,Y X,Y'")


def names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def an_origin(text: str) -> tuple[float, float, float]:
    def place(given: str) -> tuple[float, float, float]:
        x, y, degrees = given.split(",")
        return float(x), float(y), float(degrees)

    def is_finite(one: tuple[float, float, float]) -> bool:
        return all(math.isfinite(value) for value in one)

    return value_of(text, place, is_finite, "three numbers X,Y,DEG")


def arguments(given: list[str] | None) -> argparse.Namespace:
    parser = parser_of(
        "plan",
        __doc__,
        "mapod plan flat.json --width 0.3 --radius 0.17 --picture flat.png --out path.geojson",
        "mapod plan hall.geojson --radius 0.4 --from 1,1 --to 20,7.5",
        "mapod plan hall.geojson --footprint '0.6,0.3 -0.6,0.3 -0.6,-0.3 0.6,-0.3' "
        "--from 1,1,90 --to 20,7.5",
    )
    add = parser.add_argument
    add("file", type=Path, help="the floor plan")
    add("--width", type=number_in(0.01, 100), default=0.3, help="of the tool's band, in m (0.3)")
    add("--overlap", type=number_in(0, 80), default=0.0, help="of neighbouring bands, in m (0)")
    shape = parser.add_mutually_exclusive_group()
    radius = "of the machine about the point it turns about, in m (half the width)"
    shape.add_argument("--radius", type=number_in(0, 100), help=radius)
    corners = "its corners 'X,Y X,Y ...' ahead and left of that point, for ways through passages"
    shape.add_argument("--footprint", type=a_footprint, help=corners)
    add("--clearance", type=number_in(0, 100), default=0.0, help="from walls, in m (0)")
    add("--start", type=a_point, metavar="X,Y", help="where the path begins")
    add("--dock", type=a_point, metavar="X,Y", help="where it ends, and begins without --start")
    add("--free-ends", action="store_true", help="begin and end where it is best")
    add("--rooms", action="store_true", help="room by room, if the file has rooms")
    add("--angle", type=number_in(-360, 360), help="of the lanes, in deg (along the walls)")
    add(
        "--exact-lanes", action="store_true", help="leave lanes as they are laid, and their corners"
    )
    ends = "X,Y[,DEG]"
    add("--from", dest="begin", type=an_end, metavar=ends, help="a way from here, where it looks")
    add("--to", dest="goal", type=an_end, metavar=ends, help="to there; DEG: with --footprint")
    add("--speed", type=number_in(0.01, 100), default=0.3, help="for the time, in m/s (0.3)")
    add("--accel", type=number_in(0.01, 100), default=0.5, help="in m/s2 (0.5)")
    add("--turn", type=number_in(1, 3600), default=90.0, help="on the spot, in deg/s (90)")
    add("--report", action="store_true", help="tell the figures, and what is missed, as JSON")
    add("--picture", type=Path, help="a PNG")
    add("--out", type=Path, help="the path as GeoJSON, each line with its kind: sweep or travel")
    drawing = parser.add_argument_group("of a DXF drawing")
    add = drawing.add_argument
    add("--unit", choices=UNITS, default="", help="of its numbers (as the file says)")
    add("--layers", type=names, default=(), metavar="A,B", help="on which its walls are (all)")
    where = "of the plan, and its x axis, in its drawing: in m and deg (0,0,0)"
    add("--origin", type=an_origin, default=(0.0, 0.0, 0.0), metavar="X,Y,DEG", help=where)
    add("--walls", type=Path, metavar="FILE", help="its walls as GeoJSON, and nothing is planned")
    options = parser.parse_args(given)
    options.is_drawing = options.file.suffix.lower() == ".dxf"
    of_drawings = options.unit, options.layers, options.walls, any(options.origin)
    if any(of_drawings) and not options.is_drawing:
        parser.error("--unit, --layers, --origin, --walls: only with a DXF drawing, FILE.dxf")
    if (options.begin is None) != (options.goal is None):
        parser.error("--from and --to: say both or none")
    if (
        options.goal
        and options.footprint is None
        and (options.begin[1], options.goal[1]) != NEITHER
    ):
        parser.error("--from, --to: DEG only with --footprint: a disc fits in all directions")
    if options.free_ends and (options.start or options.dock):
        parser.error("--free-ends: not with --start or --dock")
    return options


def margin_of(options: argparse.Namespace) -> float:
    """The machine's radius."""
    if options.footprint is not None:
        return max(math.hypot(x, y) for x, y in options.footprint)
    return float(options.width / 2 if options.radius is None else options.radius)


def shape_of(options: argparse.Namespace) -> "Shape | None":
    """None: a disc. Raises FloorError."""
    from core.paths.geometry.shaped_ways import Shape

    return Shape(options.footprint, options.clearance) if options.footprint else None


def write_json(path: Path | None, content: object) -> None:
    """A file whole or not at all; into a pipe or a terminal, straight."""
    if path is None:
        return
    from map_files import write_whole

    text = (json.dumps(content, indent=1) + "\n").encode()
    if path.is_file() or not path.exists():
        write_whole(str(path.resolve()), text)  # a link stays a link
    else:
        path.write_bytes(text)


def rings_of(areas: "MultiPolygon") -> list[list[Any]]:
    """Polygons as GeoJSON has their coordinates, the largest first."""
    parts = sorted(areas.geoms, key=lambda part: part.area, reverse=True)
    return [[list(ring.coords) for ring in (p.exterior, *p.interiors)] for p in parts]


def cover(options: argparse.Namespace, plan: "FloorPlan", machine: "Machine") -> None:
    """Raises FloorError, OSError."""
    from core.paths.coverage.measures import Motion, measures
    from core.paths.coverage.plan import plan_coverage
    from core.paths.coverage.spaces import plan_all_spaces
    from tools.floorplans.geojson import plan_as_geojson
    from tools.floorplans.picture import MISSED, REACHED, drawn

    start, dock = options.start or plan.start, options.dock or plan.dock
    if options.dock is not None and options.start is None:
        start = None  # it begins there
    if options.free_ends:
        start = dock = None
    begin_s = time.perf_counter()
    shape = shape_of(options)
    planner = plan_coverage if shape is None else partial(plan_all_spaces, shape=shape)
    made = planner(
        plan.free,
        machine,
        start=start,
        dock=dock,
        rooms=[area for _, area in plan.rooms] if options.rooms else (),
        angle_rad=None if options.angle is None else math.radians(options.angle),
        is_refined=not options.exact_lanes,
    )
    took_s = time.perf_counter() - begin_s
    motion = Motion(
        speed_mps=options.speed, accel_mps2=options.accel, turn_radps=math.radians(options.turn)
    )
    told = measures(made, plan.free, machine, motion)
    if shape is not None:
        told = replace(told, outside_m2=off_floor_of(made, plan, shape))
    if options.report:
        figures = {name: getattr(told, name) for name in told.__slots__}
        figures |= {"planned_s": took_s, "uncovered": rings_of(made.uncovered)}
        print(json.dumps(figures, indent=1))
    else:
        missed_m2, places = made.uncovered.area, len(made.uncovered.geoms)
        print("\n".join(lines_of(told)))
        print(
            f"planned in         {took_s:9.2f} s; lanes at {math.degrees(made.angle_rad):.1f} deg"
        )
        print(f"missed             {missed_m2:9.3f} m2 in {places} places")
    write_json(options.out, plan_as_geojson(made))
    if options.picture is not None:
        layers = [(made.reachable, REACHED), (made.uncovered, MISSED)]
        drawn(plan.free, layers, made.segments).save(options.picture, format="PNG")


def off_floor_of(made: "CoveragePlan", plan: "FloorPlan", shape: "Shape") -> float:
    """Area in m2 that the machine is over beside the floor."""
    from core.paths.geometry.rings import joined
    from core.paths.geometry.shaped_ways import off_floor_m2
    from core.paths.geometry.ways import Way, turns_along

    if not made.segments:
        return 0.0
    path = joined([segment.points for segment in made.segments])
    return off_floor_m2(plan.free, shape, Way(path, turns_along(path)))


def lines_of(told: "Measures") -> list[str]:
    """The figures, a line each."""
    return [
        f"covered            {100 * told.covered_of_reachable:9.2f} % of what the tool can get to",
        f"                   {100 * told.covered_of_free:9.2f} % of all free floor",
        f"swept twice        {100 * told.overlap:9.1f} %",
        f"path               {told.length_m:9.2f} m, {told.travel_m:.2f} m of it travel",
        f"length ratio       {told.length_ratio:9.3f} x the area / the width",
        f"turns              {told.turns:9d}, {math.degrees(told.turned_rad):.0f} deg in all",
        f"time               {told.time_s:9.0f} s",
        f"off the floor      {told.outside_m2:9.6f} m2",
    ]


def go(options: argparse.Namespace, plan: "FloorPlan", machine: "Machine") -> int:
    """A way from A to B. Raises FloorError, OSError."""
    from core.paths.geometry.shaped_ways import NoFit, find_shaped_way
    from core.paths.geometry.ways import NoWay, Way, find_way
    from core.paths.records import Segment
    from tools.floorplans.geojson import way_as_geojson
    from tools.floorplans.picture import drawn

    (start, start_rad), (goal, goal_rad) = options.begin, options.goal
    found: Way | NoWay | NoFit
    shape = shape_of(options)
    if shape is None:
        found = find_way(plan.free, machine.margin_m, start, goal)
    else:
        found = find_shaped_way(plan.free, shape, start, goal, start_rad, goal_rad)
    if not isinstance(found, Way):
        return fail("plan", f"no way: {found.describe()}", 1)
    corners = len(found.points) - 2
    if options.report:
        print(json.dumps({"length_m": found.length_m, "corners": corners}, indent=1))
    else:
        print(f"{found.length_m:.3f} m, {corners} corners")
    write_json(options.out, way_as_geojson(found))
    if options.picture is not None:
        segments = [Segment("travel", found.points)]
        drawn(plan.free, [], segments).save(options.picture, format="PNG")
    return 0


def walls_of(options: argparse.Namespace) -> "list[LineString]":
    """Of a DXF drawing; tells what else is drawn. Raises PlanFileError, OSError."""
    from tools.floorplans import dxf

    reading = dxf.Reading(options.unit, options.layers, options.origin)
    found = dxf.drawn_in(options.file, reading)
    if found.left_out:
        print(f"mapod plan: {options.file}: {dxf.told_of(found.left_out)}", file=sys.stderr)
    return found.walls


def write_walls(options: argparse.Namespace) -> int:
    from tools.floorplans.geojson import walls_as_geojson

    walls = walls_of(options)
    content = walls_as_geojson(walls)
    write_json(options.walls, content)
    length_m = sum(wall.length for wall in walls)
    print(f"{len(content['features'])} walls, {length_m:.1f} m in all")
    return 0


def drawn_plan(options: argparse.Namespace) -> "FloorPlan":
    """Raises PlanFileError, OSError."""
    from tools.floorplans.dxf import plan_from_walls

    return plan_from_walls(walls_of(options))


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 no way from A to B, 2 wrong use or a floor that cannot be planned."""
    options = arguments(given)
    if importlib.util.find_spec("shapely") is None:
        return fail("plan", NOT_INSTALLED)
    if options.is_drawing and importlib.util.find_spec("ezdxf") is None:
        return fail("plan", NO_DXF)
    written = ("--picture", options.picture, ".png"), ("--out", options.out, "")
    if why := cannot_be_written(*written, ("--walls", options.walls, "")):
        return fail("plan", why)
    from core.paths.geometry.space import FloorError
    from core.paths.records import Machine
    from tools.floorplans.plan_file import load_plan
    from tools.floorplans.records import PlanFileError

    try:
        machine = Machine(
            radius_m=margin_of(options),
            clearance_m=options.clearance,
            width_m=options.width,
            overlap_m=options.overlap,
        )
        if options.walls is not None:
            return write_walls(options)
        plan = drawn_plan(options) if options.is_drawing else load_plan(options.file)
        if options.goal is not None:
            return go(options, plan, machine)
        cover(options, plan, machine)
    except (FloorError, PlanFileError, ValueError, OSError) as error:
        is_named = not (options.is_drawing and isinstance(error, PlanFileError))
        return fail("plan", error if is_named else f"{options.file}: {error}")
    return 0
