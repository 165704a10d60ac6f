"""The fake SICK LMS1xx as a program: `python -m fakes.programs.lms1xx --help`."""

import sys

from fakes.programs.program import run_scanner

if __name__ == "__main__":
    sys.exit(run_scanner())
