"""The layer rule of the design, read from the imports of every file."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = {"core", "hw", "mapod_link", "fakes", "tools", "tests", "app", "main", "jit"}
MAY_IMPORT = {
    "jit.py": set(),
    "core": {"core", "jit"},
    "hw": {"hw", "core.records", "jit"},
    "mapod_link": {"mapod_link"},
    "fakes": {"fakes", "mapod_link", "jit"},
    "app.py": {"hw", "core"},
    "main.py": {"app", "hw", "core"},
    "tools": {"tools", "app", "main", "hw", "core", "fakes", "mapod_link", "jit"},
    "tests": ROOMS,
}
LIBRARIES = {
    "jit.py": {"numpy", "numba"},
    "core": {"numpy", "msgspec"},
    "hw": {"numpy", "serial", "cobs", "pymodbus"},
    "mapod_link": {"numpy"},
    "app.py": {"numpy", "structlog"},
    "main.py": {"structlog"},
    "fakes": {"numpy", "mujoco"},
}
CLOCKS_AND_FILES = {
    "time",
    "asyncio",
    "socket",
    "os",
    "threading",
    "random",
    "logging",
    "structlog",
}
FILES = sorted(
    path
    for path in ROOT.rglob("*.py")
    if not any(part.startswith(".") or part == "build" for part in path.relative_to(ROOT).parts)
)


def imports_of(path: Path) -> list[str]:
    """Dotted names that a file imports; `from core import health` counts as core.driving.health."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            package = node.module or ""
            names += (
                [f"{package}.{alias.name}" for alias in node.names]
                if package in ROOMS
                else [package]
            )
    return names


def room_of(path: Path) -> str:
    """The room of a file: the folder at the top, or the file itself."""
    return path.relative_to(ROOT).parts[0]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_imports_only_what_its_room_may(path: Path) -> None:
    room = room_of(path)
    assert room in MAY_IMPORT, f"{path}: stands in no room of the house"
    own = [name for name in imports_of(path) if name.split(".")[0] in ROOMS]
    allowed = MAY_IMPORT[room]
    wrong = [
        name
        for name in own
        if not any(name == may or name.startswith(f"{may}.") for may in allowed)
    ]
    assert not wrong, f"{path} imports {wrong}; {room} may import {sorted(allowed)}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_robot_needs_only_the_runtime_libraries(path: Path) -> None:
    libraries = LIBRARIES.get(room_of(path))
    if libraries is None:
        return
    import sys

    foreign = {name.split(".")[0] for name in imports_of(path)} - ROOMS - sys.stdlib_module_names
    assert foreign <= libraries, f"{path} imports {sorted(foreign - libraries)}"


@pytest.mark.parametrize(
    "path", [p for p in FILES if room_of(p) == "core"], ids=lambda path: path.name
)
def test_core_reads_no_clock_and_opens_nothing(path: Path) -> None:
    assert not {name.split(".")[0] for name in imports_of(path)} & CLOCKS_AND_FILES
    calls = [
        node.func.id
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    ]
    assert "open" not in calls
    assert "print" not in calls


def test_the_rule_itself_catches_a_wrong_import(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.py"
    wrong.write_text("from core import records\nimport hw.lms1xx.telegrams\n")
    assert imports_of(wrong) == ["core.records", "hw.lms1xx.telegrams"]
