"""Faults are put into the files of `rooms`, one at a time; their tests must see each.

`python -m tests.mutation --count 40 --seed 1` takes a sample, `--count 0` all; `--only PATH` one
file. Exit status 1 where a mutant lives that `equivalent` does not list. Each runs in a copy of the
tree. Kernels of the map run as Python; those of driving are compiled anew, for their tests drive.
"""

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from tests import ROOT
from tests.mutation.equivalent import EQUIVALENT
from tests.mutation.mutants import Mutant, mutants_of
from tests.mutation.rooms import BEAMS, TESTS_OF

TOO_LONG_S = 300.0  # a mutant that goes round for ever is seen as well
LEFT_OUT = shutil.ignore_patterns(".*", "*.pyc", "docs")


def lives(mutant: Mutant, folder: Path) -> bool:
    """Whether all tests pass with a fault in a copy of the tree."""
    file = folder / mutant.path
    file.write_text(mutant.source, encoding="utf-8")
    tests = TESTS_OF[mutant.path]
    python = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    if tests is BEAMS:
        python["NUMBA_DISABLE_JIT"] = "1"
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        ran = subprocess.run(
            command, cwd=folder, env=python, capture_output=True, timeout=TOO_LONG_S
        )
        return ran.returncode == 0
    except subprocess.TimeoutExpired:
        return False
    finally:
        shutil.copy(ROOT / mutant.path, file)


def sample(count: int, seed: int, only: str | None) -> list[Mutant]:
    """Mutants that are not equivalent, by chance but the same for a seed."""
    paths = [only] if only else list(TESTS_OF)
    all_of = [
        mutant
        for path in paths
        for mutant in mutants_of(path, (ROOT / path).read_text(encoding="utf-8"))
        if mutant.name not in EQUIVALENT
    ]
    return random.Random(seed).sample(all_of, count) if 0 < count < len(all_of) else all_of


def main() -> int:
    """Tell which mutants live; 0 when none does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="how many (40); 0: all")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (1)")
    parser.add_argument("--only", choices=list(TESTS_OF), help="mutants of one file")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at a time")
    args = parser.parse_args()
    chosen, living = sample(args.count, args.seed, args.only), []
    with tempfile.TemporaryDirectory() as temporary:
        folders: SimpleQueue[Path] = SimpleQueue()
        for k in range(args.jobs):
            folders.put(Path(shutil.copytree(ROOT, Path(temporary) / str(k), ignore=LEFT_OUT)))

        def judge(mutant: Mutant) -> bool:
            folder = folders.get()
            try:
                return lives(mutant, folder)
            finally:
                folders.put(folder)

        for path in (next(iter(TESTS_OF)), next(reversed(TESTS_OF))):  # one of each room
            plain = Mutant(path, "none", (ROOT / path).read_text(encoding="utf-8"))
            if not judge(plain):
                print(f"the tests of {path} fail without any mutant")
                return 2
        with ThreadPoolExecutor(args.jobs) as pool:
            for k, (mutant, alive) in enumerate(zip(chosen, pool.map(judge, chosen), strict=True)):
                if alive:
                    living.append(mutant)
                print(f"{k + 1:4} of {len(chosen)} {'LIVES' if alive else 'seen '} {mutant.name}")
    print(f"{len(chosen) - len(living)} of {len(chosen)} mutants are seen by the tests")
    return 1 if living else 0


if __name__ == "__main__":
    sys.exit(main())
