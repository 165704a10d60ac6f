"""The last minutes, for a page that steps back: windows twice a second, states ten times a second.

Memory is bounded: five minutes or 32 MB, whichever is less; what is oldest goes first.
"""

import zlib
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, replace
from itertools import islice

import msgspec
import numpy as np

from tools.view.window import Window

SPAN_S, WINDOW_PERIOD_S = 300.0, 0.5
ROUND = 50  # moments in one round of news
MOST_BYTES = 32_000_000
FASTEST = 1  # of zlib's levels


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """A moment: what pages were told of it, and the newest window that was kept by then."""

    t_s: float
    state: bytes  # JSON, without `driving`
    window: "KeptWindow | None"


@dataclass(frozen=True, slots=True, eq=False)
class KeptWindow:
    """A window with its cells packed."""

    window: Window  # without cells
    size: int
    packed: bytes

    def unpacked(self) -> Window:
        cells = np.frombuffer(zlib.decompress(self.packed), np.uint8)
        return replace(self.window, cells=cells.reshape(self.size, self.size))


class History:
    """What was told, by its time on the server's clock."""

    def __init__(self) -> None:
        self._moments: deque[Kept] = deque()
        self._newest: KeptWindow | None = None
        self._bytes = 0

    @property
    def from_s(self) -> float | None:
        return self._moments[0].t_s if self._moments else None

    @property
    def megabytes(self) -> float:
        return self._bytes / 1e6

    def keep(self, t_s: float, state: bytes, window: Window | None) -> None:
        if window is not None and self._is_due(t_s, window):
            packed = zlib.compress(window.cells.tobytes(), FASTEST)
            bare = replace(window, cells=window.cells[:0])
            self._newest = KeptWindow(bare, window.size, packed)
            self._bytes += len(packed)
        self._moments.append(Kept(t_s, state, self._newest))
        self._bytes += len(state)
        while self._moments[0].t_s < t_s - SPAN_S or self._bytes > MOST_BYTES:
            self._drop_oldest()
            if not self._moments:
                break

    def after(self, t_s: float, most: int) -> list[Kept]:
        """The moments later than `t_s`, oldest first."""
        first = bisect_right(self._moments, t_s, key=lambda kept: kept.t_s)
        return list(islice(self._moments, first, first + most))

    def _is_due(self, t_s: float, window: Window) -> bool:
        newest = self._newest
        if newest is None or newest.window.epoch != window.epoch:
            return True
        return t_s - newest.window.t_s >= WINDOW_PERIOD_S - 0.01

    def _drop_oldest(self) -> None:
        oldest = self._moments.popleft()
        self._bytes -= len(oldest.state)
        after = self._moments[0].window if self._moments else None
        if oldest.window is not None and oldest.window is not after:
            self._bytes -= len(oldest.window.packed)


class Past:
    """The history on its way to one page: from a time to now, some of it in each round of news."""

    def __init__(self, history: History, from_s: float) -> None:
        self._history, self._at_s = history, from_s
        self._first: float | None = None
        self._window: KeptWindow | None = None
        self._held: Window | None = None
        self.is_done = False

    def next_messages(self) -> list[str | bytes]:
        """Windows (the first one whole) and states as they were, then `history_end`."""
        told: list[str | bytes] = []
        moments = self._history.after(self._at_s, ROUND)
        for kept in moments:
            self._first = kept.t_s if self._first is None else self._first
            self._at_s = kept.t_s
            if kept.window is not None and kept.window is not self._window:
                self._window, window = kept.window, kept.window.unpacked()
                told += [change] if (change := window.since(self._held, past=True)) else []
                self._held = window
            told.append((kept.state + b',"past":true}').decode())
        if len(moments) < ROUND:
            self.is_done = True
            end = {"type": "history_end", "from_s": self._first}
            told.append(msgspec.json.encode(end).decode())
        return told
