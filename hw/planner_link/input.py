"""Frames out of what a port has read, a bounded number of bytes at a time.

What a tick does not look at waits for the next one, in order; meanwhile the port is not read, so
that the kernel's buffer bounds the rest. Each connection begins with a frame.
"""

from collections import deque

from hw.device import BadFrame, Port
from hw.planner_link.frames import Deframer

TICK_BYTES = 2048  # looked at in one call: a line of 921 600 baud brings 1843 in 20 ms


class FrameInput:
    """The frames of one port."""

    def __init__(self, port: Port) -> None:
        self._port, self._opened = port, port.opened
        self._deframer = Deframer()
        self._unread: deque[bytes] = deque()

    def read(self) -> list[bytes | BadFrame]:
        """The frames of the next bytes."""
        if self._port.opened != self._opened:
            self._opened, self._deframer = self._port.opened, Deframer()
            self._unread.clear()
        if not self._unread:
            self._unread.extend(self._port.read())
        frames: list[bytes | BadFrame] = []
        left = TICK_BYTES
        while self._unread and left > 0:
            piece = self._unread.popleft()
            if self._port.datagrams:
                frames.append(piece)
            else:
                frames += self._deframer.feed(piece[:left])
                if piece[left:]:
                    self._unread.appendleft(piece[left:])
            left -= len(piece)
        return frames
