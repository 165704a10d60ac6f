"""What a floor plan is, and what is common to all kinds of files of one. Metres, x right, y up."""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from core.paths.geometry.space import repaired
from core.records import F64

MOST_BYTES = 64_000_000  # of a file
MOST_M = 5000.0  # length of a plan
Point = tuple[float, float]
Json = dict[str, Any]


class PlanFileError(Exception):
    """A file that is no floor plan, in words."""


@dataclass(slots=True, eq=False)
class FloorPlan:
    """A floor, and what else a file tells of it."""

    free: MultiPolygon  # without obstacles, walls and areas where no robot may go
    rooms: list[tuple[str, MultiPolygon]] = field(default_factory=list)
    start: Point | None = None
    dock: Point | None = None
    driven: F64 | None = None  # (n, 2) the path that a robot drove there


def number(value: object, where: str) -> float:
    """Raises PlanFileError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e12:
        raise PlanFileError(f"{where}: must be a number, is {shown(value)}")
    return float(value)


def shown(value: object) -> str:
    """A value in a message, not longer than a line."""
    text = json.dumps(value, default=str)
    return text if len(text) <= 40 else f"{text[:37]}..."


def list_at(table: Json, key: str, where: str) -> list[Any]:
    """Raises PlanFileError."""
    value = table.get(key)
    if not isinstance(value, list):
        raise PlanFileError(f"{where}{key}: must be a list, is {shown(value)}")
    return value


def cells_as_area(runs: list[tuple[int, int, int]], cell_m: float) -> MultiPolygon:
    """Runs of cells (x, y, n), y down, as an area; exact, for it is joined in whole cells."""
    if not runs:
        return MultiPolygon()
    x, y, n = np.array(runs, dtype=float).T
    area = repaired(shapely.union_all(shapely.box(x, -y - 1, x + n, -y)))
    return MultiPolygon([Polygon(p) for p in shapely.transform(area, lambda p: p * cell_m).geoms])
