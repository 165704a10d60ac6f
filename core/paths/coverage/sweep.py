"""Lanes to pieces of a sweep: cells to and fro, along walls at the ends, round small obstacles."""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LinearRing, Polygon

from core.paths.coverage.raster import NONE, Raster, edges_along
from core.paths.coverage.scan import INSIDE_M, Cell, cells_of, edges_of, lane_at, lane_heights
from core.paths.geometry.rings import Ring, Walls, joined, length_of
from core.paths.geometry.space import polygons_in
from core.records import F64

LONGEST = 3.0  # a turn along a wall may be that many times the straight line, and a lane more
SMALL = 2.0  # obstacles of fewer lanes' height, grown by the machine, split lanes and not cells
MISSED = 3.0  # what is missed costs so many times what it costs in a lane
QUARTER = math.pi / 2


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Something to sweep in one go. Its variants are other ways through the same area."""

    variants: tuple[F64, ...]  # (n, 2) each, metres; each may be driven from either end


def rotated(points: F64, angle_rad: float) -> F64:
    """(n, 2) about the origin, counter-clockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def turned(polygon: Polygon, angle_rad: float) -> Polygon:
    """A polygon about the origin, counter-clockwise."""
    return shapely.transform(polygon, lambda points: rotated(points, angle_rad))


def _without_small_holes(polygon: Polygon, height_m: float) -> tuple[Polygon, list[Polygon]]:
    """The polygon without holes that are lower than that along y; and those holes."""
    small: list[LinearRing] = []
    rest: list[LinearRing] = []
    for ring in polygon.interiors:
        _, low, _, high = ring.bounds
        (small if high - low <= height_m else rest).append(ring)
    return Polygon(polygon.exterior, rest), [Polygon(ring) for ring in small]


class Sweeper:
    """Sweeps one polygon of places for the machine's centre, in lanes along x."""

    def __init__(self, polygon: Polygon, spacing_m: float) -> None:
        self._spacing_m = spacing_m
        self._filled, self._holes = _without_small_holes(polygon, SMALL * spacing_m)
        self._walls = Walls(self._filled)
        self._edges = edges_of(self._filled)
        self._tree = shapely.STRtree(self._holes)
        self._cells = cells_of(self._filled, spacing_m / 2)

    def pieces(self) -> list[Piece]:
        """Each cell in lanes along x."""
        made = [self._piece(cell) for cell in self._cells]
        return [piece for piece in made if piece is not None]

    def best_pieces(self, raster: Raster) -> tuple[list[Piece], float]:
        """Each cell along x, or along y where that is less work; metres of work in all.

        They are counted on the raster.
        """
        found: list[Piece] = []
        total_m = 0.0
        for cell in self._cells:
            along = self._piece(cell)
            ways = [[] if along is None else [along], self._across(cell)]
            edges = [
                np.vstack([NONE, *(edges_along(piece.variants[0]) for piece in way)])
                for way in ways
            ]
            won = [raster.area(raster.gain(NONE, each)) for each in edges]
            works = [
                sum(length_of(piece.variants[0]) + 2 * self._spacing_m for piece in way)
                + MISSED * (max(won) - area) / self._spacing_m
                for way, area in zip(ways, won, strict=True)
            ]
            best = int(works[1] < works[0])
            raster.gain(NONE, edges[best], keep=True)
            found += ways[best]
            total_m += works[best]
        return found, total_m

    def _across(self, cell: Cell) -> list[Piece]:
        """The same cell in lanes along y."""
        found: list[Piece] = []
        for area in self._areas(cell):
            inside = [hole.exterior for hole in self._holes if area.contains(hole)]
            whole = turned(Polygon(area.exterior, [*area.interiors, *inside]), -QUARTER)
            for piece in Sweeper(whole, self._spacing_m).pieces():
                found.append(Piece(tuple(rotated(way, QUARTER) for way in piece.variants)))
        return found

    def _areas(self, cell: Cell) -> list[Polygon]:
        """The polygon of a cell, without what the lane at the border of a wider cell sweeps."""
        keep_m = self._spacing_m / 2
        low = cell.low_m + (keep_m if cell.is_narrow_below else 0.0)
        high = cell.high_m - (keep_m if cell.is_narrow_above else 0.0)
        if high - low < INSIDE_M:
            return []
        x0, x1 = min(row[1] for row in cell.rows), max(row[2] for row in cell.rows)
        cut = self._filled.intersection(shapely.box(x0 - 1e-6, low, x1 + 1e-6, high))
        y, left, right = cell.rows[len(cell.rows) // 2]
        y = min(max(y, low), high)
        line = shapely.LineString([(left, y), (right, y)])
        return [p for p in polygons_in(cut) if p.intersection(line).length > (right - left) / 2]

    def _piece(self, cell: Cell) -> Piece | None:
        heights = lane_heights(cell, self._spacing_m)
        lanes = [self._lane(lane_at(self._edges, cell, y), y) for y in heights]
        if not lanes:
            return None
        return Piece(tuple(self._to_and_fro(lanes, first) for first in (0, 1)))

    def _lane(self, span: tuple[float, float], y_m: float) -> F64:
        """From left to right, round the small obstacles on it, each on its shorter side."""
        ends = np.array([[span[0], y_m], [span[1], y_m]])
        line = shapely.LineString(ends)
        hits = []
        for k in self._tree.query(line, predicate="intersects"):
            cut = shapely.get_coordinates(line.intersection(self._holes[k]))
            hits.append((cut[:, 0].min(), cut[:, 0].max(), k))
        parts = [ends[:1]]
        for x0, x1, k in sorted(hits):
            ring = Ring(shapely.get_coordinates(self._holes[k].exterior))
            places = [ring.place(np.array([x, y_m]))[0] for x in (x0, x1)]
            parts.append(ring.between(*places))
        return joined([*parts, ends[1:]])

    def _to_and_fro(self, lanes: list[F64], first: int) -> F64:
        """Lanes one after the other, the first from its left (0) or right (1) end."""
        pieces: list[F64] = []
        for k, lane in enumerate(lanes):
            way = lane if (k + first) % 2 == 0 else lane[::-1]
            if pieces:
                pieces.append(self._turn(pieces[-1][-1], way[0]))
            pieces.append(way)
        return joined(pieces)

    def _turn(self, end: F64, start: F64) -> F64:
        """From lane to lane, along the wall if that is not far."""
        most_m = LONGEST * math.dist(end, start) + self._spacing_m
        along = self._walls.between(end, start, most_m)
        return np.vstack([end, start]) if along is None else along
