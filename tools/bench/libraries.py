"""Others' libraries to measure against, where `make bench` has put them: none is mapod's."""

import importlib
import importlib.util
import os
import sys
from types import ModuleType

from tools.cli.options import ROOT

BUILD = ROOT / "build"


def maybe_octomap() -> ModuleType | None:
    return _maybe("pyoctomap", "octomap")


def maybe_open3d() -> ModuleType | None:
    """On one thread, as ours is measured."""
    os.environ["OMP_NUM_THREADS"] = "1"  # read when it is loaded
    return _maybe("open3d", "open3d")


def _maybe(name: str, folder: str) -> ModuleType | None:
    path = str(BUILD / folder)
    if os.path.isdir(path) and path not in sys.path:
        sys.path.append(path)  # behind what mapod itself needs
    return importlib.import_module(name) if importlib.util.find_spec(name) else None
