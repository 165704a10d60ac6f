"""The last minutes, for a page that steps back: states ten times a second, all else twice.

Memory is bounded: five minutes or 32 MB, whichever is less; what is oldest goes first.
"""

import zlib
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from tools.view.window import ScanLine, Window

SPAN_S, WINDOW_PERIOD_S = 300.0, 0.5
MOST_BYTES = 32_000_000
FASTEST = 1  # of zlib's levels


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """A moment: what pages were told of it, and the newest of the rest that was kept by then."""

    t_s: float
    state: bytes  # JSON, without `driving`
    window: "KeptWindow | None"
    scan: ScanLine | None

    def messages(self) -> list[str | bytes]:
        """To a page that asks what was: the state first."""
        told: list[str | bytes] = [(self.state + b',"history":true}').decode()]
        told += [self.window.unpacked().whole(history=True)] if self.window else []
        return told + ([self.scan.message(history=True)] if self.scan else [])


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
        self._window: KeptWindow | None = None
        self._scan: ScanLine | None = None  # that was kept with it
        self._bytes = 0

    @property
    def from_s(self) -> float | None:
        return self._moments[0].t_s if self._moments else None

    @property
    def megabytes(self) -> float:
        return self._bytes / 1e6

    def keep(
        self, t_s: float, state: bytes, window: Window | None, scan: ScanLine | None = None
    ) -> None:
        """What is true from now on; `t_s` grows from call to call."""
        if window is not None and self._is_due(t_s, window):
            packed = zlib.compress(window.cells.tobytes(), FASTEST)
            bare = replace(window, cells=window.cells[:0])
            self._window, self._scan = KeptWindow(bare, window.size, packed), scan
            self._bytes += len(packed) + (scan.points_m.nbytes if scan else 0)
        self._moments.append(Kept(t_s, state, self._window, self._scan))
        self._bytes += len(state)
        while self._moments and (self._moments[0].t_s < t_s - SPAN_S or self._bytes > MOST_BYTES):
            self._drop_oldest()

    def at(self, t_s: float) -> Kept | None:
        """The moment at `t_s` or the one before it, or the oldest; None while there is none."""
        if not self._moments:
            return None
        after = bisect_right(self._moments, t_s, key=lambda kept: kept.t_s)
        return self._moments[max(after - 1, 0)]

    def _is_due(self, t_s: float, window: Window) -> bool:
        newest = self._window
        if newest is None or newest.window.epoch != window.epoch:
            return True
        return t_s - newest.window.t_s >= WINDOW_PERIOD_S - 0.01

    def _drop_oldest(self) -> None:
        oldest = self._moments.popleft()
        self._bytes -= len(oldest.state)
        after = self._moments[0].window if self._moments else None
        if oldest.window is not None and oldest.window is not after:
            scan_bytes = oldest.scan.points_m.nbytes if oldest.scan else 0
            self._bytes -= len(oldest.window.packed) + scan_bytes
