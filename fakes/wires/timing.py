"""What gives a fake device a pace of its own: its clock, and what it has said but not yet sent."""

import heapq

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


class Quartz:
    """A device's clock: its seconds since power-up, a little fast or slow against the host's."""

    def __init__(self) -> None:
        self.device_s = 0.0
        self._host_s: float | None = None
        self._rate = 1.0

    def follow(self, now_s: float, drift_ppm: float) -> float:
        """Run on to a host instant; returns that instant, or the last one if it lies before."""
        self._rate = 1.0 + 1e-6 * drift_ppm
        if self._host_s is None:
            self._host_s = now_s
        now_s = max(now_s, self._host_s)
        self.device_s += (now_s - self._host_s) * self._rate
        self._host_s = now_s
        return now_s

    def restart(self) -> None:
        self.device_s = 0.0

    def host_s(self, device_s: float) -> float:
        """The host instant at which it shows device_s, as fast as it runs now."""
        return (self._host_s or 0.0) + (device_s - self.device_s) / self._rate

    def host_times_s(self, device_s: F64) -> F64:
        """The host instants (n,) at which it shows device_s (n,)."""
        return (self._host_s or 0.0) + (device_s - self.device_s) / self._rate


class Outbox:
    """Pieces of the device's stream, each with the host instant at which its last byte is out."""

    def __init__(self) -> None:
        self._pieces: list[tuple[float, int, bytes]] = []
        self._count = 0

    def put(self, due_s: float, piece: bytes) -> None:
        """To be sent at due_s; what is due at the same instant keeps its order."""
        heapq.heappush(self._pieces, (due_s, self._count, piece))
        self._count += 1

    def take(self, until_s: float) -> bytes:
        if not self._pieces or self._pieces[0][0] > until_s:
            return b""
        due = bytearray()
        while self._pieces and self._pieces[0][0] <= until_s:
            due += heapq.heappop(self._pieces)[2]
        return bytes(due)

    def clear(self) -> None:
        self._pieces.clear()
