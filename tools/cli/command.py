"""The command `mapod`: finds the command that is asked for, and hands it its arguments.

A command is one file of this folder: `main(arguments)` gives the exit status. A file is loaded only
when its command is called, so that `mapod version` needs none of the libraries.
"""

import importlib
import os
import signal
import sys
from collections.abc import Sequence

from tools.cli.options import USAGE

COMMANDS = {  # file, function in it if it is not `main`, and what it does
    "init": ("run:init", "write mapod.toml, the settings of a robot"),
    "check": ("run:check", "say in words what the settings describe"),
    "run": ("run:run", "run the robot: sensors in, obstacle map out"),
    "demo": ("demo", "a simulated robot, and its map in the browser"),
    "view": ("view", "the map that a planner gets, in the browser; or --terminal"),
    "record": ("run:record", "run the robot, and keep every byte of every port"),
    "replay": ("replay", "play a recording through the app"),
    "why": ("why", "why the robot stood, or a cell was what it was, then"),
    "export": ("export", "a recording as tables, points, pictures, a map for ROS"),
    "sweep": ("sweep", "many recordings with many settings, each scored"),
    "doctor": ("doctor", "whether this machine can run mapod well, and what to do"),
    "devices": ("devices", "which device speaks on which port"),
    "scanner": ("scanner", "talk to the laser scanner"),
    "attitude": ("attitude", "talk to the attitude sensor"),
    "drive": ("drive", "read the motor controller; drive by keyboard"),
    "calibrate": ("calibrate", "how the scanner sits, from flat floor; how its ranges are off"),
    "rail": ("rail", "tell mapod by hand where a cart on a rail stands"),
    "placement": ("placement", "where to mount a sensor that looks down"),
    "plan": ("plan", "sweep a floor plan, or get from A to B on it"),
    "compare": ("compare", "a real device and its fake, asked the same"),
    "link-test": ("link_test", "check a planner's receiver over its port"),
    "flash": ("flash", "put mapod onto a robot, with a way back"),
    "warm": ("run:warm", "compile what `run` needs, ahead of time"),
    "version": ("run:version", "which version this is"),
}


def help_text() -> str:
    lines = [f"  {name:<11}{what}" for name, (_, what) in COMMANDS.items()]
    return "\n".join(
        [
            "usage: mapod COMMAND [OPTION]...",
            "",
            *lines,
            "",
            "`mapod COMMAND --help` tells the options of a command, with an example.",
        ]
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status: that of the command; 2 if there is no such command."""
    try:
        status = _run(list(sys.argv[1:] if arguments is None else arguments) or ["--help"])
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except BrokenPipeError:  # who reads what is said has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE


def _run(arguments: Sequence[str]) -> int:
    name, *rest = arguments
    if name in ("-h", "--help", "help"):
        print(help_text())
        return 0
    name = "version" if name == "--version" else name
    if name not in COMMANDS:
        print(f"mapod: there is no command {name!r}; mapod --help lists them", file=sys.stderr)
        return USAGE
    file, _, function = COMMANDS[name][0].partition(":")
    module = importlib.import_module(f"{__package__}.{file}")
    return int(getattr(module, function or "main")(rest))
