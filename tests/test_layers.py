"""The rules of the rooms, read from the imports and names of every file: one test for each rule."""

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from tests import ROOT

TOP = {"app", "beside", "cleaner", "config_file", "logs", "main", "map_files", "perception"}
TOP |= {"recorder", "version", "wiring"}
OWN = TOP | {
    "core",
    "jit",
    "mapod",
    "hw",
    "recording",
    "mapod_link",
    "fakes",
    "tools",
}  # "tests" may use all
MAY_IMPORT = {  # by the first part of a module's name
    "jit": set(),
    "core": {"core", "jit"},
    "hw": {"hw", "core.records", "jit"},
    "mapod_link": {"mapod_link"},
    "fakes": {"fakes", "mapod_link", "jit"},
    "recording": {"recording", "core", "hw.device", "mapod_link"},
    **{name: TOP - {"main"} | {"core", "hw", "recording"} for name in TOP},
    "mapod": {"mapod", "tools"},  # the name under which all of it is installed
    "tools": OWN,
}
LIBRARIES = {
    "jit": {"numpy", "numba"},
    "core": {"numpy", "msgspec", "shapely"},  # shapely: in the rooms of polygons alone, see below
    "hw": {"numpy", "msgspec", "serial", "cobs", "cv2"},  # cv2: within functions, see below
    "mapod_link": {"numpy"},
    "recording": {"numpy", "msgspec", "mcap", "zstandard"},
    "fakes": {"numpy", "mujoco", "PIL"},
    **{name: {"numpy", "msgspec"} for name in TOP},
}
POLYGONS = ("core.objects", "core.paths")
CLOCKS_AND_FILES = {"time", "asyncio", "socket", "os", "threading", "random", "logging", "pathlib"}
METHODS = ("surface", "heights", "paper", "certainty")
VOCABULARY = {"core.records", "core.config", "core.geometry"}
DEVICES = ("lms1xx", "urg04lx", "stripe", "visionary", "depth_images", "kinect", "mti", "ax3500")
OF_AN_LMS = re.compile(
    r"lms1|lms_?\d|1081|contamin|cola|dialect|angular_step|scan_rate|first_deg|last_deg"
)
OF_AN_URG = re.compile(r"\burg\b|\burg-?0|\bscip|hokuyo")
QUOTED = re.compile(r'"""(?:.|\n)*?"""')
IMPORT = re.compile(r"^ *((?:from \S+ )?import (?:\([^)]*\)|[^(#\n]+))(?: *#.*)?$", re.MULTILINE)
BY_THEIR_NAMES = {"hw.registry", "hw.fingerprint"}  # know devices by their names: that is their job


@dataclass(frozen=True)
class Module:
    """One file, by its dotted name."""

    name: str
    text: str
    imports: list[str]  # dotted; of `from core import health`, both `core` and `core.health`
    plain: list[str]  # those of `import x`

    @property
    def room(self) -> str:
        return self.name.split(".")[0]


