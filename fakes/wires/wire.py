"""Joins a fake to the app in memory, with faults to order; no time passes but what it is told.

A wire moves bytes both ways whenever it is stepped. It waits for nothing and reads no clock. Those
that other programs reach, with the same faults, are in `sockets.py` and `pty.py`.
"""

from fakes.wires.disturbance import DatagramFake, Disturbance, Fake, Late, tell_reconnected
from fakes.wires.pty import PtyWire
from fakes.wires.sockets import TcpWire

__all__ = ["DatagramWire", "Fake", "MemoryPort", "PtyWire", "TcpWire", "Wire"]


class MemoryPort:
    """A port of the app without a wire, and the end of it that a fake holds.

    `connected` is the wire's plug. Pulled, everything on the way is lost; in again, `opened` grows.
    """

    def __init__(self, datagrams: bool = False) -> None:
        self.datagrams = datagrams
        self.cause, self.opened, self.backlog = "", 1, 0
        self._connected, self._closed = True, False
        self._to_host: list[bytes] = []
        self._to_device: list[bytes] = []

    @property
    def connected(self) -> bool:
        """Whether the wire is plugged in; settable. A closed port stays as it is."""
        return self._connected

    @connected.setter
    def connected(self, connected: bool) -> None:
        if self._closed or connected == self._connected:
            return
        self._connected, self.backlog = connected, 0
        self._to_host, self._to_device = [], []
        self.opened += connected
        self.cause = "" if connected else "the wire in memory is cut"

    def fileno(self) -> int:
        """-1: nothing of it is known to the operating system."""
        return -1

    def poll(self, now_s: float) -> bool:
        return self._connected

    @property
    def has_arrived(self) -> bool:
        """Whether bytes wait to be read."""
        return bool(self._to_host)

    def read(self) -> list[bytes]:
        if not self._to_host:
            return []
        pieces, self._to_host = self._to_host, []
        return pieces

    def write(self, data: bytes) -> None:
        """Keep for the fake; dropped while not connected. A datagram is never in the backlog."""
        if self._connected and data:
            self._to_device.append(bytes(data))
            self.backlog += 0 if self.datagrams else len(data)

    def close(self) -> None:
        self.connected = False
        self._closed, self.cause = True, "closed"

    def take(self) -> bytes:
        """The fake's side: all that the host wrote since the last call."""
        return b"".join(self.take_datagrams())

    def take_datagrams(self) -> list[bytes]:
        """The fake's side: what the host wrote since the last call, one item a write."""
        if not self._to_device:
            return []
        written, self._to_device, self.backlog = self._to_device, [], 0
        return written

    def give(self, data: bytes) -> None:
        """The fake's side: one piece, or one datagram, for the host; lost while not connected."""
        if self._connected and (data or self.datagrams):
            self._to_host.append(bytes(data))


class MemoryWire(Disturbance):
    """What both wires in memory have: a plug, which `cut` pulls, and what is on its way."""

    def __init__(self, port: MemoryPort, seed: int) -> None:
        super().__init__(seed)
        self._port, self._late = port, Late()
        self._opened = 0  # as the port counted when it was last asked
        self._pulled = False  # by this wire: a plug that somebody else pulled is theirs to put in

    def plug(self, now_s: float, fake: object) -> None:
        """Pull the port's plug or put it in; a fake is told if the host has connected anew."""
        if self.cut != self._pulled:
            self._pulled, self._port.connected = self.cut, not self.cut
        if self._port.opened != self._opened and self._port.connected:
            self._opened = self._port.opened
            self._late.clear()
            tell_reconnected(fake, now_s)


class Wire(MemoryWire):
    """A stream between a fake and a MemoryPort; rates are per byte."""

    def __init__(self, fake: Fake, port: MemoryPort, seed: int) -> None:
        super().__init__(port, seed)
        self.chunk = 0  # the device's bytes come in pieces of at most so many; 0: as sent
        self._fake = fake

    def step(self, now_s: float) -> None:
        self.plug(now_s, self._fake)
        sent = self._fake.exchange(now_s, self.heard(self._port.take()))
        if sent:
            self.send(now_s, sent, self._late)
        for data in self._late.take(now_s):
            size = self.chunk or len(data)
            for start in range(0, len(data), size):
                self._port.give(data[start : start + size])


class DatagramWire(MemoryWire):
    """Whole datagrams between a fake and a MemoryPort; drop rates are per datagram."""

    def __init__(self, fake: DatagramFake, port: MemoryPort, seed: int) -> None:
        super().__init__(port, seed)
        self._fake = fake

    def step(self, now_s: float) -> None:
        self.plug(now_s, self._fake)
        for datagram in self._port.take_datagrams():
            if not self._hit(self.host_drop_rate):
                self._fake.feed_datagram(now_s, self._noisy(datagram, 0.0, self.host_damage_rate))
        for datagram in self._fake.poll(now_s):
            self.send(now_s, datagram, self._late)
        for datagram in self._late.take(now_s):
            self._port.give(datagram)

    def thinned(self, data: bytes) -> bytes:
        """Nothing, or all with some bytes altered."""
        return b"" if self._hit(self.drop_rate) else self._noisy(data, 0.0, self.damage_rate)
