"""Compile every kernel that is not on disk yet: the app's, the simulated world's, the planner's.

`python -m tools.warm`. A robot needs only the app's: `main.py --warm`.
"""

import gc
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from numba.core import event

ROOT = Path(__file__).resolve().parents[1]
TOLD_AT = 20  # kernels: progress is told so often
SCENES = ("crowd", "yard")  # who walks there, and what is soft: all that rays can meet


def warm_app() -> None:
    from app import warm_kernels
    from config_file import load_config

    warm_kernels(load_config((ROOT / "mapod.toml").read_text(encoding="utf-8")))


def warm_world() -> None:
    from fakes.scenes.scene import load_scene
    from fakes.world.rig import Rig

    for scene in SCENES:
        Rig(load_scene(scene, 1), 1)


def warm_paths() -> None:
    import shapely

    from core.paths.coverage.plan import plan_coverage
    from core.paths.records import Machine

    hall = shapely.box(0.0, 0.0, 3.0, 2.0) - shapely.box(1.3, 0.5, 1.5, 2.0)
    machine = Machine(radius_m=0.15, clearance_m=0.0, width_m=0.3, overlap_m=0.0)
    plan_coverage(hall, machine, start=(0.3, 0.3), dock=(2.5, 1.5))


def warm_camera() -> None:
    """What only a robot with a depth camera has: tests run it, and the demo of one."""
    from config_file import load_config
    from core.objects.frame.steps import FrameSteps
    from core.objects.vector_map.warm import warm_object_map

    config = load_config((ROOT / "robots" / "cleaner.toml").read_text(encoding="utf-8"))
    assert config.objects is not None
    assert config.object_map is not None
    FrameSteps(config.objects).warm()
    warm_object_map(config.object_map)


PARTS: dict[str, Callable[[], None]] = {
    "app": warm_app,
    "world": warm_world,
    "paths": warm_paths,
    "camera": warm_camera,
}


class Progress(event.Listener):
    """Tells how many kernels were compiled by now."""

    def __init__(self, part: str) -> None:
        self._part, self.count = part, 0

    def on_start(self, event: event.Event) -> None:
        """Nothing is told of what only begins."""

    def on_end(self, event: event.Event) -> None:
        """One more, if it is a kernel of ours and no part of Numba."""
        if event.data["dispatcher"].py_func.__module__.startswith("numba."):
            return
        self.count += 1
        if self.count % TOLD_AT == 0:
            print(f"mapod: {self.count} kernels of the {self._part} are compiled", flush=True)


def main(parts: list[str]) -> int:
    """Compile these parts' kernels; all parts in a process each when none is named."""
    if not parts:
        runs = [subprocess.Popen([sys.executable, "-m", "tools.warm", part]) for part in PARTS]
        return max(abs(run.wait()) for run in runs)
    gc.disable()  # a tenth of the time, for a process that ends at once
    for part in parts:
        event.register("numba:compile", Progress(part))
        PARTS[part]()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
