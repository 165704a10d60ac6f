"""Which version of mapod this is."""

from main import version
from tools.cli.options import parser_of


def main(arguments: list[str] | None = None) -> int:
    """Exit status."""
    parser_of("version", __doc__, "mapod version").parse_args(arguments)
    print(f"mapod {version()}")
    return 0
