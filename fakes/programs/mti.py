"""The fake Xsens MTi as a program: `python -m fakes.programs.mti --help`."""

import sys

from fakes.programs.program import run_attitude

if __name__ == "__main__":
    sys.exit(run_attitude())
