"""Many runs on all cores: results as they come, a crash in words, and a bar meanwhile."""

import concurrent.futures
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

T = TypeVar("T")
R = TypeVar("R")
TOLD_EVERY_S = 5.0  # without a screen
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")  # a worker has one core


def begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def results_of(
    work: Callable[[T], R], tasks: Sequence[T], jobs: int
) -> Generator[tuple[T, R | str], None, None]:
    """Results as they end, crashes in words; `work` can be imported, and gives no text."""
    for name in THREADS:
        os.environ.setdefault(name, "1")
    pool = concurrent.futures.ProcessPoolExecutor(
        min(jobs, len(tasks)), multiprocessing.get_context("spawn"), begin
    )
    with pool:
        waiting = {pool.submit(work, task): task for task in tasks}
        try:
            for future in concurrent.futures.as_completed(waiting):
                error = future.exception()
                yield waiting[future], future.result() if error is None else words_of(error)
        except (KeyboardInterrupt, GeneratorExit):
            pool.shutdown(cancel_futures=True)
            raise


def words_of(error: BaseException) -> str:
    if isinstance(error, BrokenProcessPool):
        return "the process that ran it, or one beside it, was killed"
    return "".join(traceback.format_exception(error)).strip()


def with_bar(
    console: Console, total: int, results: Iterable[R], words: Callable[[Sequence[R]], str]
) -> Iterator[R]:
    """The same results, with a bar, or a line now and then; `words` are of all results so far."""
    seen: list[R] = []
    told_s = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    is_drawn = console.is_terminal
    with Progress(*columns, TimeRemainingColumn(), console=console, disable=not is_drawn) as bar:
        task = bar.add_task("runs", total=total)
        for result in results:
            seen.append(result)
            if is_drawn:
                bar.update(task, advance=1, description=words(seen))
            elif time.monotonic() - told_s >= TOLD_EVERY_S:
                told_s = time.monotonic()
                console.print(f"  {len(seen)} of {total} runs: {words(seen)}", soft_wrap=True)
            yield result
