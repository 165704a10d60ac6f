"""A timer that rings on time: asyncio's own come up to a millisecond late.

Reads no clock. Source: timerfd_create(2).
"""

import asyncio
import contextlib
import ctypes
import math
import os
import struct

CLOCK_MONOTONIC, ABSOLUTE = 1, 1
SPEC = struct.Struct("@4l")  # period and first time, seconds and nanoseconds each
BILLION = 1_000_000_000


class Timer:
    """Waits for instants of the monotonic clock, while the loop goes on with all else.

    Raises:
        OSError: the system has no such timer to give.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._fd = self._libc.timerfd_create(CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        self._loop, self._rung = loop, asyncio.Event()
        loop.add_reader(self._fd, self._ring)

    async def wait_until(self, due_s: float) -> None:
        """Until the host's monotonic clock shows `due_s`; lets others go on even if it is past."""
        self._rung.clear()
        nanoseconds = max(1, math.ceil(due_s * BILLION))  # 0 would mean never
        spec = SPEC.pack(0, 0, nanoseconds // BILLION, nanoseconds % BILLION)
        self._libc.timerfd_settime(self._fd, ABSOLUTE, spec, None)
        await self._rung.wait()

    def close(self) -> None:
        self._loop.remove_reader(self._fd)
        os.close(self._fd)

    def _ring(self) -> None:
        with contextlib.suppress(BlockingIOError):  # set anew meanwhile
            os.read(self._fd, 8)
            self._rung.set()
