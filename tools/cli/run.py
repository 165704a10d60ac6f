"""The app's own command line as commands: run, record, check, warm and version; and init.

`mapod replay FILE` plays what `record` keeps: all that moved the app, but not the planner's key.
"""

import argparse
import os
import signal
import sys
import threading
from pathlib import Path

from config_file import load_config
from core.config import ConfigError
from main import RECORD, UNATTENDED, add_map_options
from main import run as run_app
from tools.cli.options import ROBOTS, ROOT, SHIPPED_CONFIG, Parser, fail, parser_of
from tools.settings_merge import DEVICES, merged
from version import version as app_version

FILES = "load_map", "save_map", "load_objects", "save_objects", "record"  # options of the app
HEADER = ROOT / "hw" / "mcu" / "mapod_link.h"


def run(arguments: list[str]) -> int:
    """Exit status: 0 ended as it was told to, 2 the settings can't be used."""
    about = "Run the robot: sensors in, obstacle map out, until Ctrl-C, SIGTERM or SIGHUP."
    parser = parser_of("run", about, "mapod run --config mapod.toml --save-map hall.map")
    _add_run_options(parser)
    parser.add_argument("--record", metavar="FILE", help=RECORD)
    parser.add_argument("--unattended", action="store_true", help=UNATTENDED)
    options = parser.parse_args(arguments)
    return run_app(_arguments_of(options) + ["--unattended"] * options.unattended)


def record(arguments: list[str]) -> int:
    """Exit status: 0 ended as it was told to, 1 recorded in part, 2 wrong use."""
    about = "Run the robot as `mapod run` does, and keep every byte of every port in a file."
    parser = parser_of("record", about, "mapod record --out hall.mcap --seconds 60")
    _add_run_options(parser)
    parser.add_seconds("until Ctrl-C")
    parser.add_out("the recording", Path("mapod.mcap"))
    options = parser.parse_args(arguments)
    options.record = str(options.out)

    def at_start() -> None:
        if options.seconds:
            end = threading.Timer(options.seconds, os.kill, (os.getpid(), signal.SIGINT))
            end.daemon = True
            end.start()

    troubles: list[str] = []
    status = run_app(_arguments_of(options), at_start, troubles.append)
    if status == 0 and any(troubles):
        return fail("record", f"{options.out} ends early: {troubles[0]}", 1)
    if status == 0 and options.out.is_file():
        print(f"mapod: {options.out}: {options.out.stat().st_size / 1e6:.1f} MB", file=sys.stderr)
    return status


def check(arguments: list[str]) -> int:
    about = "Say in words what the settings describe, or what is wrong with them. Opens no port."
    return _with_settings("check", about, arguments)


def warm(arguments: list[str]) -> int:
    about = "Compile what `mapod run` needs with these settings, so that its first start is quick."
    return _with_settings("warm", about, arguments)


def version(arguments: list[str]) -> int:
    parser_of("version", "Which version of mapod this is.", "mapod version").parse_args(arguments)
    print(f"mapod {app_version()}")
    return 0


def _with_settings(command: str, about: str, arguments: list[str]) -> int:
    parser = parser_of(command, about, f"mapod {command} --config robots/mine.toml")
    parser.add_config()
    options = parser.parse_args(arguments)
    return run_app(["--config", str(options.config), f"--{command}"])


def _add_run_options(parser: Parser) -> None:
    parser.add_config()
    add_map_options(parser)


def _arguments_of(options: argparse.Namespace) -> list[str]:
    given = ["--config", str(options.config)]
    for name in FILES:
        path = getattr(options, name)
        given += [f"--{name.replace('_', '-')}", path] if path else []
    return given


def init(arguments: list[str] | None = None) -> int:
    """Exit status: 0 written, 2 not."""
    about = "Write mapod.toml, the settings of a robot, to be edited; never over what is there."
    examples = "mapod init --out mapod.toml", "mapod init --from old.toml --out mapod.toml"
    parser = parser_of("init", about, *examples)
    older = "settings of an older version: kept as they are, and what is new is added"
    parser.add_argument("--from", type=Path, dest="older", metavar="FILE", help=older)
    with_from = "with --from, what is new is as there, and its drivers must be the same"
    parser.add_argument("--robot", choices=ROBOTS, help=f"one of robots/; {with_from}")
    parser.add_out("the file to write", Path("mapod.toml"))
    options = parser.parse_args(arguments)
    path: Path = options.out
    try:
        text, added = ROBOTS.get(options.robot, SHIPPED_CONFIG).read_bytes(), list[str]()
        if options.older:
            text, added = _merged(options.older.read_bytes(), text, options.robot)
        with path.open("xb") as file:
            file.write(text)
    except FileExistsError:
        return fail("init", f"{path} is there already; it stays as it is")
    except (ConfigError, UnicodeDecodeError) as error:
        return fail("init", f"{options.older}: {error}")
    except OSError as error:
        return fail("init", f"{error.filename or path}: {error.strerror}")
    for line in added:
        print(f"new setting: {line}")
    if options.older:
        new = "the new settings are those above" if added else "no setting is new"
        print(f"{path} is written: {new}")
    else:
        print(f"{path} is written. Next: mapod devices, then mapod check --config {path}")
        print(f"A planner in C includes {HEADER}; example.c lies beside it")
    return 0


def _merged(older: bytes, shipped: bytes, robot: str | None) -> tuple[bytes, list[str]]:
    """The text, and what is new in it. Raises ConfigError, UnicodeDecodeError."""
    result = merged(older.decode("utf-8-sig"), shipped.decode("utf-8"))
    if robot is not None:
        own, its = load_config(result.text), load_config(shipped.decode("utf-8"))
        for section in DEVICES:
            driver, other = (getattr(config, section).driver for config in (own, its))
            if driver != other:
                raise ConfigError(f"[{section}] driver is {driver!r}, of --robot {robot} {other!r}")
    return result.text.encode("utf-8"), result.added
