"""The app's side of recording: what happens goes over a pipe to the writer, another process.

Nothing here waits. What the pipe does not take is kept up to a bound; beyond it states are left out
first, then all, and what is left out is counted by kind. A writer that is gone ends the recording.
"""

import json
import os
import select
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from recording.ports import Notes
from recording.records import BYE, FIRST, GAP, HEAD, LINE, OF_WIRES

HELD_BYTES = 8 << 20  # that the writer may be behind, beside what the pipe holds: a minute or so
PIECE, PIECES = 1 << 16, 4  # bytes a write, and writes a turn
GATHER_S, GATHER_BYTES = 0.1, 1 << 14  # the writer is woken no more often, or for so much
LINES = 1000  # of the log, that wait at most
FIRST_S = 10.0  # that the writer may need to take what comes before the run


class AnyTap(Notes, Protocol):
    """What a run is told to."""

    clock: Callable[[], float]
    trouble: str  # why nothing is taken any more

    def begin(self, first: Mapping[str, Any]) -> None:
        """Before the run: what it is, and what is to be kept of it."""

    def line(self, t_s: float, level: str, event: str, keys: Mapping[str, Any]) -> None:
        """A line of the log, from any thread."""

    def flush(self, now_s: float) -> None:
        """A call of the app is over."""

    def end(self, wait_s: float) -> None:
        """After the run: that it is all; may wait so long."""


class Tap:
    """Takes records and hands them over, in order; `trouble` says why it no longer does."""

    def __init__(self, fd: int, clock: Callable[[], float] = time.monotonic) -> None:
        """`fd`: of the pipe, for writing."""
        self.clock = clock
        self.calls = 0  # of the app
        self.trouble = ""
        self.dropped: Counter[str] = Counter()  # records, by kind
        self._fd = fd
        self._new: list[bytes] = []  # not in a piece yet
        self._new_bytes = self._held_bytes = 0  # the latter with what is in pieces
        self._pieces: deque[memoryview] = deque()
        self._lines: deque[tuple[float, bytes]] = deque(maxlen=LINES)  # of any thread
        self._has_gap = False  # of which nobody was told yet
        self._flushed_s = -1.0
        os.set_blocking(fd, False)

    def begin(self, first: Mapping[str, Any]) -> None:
        """Before the run: what the writer is to do, which it may take its time to read."""
        text = json.dumps(dict(first)).encode()
        waiting = memoryview(HEAD.pack(0.0, FIRST, 0, len(text)) + text)
        end_s = time.monotonic() + FIRST_S
        while waiting and not self.trouble:
            left_s = end_s - time.monotonic()
            _, ready, _ = select.select([], [self._fd], [], max(0.0, left_s))
            taken = self._write(waiting)
            waiting = waiting[taken:]
            if not ready and not taken:
                self.trouble = "the writer does not start"

    def note(
        self, t_s: float, kind: bytes, port: int = 0, data: bytes = b"", more: bytes = b""
    ) -> None:
        """One record, for the loop's thread alone."""
        length = len(data) + len(more)
        size = HEAD.size + length
        is_roomy = self._held_bytes + size <= HELD_BYTES // 2 and not self._has_gap  # as ever
        if self.trouble or not (is_roomy or self._has_room(t_s, kind, size)):
            self.dropped[kind.decode()] += 1
            return
        self._new.append(HEAD.pack(t_s, kind, port, length) + data)
        self._new_bytes += size
        self._held_bytes += size
        if more:
            self._join()
            self._pieces.append(memoryview(more))

    def line(self, t_s: float, level: str, event: str, keys: Mapping[str, Any]) -> None:
        """A line of the log, from any thread."""
        said = {"level": level, "event": event, "keys": dict(keys)}
        self._lines.append((t_s, json.dumps(said, default=str).encode()))

    def flush(self, now_s: float) -> None:
        """Hand over what there is, where it is worth it."""
        is_due = now_s - self._flushed_s >= GATHER_S or self._new_bytes >= GATHER_BYTES
        if not (is_due or self._pieces):
            return
        self._flushed_s = now_s
        self._gather()
        if self._pieces and not self.trouble:
            self._hand_over()

    def end(self, wait_s: float) -> None:
        """After the run: the rest, and that it is all; waits so long for the writer to take it."""
        self._gather()
        last = json.dumps(self.dropped).encode()
        self._pieces.append(memoryview(HEAD.pack(self.clock(), BYE, 0, len(last)) + last))
        end_s = time.monotonic() + wait_s
        while self._pieces and not self.trouble and (left_s := end_s - time.monotonic()) > 0:
            select.select([], [self._fd], [], left_s)
            self._hand_over()

    def _has_room(self, t_s: float, kind: bytes, size: int) -> bool:
        """Whether it can be kept. Behind a gap nothing is, until there is room to tell of it."""
        most = HELD_BYTES // (1 if kind in OF_WIRES else 2)
        has_room = self._held_bytes + size <= (HELD_BYTES // 2 if self._has_gap else most)
        if not has_room:
            self._has_gap |= kind in OF_WIRES
        elif self._has_gap:
            self._has_gap = False
            self.note(t_s, GAP, 0, json.dumps(self.dropped).encode())
        return has_room

    def _gather(self) -> None:
        while self._lines:
            t_s, data = self._lines.popleft()
            self.note(t_s, LINE, 0, data)
        self._join()

    def _join(self) -> None:
        if self._new:
            self._pieces.append(memoryview(b"".join(self._new)))
            self._new, self._new_bytes = [], 0

    def _hand_over(self) -> None:
        """What the pipe takes now; of much a part, so that no turn takes long."""
        for _ in range(PIECES):
            if not self._pieces:
                return
            piece = self._pieces[0]
            taken = self._write(piece[:PIECE])
            self._held_bytes -= taken
            if taken == len(piece):
                self._pieces.popleft()
            elif taken:
                self._pieces[0] = piece[taken:]
            if taken < min(len(piece), PIECE):
                return

    def _write(self, data: memoryview) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError:  # BrokenPipeError
            self.trouble = self.trouble or "its writer has ended"
            self._pieces.clear()
            self._new.clear()
            return 0
