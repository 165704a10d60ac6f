"""Run the robot: sensors in, obstacle map out, until Ctrl-C or SIGTERM; SIGUSR1 saves the map."""

import argparse

from main import run as run_app
from tools.cli.options import add_config, parser_of


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """What a live run takes."""
    add_config(parser)
    parser.add_argument(
        "--load-map",
        metavar="FILE",
        help="go on from a saved map; the robot must stand where it stood then",
    )
    parser.add_argument("--save-map", metavar="FILE", help="save the map at the end and on SIGUSR1")


def arguments_of(options: argparse.Namespace) -> list[str]:
    """The same for the app's own command line."""
    given = ["--config", str(options.config)]
    for name in ("load_map", "save_map"):
        if getattr(options, name):
            given += [f"--{name.replace('_', '-')}", getattr(options, name)]
    return given


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 ended as it was told to, 2 the settings can't be used."""
    parser = parser_of("run", __doc__, "mapod run --config mapod.toml --save-map hall.map")
    add_run_options(parser)
    return run_app(arguments_of(parser.parse_args(arguments)))
