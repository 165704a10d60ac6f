"""Files to floor plans: which kind a file is, and what is wrong with one that is none."""

import json
import sys
from pathlib import Path

from core.paths.geometry.space import FloorError
from tools.floorplans.geojson import plan_from_geojson
from tools.floorplans.records import MOST_BYTES, MOST_M, FloorPlan, Json, PlanFileError, shown
from tools.floorplans.valetudo import plan_from_valetudo


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
    except ValueError:  # the other two are of its kind
        most = sys.get_int_max_str_digits()
        raise PlanFileError(f"must be JSON, whole numbers of at most {most} digits") from None
    except RecursionError:
        raise PlanFileError("must be JSON of a floor plan, is nested too deep") from None
    if not isinstance(content, dict):
        raise PlanFileError(f"must be a JSON object, is {shown(content)}")
    return content


def load_plan(path: Path) -> FloorPlan:
    """The floor plan of a file. Raises PlanFileError: what is wrong with it, with its name."""
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