def module_of(text: str, name: str) -> Module:
    """A file's text as a module. What stands between triple quotes imports nothing."""
    imports, plain = [], []
    for found in IMPORT.finditer(QUOTED.sub("", text)):
        [node] = ast.parse(found[1]).body  # alone: the trees of all files take seconds to build
        if isinstance(node, ast.ImportFrom):
            package = "." * node.level + (node.module or "")
            imports += [package, *(f"{package}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            plain += [alias.name for alias in node.names]
    return Module(name, text, imports + plain, plain)


@cache
def modules() -> dict[str, Module]:
    """All of them, by name; a package is its `__init__.py`."""
    found = {}
    for path in [*ROOT.glob("*.py"), *(p for room in OWN for p in (ROOT / room).rglob("*.py"))]:
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        found[name] = module_of(path.read_text(encoding="utf-8"), name)
    assert len(found) > 200
    return found


def within(name: str, *rooms: str) -> bool:
    return any(name == room or name.startswith(f"{room}.") for room in rooms)


def wrong(where: str, *never: str) -> list[str]:
    """Imports from one room of what lies in others."""
    return [
        f"{module.name} imports {name}"
        for module in modules().values()
        if within(module.name, where)
        for name in module.imports
        if within(name, *never)
    ]


def faults_of(module: Module) -> Iterator[str]:
    """What a room may not import; imports that are relative, or that no build can rewrite."""
    for name in module.imports:
        first = name.split(".")[0]
        if first == "":
            yield f"{module.name} imports {name}: relative"
        elif first not in OWN:
            libraries = LIBRARIES.get(module.room)
            is_tests = first == "tests"
            if is_tests or (libraries and first not in libraries | sys.stdlib_module_names):
                yield f"{module.name} imports {name}"
        elif not any(within(name, may) or within(may, name) for may in MAY_IMPORT[module.room]):
            yield f"{module.name} imports {name}"
    for name in module.plain:
        if name.split(".")[0] in OWN:
            yield f"{module.name}: write `from {name} import ...`"


def test_rooms_import_only_what_lies_below_them_and_a_robots_own_libraries() -> None:
    assert [fault for module in modules().values() for fault in faults_of(module)] == []


def test_that_rule_catches_what_it_forbids() -> None:
    forbidden = "import hw.device", "from app import App", "import serial", "from . import records"
    for line in (*forbidden, "def f():\n    from tests import ROOT", "import core.grid"):
        assert list(faults_of(module_of(line, "core.x"))), line
    assert list(faults_of(module_of("from core import config", "hw.x")))
    assert not list(faults_of(module_of("from core.records import Scan", "hw.x")))


def test_core_reads_no_clock_and_opens_nothing() -> None:
    for module in modules().values():
        if module.room == "core":
            assert not {name.split(".")[0] for name in module.imports} & CLOCKS_AND_FILES
            calls = [
                node.func for node in ast.walk(ast.parse(module.text)) if isinstance(node, ast.Call)
            ]
            called = {function.id for function in calls if isinstance(function, ast.Name)}
            assert not called & {"open", "print"}, module.name


def test_in_core_nobody_imports_what_stands_above_him() -> None:
    above = ("core.motion", "core.mapping", "core.driving", "core.saved", "core.summary")
    faults = [fault for low in ("core.grid", *VOCABULARY) for fault in wrong(low, *above)]
    faults += wrong("core.motion", *above[1:]) + wrong("core.mapping", *above[2:])
    faults += wrong("core.driving", *above[3:])
    faults += wrong("core", "core.driving.report")
    maps = ("core.grid", "core.motion", "core.mapping", "core.driving", "core.saved")
    faults += [fault for low in maps for fault in wrong(low, *POLYGONS)]
    faults += wrong("core.objects", *maps[2:], "core.paths")
    faults += wrong("core.paths", *maps, "core.objects")
    paths = [f"core.paths.{room}" for room in ("geometry", "coverage", "cleaning")]
    faults += wrong(paths[0], *paths[1:]) + wrong(paths[1], paths[2])
    assert faults == []


def test_heights_are_read_off_a_map_and_only_who_puts_a_scans_steps_together_knows_of_them() -> (
    None
):
    rooms = [name for name in modules() if within(name, "core.mapping.surface")]
    steps = [name for name in rooms if name.count(".") == 3 and not name.endswith(".maps")]
    faults = [fault for step in steps for fault in wrong(step, "core.mapping.heights")]
    faults += wrong("core.mapping.heights", "core.mapping.surface.maps")
    faults += wrong("core.mapping.layers", *(f"core.mapping.{room}" for room in METHODS))
    assert len(steps) > 5
    assert faults == []


def test_in_the_rig_commands_stand_above_the_rooms_and_each_room_above_those_it_needs() -> None:
    rig = [name.split(".") for name in modules() if within(name, "tools.rig")]
    rooms = {parts[2] for parts in rig if len(parts) > 3}
    needs = {
        "planner": set(),
        "truth": set(),
        "cleaning": set(),
        "runs": {"planner", "truth"},
        "faults": {"truth", "runs"},
        "real_time": {"planner", "truth"},
    }
    assert rooms == needs.keys()
    faults = [
        fault
        for room, needed in needs.items()
        for fault in wrong(
            f"tools.rig.{room}", *(f"tools.rig.{other}" for other in rooms - needed - {room})
        )
    ]
    commands = [".".join(parts) for parts in rig if len(parts) == 3 and parts[2] not in rooms]
    faults += [fault for room in ("tools", "mapod") for fault in wrong(room, *commands)]
    assert faults == []


def test_the_monitor_shares_nothing_with_what_computes_motion_and_decides_on_cells() -> None:
    own = {name for name in modules()["core.driving.monitor"].imports if name in modules()}
    assert [name for name in own if within(name, "core.driving", "core.mapping")] == [
        "core.driving.stall"
    ]
    users = [m.name for m in modules().values() if "core.driving.monitor" in m.imports]
    assert [name for name in users if within(name, "core")] == []


def test_a_devices_room_imports_no_other_devices() -> None:
    for side in ("hw", "fakes"):
        for device in DEVICES:
            others = [f"{side}.{other}" for other in DEVICES if other != device]
            assert wrong(f"{side}.{device}", *others) == []
    rooms = [f"hw.{device}" for device in DEVICES]
    assert [
        f"{module.name} imports {name}"
        for module in modules().values()
        if module.room == "hw" and not within(module.name, *rooms, *BY_THEIR_NAMES)
        for name in module.imports
        if within(name, *rooms)
    ] == []


def outside(room: str, pattern: re.Pattern[str]) -> list[str]:
    """Lines of core, hw and the app that have it, outside of a device's room."""
    return [
        f"{module.name}:{number}: {line.strip()}"
        for module in modules().values()
        if within(module.name, "core", "hw", *TOP)
        and not within(module.name, room, *BY_THEIR_NAMES)
        for number, line in enumerate(module.text.splitlines(), 1)
        if pattern.search(line.lower())
    ]


def test_nobody_outside_its_rooms_knows_what_is_particular_to_an_lms1xx() -> None:
    found = outside("hw.lms1xx", OF_AN_LMS)
    assert [
        line for line in found if not re.match(r"hw\.visionary[.:].*cola", line, re.IGNORECASE)
    ] == []


def test_nobody_outside_its_room_knows_of_an_urg04lx() -> None:
    assert outside("hw.urg04lx", OF_AN_URG) == []


def test_an_extra_is_loaded_by_who_needs_it_and_no_other() -> None:
    lines = [
        (module.name, line)
        for module in modules().values()
        if module.room == "hw"
        for line in module.text.splitlines()
        if re.match(r" *(import|from) cv2\b", line)
    ]
    assert lines == [("hw.stripe.images", "        import cv2")]
    assert [
        f"{module.name} imports {name}"
        for module in modules().values()
        if within(module.name, "core", *TOP) and not within(module.name, *POLYGONS)
        for name in module.imports
        if within(name, "shapely")
    ] == []


def test_imports_run_in_no_circle() -> None:
    left = {
        name: {other for other in module.imports if other in modules() and not within(name, other)}
        for name, module in modules().items()
    }
    while free := {name for name, others in left.items() if not others & left.keys()}:
        left = {name: others for name, others in left.items() if name not in free}
    assert sorted(left) == []
