"""Work that is done beside the loop: one call at a time, what it gave is taken at a tick."""

import sys
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, Protocol, TypeVar

from hw.runtime.threads import Worker

SWITCH_S = 5e-4  # so long the loop waits, at most, for a thread's Python to let it go on
STACK_BYTES = 16 << 20  # of a thread: GEOS goes deep
T = TypeVar("T")


class Work(Protocol[T]):
    """Who does it."""

    @property
    def is_idle(self) -> bool:
        """Whether it may be given a call."""

    def give(self, call: Callable[[], T]) -> None:
        """Have it done. In a replay nobody does it."""

    def maybe_take(self) -> T | None:
        """What a call gave, once; None: it is not done yet."""


class AtOnce(Generic[T]):
    """Done as it is given, and there at the next tick: where time is simulated."""

    def __init__(self) -> None:
        self._given: list[T] = []

    @property
    def is_idle(self) -> bool:
        return not self._given

    def give(self, call: Callable[[], T]) -> None:
        self._given.append(call())

    def maybe_take(self) -> T | None:
        return self._given.pop() if self._given else None


class Beside(Generic[T]):
    """Done by a thread, while the loop goes on."""

    def __init__(self) -> None:
        self._worker = Worker(STACK_BYTES)
        self._maybe_future: Future[T] | None = None
        sys.setswitchinterval(SWITCH_S)

    @property
    def is_idle(self) -> bool:
        return self._maybe_future is None

    def give(self, call: Callable[[], T]) -> None:
        self._maybe_future = self._worker.submit(call)

    def after(self, call: Callable[[], None]) -> None:
        """Wait until it is done, behind all that was given."""
        self._worker.submit(call).result()

    def maybe_take(self) -> T | None:
        if self._maybe_future is None or not self._maybe_future.done():
            return None
        gave, self._maybe_future = self._maybe_future.result(), None
        return gave


class Replayed(Generic[T]):
    """What calls gave, from a recording, at the same ticks."""

    is_idle = False

    def __init__(self) -> None:
        self.waiting = deque[T]()

    def give(self, call: Callable[[], T]) -> None: ...

    def maybe_take(self) -> T | None:
        return self.waiting.popleft() if self.waiting else None
