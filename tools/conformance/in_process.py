"""A receiver object as an examinee, on a clock of its own."""

from collections.abc import Callable
from typing import Protocol

from tools.conformance.wire import U8

SLICE_S = 0.005  # how often it is polled
LEAST_S = 0.0001  # that passes, however much it says


class Receiver(Protocol):
    """What all receivers in process have in common; `poll` gives frames without COBS."""

    def feed_datagram(self, now_s: float, data: bytes, /) -> object: ...
    def feed_stream(self, now_s: float, data: bytes, /) -> object: ...
    def poll(self, now_s: float, /) -> list[bytes]: ...
    def window(self) -> U8: ...
    def stale(self, now_s: float, /) -> bool: ...


class InProcess:
    """An examinee that is an object.

    Args:
        make: a new receiver, as after its power was off; told how often that has happened.
    """

    in_process = True

    def __init__(
        self, make: Callable[[int], Receiver], *, datagrams: bool = True, shows_cells: bool = True
    ) -> None:
        self.datagrams, self.shows_cells = datagrams, shows_cells
        self._make, self._starts = make, 0
        self.receiver = make(0)
        self._now_s = 50.0

    def now_s(self) -> float:
        """Only `listen` moves it on."""
        return self._now_s

    def send(self, data: bytes) -> None:
        if self.datagrams:
            self.receiver.feed_datagram(self._now_s, data)
        else:
            self.receiver.feed_stream(self._now_s, data)

    def listen(self, seconds: float) -> list[bytes]:
        """Time passes until it says something."""
        end_s = self._now_s + seconds
        self._now_s = min(end_s, self._now_s + LEAST_S)
        while not (frames := self.receiver.poll(self._now_s)) and self._now_s < end_s:
            self._now_s = min(end_s, self._now_s + SLICE_S)
        return frames

    def window(self) -> U8 | None:
        return self.receiver.window() if self.shows_cells else None

    def restart(self) -> bool:
        self._starts += 1
        self.receiver = self._make(self._starts)
        return True
