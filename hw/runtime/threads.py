"""The loop's real-time rights, and the threads beside it, without them, for what may block.

The collector, the pager and other processes are kept out of the loop as far as permitted.
Source: design, section 3.
"""

import contextlib
import ctypes
import gc
import os
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from hw.runtime.memory import lock_memory

FIFO_PRIORITY = 20
STACK_BYTES = 256 * 1024  # locked: the default of 8 MiB would be touched as the thread starts
LINES = 2000  # of the log, that wait at most
LAST_S = 1.0  # that the end of the program waits for them
CORES = os.sched_getaffinity(0)  # that the process may use
T = TypeVar("T")


def take_real_time() -> tuple[bool, bool]:
    """(memory locked, SCHED_FIFO taken); the garbage collector is frozen and off in any case."""
    gc.collect()
    gc.freeze()
    gc.disable()
    locked = lock_memory()
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except OSError:
        return locked, False
    stay_on_core()
    return locked, True


def stay_on_core() -> None:
    """The thread that calls this, which goes before all others, keeps the core whose caches it has.

    Source: sched_getcpu(3).
    """
    core = ctypes.CDLL(None).sched_getcpu()
    if core in CORES:
        with contextlib.suppress(OSError):  # a filter of system calls
            os.sched_setaffinity(0, {core})


def leave_real_time() -> None:
    """The thread that calls this works on only when nothing else is due, on any core.

    As far as permitted: it works in any case.
    """
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, CORES)


class Worker:
    """A thread for calls that may block, one after the other: opening and closing a serial line.

    It is started by the first call, and ends with the process, whatever it waits for.
    """

    def __init__(self, stack_bytes: int = STACK_BYTES) -> None:
        """`stack_bytes`: of the thread, all of it in memory where that is locked."""
        self._stack_bytes = stack_bytes
        self._calls: queue.SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = (
            queue.SimpleQueue()
        )
        self._is_started = False

    def submit(self, call: Callable[[], T]) -> "Future[T]":
        """Have it called; what it gives or raises is in the future."""
        future: Future[T] = Future()
        self._calls.put((future, call))
        if not self._is_started:
            self._is_started = True
            before = threading.stack_size(self._stack_bytes)
            threading.Thread(target=self._run, daemon=True).start()
            threading.stack_size(before)
        return future

    def finish(self) -> None:
        """Nothing more will be given: the thread ends when all is done."""
        self._calls.put(None)

    def _run(self) -> None:
        leave_real_time()
        while (given := self._calls.get()) is not None:
            future, call = given
            try:
                future.set_result(call())
            except BaseException as error:  # noqa: BLE001  raised where the result is taken
                future.set_exception(error)
            del given, future, call  # what they hold is let go of, not kept until the next call


class LogWriter:
    """Takes text for a descriptor as an open file would; a thread alone waits for the pipe or disk.

    What it can't get rid of in time is dropped and counted: a robot must not stand, or worse go on,
    because nobody reads its log.
    """

    def __init__(self, fd: int) -> None:
        self._fd, self._dropped, self._told = fd, 0, 0
        self._waiting: queue.Queue[str | None] = queue.Queue(LINES)
        self._thread = threading.Thread(target=self._work, name="log", daemon=True)
        self._thread.start()

    def write(self, text: str) -> int:
        """Hand over; dropped where too much waits already."""
        try:
            self._waiting.put_nowait(text)
        except queue.Full:
            self._dropped += 1
        return len(text)

    def flush(self) -> None:
        """The thread does so at each line."""

    def take_dropped(self) -> int:
        """How many lines were dropped since it was asked last; 0 while there is no room to tell."""
        if self._waiting.full():
            return 0
        dropped, self._told = self._dropped - self._told, self._dropped
        return dropped

    def close(self) -> None:
        """Let what waits go out, for LAST_S at most."""
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=LAST_S)
            self._thread.join(LAST_S)

    def _work(self) -> None:
        leave_real_time()
        while (text := self._waiting.get()) is not None:
            data = text.encode("utf-8", "replace")
            try:
                while data:
                    data = data[os.write(self._fd, data) :]
            except OSError:  # nobody is there to read it any more
                self._dropped += 1
