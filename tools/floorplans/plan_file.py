"""Files to floor plans: which kind a file is, and what is wrong with one that is none.

Metres, x right, y up.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from core.paths.space import FloorError, repaired
from core.records import F64

MOST_BYTES = 64_000_000
MOST_M = 5000.0
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


def _refused(name: str) -> float:
    raise PlanFileError(f"must be JSON, which has no {name}")


def _json_of(path: Path) -> Json:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise PlanFileError(f"must be at most {MOST_BYTES} bytes, is {path.stat().st_size}")
        content = json.loads(path.read_bytes(), parse_constant=_refused)
    except OSError as error:
        raise PlanFileError(str(error.strerror)) from None
    except UnicodeDecodeError:
        raise PlanFileError("must be JSON in UTF-8") from None
    except json.JSONDecodeError as error:
        raise PlanFileError(f"must be JSON: line {error.lineno}: {error.msg}") from None
    except RecursionError:
        raise PlanFileError("must be JSON of a floor plan, is nested too deep") from None
    if not isinstance(content, dict):
        raise PlanFileError(f"must be a JSON object, is {shown(content)}")
    return content


def load_plan(path: Path) -> FloorPlan:
    """The floor plan of a file. Raises PlanFileError: what is wrong with it, with its name."""
    from tools.floorplans.geojson import plan_from_geojson
    from tools.floorplans.valetudo import plan_from_valetudo

    try:
        content = _json_of(path)
        if "layers" in content:
            plan = plan_from_valetudo(content)
        elif isinstance(content.get("type"), str):
            plan = plan_from_geojson(content)
        else:
            raise PlanFileError("must be GeoJSON (has `type`) or a Valetudo map (has `layers`)")
        _check(plan)
    except (PlanFileError, FloorError) as error:
        raise PlanFileError(f"{path}: {error}") from None
    return plan


def _check(plan: FloorPlan) -> None:
    if plan.free.is_empty:
        raise PlanFileError("has no floor: no polygon with an area")
    low_x, low_y, high_x, high_y = plan.free.bounds
    long_m = max(high_x - low_x, high_y - low_y)
    if not long_m <= MOST_M:
        raise PlanFileError(f"must be in metres and at most {MOST_M:g} m long, is {long_m:g} m")


def cells_as_area(runs: list[tuple[int, int, int]], cell_m: float) -> MultiPolygon:
    """Runs of cells (x, y, n), y down, as an area; exact, for it is joined in whole cells."""
    if not runs:
        return MultiPolygon()
    x, y, n = np.array(runs, dtype=float).T
    area = repaired(shapely.union_all(shapely.box(x, -y - 1, x + n, -y)))
    return MultiPolygon([Polygon(p) for p in shapely.transform(area, lambda p: p * cell_m).geoms])
