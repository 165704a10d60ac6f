"""A simulated robot, the unchanged app, and its map in the terminal.

World and fakes are one process, the app is another; they speak over TCP and ptys, and the app's
obstacle map comes back over UDP. With --drive the keyboard drives the robot, through app and
controller. Ctrl-C, or the end of --seconds, ends all of them.
"""

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from mapod_link.wires import UdpWire
from tools.cli.options import (
    ROOT,
    SHIPPED_CONFIG,
    add_config,
    add_out,
    add_seconds,
    add_world,
    fail,
    lacks_simulation,
    parser_of,
)
from tools.cli.view import print_summary, watch_and_drive
from tools.settings import NotThereError, rewritten
from tools.terminal.planner_end import PlannerEnd, PtyWire, WatchingReceiver
from tools.terminal.processes import Child, RunError, Stop, folder_kept_on_failure, ports_of, say
from tools.terminal.screen import has_screen

SECONDS_WITHOUT_SCREEN = 20.0
FIRST_MAP_S = 120.0  # compiling the kernels anew fits in
SERIAL_BAUD = 115_200
DRIVEN = {"robot.enable_motors": True, "robot.start_clear_m": 9.0}  # the corridor begins clear
DRIVEN_MPS, DRIVEN_RADPS = 0.5, 0.6
DRIVEN_WORLD = ("--no-driver", "--drive-mode", "rs232_watchdog")


@dataclass(frozen=True, slots=True)
class Commands:
    """What is started; the app's configuration file is appended to `app`."""

    fakes: list[str]
    app: list[str]


class Demo:
    """World, app and planner of one run, in a folder of its own."""

    def __init__(self, options: argparse.Namespace, commands: Commands, folder: Path) -> None:
        self._options, self._commands, self._folder = options, commands, folder
        self._children: list[Child] = []
        self.wire = PtyWire(SERIAL_BAUD) if options.serial else UdpWire("127.0.0.1", 0)
        self.end = PlannerEnd(self.wire, WatchingReceiver())
        self._until_s = float("inf")
        self._overdue_s = float("inf")

    def start(self, stop: Stop) -> None:
        fakes = self._start("world", self._commands.fakes)
        ports = ports_of(fakes, stop)
        if ports is None:
            return
        values: dict[str, object] = {f"{name}.port": url for name, url in ports.items()}
        values["planner.port"] = self.wire.url
        if self._options.drive:
            values |= DRIVEN
        shipped = Path(self._options.config).read_text()
        config = self._folder / "mapod.toml"
        config.write_text(rewritten(shipped, values))
        self._start("app", [*self._commands.app, str(config)])
        self._overdue_s = time.monotonic() + FIRST_MAP_S

    def done(self, now_s: float) -> bool:
        """True once it has run for as long as it should. Raises RunError if it cannot go on."""
        for child in self._children:
            child.check_alive()
        planner = self.end.planner
        running = not planner.blank and planner.pose is not None and planner.pose.mode != 0
        if running and self._overdue_s < float("inf"):
            self._overdue_s = float("inf")
            self._until_s = now_s + (self._options.seconds or float("inf"))
        if now_s > self._overdue_s:
            words = self._children[-1].last_words()
            raise RunError(f"no map within {FIRST_MAP_S:.0f} s; the app's last words:\n{words}")
        return now_s >= self._until_s

    def close(self) -> list[str]:
        """End the app, then the world; what did not end well."""
        complaints = [child.end() for child in reversed(self._children)]
        self.wire.close()
        return [complaint for complaint in complaints if complaint]

    def _start(self, name: str, argv: list[str]) -> Child:
        self._children.append(Child(name, argv, self._folder))
        return self._children[-1]


def run(options: argparse.Namespace, commands: Commands, console: Console) -> int:
    """The demo from start to end; exit status."""
    if options.seconds is None and not has_screen(console):
        options.seconds = SECONDS_WITHOUT_SCREEN
    try:
        with folder_kept_on_failure(options.out) as folder, Stop().on_signals() as stop:
            demo = Demo(options, commands, folder)
            try:
                say(f'starting the world "{options.scene}" (seed {options.seed})')
                demo.start(stop)
                say(f"the app is starting; its map comes to {demo.wire.url}; Ctrl-C ends all")
                speeds = (DRIVEN_MPS, DRIVEN_RADPS) if options.drive else None
                watch_and_drive(
                    demo.end, console, lambda now_s: stop.wanted or demo.done(now_s), speeds
                )
                now_s = demo.end.step(0.0)
            except RunError as error:
                raise RunError(f"{error}\nall that was said is in {folder}") from None
            finally:
                complaints = demo.close()
            if complaints:
                raise RunError("\n".join([*complaints, f"all that was said is in {folder}"]))
            print_summary(demo.end, console, now_s)
    except (RunError, NotThereError, OSError, ValueError) as error:
        return fail("demo", error, 1)
    say("all processes have ended")
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 ended as it was told to, 1 something failed, 2 wrong use."""
    parser = parser_of("demo", __doc__, "mapod demo --scene office --seed 3 --seconds 60")
    add_world(parser)
    add_seconds(parser, "until Ctrl-C; 20 without a terminal")
    add_config(parser, SHIPPED_CONFIG)
    add_out(parser, "a folder for what all of them say (default: one that stays if one fails)")
    parser.add_argument("--serial", action="store_true", help="planner on a pty, not on UDP")
    parser.add_argument("--drive", action="store_true", help="drive with the keyboard")
    options = parser.parse_args(arguments)
    if why := lacks_simulation():
        return fail("demo", why)
    python = sys.executable
    world = ["--scene", options.scene, "--seed", str(options.seed)]
    world += DRIVEN_WORLD if options.drive else ()
    commands = Commands(
        fakes=[python, "-m", "fakes", *world],
        app=[python, str(ROOT / "main.py"), "--config"],
    )
    return run(options, commands, Console())
