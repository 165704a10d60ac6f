"""A simulated robot, the unchanged app, and its map in the browser and in the terminal.

World and fakes are one process, the app is another; they speak over TCP and ptys, and the app's
obstacle map comes back over UDP. With --drive the keyboard drives the robot, through app and
controller; `--robot cleaner` maps a small store with its depth camera and sweeps it, driven by a
planner that follows the app's path. The live page of `mapod view` is at the address that the first
line tells, as a second receiver. Ctrl-C, or the end of --seconds, ends all of them.
"""

import argparse
import contextlib
import importlib
import importlib.util
import math
import socket
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from config_file import with_changes
from core.config import Config, ConfigError
from mapod_link.wires import UdpWire
from tools.cli.options import (
    ROBOTS,
    SHIPPED_CONFIG,
    configured,
    fail,
    lacks_simulation,
    parser_of,
)
from tools.cli.view import NO_PAGE, PAGE_AT, print_summary, watch_and_drive
from tools.settings import NotThereError, camera_of, lens_of, rewritten, wheels_of
from tools.terminal.planner_end import PlannerEnd, PtyWire, WatchingReceiver
from tools.terminal.processes import (
    APP,
    Child,
    RunError,
    SimulatedRobot,
    Stop,
    first_lines_of,
    folder_kept_on_failure,
    say,
)
from tools.terminal.screen import has_screen

SECONDS_WITHOUT_SCREEN = 20.0
SERIAL_BAUD = 115_200
DRIVEN = {"robot.enable_motors": True, "robot.start_clear_m": 9.0}  # the corridor begins clear
DRIVEN_MPS, DRIVEN_RADPS = 0.5, 0.6
CLEANED_CLEAR_M = 1.2  # around the dock of a machine that cleans
USUAL_SCENE = "corridor"
SCENES = {"cleaner": "store", "messor": "stones"}  # of robots that are not at home in the usual one
DRIVEN_WORLD = ("--no-driver", "--drive-mode", "rs232_watchdog")


def run(options: argparse.Namespace, world: list[str], app: Sequence[str], console: Console) -> int:
    """The demo from start to end; `app` gets the file of its settings appended."""
    if options.seconds is None and not has_screen(console):
        options.seconds = SECONDS_WITHOUT_SCREEN
    seconds = options.seconds or math.inf
    try:
        wire = PtyWire(SERIAL_BAUD) if options.serial else UdpWire("127.0.0.1", 0)
        with (
            contextlib.closing(wire),
            folder_kept_on_failure(options.out) as folder,
            Stop().on_signals() as stop,
        ):
            robot, end = SimulatedRobot(folder), PlannerEnd(wire, WatchingReceiver())
            values: dict[str, object] = dict(DRIVEN) if options.drive else {}
            if options.cleans:
                values |= {"robot.enable_motors": True, "robot.start_clear_m": CLEANED_CLEAR_M}
            drives = path_driving(end, options.cleans and not options.drive)
            settings = rewritten(Path(options.config).read_text(), values)

            def done(now_s: float) -> bool:
                drives(now_s)
                if stop.wanted:
                    return True
                return robot.has_map(now_s, end.planner) and now_s >= robot.mapped_s + seconds

            with robot.ended():
                address, page_url = ("", "") if options.no_page else page(robot, settings, stop)
                if options.record:
                    values["record.path"] = recorded_to(options.record)
                values["planner.port"] = [wire.url, page_url] if page_url else wire.url
                if not stop.wanted:
                    say(address or "no page")
                    say(f'starting the world "{options.scene}" (seed {options.seed})')
                    robot.start(world, Path(options.config), values, stop, app)
                if not stop.wanted:
                    say(f"the app is starting; its map comes to {wire.url}; Ctrl-C ends all")
                    keys = options.drive and (sys.stdin.isatty() or not page_url)  # else the page
                    speeds = (DRIVEN_MPS, DRIVEN_RADPS) if keys else None
                    watch_and_drive(end, console, done, speeds, address)
                now_s = end.step(0.0)
            if robot.mapped_s < math.inf or not stop.wanted:
                print_summary(end, console, now_s)
    except (RunError, NotThereError, OSError, ValueError) as error:
        return fail("demo", error, 1)
    say("all processes have ended")
    return 0


