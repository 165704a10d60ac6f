"""What the rig has: `python -m tools.rig`; `python -m tools.rig draw FOLDER` draws runs again."""

import sys
from collections.abc import Sequence
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
    if arguments and arguments[0] == "draw":
        try:
            for folder in arguments[1:]:
                print(record.draw(Path(folder)))
        except (OSError, ValueError, KeyError, TypeError) as error:
            print(f"tools.rig draw: not a recorded run: {error}", file=sys.stderr)
            return 1
        return 0
    for name, what in PROGRAMS.items():
        print(f"python -m tools.rig.{name:<12} {what}")
    print(f"python -m tools.rig draw FOLDER... {'':<2}the pictures of recorded runs again")
    return 0 if not arguments else 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
