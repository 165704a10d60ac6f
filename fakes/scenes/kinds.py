"""What a value in a scene's file must be: a number, a table, a list of tables, or [from, to]."""

from collections.abc import Iterable
from typing import Any

NUMBERS = "x_axis_east_of_north_deg", "start_clear_m", "friction"
TABLES = "goals", "rooms", "route", "upsets"
PAIRS = {"rooms": ("count", "wide_m", "long_m", "door_m"), "goals": ("count",)}
SCATTER_PAIRS = "count", "x", "y"


def check_kinds(table: dict[str, Any], file: str, lists: Iterable[str]) -> None:
    """Whether the file's own keys have values of their kinds; `lists`: those with many entries.

    Raises:
        ValueError: one has not; the text says which, and what it must be.
    """
    for key in NUMBERS:
        _check(_is_number(table.get(key, 0.0)), file, key, "a number", table)
    for key in TABLES:
        _check(isinstance(table.get(key, {}), dict), file, key, "a table", table)
    for key in (*lists, "scatter"):
        _check(_is_tables(table.get(key, [])), file, key, "a list of tables", table)
    goals, route = table.get("goals", {}), table.get("route", {})
    _check(_is_tables(goals.get("areas", [])), file, "areas", "a list of tables", goals)
    _check(_is_number(route.get("speed_mps", 0.0)), file, "speed_mps", "a number", route)
    points = route.get("waypoints", [])
    are_points = isinstance(points, list) and all(map(_is_point, points))
    _check(are_points, file, "waypoints", "a list of [x, y]", route)
    pairs = [(table.get(of, {}), key) for of, keys in PAIRS.items() for key in keys]
    pairs += [(entry, key) for entry in table.get("scatter", []) for key in SCATTER_PAIRS]
    for entry, key in pairs:
        is_right = key not in entry or _is_pair(entry[key])
        _check(is_right, file, key, "[from, to] with from <= to", entry)


def _check(is_right: bool, file: str, key: str, must_be: str, table: dict[str, Any]) -> None:
    if not is_right:
        raise ValueError(f"{file}, {key}: must be {must_be}, is {table[key]!r}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(one, dict) for one in value)


def _is_point(value: Any) -> bool:
    return isinstance(value, list) and len(value) >= 2 and all(map(_is_number, value))


def _is_pair(value: Any) -> bool:
    return _is_point(value) and len(value) == 2 and bool(value[0] <= value[1])
