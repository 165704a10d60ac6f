"""Faults are put into the files of `rooms`, one at a time; their tests must see each.

`python -m tests.mutation` takes all, `--count 40 --seed 1` a sample, `--only PATH` one file. Exit
status 1 where a mutant lives that `equivalent` does not list, or where one listed there is none.
All runs in copies of one process that has collected the tests: first what is quick and has seen
many mutants; kernels run as Python.
"""

import argparse
import gc
import importlib
import json
import mmap
import os
import random
import signal
import struct
import sys
import time
import types
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests import ROOT
from tests.mutation.equivalent import EQUIVALENT
from tests.mutation.mutants import Mutant, mutants_of
from tests.mutation.rooms import TESTS_OF

TOLD_EVERY = 50  # mutants; all that live are told
PATIENCE, LEAST_S = 5, 1.0  # a test takes so many times its own seconds of CPU: it goes for ever


def graft(new: Any, old: Any) -> int:
    """Let the functions of a module or class be those of another one; how many changed."""
    changed = 0
    for name, value in vars(new).items():
        was = vars(old).get(name)
        if isinstance(value, property):
            value, was = value.fget, was.fget
        if isinstance(value, types.FunctionType) and value.__module__ == "mutant":
            defaults = value.__defaults__, value.__kwdefaults__
            same = value.__code__ == was.__code__
            changed += not same or defaults != (was.__defaults__, was.__kwdefaults__)
            was.__code__, (was.__defaults__, was.__kwdefaults__) = value.__code__, defaults
        elif isinstance(value, type) and value.__module__ == "mutant":
            changed += graft(value, was)
    return changed


def put_in(mutant: Mutant) -> None:
    """Change the module, wherever its functions are known already."""
    new = types.ModuleType("mutant")
    sys.modules["mutant"] = new
    exec(compile(mutant.source, mutant.path, "exec"), vars(new))
    name = mutant.path.removesuffix(".py").replace("/", ".")
    assert graft(new, importlib.import_module(name)), f"{mutant.name} was not put in"


