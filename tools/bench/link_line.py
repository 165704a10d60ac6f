"""A simulated line between mapod's sender and a receiver: byte pace, delay, loss, no real time.

A serial line carries its bytes one after the other at its rate, and what is written while it is
busy waits; a datagram link carries at once. Each frame comes after the same delay or not at all.
Source: planner link, sections 2 and 11.
"""

import math
import random
from collections import deque
from dataclasses import dataclass

from mapod_link.serial_line import maybe_bytes_from_cobs, serial_from_frame

BITS = 10  # of a byte on the line
TTY_BYTES = 4096  # that a driver takes before it says that it is full


@dataclass(frozen=True, slots=True)
class Arrival:
    """One frame at the far end, or the instant at which it should have been there."""

    at_s: float
    frame: bytes  # without COBS
    is_lost: bool


class Lane:
    """One direction of the line."""

    def __init__(self, baud: int | None, delay_s: float, loss: float, seed: int) -> None:
        self.baud, self.delay_s, self.loss = baud, delay_s, loss
        self.bytes_sent = 0
        self._random = random.Random(seed)
        self._free_s = -math.inf  # when the line has sent what it was given
        self._way: deque[Arrival] = deque()

    def send(self, now_s: float, data: bytes) -> None:
        """What one end writes: a datagram, or frames in COBS."""
        if self.baud is None:
            self._carry(now_s, data, len(data))
            return
        for piece in data.split(b"\0")[:-1]:
            frame = maybe_bytes_from_cobs(piece)
            assert frame is not None, "what the sender writes is COBS"
            self._carry(now_s, frame, len(piece) + 1)

    def _carry(self, now_s: float, frame: bytes, wire_bytes: int) -> None:
        self.bytes_sent += wire_bytes
        busy_s = 0.0 if self.baud is None else wire_bytes * BITS / self.baud
        self._free_s = max(now_s, self._free_s) + busy_s
        if frame:
            is_lost = self._random.random() < self.loss
            self._way.append(Arrival(self._free_s + self.delay_s, frame, is_lost))

    def waiting_s(self, now_s: float) -> float:
        """How long the line still needs for what it was given."""
        return max(0.0, self._free_s - now_s)

    def arrivals(self, until_s: float) -> list[Arrival]:
        """What has come, or got lost, since the last call; in order."""
        come = []
        while self._way and self._way[0].at_s <= until_s:
            come.append(self._way.popleft())
        return come


class LinePort:
    """The sender's port on a simulated line (`hw.device.Port`); its owner sets `now_s`."""

    def __init__(self, to_receiver: Lane, to_sender: Lane, buffer_bytes: int = TTY_BYTES) -> None:
        self.datagrams = to_receiver.baud is None
        self.cause, self.opened, self.now_s = "", 1, 0.0
        self._out, self._in, self._buffer_bytes = to_receiver, to_sender, buffer_bytes

    @property
    def backlog(self) -> int:
        """Bytes that the driver's buffer has no room for."""
        if self._out.baud is None:
            return 0
        waiting = math.ceil(self._out.waiting_s(self.now_s) * self._out.baud / BITS - 1e-6)
        return max(0, waiting - self._buffer_bytes)

    @backlog.setter
    def backlog(self, waiting: int) -> None:
        """The line alone decides."""

    def fileno(self) -> int:
        return -1

    def poll(self, now_s: float) -> bool:
        return True

    def read(self) -> list[bytes]:
        come = [arrival.frame for arrival in self._in.arrivals(self.now_s) if not arrival.is_lost]
        return come if self.datagrams else [serial_from_frame(frame) for frame in come]

    def write(self, data: bytes) -> None:
        self._out.send(self.now_s, data)

    def close(self) -> None:
        """Nothing to let go of."""
