"""Runs the paper's experiments and more: `python -m tools.experiments [--only 5.3] [--quick]`.

Writes docs/experiments.md and docs/pictures. With --only the table of what was run is printed, and
only its pictures are written; with --quick they go to a temporary folder.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from tools.docs.pictures import PICTURES, record
from tools.experiments.report import document, merged, stale_pictures, table
from tools.experiments.runner import experiments, run_all

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "experiments.md"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tools.experiments", description=__doc__)
    parser.add_argument("--only", default="", help="those whose name begins so: 5.3, '7 ramps'")
    parser.add_argument("--quick", action="store_true", help="short drives; writes no document")
    options = parser.parse_args(arguments)
    names = [name for name in experiments() if name.startswith(options.only)]
    if not names:
        print(f"no experiment begins with {options.only!r}: there are", *experiments(), sep="\n  ")
        return 2
    print(f"mapod: {len(names)} experiments, both methods on the same bytes; some minutes")
    folder = Path(tempfile.mkdtemp(prefix="mapod-pictures-")) if options.quick else PICTURES
    outcomes = merged(run_all(names, options.quick, folder))
    if not options.quick:
        drawn = [file for outcome in outcomes for file, _ in outcome.pictures]
        record(drawn, "make experiments", ["tools/experiments/pictures.py"])
    if options.only or options.quick:
        print("\n".join(table([row for outcome in outcomes for row in outcome.rows])))
        print(f"mapod: pictures in {folder}")
    else:
        DOCUMENT.write_text(document(outcomes), encoding="utf-8")
        for path in stale_pictures(PICTURES, outcomes):
            path.unlink()
        print(f"mapod: written to {DOCUMENT.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
