"""The fake Roboteq AX3500 as a program: `python -m fakes.programs.ax3500 --help`."""

import sys

from fakes.programs.program import run_drive

if __name__ == "__main__":
    sys.exit(run_drive())
