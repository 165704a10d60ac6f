"""What goes wrong on a wire, whatever it is made of: one set of faults, as plain attributes.

Offsets count every byte that the device ever sent, whatever became of it. Faults strike in this
order: alter_at, drop_at, damage and drop, mute; then the delay; then a cut. All chance is seeded.
"""

import random
from collections import deque
from typing import Protocol


class Fake(Protocol):
    """A device seen through its wire; may also have `reconnected(now_s)`: a new client came."""

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what the host wrote; give all that the device has sent up to now_s."""


class DatagramFake(Protocol):
    """A device whose wire keeps datagrams whole."""

    def feed_datagram(self, now_s: float, data: bytes) -> None: ...
    def poll(self, now_s: float) -> list[bytes]:
        """All datagrams that the device has sent up to now_s."""


class Late:
    """Bytes on their way to one host, in order: the first holds up all behind it."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, bytes]] = deque()  # due, data

    def put(self, due_s: float, data: bytes) -> None:
        """To arrive at due_s, or later if something before it does."""
        self._waiting.append((due_s, data))

    def take(self, now_s: float) -> list[bytes]:
        arrived: list[bytes] = []
        while self._waiting and self._waiting[0][0] <= now_s:
            arrived.append(self._waiting.popleft()[1])
        return arrived

    def clear(self) -> None:
        self._waiting.clear()


class Disturbance:
    """The faults of a wire between a device and its hosts, to be set at any time."""

    def __init__(self, seed: int) -> None:
        self.cut = False  # the plug is out; what is on the way is lost
        self.mute = False  # the device's bytes are swallowed, the host's still arrive
        self.delay_s = 0.0  # the device's bytes arrive late, in order
        self.drop_rate = 0.0  # share lost of what the device sends, 0..1
        self.damage_rate = 0.0  # share altered of what the device sends, 0..1
        self.host_drop_rate = 0.0  # share lost of what the host sends, 0..1
        self.host_damage_rate = 0.0  # share altered of what the host sends, 0..1
        self.alter_at: dict[int, int] = {}  # offset in the device's stream -> XOR mask
        self.drop_at: set[int] = set()  # offsets in the device's stream that get lost
        self.sent = 0  # bytes that the device has sent so far: the offset of its next one
        self._random = random.Random(seed)

    def send(self, now_s: float, data: bytes, late: Late) -> None:
        """Put on the way to a host what is left of the device's bytes."""
        left = self.thinned(self._altered(data))
        if left and not self.mute:
            late.put(now_s + self.delay_s, left)

    def heard(self, data: bytes) -> bytes:
        return data and self._noisy(data, self.host_drop_rate, self.host_damage_rate)

    def thinned(self, data: bytes) -> bytes:
        """What chance leaves of the device's bytes; rates are per byte."""
        return self._noisy(data, self.drop_rate, self.damage_rate)

    def _altered(self, data: bytes) -> bytes:
        first, self.sent = self.sent, self.sent + len(data)
        if not self.alter_at and not self.drop_at:
            return data
        return bytes(
            byte ^ self.alter_at.get(offset, 0)
            for offset, byte in enumerate(data, first)
            if offset not in self.drop_at
        )

    def _noisy(self, data: bytes, drop_rate: float, damage_rate: float) -> bytes:
        if not drop_rate and not damage_rate:
            return data
        left = bytearray()
        for byte in data:
            mask = self._random.randrange(1, 256) if self._hit(damage_rate) else 0
            if not self._hit(drop_rate):
                left.append(byte ^ mask)
        return bytes(left)

    def _hit(self, rate: float) -> bool:
        return self._random.random() < rate


def tell_reconnected(fake: object, now_s: float) -> None:
    """A new client has connected; a fake on a serial line does not ask to know."""
    reconnected = getattr(fake, "reconnected", None)
    if reconnected is not None:
        reconnected(now_s)
