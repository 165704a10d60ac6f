"""The camera's second port: opened when it is wanted, read to its end at each step, newest frame.

At 30 frames a second it brings 39 MB each second, so a step reads all that has come, up to some
frames. What comes faster than steps is passed over, and counted.
"""

from collections.abc import Callable

from hw.device import BadFrame, Port, Reopens
from hw.visionary.blob import MOST_BYTES, Blob, BlobParser

OpenAt = Callable[[int], Port]  # a port of the camera's, by its number
MOST_A_STEP = 2 * MOST_BYTES
MOST_FAULTS = 16  # in a step: what is behind them waits, for junk costs more than frames do


class Stream:
    """Frames as they come.

    Args:
        open_at: gives a port of the same host, not opened yet.
    """

    def __init__(self, open_at: OpenAt) -> None:
        self.passed_over = 0  # frames
        self._open_at, self._parser = open_at, BlobParser()
        self._maybe_port: Port | None = None
        self._number = self._opened = 0  # as its port counted when it was last asked; 0: dropped
        self._is_wanted = self.is_open = False
        self._maybe_newest: Blob | None = None

    def want(self, number: int) -> None:
        """From now on, at this port of the host's."""
        if self._maybe_port is None or number != self._number:
            if self._maybe_port is not None:
                self._maybe_port.close()
            self._maybe_port, self._number, self._opened = self._open_at(number), number, 0
        self._is_wanted = True

    def drop(self, why: str) -> None:
        """No longer; the next connection is a fresh one."""
        if self._is_wanted and isinstance(self._maybe_port, Reopens):
            self._maybe_port.reopen(why)
        self._is_wanted = self.is_open = False
        self._maybe_newest, self._opened = None, 0

    def close(self) -> None:
        if self._maybe_port is not None:
            self._maybe_port.close()
        self._is_wanted = self.is_open = False

    @property
    def cause(self) -> str:
        """Why it is not open, in words."""
        return "" if self._maybe_port is None else self._maybe_port.cause

    def step(self, now_s: float) -> list[BadFrame]:
        """Read what has come; what of it was no frame."""
        port = self._maybe_port
        if port is None or not self._is_wanted:
            return []
        self.is_open = port.poll(now_s)
        if not self.is_open:
            return []
        if port.opened != self._opened:
            if not self._opened:
                port.read()  # what was sent before belongs to no start of ours
            self._opened = port.opened
            self._parser.begin()
        faults, read = list[BadFrame](), 0
        while read < MOST_A_STEP and len(faults) < MOST_FAULTS and (pieces := port.read()):
            for piece in pieces:
                read += len(piece)
                for event in self._parser.feed(now_s, piece):
                    if isinstance(event, BadFrame):
                        faults.append(event)
                    else:
                        self.passed_over += self._maybe_newest is not None
                        self._maybe_newest = event
        return faults

    def maybe_newest(self) -> Blob | None:
        """The newest frame since the last call."""
        newest, self._maybe_newest = self._maybe_newest, None
        return newest
