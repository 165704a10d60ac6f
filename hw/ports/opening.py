"""Opening what may take a while: in a thread, asked for once, taken when it is done."""

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Generic, TypeVar

from hw.runtime.threads import Worker

T = TypeVar("T")


class Opening(Generic[T]):
    """What a port opens in its worker's thread."""

    def __init__(self, worker: Worker, open_it: Callable[[], T]) -> None:
        self._worker, self._open_it = worker, open_it
        self._future: Future[T] | None = None  # under way

    @property
    def is_under_way(self) -> bool:
        return self._future is not None

    def maybe_opened(self) -> T | None:
        """What is open now, once; begins, or goes on. Raises what opening raised."""
        if self._future is None:
            self._future = self._worker.submit(self._open_it)
        if not self._future.done():
            return None
        try:
            return self._future.result()
        finally:  # here, for a local name of it and its error would keep each other for ever
            self._future = None

    def give_up(self, let_go: Callable[[T], None]) -> None:
        """Let go of what is still being opened, in the thread, once it is."""
        future, self._future = self._future, None
        if future is not None:
            self._worker.submit(partial(_discard, future, let_go))


def _discard(future: Future[T], let_go: Callable[[T], None]) -> None:
    if future.exception() is None:
        let_go(future.result())
