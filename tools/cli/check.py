"""Say in words what the settings describe, or what is wrong with them. Opens no port."""

from main import run as run_app
from tools.cli.options import add_config, parser_of


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 the settings can be used, 2 they can't."""
    parser = parser_of("check", __doc__, "mapod check --config robots/mine.toml")
    add_config(parser)
    options = parser.parse_args(arguments)
    return run_app(["--config", str(options.config), "--check"])
