"""Walls of a DXF drawing, in metres, and the floor that they close in. Needs ezdxf.

Of the model space all that is drawn with lines is a wall, or what is on the named layers: lines,
double lines, polylines, arcs, circles, ellipses, splines, and all that in blocks. Texts, hatches
and dimensions are left out; what else is none of these is counted. What is on layer 0 of a block
is on the layer on which the block is inserted. What is read may come from anybody: its size and
its depth are bounded.

Source: Autodesk, DXF Reference, header variable $INSUNITS.
"""

import math
import os
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ezdxf.filemanagement
import ezdxf.path
import ezdxf.units
import numpy as np
import shapely
from ezdxf.enums import InsertUnits
from ezdxf.lldxf.const import DXFError
from ezdxf.math import Matrix44
from shapely import LineString

from core.paths.geometry.space import repaired
from core.records import F64
from tools.floorplans.geojson import WALL_M
from tools.floorplans.records import MOST_BYTES, MOST_M, FloorPlan, PlanFileError, shown

UNITS = {"mm": 4, "cm": 5, "dm": 14, "m": 6, "in": 1, "ft": 2}  # codes of $INSUNITS
SAGITTA_M = 0.002  # by which a chord may leave its arc
MOST_PARTS = 50_000  # entities, those of blocks each time that they are inserted
MOST_DEPTH = 16  # of blocks in blocks
MOST_CORNERS = 1_000_000
HATCHES = {"HATCH", "MPOLYGON"}
SAY_NOTHING = HATCHES | {  # known to be left out
    "TEXT", "MTEXT", "ATTRIB", "ATTDEF", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION",
}  # fmt: skip
CUT = StopIteration, struct.error  # by ezdxf, of a file that ends too early
RAISED = (  # by it, of a damaged file
    DXFError, ArithmeticError, AssertionError, AttributeError, LookupError, OSError, RuntimeError,
    TypeError, ValueError, *CUT,
)  # fmt: skip
NO_UNIT = f"says no unit that is known: --unit of {', '.join(UNITS)}"


@dataclass(frozen=True, slots=True)
class Reading:
    """How a drawing is to be read."""

    unit: str = ""  # of UNITS; "": as the file says
    layers: tuple[str, ...] = ()  # none: all
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # x and y in m, and deg, where ours is


@dataclass(frozen=True, slots=True)
class Drawn:
    """What a drawing holds."""

    walls: list[LineString]  # m
    left_out: dict[str, int]  # of what is drawn and no wall: how many, by type


@dataclass(frozen=True, slots=True)
class _Part:
    """An entity at its place."""

    entity: Any
    layer: str
    matrix: Matrix44  # of all blocks that it is in


def drawn_in(path: Path, reading: Reading) -> Drawn:
    """Raises PlanFileError: what is wrong. OSError."""
    with path.open("rb") as file:
        if (size := file.seek(0, os.SEEK_END)) > MOST_BYTES:
            raise PlanFileError(f"must be at most {MOST_BYTES} bytes, is {size}")
    others = Counter[str]()
    try:
        drawing: Any = ezdxf.filemanagement.readfile(path)
        metres = _metres_per_unit(drawing, reading.unit)
        parts = _Parts().of(drawing.modelspace(), "0", Matrix44(), 0)
        if reading.layers:
            names = {name.lower() for name in reading.layers}
            parts = (part for part in parts if part.layer.lower() in names)
        lines = list(_lines(parts, metres, others))
    except RAISED as error:
        told = "it ends too early" if isinstance(error, CUT) else " ".join(str(error).split())
        reason = told[:200] or type(error).__name__
        raise PlanFileError(f"must be a DXF drawing: {reason}") from None
    left_out = dict(sorted(others.items()))
    if not lines:
        there = sorted(layer.dxf.name for layer in drawing.layers)[:20]
        without = f" ({told_of(left_out)})" if left_out else ""
        raise PlanFileError(f"no line is drawn{without}; its layers are {', '.join(there)}")
    x, y, degrees = reading.origin
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = np.array([[c, -s], [s, c]])
    return Drawn([LineString((line - (x, y)) @ turn) for line in lines], left_out)


