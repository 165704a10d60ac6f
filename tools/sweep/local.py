"""Jobs on this machine's cores, each in a process that only it can lose.

Every process is a pool of one: one that is killed takes one job with it, which is tried once more.
"""

import concurrent.futures
import multiprocessing
import os
import signal
import threading
import traceback
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from tools.sweep.jobs import Failure

T = TypeVar("T")
R = TypeVar("R")
TRIES = 2  # of a job whose process is killed
KILLED = "the process that ran it was killed, and so was the one that tried it again"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")  # a worker has one core


def begin() -> None:
    """In a new process: Ctrl-C ends it, and so does the end of who started it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def one_process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), begin)


class LocalProcesses:
    """So many processes at once."""

    def __init__(self, count: int) -> None:
        self._count = count

    def results(
        self, work: Callable[[T], R], tasks: Sequence[T]
    ) -> Generator[tuple[int, R | Failure], None, None]:
        """Each task's place and result, as they end; a crash in words."""
        for name in THREADS:
            os.environ.setdefault(name, "1")
        waiting = deque((at, 1) for at in range(len(tasks)))
        idle: list[ProcessPoolExecutor] = []
        running: dict[Future[R], tuple[int, int, ProcessPoolExecutor]] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self._count:
                    at, attempt = waiting.popleft()
                    future, process = _given(idle, work, tasks[at])
                    running[future] = at, attempt, process
                ended, _ = concurrent.futures.wait(running, return_when=FIRST_COMPLETED)
                for future in ended:
                    at, attempt, process = running.pop(future)
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool) and attempt < TRIES:
                        waiting.appendleft((at, attempt + 1))
                        continue
                    if not isinstance(error, BrokenProcessPool):
                        idle.append(process)
                    yield at, future.result() if error is None else Failure(words_of(error))
        finally:
            for process in (*idle, *(process for _, _, process in running.values())):
                process.shutdown(cancel_futures=True)


def _given(
    idle: list[ProcessPoolExecutor], work: Callable[[T], R], task: T
) -> tuple["Future[R]", ProcessPoolExecutor]:
    """The job, and the process that has it now: one that is idle and alive, or a new one."""
    while idle:
        process = idle.pop()
        try:
            return process.submit(work, task), process
        except BrokenProcessPool:  # killed while it had nothing to do
            continue
    process = one_process()
    return process.submit(work, task), process


def words_of(error: BaseException) -> str:
    if isinstance(error, BrokenProcessPool):
        return KILLED
    return "".join(traceback.format_exception(error)).strip()
