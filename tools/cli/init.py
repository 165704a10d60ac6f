"""Write mapod.toml, the settings of a robot, to be edited. What is there is never overwritten."""

from pathlib import Path

from tools.cli.options import ROOT, SHIPPED_CONFIG, add_out, fail, parser_of

HEADER = ROOT / "hw" / "mcu" / "mapod_link.h"


def main(arguments: list[str] | None = None) -> int:
    parser = parser_of("init", __doc__, "mapod init --out mapod.toml")
    add_out(parser, "the file to write", Path("mapod.toml"))
    path: Path = parser.parse_args(arguments).out
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(SHIPPED_CONFIG.read_text(encoding="utf-8"))
    except FileExistsError:
        return fail("init", f"{path} is there already; it stays as it is")
    except OSError as error:
        return fail("init", f"{path}: {error.strerror}")
    print(f"{path} is written. Next: mapod devices, then mapod check --config {path}")
    print(f"A planner in C includes {HEADER}; example.c lies beside it")
    return 0
