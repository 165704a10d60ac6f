"""The rig's programs: `python -m tools.rig NAME ...`; without a name, what there is."""

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path

from tools.rig import record

PROGRAMS = {
    "live": "main.py, fakes and planner as processes of their own, in real time",
    "campaign": "many runs by chance on a simulated clock, judged by the truth",
    "fault_table": "every fault of every fake while the robot drives",
    "latency": "from the scan to the planner's end of the wire, loaded and not",
    "draw_scene": "a scene from above, as PNG",
}


def main(arguments: Sequence[str]) -> int:
    """Exit status."""
    name, rest = (arguments[0] if arguments else ""), list(arguments[1:])
    if name == "draw":
        for folder in rest:
            print(record.draw(Path(folder)))
        return 0
    if name in PROGRAMS:
        program: Callable[[Sequence[str]], int] = import_module(f"tools.rig.{name}").main
        return program(rest)
    print("python -m tools.rig NAME ..., --help after it says more:")
    for known, what in PROGRAMS.items():
        print(f"  {known:<12} {what}")
    print(f"  {'draw':<12} FOLDER...: the pictures of recorded runs again")
    return 0 if not name else 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