class Hunt:
    """Instead of running the tests once, runs them for each mutant."""

    def __init__(self, chosen: list[Mutant], jobs: int) -> None:
        self.chosen, self.jobs, self.tests_of = chosen, jobs, TESTS_OF
        self.seconds: dict[str, float] = {}
        self.living: list[str] = []
        self._saw = mmap.mmap(-1, 4 * len(chosen))  # by mutant: which test saw it; copies share it
        self._seen_by = Counter[str]()  # mutants, by test

    def pytest_configure(self, config: pytest.Config) -> None:
        """Nobody reads how a test failed: that would take longer than most tests."""
        config.option.tbstyle = "no"

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """What each test costs, in seconds of CPU: a busy machine makes no test patient."""
        began_s = time.process_time()
        done = yield
        self.seconds[item.nodeid] = time.process_time() - began_s
        return done

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """In copies of this process: the tests without a fault, then with each."""
        if session.testsfailed:
            raise session.Failed("the tests cannot be collected")
        self.seconds = self._seconds_without(session)
        if not self.seconds:
            raise session.Failed("a test fails without any mutant")
        gc.freeze()  # a copy that collects would copy all pages
        under_way: dict[int, tuple[int, list[pytest.Item]]] = {}
        for done, (number, lives) in enumerate(self._judged(session, under_way), 1):
            mutant = self.chosen[number]
            if lives:
                self.living.append(mutant.name)
            if lives or done % TOLD_EVERY == 0:
                fate = "LIVES" if lives else "seen"
                print(f"{done:4} of {len(self.chosen)}: {fate} {mutant.name}", flush=True)
        return True

    def _seconds_without(self, session: pytest.Session) -> dict[str, float]:
        """What each test costs without a fault; nothing when one fails."""
        reader, writer = os.pipe()
        pid = self._fork(session, session.items, None, writer)
        os.close(writer)
        with open(reader, encoding="utf-8") as file:
            told = file.read()  # before the wait: a pipe holds 64 kB, and then its writer waits
        os.waitpid(pid, 0)
        seconds: dict[str, float] = json.loads(told or "{}")
        return seconds

    def _judged(
        self, session: pytest.Session, under_way: dict[int, tuple[int, list[pytest.Item]]]
    ) -> Iterator[tuple[int, bool]]:
        for number in range(len(self.chosen) + self.jobs):
            mutant = self.chosen[number] if number < len(self.chosen) else None
            if mutant is not None:
                items = [
                    i for i in session.items if _file(i).startswith(self.tests_of[mutant.path])
                ]
                items.sort(key=lambda i: self.seconds[i.nodeid] / (1 + self._seen_by[i.nodeid]))
                under_way[self._fork(session, items, number, None)] = number, items
            if under_way and (mutant is None or len(under_way) == self.jobs):
                pid, status = os.wait()
                judged, ran = under_way.pop(pid)
                [seen_by] = struct.unpack_from("i", self._saw, 4 * judged)
                if seen_by > 0:
                    self._seen_by[ran[seen_by - 1].nodeid] += 1
                yield judged, status == 0

    def _fork(
        self,
        session: pytest.Session,
        items: list[pytest.Item],
        number: int | None,
        writer: int | None,
    ) -> int:
        """Run tests in a copy of this process, until one fails; its process id."""
        sys.stdout.flush()
        if pid := os.fork():
            return pid
        status, mutant = 1, None if number is None else self.chosen[number]
        try:
            if mutant is not None:
                put_in(mutant)
            for k, (item, then) in enumerate(zip(items, [*items[1:], None], strict=True), 1):
                if mutant is not None:
                    limit_s = LEAST_S + PATIENCE * self.seconds[item.nodeid]
                    signal.setitimer(signal.ITIMER_PROF, limit_s)
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=then)
                if session.testsfailed:
                    if number is not None:
                        struct.pack_into("i", self._saw, 4 * number, k)
                    break
            status = 1 if session.testsfailed else 0
            if writer is not None and status == 0:
                with open(writer, "w", encoding="utf-8") as file:
                    json.dump(self.seconds, file)
        except BaseException as error:  # noqa: BLE001
            os.write(2, f"{mutant and mutant.name}: {error!r}\n".encode())
        finally:
            os._exit(status)


def _file(item: pytest.Item) -> str:
    return item.path.relative_to(ROOT).as_posix()


def main() -> int:
    """Tell which mutants live; 0 when none does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=0, help="how many (all)")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (1)")
    parser.add_argument("--only", choices=list(TESTS_OF), help="mutants of one file")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at a time")
    args = parser.parse_args()
    paths = [args.only] if args.only else list(TESTS_OF)
    whole = [m for path in paths for m in mutants_of(path, Path(ROOT / path).read_text("utf-8"))]
    none = [n for n in EQUIVALENT if n.split()[0] in paths and n not in {m.name for m in whole}]
    chosen = [mutant for mutant in whole if mutant.name not in EQUIVALENT]
    if 0 < args.count < len(chosen):
        chosen = random.Random(args.seed).sample(chosen, args.count)
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    hunt = Hunt(chosen, args.jobs)
    tests = dict.fromkeys(test for path in paths for test in hunt.tests_of[path])
    options = [
        "--override-ini=addopts=",
        "-p",
        "no:terminal",
        "-p",
        "no:xdist",
        "-p",
        "no:cacheprovider",
        "-m",
        "not slow",
    ]
    status = pytest.main([*options, "--hypothesis-profile=mutants", *tests], plugins=[hunt])
    if status:
        print("the tests fail without any mutant")
        return 2
    for name in none:
        print(f"there is no such mutant any more: {name}")
    for name in hunt.living:
        print(f"LIVES {name}")
    print(f"{len(chosen) - len(hunt.living)} of {len(chosen)} mutants are seen by the tests")
    return 1 if hunt.living or none else 0


if __name__ == "__main__":
    sys.exit(main())
