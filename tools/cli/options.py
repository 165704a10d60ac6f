"""How the arguments of all commands of `mapod` are written, and what wrong use is answered with.

An option that several commands have is declared here, so that it means the same everywhere. Wrong
use ends with status 2 and one line.
"""

import argparse
import contextlib
import errno
import importlib.util
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn, TypeVar

from config_file import load_config, read_settings
from core.config import Config, ConfigError

ROOT = Path(__file__).resolve().parents[2]  # of the sources; of the package where it is installed
SHIPPED_CONFIG = ROOT / "mapod.toml"
ROBOTS = {path.stem: path for path in sorted((ROOT / "robots").glob("*.toml"))}  # others' settings
USAGE = 2  # exit status
Value = TypeVar("Value")
ROOMS = __package__.removesuffix("tools.cli")  # "mapod." where it is installed
IN_THE_SOURCES = "needs the simulation, which a checkout has: `make setup`, then .venv/bin/mapod"
NOT_INSTALLED = "needs the simulation's libraries: pip install -e '.[sim]'"


class Parser(argparse.ArgumentParser):
    """Tells what is wrong in one line; has the options that several commands have."""

    def error(self, message: str) -> NoReturn:
        self.exit(USAGE, f"{self.prog}: {message} ({self.prog} --help)\n")

    def add_config(self, default: Path = Path("mapod.toml")) -> None:
        shown = "the shipped one" if default == SHIPPED_CONFIG else default
        self.add_argument(
            "--config", type=Path, default=default, help=f"the robot's settings (default: {shown})"
        )

    def add_port(self, example: str, default: str | None = None) -> None:
        shown = default or "that of --config"
        self.add_argument("--port", default=default, help=f"such as {example} (default: {shown})")

    def add_actions(self, port: str) -> Callable[[str, str], "Parser"]:
        """Gives `action(name, about)`, which adds a subcommand with --port and --config."""
        what = self.add_subparsers(dest="what", required=True, metavar="WHAT")

        def action(name: str, about: str) -> Parser:
            one = what.add_parser(name, help=about, description=about, allow_abbrev=False)
            one.add_port(port)
            one.add_config()
            return one

        return action

    def add_seconds(self, end: str, default: float | None = None) -> None:
        self.add_argument("--seconds", type=a_span, default=default, help=f"how long ({end})")

    def add_world(self, usual: str) -> None:
        self.add_argument("--scene", help=f"which world (default: {usual})")
        self.add_argument("--seed", type=a_seed, default=1, help="of all chance (default: 1)")

    def add_out(self, what: str, default: Path | None = None) -> None:
        shown = f" (default: {default})" if default else ""
        self.add_argument("--out", type=Path, default=default, help=f"{what}{shown}")

    def add_key(self) -> None:
        about = "32 bytes, or 64 hex digits: signed frames"
        self.add_argument("--key-file", default="", help=about)


def parser_of(name: str, about: str | None, *examples: str) -> Parser:
    return Parser(
        prog=f"mapod {name}",
        description=about,
        epilog="\n  ".join([f"example{'s' * (len(examples) > 1)}:", *examples]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def value_of(
    text: str, convert: Callable[[str], Value], is_allowed: Callable[[Value], bool], allowed: str
) -> Value:
    """Raises ArgumentTypeError: what was given, and what is allowed."""
    with contextlib.suppress(ValueError):
        value = convert(text)
        if is_allowed(value):
            return value
    raise argparse.ArgumentTypeError(f"must be {allowed}, is {text!r}")


def number_in(low: float, high: float) -> Callable[[str], float]:
    def number(text: str) -> float:
        allowed = f"from {low:g} to {high:g}"
        return value_of(text, float, lambda value: low <= value <= high, allowed)

    return number


def whole_in(low: int, high: int) -> Callable[[str], int]:
    def number(text: str) -> int:
        allowed = f"a whole number from {low} to {high}"
        return value_of(text, int, lambda value: low <= value <= high, allowed)

    return number


def a_span(text: str) -> float:
    return value_of(text, float, lambda value: 0.0 < value < math.inf, "above 0")


def a_seed(text: str) -> int:
    return value_of(text, int, lambda value: value >= 0, "a whole number, 0 or more")


def settings_text(path: Path) -> str:
    """A settings file's text. Raises ConfigError: what is wrong with it, with its name."""
    try:
        text = read_settings(path)
        load_config(text)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return text


def configured(path: Path) -> Config:
    """The settings in a file. Raises ConfigError: what is wrong with it, with its name."""
    return load_config(settings_text(path))


def lacks_simulation() -> str:
    """Why what needs fakes and world cannot run here, in words; "" where it can."""
    if importlib.util.find_spec(f"{ROOMS}fakes") is None:
        return IN_THE_SOURCES
    return "" if importlib.util.find_spec("mujoco") else NOT_INSTALLED


def fail(command: str, reason: object, status: int = USAGE) -> int:
    if isinstance(reason, BrokenPipeError):  # nobody reads on: for `command.main`
        raise reason
    words = words_of(reason) if isinstance(reason, OSError) else reason
    print(f"mapod {command}: {words}", file=sys.stderr, flush=True)
    return status


def words_of(error: OSError) -> str:
    """What it is about and what is wrong with it, without the system's number."""
    if error.errno is None:
        return str(error)
    why = "no such file or folder" if error.errno == errno.ENOENT else error.strerror
    return str(why) if error.filename is None else f"{error.filename}: {why}"


def cannot_be_written(*files: tuple[str, Path | None, str]) -> str:
    """Which of the files that are asked for can't be, before any work is done; or "".

    Args:
        files: option, what it was given, and how its name must end ("": as it likes).
    """
    for option, path, ending in files:
        if path is None:
            continue
        if ending and path.suffix.lower() != ending:
            return f"{option} {path}: must end with {ending}"
        if path.is_dir() or not path.parent.is_dir():
            return f"{option} {path}: must be a file in a folder that is there"
    return ""
