"""The conformance tests of section 14 on mapod's own receivers, and the soak.

    python -m tools.conformance                       all tests, Python and C, in process
    python -m tools.conformance --soak 1000000        both receivers on rough wires, 16 legs
    python -m tools.conformance --soak 1000000 --seed 7 --leg 3     one leg again

What fails is told with seed, leg, tick and the newest bytes; the same seed and leg fail again.
"""

import argparse
import sys
import time
from collections import Counter
from functools import partial
from itertools import product
from typing import Protocol

from mapod_link.receiver import Receiver as PythonReceiver
from tools.conformance.c_receiver import CReceiver
from tools.conformance.exam import DeviationError, Exam
from tools.conformance.in_process import InProcess, Receiver
from tools.conformance.soak import Soak, leg_of
from tools.conformance.suite import CHECKS, meet, run
from tools.rig.planner.build import MissingToolError

LEGS = 16
KEY, NONCE = bytes(range(32)), 0x11223344


class Make(Protocol):
    """A receiver after so many starts."""

    def __call__(self, start: int, key: bytes | None) -> Receiver: ...


RECEIVERS: dict[str, Make] = {
    "Python": lambda start, key: PythonReceiver(NONCE + start, key=key),
    "C": lambda start, key: CReceiver(NONCE + start, key=key),
}


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0, or 1 if something failed, 2 if the C receiver can't be built."""
    parser = argparse.ArgumentParser(
        prog="tools.conformance",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--soak", type=int, default=0, help="frames in all; 0: the tests instead")
    parser.add_argument("--seed", type=int, default=1, help="of all that is drawn by chance (1)")
    parser.add_argument("--leg", type=int, help=f"only this one of the soak's {LEGS} legs")
    options = parser.parse_args(arguments)
    try:
        if options.soak:
            legs = range(LEGS) if options.leg is None else [options.leg]
            return soak(options.soak, options.seed, list(legs))
        return examine(options.seed)
    except MissingToolError as error:
        print(f"conformance: {error}")
        return 2


def examine(seed: int) -> int:
    """All checks on both receivers, on datagrams and on a stream, with and without a key."""
    failures = 0
    for (name, make), key, datagrams in product(RECEIVERS.items(), (None, KEY), (True, False)):
        wire = "datagrams" if datagrams else "stream"
        print(f"\n{name}, {wire}, {'AUTH' if key else 'no AUTH'}", flush=True)
        bench = InProcess(partial(make, key=key), datagrams=datagrams)
        failures += _examined(Exam(bench, seed=seed, key=key), seed)
    return 1 if failures else 0


def _examined(exam: Exam, seed: int) -> int:
    """One receiver; gives how many checks failed."""
    if why := meet(exam):
        print(f"  {why}")
        return 1
    failures = 0
    for verdict in run(exam, CHECKS, seed):
        check = verdict.check
        print(f"  {check.number:<3} {check.name:<28} {verdict.outcome:<8} {verdict.words}")
        if verdict.failure:
            failures += 1
            _tell(verdict.failure)
    return failures


def soak(frames: int, seed: int, legs: list[int]) -> int:
    """So many frames in all legs together; stops at the first failure."""
    print(f"conformance: soak of {frames} frames in {LEGS} legs, seed {seed}", flush=True)
    sums: Counter[str] = Counter()
    for number in legs:
        begun_s = time.monotonic()
        leg = Soak(leg_of(number, seed), seed)
        try:
            leg.run(-(-frames // LEGS))
        except DeviationError as failure:
            _tell(failure)
            print(f"again by: --soak {frames} --seed {seed} --leg {number}")
            return 1
        sums.update(leg.sums())
        told = ", ".join(f"{count} {name}" for name, count in leg.sums().items())
        seconds = time.monotonic() - begun_s
        print(f"  leg {number:>2}: {leg.leg.words}\n          {told}; {seconds:.0f} s", flush=True)
    print("conformance: all legs: " + ", ".join(f"{count} {name}" for name, count in sums.items()))
    return 0


def _tell(failure: DeviationError) -> None:
    print(f"    {failure.what}\n    expected {failure.expected}\n    got      {failure.got}")
    for data in failure.frames:
        print(f"      {data.hex(' ')}")


if __name__ == "__main__":
    sys.exit(main())
