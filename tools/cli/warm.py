"""Compile what `mapod run` needs with these settings, so that its first start is quick."""

from main import run as run_app
from tools.cli.options import add_config, parser_of


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 done, 2 the settings can't be used."""
    parser = parser_of("warm", __doc__, "mapod warm --config robots/mine.toml")
    add_config(parser)
    options = parser.parse_args(arguments)
    return run_app(["--config", str(options.config), "--warm"])
