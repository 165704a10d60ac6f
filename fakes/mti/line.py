"""The serial side of a fake MTi: bytes leave one after the other, and much can happen to them.

Source: MTi sheet, sections 7 and 10.
"""

import math
import random
from collections import deque

from fakes.mti.faults import Faults


class SerialLine:
    """What the device has said and not yet sent."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self.random = random.Random(seed)  # of the whole device but its measurements
        self.free_s = -math.inf  # host clock, when all that was said has left
        self._faults = faults
        self._delays = random.Random(f"delays {seed}")
        self._queue: deque[tuple[float, float, bytes]] = deque()  # begin, seconds a byte, bytes
        self._arrived_s = -math.inf

    def send(self, ready_s: float, message: bytes) -> None:
        faults = self._faults
        if self.hits(faults.wrong_checksum_rate):
            message = message[:-1] + bytes([message[-1] ^ 0xFF])
        if faults.half_frame:
            faults.half_frame, message = False, message[: len(message) // 2]
        if faults.lost_byte_rate > 0:
            message = bytes(byte for byte in message if not self.hits(faults.lost_byte_rate))
        byte_s = 10 / faults.baud
        begin_s = max(ready_s, self.free_s)
        self.free_s = begin_s + byte_s * len(message)
        if faults.jitter_s > 0:
            begin_s += self._delays.expovariate(1 / faults.jitter_s)
        begin_s = max(begin_s, self._arrived_s)
        self._arrived_s = begin_s + byte_s * len(message)
        self._queue.append((begin_s, byte_s, message))

    def break_off(self, now_s: float, message: bytes = b"") -> None:
        """Nothing of what waits will be sent, but these bytes at once."""
        self._queue.clear()
        self._queue.append((now_s, 0.0, message))
        self.free_s = self._arrived_s = now_s

    def taken(self, now_s: float) -> bytes:
        if not self._queue:
            return b""
        burst_s = self._faults.burst_s
        until_s = math.floor(now_s / burst_s) * burst_s if burst_s > 0 else now_s
        until_s -= self._faults.late_s
        sent = bytearray()
        while self._queue:
            begin_s, byte_s, message = self._queue[0]
            if begin_s + byte_s * len(message) > until_s:
                count = int((until_s - begin_s) / byte_s) if until_s > begin_s else 0
                if count:
                    sent += message[:count]
                    self._queue[0] = (begin_s + byte_s * count, byte_s, message[count:])
                break
            sent += message
            self._queue.popleft()
        return b"" if self._faults.mute else bytes(sent)

    def hits(self, rate: float) -> bool:
        return rate > 0 and self.random.random() < rate
