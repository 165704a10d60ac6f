"""Maps of centimetres by each method: `python -m tools.experiments.terrain [--quick]`.

Writes the tables of docs/terrain.md and two pictures. With --quick, a few seeds: the tables are
printed, and the pictures go to a temporary folder.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from tools.docs.pictures import PICTURES, record
from tools.experiments.terrain.pictures import draw_all
from tools.experiments.terrain.report import DOCUMENT, tables, with_tables
from tools.experiments.terrain.runs import FULL, QUICK, run_all

DRAWN_BY = ["tools/experiments/terrain/pictures.py"]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tools.experiments.terrain", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few seeds; writes no document")
    parser.add_argument("--jobs", type=int, default=0, help="processes; 0: one a core")
    options = parser.parse_args(arguments)
    told = tables(run_all(QUICK if options.quick else FULL, options.jobs))
    if options.quick:
        folder = Path(tempfile.mkdtemp(prefix="mapod-pictures-"))
        draw_all(folder)
        print(f"{told}\nmapod: pictures in {folder}")
        return 0
    DOCUMENT.write_text(with_tables(DOCUMENT.read_text(encoding="utf-8"), told), encoding="utf-8")
    record(draw_all(PICTURES), "make terrain", DRAWN_BY)
    print(f"mapod: written to {DOCUMENT.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
