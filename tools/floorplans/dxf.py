"""Walls of a DXF drawing, in metres, and the floor that they close in. Needs ezdxf.

Of the model space all that is drawn with lines is a wall, or what is on the named layers: lines,
polylines, arcs, circles, ellipses, splines, and all that in blocks. Texts, hatches and dimensions
are left out. What is read may come from anybody: its size and its depth are bounded.

Source: Autodesk, DXF Reference, header variable $INSUNITS.
"""

import math
import os
import struct
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
from shapely import LineString

from core.paths.geometry.space import repaired
from core.records import F64
from tools.floorplans.geojson import WALL_M
from tools.floorplans.records import MOST_BYTES, MOST_M, FloorPlan, PlanFileError

UNITS = {"mm": 4, "cm": 5, "dm": 14, "m": 6, "in": 1, "ft": 2}  # codes of $INSUNITS
SAGITTA_M = 0.002  # by which a chord may leave its arc
MOST_PARTS = 50_000  # entities, those of blocks each time that they are inserted
MOST_DEPTH = 16  # of blocks in blocks
MOST_CORNERS = 1_000_000
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


def walls_from_dxf(path: Path, reading: Reading) -> list[LineString]:
    """Raises PlanFileError: what is wrong. OSError."""
    with path.open("rb") as file:
        if (size := file.seek(0, os.SEEK_END)) > MOST_BYTES:
            raise PlanFileError(f"must be at most {MOST_BYTES} bytes, is {size}")
    try:
        drawing: Any = ezdxf.filemanagement.readfile(path)
        metres = _metres_per_unit(drawing, reading.unit)
        parts = _parts(drawing.modelspace(), [0], 0)
        lines = list(_lines(parts, metres, {name.lower() for name in reading.layers}))
    except RAISED as error:
        told = "it ends too early" if isinstance(error, CUT) else " ".join(str(error).split())
        reason = told[:200] or type(error).__name__
        raise PlanFileError(f"must be a DXF drawing: {reason}") from None
    if not lines:
        there = sorted(layer.dxf.name for layer in drawing.layers)[:20]
        raise PlanFileError(f"no line is drawn; its layers are {', '.join(there)}")
    x, y, degrees = reading.origin
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = np.array([[c, -s], [s, c]])
    return [LineString((line - (x, y)) @ turn) for line in lines]


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


def _parts(entities: Iterable[Any], count: list[int], depth: int) -> Iterator[Any]:
    """All entities, those of inserted blocks at their places."""
    if depth > MOST_DEPTH:
        raise PlanFileError(f"its blocks must be at most {MOST_DEPTH} deep in each other")
    for entity in entities:
        count[0] += 1
        if count[0] > MOST_PARTS:
            raise PlanFileError(f"must have at most {MOST_PARTS} entities, with those of blocks")
        if entity.dxftype() != "INSERT":
            yield entity
        elif entity.mcount > 1:
            yield from _parts(entity.multi_insert(), count, depth)
        else:
            yield from _parts(entity.virtual_entities(), count, depth + 1)


def _lines(parts: Iterable[Any], metres: float, layers: set[str]) -> Iterator[F64]:
    """(n, 2) m each."""
    corners = 0
    for part in parts:
        if layers and part.dxf.layer.lower() not in layers:
            continue
        try:
            way = ezdxf.path.make_path(part)
        except TypeError:
            continue  # nothing that is drawn with lines
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
