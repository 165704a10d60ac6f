"""A thread for calls that may block, beside the loop: opening and closing a serial line.

One after the other, in the order in which they were given, and without the loop's rights.
"""

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from hw.runtime.real_time import leave_real_time

STACK_BYTES = 256 * 1024  # locked: the default of 8 MiB would be touched as the thread starts
T = TypeVar("T")


class Worker:
    """The thread is started by the first call. It ends with the process, whatever it waits for."""

    def __init__(self) -> None:
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
            before = threading.stack_size(STACK_BYTES)
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