def told_of(left_out: dict[str, int]) -> str:
    """In one line."""
    counts = [f"{count} {type_}" for type_, count in left_out.items()]
    more = f", {len(counts) - 20} other types" if len(counts) > 20 else ""
    return f"left out: {', '.join(counts[:20])}{more}"


def plan_from_walls(walls: list[LineString]) -> FloorPlan:
    """The floor that they close in, all rooms together. PlanFileError: they close in none."""
    shape = shapely.unary_union(walls)
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(shape)))
    if len(faces) == 0:
        raise PlanFileError("no lines of it close in a floor; draw its outline as a closed line")
    inside = shapely.union_all(faces)
    return FloorPlan(repaired(inside.difference(shape.buffer(WALL_M))))


def _metres_per_unit(drawing: Any, unit: str) -> float:
    code = UNITS[unit] if unit else drawing.header.get("$INSUNITS", 0)
    if code not in UNITS.values():
        raise PlanFileError(NO_UNIT)
    return float(ezdxf.units.conversion_factor(InsertUnits(code), InsertUnits.Meters))


class _Parts:
    """Walks through a drawing, and counts what it meets."""

    def __init__(self) -> None:
        self._count = 0

    def of(
        self, entities: Iterable[Any], layer: str, matrix: Matrix44, depth: int
    ) -> Iterator[_Part]:
        """All entities; `layer` is what layer 0 stands for."""
        if depth > MOST_DEPTH:
            raise PlanFileError(f"its blocks must be at most {MOST_DEPTH} deep in each other")
        for entity in entities:
            self._add(1)
            own = str(entity.graphic_properties().get("layer", "0"))
            here = layer if own == "0" else own
            type_ = entity.dxftype()
            if type_ == "INSERT":
                yield from self._inserted(entity, here, matrix, depth)
            elif type_ == "MLINE":
                yield from (_Part(line, here, matrix) for line in self._double(entity))
            else:
                yield _Part(entity, here, matrix)

    def _inserted(self, insert: Any, layer: str, matrix: Matrix44, depth: int) -> Iterator[_Part]:
        block = insert.block()
        if block is None:
            raise PlanFileError(f"its block {shown(insert.dxf.name)} is inserted, and is not there")
        is_in_rows = insert.mcount > 1
        self._add(insert.mcount if is_in_rows else 0)
        for each in insert.multi_insert() if is_in_rows else [insert]:
            yield from self.of(block, layer, each.matrix44() * matrix, depth + 1)

    def _double(self, entity: Any) -> list[Any]:
        """The lines of a double line, or itself where it has none."""
        self._add(sum(len(corner.line_params) for corner in entity.vertices))
        lines = [part for part in entity.virtual_entities() if part.dxftype() not in HATCHES]
        return lines or [entity]

    def _add(self, count: int) -> None:
        self._count += count
        if self._count > MOST_PARTS:
            raise PlanFileError(f"must have at most {MOST_PARTS} entities, with those of blocks")


def _lines(parts: Iterable[_Part], metres: float, others: Counter[str]) -> Iterator[F64]:
    """(n, 2) m each; what is none is counted."""
    corners = 0
    for part in parts:
        type_ = part.entity.dxftype()
        if type_ in SAY_NOTHING:
            continue
        try:
            way = ezdxf.path.make_path(part.entity).transform(part.matrix)
        except TypeError:  # nothing that is drawn with lines
            others[type_] += 1
            continue
        if len(way) == 0:
            continue
        reach_m = np.abs(np.array([(p.x, p.y) for p in way.control_vertices()])).max() * metres
        if not reach_m <= MOST_M:
            raise PlanFileError(
                f"must lie within {MOST_M:g} m of its origin, {reach_m:g} m is drawn"
            )
        points = [(p.x, p.y) for p in way.flattening(SAGITTA_M / metres, segments=4)]
        line = np.array(points) * metres
        corners += len(line)
        if corners > MOST_CORNERS:
            raise PlanFileError(f"must have at most {MOST_CORNERS} corners")
        if np.ptp(line, axis=0).max() > 0.0:
            yield line
