"""Load for a machine: all cores computing, memory moved, a disk written to.

Each is a process of its own, of ordinary priority.
"""

import contextlib
import functools
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator

MOVED_BYTES = 32 << 20  # beyond every cache
WRITTEN_BYTES = 4 << 20
CHECK_EVERY = 64  # rounds of computing between two looks at the clock


def compute(until_s: float) -> None:
    number = 1
    while time.monotonic() < until_s:
        for _ in range(CHECK_EVERY * 1000):
            number = (number * 1_103_515_245 + 12_345) % 2**31


def move_memory(until_s: float) -> None:
    one, other = bytearray(MOVED_BYTES), bytearray(MOVED_BYTES)
    while time.monotonic() < until_s:
        one[:], other[:] = other, one


def write_disk(until_s: float) -> None:
    data = os.urandom(WRITTEN_BYTES)
    with tempfile.TemporaryFile() as file:
        while time.monotonic() < until_s:
            file.seek(0)
            file.write(data)
            file.flush()
            os.fsync(file.fileno())


@contextlib.contextmanager
def loaded(seconds: float, cores: int | None = None) -> Iterator[str]:
    """Load while the block runs, at most so long; gives what it consists of, in words."""
    cores = cores or len(os.sched_getaffinity(0))
    until_s = time.monotonic() + seconds
    jobs: list[Callable[[], None]] = [functools.partial(compute, until_s)] * cores
    jobs += [functools.partial(move_memory, until_s)] * max(1, cores // 2)
    jobs.append(functools.partial(write_disk, until_s))
    spawn = multiprocessing.get_context("spawn")
    processes = [spawn.Process(target=job, daemon=True) for job in jobs]
    for process in processes:
        process.start()
    try:
        yield f"{cores} computing, {max(1, cores // 2)} moving memory, 1 writing to the disk"
    finally:
        for process in processes:
            process.kill()
            process.join()
