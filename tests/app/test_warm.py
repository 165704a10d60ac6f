"""No kernel is compiled, or read from its cache, while a robot drives: all are warmed before."""

import ast
import importlib
from pathlib import Path

from numba.core.dispatcher import Dispatcher

from app import warm_kernels
from tests import ROOT
from tests.support.shipped import shipped

METHODS = {name: f"core.mapping.{name}" for name in ("paper", "surface")}
SERVED = {"core.driving.zone: nearest_in_sectors"}  # for a server that is off as shipped
MODBUS = {"port": "tcp://127.0.0.1:5020"}


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
    others = tuple(room for name, room in METHODS.items() if name != method)
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


def test_every_kernel_that_the_settings_can_come_to_is_warm() -> None:
    warm_kernels(shipped())
    assert {name for name in cold_kernels() if not name.startswith("hw.modbus")} <= SERVED
    warm_kernels(shipped(modbus=MODBUS))
    assert cold_kernels() == set()


def test_every_kernel_of_another_method_is_warm_where_that_is_set() -> None:
    warm_kernels(shipped(map={"method": "surface"}))
    room = METHODS["surface"]
    assert not [name for name in cold_kernels("surface") if name.startswith(room)]
