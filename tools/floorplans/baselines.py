"""Planners to compare with: plain rows, coverage-path-planner, and what a robot drove."""

import math

import numpy as np
import shapely

from core.paths.geometry.rings import joined
from core.paths.geometry.space import largest, narrowed, polygons_in
from core.paths.geometry.visibility import VisibilityGraph
from core.paths.records import Machine, Segment
from core.records import F64


def plain_rows(floor: shapely.MultiPolygon, machine: Machine) -> list[Segment]:
    """Parallel rows over the whole floor to and fro; round obstacles by the shortest way.

    As cleaning robots of the early 2010s did: no cells, no choice of direction, no order.
    """
    space = largest(polygons_in(narrowed(floor, machine.margin_m)))
    low_x, low_y, high_x, high_y = space.bounds
    graph = VisibilityGraph(space)
    segments: list[Segment] = []
    count = math.floor((high_y - low_y) / machine.spacing_m) + 1
    for k in range(count):
        y = low_y + 1e-4 + k * machine.spacing_m
        line = shapely.LineString([(low_x - 1, y), (high_x + 1, y)])
        cut = shapely.get_parts(space.intersection(line))
        rows = sorted(shapely.get_coordinates(part).tolist() for part in cut if part.length > 0)
        for row in rows if k % 2 == 0 else [row[::-1] for row in reversed(rows)]:
            points = np.array(row)[[0, -1]]
            if segments:
                way = graph.way(segments[-1].points[-1], points[0])
                if way is not None and len(way) > 1:
                    segments.append(Segment("travel", way))
            segments.append(Segment("sweep", points))
    return segments


def other_planner(floor: shapely.MultiPolygon, machine: Machine, laps: int) -> list[Segment]:
    """The package coverage-path-planner with its pattern of lines, and laps along all borders.

    Raises ImportError: it is not installed.
    """
    import coverage_path_planner as cpp  # type: ignore[import-not-found]

    part = largest(polygons_in(narrowed(floor, machine.margin_m)))

    def ring(line: shapely.LinearRing) -> object:
        points = shapely.get_coordinates(line)[:-1].tolist()
        return cpp.Polygon([cpp.Point(x, y) for x, y in points])

    environment = cpp.Environment(ring(part.exterior))
    for hole in part.interiors:
        environment.addObstacle(ring(hole))
    settings = cpp.PathSettings()
    settings.pattern, settings.offset, settings.angle = "lines", machine.spacing_m, 0.0
    settings.distanceToBorder = 0.0
    settings.mowArea = True
    settings.mowBorder = settings.mowExclusionsBorder = laps > 0
    settings.borderLaps = settings.exclusionsBorderLaps = laps
    x, y = shapely.get_coordinates(part.exterior)[0].tolist()
    made = cpp.PathService().computeFullTask(environment, settings, cpp.Point(x, y))
    points = np.array([(point.x, point.y) for point in made.path.getPoints()])
    return [Segment("sweep", joined([points]))] if len(points) > 1 else []


def driven(path: F64) -> list[Segment]:
    """What a robot's own map says that it drove."""
    return [Segment("sweep", joined([path]))]
