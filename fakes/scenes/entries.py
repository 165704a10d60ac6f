"""Tables of a scene's file and what each makes: an entry's keys are the parameters of its maker.

Angles are in degrees there, `_deg` for `_rad`; x, y and z are [from, to]; who has a `material` has
its `density_per_m`, too; all but [upsets] are lists of entries, which may have a `chance`.
"""

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any

from fakes.scenes.kinds import check_kinds
from fakes.scenes.movers import box, person
from fakes.scenes.scatter import check_scatter
from fakes.scenes.solids import Material, Pillar, Slope, Solid, bump, ramp, span_from
from fakes.world.crowd import Walker
from fakes.world.error_models import ErrorModels, Patch
from fakes.world.magnetic import MagneticDisturbance
from fakes.world.slip import Slip

LISTS: dict[str, Callable[..., Any]] = {  # chance is asked in this order
    "solid": Solid, "ramp": ramp, "slope": Slope, "pillar": Pillar, "bump": bump, "person": person,
    "walker": Walker, "moved_box": box, "steel": MagneticDisturbance, "patch": Patch, "slip": Slip,
}  # fmt: skip
MAKERS = LISTS | {"upsets": ErrorModels}
SCENE = {"x_axis_east_of_north_deg", "description", "campaign", "fair", "start_clear_m", "friction",
         "mirror", "route", "goals", "rooms", "scatter", *MAKERS}  # fmt: skip
SINGLE = {"goals": {"count", "areas"}, "rooms": {"count", "wide_m", "long_m", "door_m"}}


@functools.cache
def _parameters(kind: str) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(MAKERS[kind]).parameters


@functools.cache
def _keys(kind: str) -> set[str]:
    more = {"density_per_m"} if "material" in _parameters(kind) else set()
    return {name.replace("_rad", "_deg") for name in _parameters(kind)} | more | {"chance"}


def check_keys(table: dict[str, Any], file: str) -> None:
    """Whether a file holds only keys that there are, with values of their kinds.

    Raises:
        ValueError: it does not; the text says where.
    """
    check_kinds(table, file, LISTS)
    entries = [("scene", table, SCENE)]
    entries += [(kind, table.get(kind, {}), known) for kind, known in SINGLE.items()]
    entries += [("upsets", table.get("upsets", {}), _keys("upsets") - {"chance"})]
    entries += [(kind, entry, _keys(kind)) for kind in LISTS for entry in table.get(kind, [])]
    for kind, entry, known in entries:
        if unknown := sorted(entry.keys() - known):
            raise ValueError(f"{file}, {kind}: no key {unknown[0]!r}")
    for area in table.get("goals", {}).get("areas", []):
        if unknown := sorted(area.keys() ^ {"x", "y"}):
            raise ValueError(f"{file}, goals: an area has x and y, not {unknown[0]!r}")
    for entry in table.get("scatter", []):
        check_scatter(entry)


def made(kind: str, entry: dict[str, Any]) -> Any:
    """What an entry makes; its keys are known.

    Raises:
        ValueError: a value that cannot be, or none where one must be.
    """
    parameters = _parameters(kind)
    values: dict[str, Any] = {}
    for key, value in entry.items():
        name = key if key in parameters else key.replace("_deg", "_rad")
        if name in parameters and key != "material":
            try:
                values[name] = _value(key, value, parameters[name].default, is_angle=name != key)
            except (TypeError, ValueError) as error:
                raise ValueError(f"{kind}, {key}: {error}") from None
    if "material" in parameters:
        density = float(entry.get("density_per_m", 0.0))
        values["material"] = Material(entry.get("material", "plain"), density)
    for name, parameter in parameters.items():
        if parameter.default is parameter.empty and name not in values:
            raise ValueError(f"{kind}: {name} is missing")
    return MAKERS[kind](**values)


def _value(key: str, value: Any, default: Any, is_angle: bool) -> Any:
    if isinstance(default, bool) or isinstance(value, bool):
        if not isinstance(default, bool) or not isinstance(value, bool):
            raise ValueError(f"must {'' if isinstance(default, bool) else 'not '}be true or false")
        return value
    if key in ("x", "y", "z"):
        return span_from(value)
    if isinstance(value, list):
        return tuple(_value("", part, 0.0, is_angle) for part in value)
    if isinstance(value, str) and not isinstance(default, float):
        return value
    return math.radians(value) if is_angle else float(value)
