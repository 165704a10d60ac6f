"""The way out of the fake URG-04LX: bytes leave one after the other, at its rate where it has one.

Source: urg04lx sheet, section 1: 8N1.
"""

import math
import random
from collections import deque

from fakes.urg04lx.faults import Faults

BITS = 10  # of a character


class Line:
    """What the device has said and not yet sent."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self.free_s = -math.inf  # host clock, when all that was said has left
        self._faults, self._random = faults, random.Random(seed)
        self._queue: deque[tuple[float, float, bytes]] = deque()  # begin, seconds a byte, bytes

    @property
    def is_empty(self) -> bool:
        return not self._queue

    def send(self, ready_s: float, message: bytes) -> None:
        message = self._damaged(message)
        byte_s = BITS / self._faults.baud if self._faults.baud else 0.0
        begin_s = max(ready_s, self.free_s)
        self.free_s = begin_s + byte_s * len(message)
        self._queue.append((begin_s, byte_s, message))

    def taken(self, now_s: float) -> bytes:
        until_s = now_s - self._faults.late_s
        sent = bytearray()
        while self._queue and self._queue[0][0] <= until_s:
            begin_s, byte_s, message = self._queue[0]
            count = int((until_s - begin_s) / byte_s + 1e-6) if byte_s else len(message)
            sent += message[:count]
            if count < len(message):
                self._queue[0] = (begin_s + byte_s * count, byte_s, message[count:])
                break
            self._queue.popleft()
        return b"" if self._faults.mute else bytes(sent)

    def clear(self) -> None:
        self._queue.clear()
        self.free_s = -math.inf

    def _damaged(self, message: bytes) -> bytes:
        faults, chance = self._faults, self._random
        if self._hits(faults.lost_line_rate):
            lines = message[:-2].split(b"\n")
            del lines[chance.randrange(len(lines))]
            message = b"\n".join(lines) + b"\n\n"
        if self._hits(faults.damaged_rate):
            at = chance.randrange(len(message) - 2)
            message = (
                message[:at] + bytes([message[at] ^ 1 << chance.randrange(7)]) + message[at + 1 :]
            )
        if faults.cut_next:
            faults.cut_next, message = False, message[: len(message) // 2]
        return message

    def _hits(self, rate: float) -> bool:
        return rate > 0 and self._random.random() < rate
