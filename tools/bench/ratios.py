"""What mapod costs beside others' ways, as ratios that are kept: `python -m tools.bench.ratios`.

A ratio is the median of what a round of ours took against the round of the other beside it, in CPU
time: what else a machine does meets both alike. History: docs/bench-ratios.jsonl; it has no times.
One that got worse by WARNED is told. Only one beyond its limit fails (--check): that is as far
again as the passes of the kept figure lay apart, and LEAST_LIMIT at least.
"""

import argparse
import math
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from tools.bench.history import keep, kept_entries, machine
from tools.bench.pairs import Pair, Work, pairs
from tools.bench.ratio_picture import PICTURE, draw
from tools.checkout import commit
from tools.cli.options import ROOT

FILE = ROOT / "docs" / "bench-ratios.jsonl"
WARNED, LEAST_LIMIT = 1.2, 1.6  # times the kept figure
PASSES, SCANS = 5, 120
LONGEST_S = 3.0  # of a pair
Figure = Sequence[float]  # median of the passes, least, most


def spent_s(work: Work, k: int) -> float:
    """Of all threads: a library may have some of its own."""
    begun_s = time.process_time()
    work(k)
    return time.process_time() - begun_s


def ratio_of(pair: Pair, spent: Callable[[Work, int], float] = spent_s) -> float:
    """The median over its rounds, which take turns in who begins; the first round warms both."""
    pair.ours(0), pair.peer(0)
    ratios, end_s = list[float](), time.monotonic() + LONGEST_S
    for k in range(1, pair.rounds):
        if k % 2:
            ours_s, peer_s = spent(pair.ours, k), spent(pair.peer, k)
        else:
            peer_s, ours_s = spent(pair.peer, k), spent(pair.ours, k)
        ratios.append(ours_s / peer_s)
        if time.monotonic() > end_s and len(ratios) >= 3:
            break
    return statistics.median(ratios)


def measured(passes: int) -> dict[str, Figure]:
    """All pairs, so many times: median, least and most of each."""
    seen: dict[str, list[float]] = {}
    for _ in range(passes):
        for pair in pairs(SCANS):
            seen.setdefault(f"{pair.name} / {pair.against}", []).append(ratio_of(pair))
    return {name: [statistics.median(each), min(each), max(each)] for name, each in seen.items()}


def limit_of(kept: Figure) -> float:
    """What lets CI fail: beyond it lies no busy machine.

    >>> limit_of([1.0, 0.9, 1.1]), round(limit_of([1.0, 0.8, 1.2]), 2)
    (1.6, 2.25)
    """
    middle, least, most = kept
    return float(middle * max(LEAST_LIMIT, (most / least) ** 2))


def worse(kept: Mapping[str, Figure], new: Mapping[str, Figure]) -> tuple[list[str], list[str]]:
    """In words: what got worse by more than WARNED, and what lies beyond its limit."""
    warned, failed = list[str](), list[str]()
    for name, (ratio, *_) in new.items():
        if name not in kept or ratio <= WARNED * kept[name][0]:
            continue
        limit = limit_of(kept[name])
        words = f"{name}: {ratio:.3g}, kept is {kept[name][0]:.3g}, the limit {limit:.3g}"
        (failed if ratio > limit else warned).append(words)
    return warned, failed


def table_of(new: Mapping[str, Figure], kept: Mapping[str, Any] | None) -> Table:
    before: Mapping[str, Figure] = kept["ratios"] if kept else {}
    title = f"kept last: {kept['date']}, commit {kept['commit']}" if kept else None
    table = Table(title=title, box=box.SIMPLE_HEAD)
    for column in ("ours / other, CPU time", "ratio", "passes", "kept", "change"):
        table.add_column(column, justify="left" if column.startswith("ours") else "right")
    for name, (ratio, least, most) in new.items():
        was = before[name][0] if name in before else math.nan
        change = "" if math.isnan(was) else f"{100 * (ratio / was - 1):+.0f} %"
        passes, told = f"{least:.3g} to {most:.3g}", "" if math.isnan(was) else f"{was:.3g}"
        table.add_row(name, f"{ratio:.3g}", passes, told, change)
    return table


def entry(new: Mapping[str, Figure]) -> dict[str, Any]:
    """As it is kept: ratios alone, with the commit and the machine."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
        "commit": commit(),
        "machine": machine(),
        "ratios": {name: [float(f"{one:.4g}") for one in each] for name, each in new.items()},
    }


def main(arguments: Sequence[str], path: Path = FILE, picture: Path = PICTURE) -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.bench.ratios", description=__doc__)
    parser.add_argument("--passes", type=int, default=PASSES)
    parser.add_argument("--keep", action="store_true", help="add them to what is kept, and draw it")
    parser.add_argument("--check", action="store_true", help="one pass; fail beyond a limit")
    options = parser.parse_args(arguments)
    entries = kept_entries(path)
    kept = entries[-1] if entries else None
    new = measured(1 if options.check else options.passes)
    Console(width=100).print(table_of(new, kept))
    warned, failed = worse(kept["ratios"] if kept else {}, new)
    if failed and options.check:  # once more: it may have been one bad moment
        again = measured(1)
        new = {name: min(one, again[name], key=lambda each: each[0]) for name, one in new.items()}
        warned, failed = worse(kept["ratios"] if kept else {}, new)
    for words in warned:
        print(f"mapod: worse: {words}")
    for words in failed:
        print(f"mapod: beyond its limit: {words}")
    if options.keep:
        keep(entry(new), path)
        draw(kept_entries(path), picture)
    return 1 if failed and options.check else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
