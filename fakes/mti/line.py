"""The serial side of a fake MTi: bytes leave one after the other, and much can happen to them.

Source: MTi sheet, sections 7 and 10.
"""

import math
import random
from collections import deque


class SerialLine:
    """What the device has said and not yet sent; plain attributes are faults, settable any time."""

    def __init__(self, seed: int) -> None:
        self.mute = False  # its bytes are lost, it hears
        self.deaf = False  # hears nothing, and speaks on
        self.burst_s = 0.0  # bytes come together, so far apart: 0.016 is a USB adapter as shipped
        self.late_s = 0.0  # all bytes come so much later
        self.jitter_s = 0.0  # mean of an exponential delay of each message; their order stays
        self.wrong_checksum_rate = 0.0  # of all messages
        self.lost_byte_rate = 0.0  # of all bytes
        self.half_frame = False  # the next message is cut in the middle; then off again
        self.baud = 115200  # until the next power-up, which sets what the memory says
        self._random = random.Random(seed)
        self._delays = random.Random(f"delays {seed}")
        self._queue: deque[tuple[float, float, bytes]] = deque()  # begin, seconds a byte, bytes
        self._line_free_s = self._arrived_s = -math.inf

    def _send(self, ready_s: float, message: bytes) -> None:
        """Onto the line, behind what is still on it."""
        if self._hit(self.wrong_checksum_rate):
            message = message[:-1] + bytes([message[-1] ^ 0xFF])
        if self.half_frame:
            self.half_frame, message = False, message[: len(message) // 2]
        if self.lost_byte_rate > 0:
            message = bytes(byte for byte in message if not self._hit(self.lost_byte_rate))
        byte_s = 10 / self.baud
        begin_s = max(ready_s, self._line_free_s)
        self._line_free_s = begin_s + byte_s * len(message)
        if self.jitter_s > 0:
            begin_s += self._delays.expovariate(1 / self.jitter_s)
        begin_s = max(begin_s, self._arrived_s)
        self._arrived_s = begin_s + byte_s * len(message)
        self._queue.append((begin_s, byte_s, message))

    def _silence(self, now_s: float) -> None:
        """Nothing of what waits will be sent."""
        self._queue.clear()
        self._line_free_s = self._arrived_s = now_s

    def _taken(self, now_s: float) -> bytes:
        """The bytes that have arrived at the host by now."""
        if not self._queue:
            return b""
        until_s = math.floor(now_s / self.burst_s) * self.burst_s if self.burst_s > 0 else now_s
        until_s -= self.late_s
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
        return b"" if self.mute else bytes(sent)

    def _hit(self, rate: float) -> bool:
        return rate > 0 and self._random.random() < rate
