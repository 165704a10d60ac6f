"""What importing the app costs, beside what its libraries alone cost in the same run."""

import os
import subprocess
import sys
from dataclasses import dataclass

from tools.cli.options import ROOT

ROUNDS = 3  # of starts; the least counts
LIBRARIES = "import numba, numpy"
COUNTED = "import main, sys; print(len(sys.modules))"


@dataclass(frozen=True, slots=True)
class Imports:
    """Of `import main`."""

    modules: int
    cpu_s: float
    libraries_cpu_s: float  # of the peer, `import numba, numpy`

    @property
    def ratio(self) -> float:
        return self.cpu_s / self.libraries_cpu_s


def imports() -> Imports:
    """A process each, the interpreter's own start included in both; compiled before."""
    runs = [(_run(COUNTED), _run(LIBRARIES)) for _ in range(1 + ROUNDS)][1:]
    return Imports(
        modules=int(runs[0][0][0]),
        cpu_s=min(app[1] for app, _ in runs),
        libraries_cpu_s=min(libraries[1] for _, libraries in runs),
    )


def _run(code: str) -> tuple[str, float]:
    """What it printed, and the CPU time that it took."""
    before = os.times()
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True
    )
    after = os.times()
    spent_s = after.children_user + after.children_system
    return done.stdout, spent_s - before.children_user - before.children_system
