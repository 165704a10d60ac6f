"""No kernel is compiled, or read from its cache, while a robot drives: all are warmed before."""

import ast
import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

from tests import ROOT
from tests.hw.stripe.test_sweep import GIVEN

METHODS = {
    "reference_plane": ("core.mapping.paper",),
    "surface": ("core.mapping.surface", "core.mapping.heights"),
    "certainty": ("core.mapping.certainty",),
}
SERVED = {"core.driving.zone: nearest_in_sectors"}  # for a server that is off as shipped
MODBUS = {"port": "tcp://127.0.0.1:5020"}
# off, or another driver's, as shipped; whoever takes up a depth camera and paths warms them
ELSEWHERE = (
    *("hw.modbus", "hw.stripe", "hw.visionary", "hw.depth_images"),
    *("core.objects", "core.paths", "core.mapping.combined"),
)
COLD = """
import json, sys
from app import warm_kernels
from tests.app.test_warm import cold_kernels
from tests.support.robot.shipped import shipped
sections = json.loads(sys.argv[1])
warm_kernels(shipped(**sections))
print(*cold_kernels(sections.get("map", {}).get("method", "surface")), sep="\\n")
"""


def called_from_python(path: Path) -> set[str]:
    """Names that functions of a module call which are no kernels themselves."""
    functions = [
        node
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
        and not any("kernel" in ast.unparse(mark) for mark in node.decorator_list)
    ]
    calls = [node for f in functions for node in ast.walk(f) if isinstance(node, ast.Call)]
    return {call.func.id for call in calls if isinstance(call.func, ast.Name)}


def cold_kernels(method: str = "surface") -> set[str]:
    """Those of the app with a method that Python calls, and that are not loaded."""
    others = tuple(room for name in METHODS.keys() - {method} for room in METHODS[name])
    cold, seen = set(), 0
    for path in sorted([*ROOT.glob("core/**/*.py"), *ROOT.glob("hw/**/*.py")]):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        module = importlib.import_module(name)
        for called in called_from_python(path):
            kernel = getattr(module, called, None)
            if isinstance(kernel, Dispatcher) and not name.startswith(others):
                seen += 1
                cold |= set() if kernel.signatures else {f"{name}: {called}"}
    assert seen > 20
    return cold


def cold_after(**sections: dict[str, Any]) -> set[str]:
    """What is cold in a process that has warmed these settings, and done nothing else.

    Here other tests have run kernels that nobody has warmed.
    """
    command = [sys.executable, "-c", COLD, json.dumps(sections)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return set(filter(None, done.stdout.splitlines()))


def test_every_kernel_that_the_settings_can_come_to_is_warm() -> None:
    cold = cold_after()
    assert {name for name in cold if not name.startswith(ELSEWHERE)} <= SERVED
    cold = cold_after(modbus=MODBUS)
    assert {name for name in cold if not name.startswith(ELSEWHERE[1:])} == set()


@pytest.mark.slow
def test_every_kernel_of_a_camera_is_warm_where_that_is_the_scanner() -> None:
    ways = [{"driver": "stripe", **GIVEN, "find": find} for find in ("peak", "threshold")]
    cold = cold_after(scanner=ways[0]) & cold_after(scanner=ways[1])
    assert not [name for name in cold if name.startswith("hw.stripe")]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["reference_plane", "certainty"])
def test_every_kernel_of_another_method_is_warm_where_that_is_set(method: str) -> None:
    cold = cold_after(map={"method": method})
    used = *METHODS[method], "hw.planner_link"
    assert not [name for name in cold if name.startswith(used)]
