"""The serial line of the fake AX3500: characters that take their time in both directions.

Source: AX3500 sheet, sections 1 and 10: 9600 baud, 10 bits a character.
"""

import heapq
import math
from collections import deque

from fakes.ax3500.properties import Properties

BAUD = 9600
CHARACTER_S = 10 / BAUD


class SerialLine:
    """When each character has arrived, and when each one sent is out. Unpaced, both at once."""

    def __init__(self, of: Properties) -> None:
        self._of = of
        self._arriving: deque[tuple[float, int]] = deque()  # arrived_s, character
        self._waiting: list[tuple[float, int, int]] = []  # not before, order, character; a heap
        self._order = 0
        self._host_free_s = self._device_free_s = -math.inf  # when each direction falls idle

    @property
    def next_arrival_s(self) -> float:
        """When the next character from the host has arrived; inf: none is on the way."""
        return self._arriving[0][0] if self._arriving else math.inf

    def write(self, now_s: float, data: bytes) -> None:
        for character in data:
            self._host_free_s = max(now_s, self._host_free_s) + self._character_s
            self._arriving.append((self._host_free_s, character))

    def take(self) -> int:
        return self._arriving.popleft()[1]

    def send(self, not_before_s: float, data: bytes) -> None:
        """The device hands characters over; those that may go earlier do so."""
        for character in data:
            heapq.heappush(self._waiting, (not_before_s, self._order, character))
            self._order += 1

    def sent(self, now_s: float) -> bytes:
        waiting, character_s = self._waiting, self._character_s
        out = bytearray()
        while waiting:
            done_s = max(waiting[0][0], self._device_free_s) + character_s
            if done_s > now_s:
                break
            self._device_free_s = done_s
            out.append(heapq.heappop(waiting)[2])
        return bytes(out)

    def clear(self) -> None:
        self._arriving.clear()
        self._waiting.clear()

    @property
    def _character_s(self) -> float:
        return CHARACTER_S if self._of.paced else 0.0
