"""What a process uses, as the kernel counts it: CPU time, wake-ups, memory, faults.

Nothing is asked of the process itself. Refuses to part user from kernel: the tick by which the
kernel does that is in step with a loop that wakes at full milliseconds.
Source: proc(5); clock_getcpuclockid(3) for `cpu_s`.
"""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

MB = 1e6
KIB = 1024
MINOR, MAJOR = 7, 9  # fields of /proc/PID/stat behind the name in brackets


def cpu_s(pid: int) -> float:
    """CPU time of all its threads, also of those that have ended; to the nanosecond."""
    return time.clock_gettime((~pid << 3) | 2)


@dataclass(frozen=True, slots=True)
class Usage:
    """Counters of a process at one instant."""

    at_s: float
    cpu_s: float
    minor_faults: int
    major_faults: int
    threads: Mapping[int, tuple[int, int]]  # id to CPU time in ns, voluntary switches


@dataclass(frozen=True, slots=True)
class Rates:
    """Between two instants; a second, where it says nothing else."""

    cpu: float  # share of a core
    wakeups: float  # of the busiest thread, which is the loop's
    other_wakeups: float  # of all other threads
    minor_faults: float
    major_faults: int  # in all


def usage_of(pid: int) -> Usage:
    """Raises OSError where the process has ended."""
    stat = _fields(Path(f"/proc/{pid}/stat"))
    threads = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        ran_ns = int((task / "schedstat").read_text(encoding="ascii").split()[0])
        status = (task / "status").read_text(encoding="utf-8")
        threads[int(task.name)] = ran_ns, _number(status, "voluntary_ctxt_switches")
    minor, major = int(stat[MINOR]), int(stat[MAJOR])
    return Usage(time.monotonic(), cpu_s(pid), minor, major, threads)


def rates_between(before: Usage, after: Usage) -> Rates:
    seconds = after.at_s - before.at_s
    spent = {
        thread: (ran_ns - before.threads[thread][0], switches - before.threads[thread][1])
        for thread, (ran_ns, switches) in after.threads.items()
        if thread in before.threads
    }
    loop = max(spent, key=lambda thread: spent[thread][0])
    others = sum(switches for thread, (_, switches) in spent.items() if thread != loop)
    return Rates(
        cpu=(after.cpu_s - before.cpu_s) / seconds,
        wakeups=spent[loop][1] / seconds,
        other_wakeups=others / seconds,
        minor_faults=(after.minor_faults - before.minor_faults) / seconds,
        major_faults=after.major_faults - before.major_faults,
    )


def resident_mb(pid: int) -> tuple[float, float]:
    """In memory, and of that locked there: what is locked but was never touched takes none."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8")
    return _number(rollup, "Rss") * KIB / MB, _number(rollup, "Locked") * KIB / MB


def pin(pid: int, cores: set[int]) -> None:
    """All threads of a process, and those that they start, to some cores."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        os.sched_setaffinity(int(task.name), cores)


def _fields(stat: Path) -> list[str]:
    return stat.read_text(encoding="utf-8").rpartition(")")[2].split()


def _number(text: str, name: str) -> int:
    line = next(line for line in text.splitlines() if line.startswith(f"{name}:"))
    return int(line.split()[1])
