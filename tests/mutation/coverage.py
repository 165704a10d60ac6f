"""Every line and branch of the files in `rooms` is run: `python -m tests.mutation.coverage`.

Kernels run as Python, for no tool looks into machine code. Exit status 1 where one is missing.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests import ROOT
from tests.mutation.rooms import TESTS_OF


def main() -> int:
    """Run the tests, tell what they leave out; 0 when that is nothing."""
    rooms = TESTS_OF
    tests = list(dict.fromkeys(test for tests in rooms.values() for test in tests))
    own = ",".join(rooms)
    python = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    with tempfile.TemporaryDirectory() as folder:
        run = [sys.executable, "-m", "coverage"]
        data = f"--data-file={Path(folder) / 'data'}"
        pytest = ["-m", "pytest", "-q", "-rN", "-p", "no:cacheprovider"]
        pytest += ["--hypothesis-profile=mutants", *tests]
        ran = subprocess.run(
            [*run, "run", data, "--branch", f"--include={own}", *pytest], env=python, cwd=ROOT
        )
        if ran.returncode:
            return ran.returncode
        told = subprocess.run(
            [*run, "report", data, "--show-missing", "--fail-under=100", "--precision=2"], cwd=ROOT
        )
    return 1 if told.returncode else 0


if __name__ == "__main__":
    sys.exit(main())