def path_driving(end: PlannerEnd, is_wanted: bool) -> Callable[[float], None]:
    """What drives the path that the app tells, to be called now and then; or nothing."""
    if not is_wanted:
        return lambda now_s: None
    driving = importlib.import_module("fakes.planner_mcu.path_driving")  # not installed with this
    step: Callable[[float], None] = driving.PathDriving(end.planner).step
    return step


def recorded_to(path: str) -> str:
    """From here, wherever the app runs. A folder stays one that ends with a slash."""
    return str(Path(path).resolve()) + "/" * path.endswith("/")


def page(robot: SimulatedRobot, settings: str, stop: Stop) -> tuple[str, str]:
    """Starts the page's server. Its address, and the URL at which it hears the app; or why not."""
    if importlib.util.find_spec("aiohttp") is None:
        return NO_PAGE, ""
    path = robot.folder / "page.toml"
    path.write_text(settings)
    port = PAGE_AT[1] if is_free(PAGE_AT[1]) else 0
    view = [sys.executable, "-m", "mapod", "view", "udp://127.0.0.1:0", "--config", str(path)]
    server = Child("page", [*view, "--http", f"127.0.0.1:{port}"], robot.folder)
    robot.children.append(server)
    address, watching = first_lines_of(server, 2, stop) or ("", "")
    return address, watching.removeprefix("watching ").partition(";")[0]


def world_words(options: argparse.Namespace, config: Config) -> list[str]:
    """What starts the world of a robot with these settings."""
    words = [sys.executable, "-m", "fakes", "--scene", options.scene, "--seed", str(options.seed)]
    words += ["--scanner", config.scanner.driver, "--lens", *map(str, lens_of(config))]
    words += ["--wheels", *map(str, wheels_of(config))]
    words += ["--most-speed", str(config.robot.max_speed_mps)]
    words += DRIVEN_WORLD if options.drive or options.cleans else ()
    camera = camera_of(config)
    words += ["--camera", *map(str, camera)] if camera else []
    words += ["--positioning"] if config.motion.source == "external" else []
    return words


def is_free(port: int) -> bool:
    try:
        socket.create_server(("127.0.0.1", port)).close()
    except OSError:
        return False
    return True


def check_given(options: argparse.Namespace, config: Config) -> None:
    """Before anything starts. Raises ConfigError, OSError, KeyError, ValueError."""
    scenes = importlib.import_module("fakes.scenes.scene")  # not installed with this command
    scenes.load_scene(options.scene, options.seed)
    if options.record:
        with_changes(config, record={"path": recorded_to(options.record)})
    if options.out is not None and not options.out.is_dir() and options.out.exists():
        raise ValueError(f"--out: must be a folder, {str(options.out)!r} is a file")


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 ended as it was told to, 1 something failed, 2 wrong use."""
    parser = parser_of("demo", __doc__, "mapod demo --scene office --seed 3 --seconds 60")
    others = ", ".join(f"{scene} for {robot}" for robot, scene in SCENES.items())
    parser.add_world(f"{USUAL_SCENE}; {others}")
    parser.add_seconds("until Ctrl-C; 20 without a terminal")
    parser.add_config(SHIPPED_CONFIG)
    parser.add_argument("--robot", choices=ROBOTS, help="settings of robots/, not of --config")
    parser.add_out("a folder for what all of them say (default: one that stays if one fails)")
    parser.add_argument("--serial", action="store_true", help="planner on a pty, not on UDP")
    parser.add_argument("--record", metavar="FILE", help="record the run: a file, x.mcap")
    parser.add_argument("--drive", action="store_true", help="drive by keyboard or page")
    parser.add_argument("--no-page", action="store_true", help="no live page beside it")
    options = parser.parse_args(arguments)
    if why := lacks_simulation():
        return fail("demo", why)
    if options.robot:
        options.config = ROBOTS[options.robot]
    try:
        config = configured(options.config)
    except ConfigError as error:
        return fail("demo", error)
    options.cleans = config.coverage is not None and config.coverage.plan
    options.scene = options.scene or SCENES.get(options.robot, USUAL_SCENE)
    if options.drive and config.motion.source != "wheels":
        return fail(
            "demo", f"--drive: mapod drives nothing with motion.source = {config.motion.source!r}"
        )
    try:
        check_given(options, config)
    except (ConfigError, OSError, KeyError, ValueError) as error:
        return fail("demo", error)
    return run(options, world_words(options, config), APP, Console())
