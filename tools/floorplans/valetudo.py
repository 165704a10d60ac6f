"""Maps of vacuum robots as Valetudo stores them, versions 1 and 2, to floor plans.

Source: the format's description in Valetudo's documentation, and maps of four robots in
tests/vectors/floorplans. Cells are whole numbers, y down; entities are in centimetres.
"""

from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry

from core.paths.geometry.space import repaired
from core.records import F64
from tools.floorplans.records import (
    FloorPlan,
    Json,
    PlanFileError,
    cells_as_area,
    list_at,
    number,
    shown,
)

MOST_CELLS = 20_000_000
WALL_M = 0.01  # half the width of a virtual wall, which has none


def plan_from_valetudo(content: Json) -> FloorPlan:
    """Raises PlanFileError: what is wrong."""
    meta = content.get("metaData")
    version = meta.get("version") if isinstance(meta, dict) else None
    if version not in (1, 2):
        raise PlanFileError(f"metaData.version: must be 1 or 2, is {shown(version)}")
    cell_m = number(content.get("pixelSize"), "pixelSize") / 100
    if not 0.005 <= cell_m <= 1:
        raise PlanFileError(f"pixelSize: must be from 0.5 to 100 cm, is {100 * cell_m:g}")
    runs: list[tuple[int, int, int]] = []
    rooms: list[tuple[str, MultiPolygon]] = []
    for k, layer in enumerate(list_at(content, "layers", "")):
        if not isinstance(layer, dict) or layer.get("type") not in ("floor", "segment"):
            continue
        here = _runs(layer, f"layers[{k}].")
        runs += here
        if layer["type"] == "segment":
            rooms.append((_name(layer, len(rooms) + 1), cells_as_area(here, cell_m)))
    plan = FloorPlan(cells_as_area(runs, cell_m), rooms)
    _add_entities(plan, list_at(content, "entities", "") if "entities" in content else [])
    return plan


def _name(layer: Json, count: int) -> str:
    meta = layer.get("metaData")
    known = meta if isinstance(meta, dict) else {}
    return str(known.get("name") or known.get("segmentId") or count)


def _runs(layer: Json, where: str) -> list[tuple[int, int, int]]:
    """Cells of a layer as x, y, n."""
    is_packed = bool(layer.get("compressedPixels")) or "pixels" not in layer
    key, size = ("compressedPixels", 3) if is_packed else ("pixels", 2)
    values = list_at(layer, key, where)
    if len(values) % size:
        raise PlanFileError(f"{where}{key}: must be {size} numbers a run, is {len(values)} in all")
    if not all(type(value) is int and 0 <= value <= 1_000_000 for value in values):
        raise PlanFileError(f"{where}{key}: must be whole numbers from 0 to 1000000")
    found = [tuple(values[k : k + size]) for k in range(0, len(values), size)]
    runs = [(x, y, rest[0] if rest else 1) for x, y, *rest in found]
    if sum(n for _, _, n in runs) > MOST_CELLS:
        raise PlanFileError(f"{where}{key}: must be at most {MOST_CELLS} cells")
    return runs


def _points(entity: Json, where: str, least: int) -> F64:
    """(n, 2) metres, y up."""
    values = list_at(entity, "points", where)
    if len(values) % 2 or len(values) < 2 * least:
        raise PlanFileError(f"{where}points: must be {least} or more pairs x, y")
    numbers = [number(value, f"{where}points") for value in values]
    return np.array(numbers).reshape(-1, 2) * (0.01, -0.01)


def _add_entities(plan: FloorPlan, entities: list[Any]) -> None:
    taken: list[BaseGeometry] = []
    driven = []
    for k, entity in enumerate(entities):
        if not isinstance(entity, dict):
            raise PlanFileError(f"entities[{k}]: must be an object, is {shown(entity)}")
        kind, where = entity.get("type"), f"entities[{k}]."
        if kind == "no_go_area":
            taken.append(shapely.Polygon(_points(entity, where, 3)))
        elif kind == "virtual_wall":
            taken.append(shapely.LineString(_points(entity, where, 2)).buffer(WALL_M))
        elif kind == "path":
            driven.append(_points(entity, where, 0))
        elif kind in ("robot_position", "charger_location"):
            x, y = _points(entity, where, 1)[0].tolist()
            if kind == "robot_position":
                plan.start = (x, y)
            else:
                plan.dock = (x, y)
    if taken:
        plan.free = repaired(plan.free.difference(repaired(shapely.GeometryCollection(taken))))
    if driven:
        plan.driven = np.vstack(driven)
