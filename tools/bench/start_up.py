"""What a start of the app costs, in CPU time, and the peers that it is compared with in one run."""

import os
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np

from tools.cli.options import ROOT

ROUNDS = 3  # of starts; the least counts
PEER_ROUNDS, PEER_STEPS = 30, 3000
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


def peer_s() -> float:
    """CPU time of one round of a fixed workload like the app's: Python over small arrays."""
    return min(_peer_round_s() for _ in range(PEER_ROUNDS))


def _peer_round_s() -> float:
    values, kept, total = np.arange(64.0), dict[int, float](), 0.0
    begun_s = time.thread_time()
    for step in range(PEER_STEPS):
        total += float(np.add(values, step)[step % 64])
        kept[step % 97] = total
    return time.thread_time() - begun_s
