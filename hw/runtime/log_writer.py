"""A log that nobody has to wait for: lines go to a thread, which alone waits for the pipe or disk.

What the thread can't get rid of in time is dropped and counted: a robot must not stand, or worse
go on, because nobody reads its log.
"""

import contextlib
import os
import queue
import threading

from hw.runtime.real_time import leave_real_time

LINES = 2000  # that wait at most
LAST_S = 1.0  # that the end of the program waits for them


class LogWriter:
    """Takes text for a descriptor as an open file would; never blocks."""

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
