"""Joins a fake to the app: in memory with faults to order, over TCP, UDP, or a pty.

A wire moves bytes both ways whenever it is stepped. It waits for nothing and reads no clock.

Source: Modbus sheet, section 6, for what a pty does and needs.
"""

import contextlib
import os
import random
import socket
import tty
from collections import deque
from typing import Protocol

READ_SIZE = 65536
TCP_BACKLOG = 1 << 20  # bytes kept for a client that does not read; what comes then is lost
PTY_BACKLOG = 1024  # beyond the kernel's own 4 to 16 KiB; old news to whoever opens next, so little


class Fake(Protocol):
    """A device seen through its wire; may also have `reconnected(now_s)`: a new client came."""

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what the host wrote; give all that the device has sent up to now_s."""


class DatagramFake(Protocol):
    """A device whose wire keeps datagrams whole."""

    def feed_datagram(self, now_s: float, data: bytes) -> None:
        """Take one datagram that the host wrote."""

    def poll(self, now_s: float) -> list[bytes]:
        """All datagrams that the device has sent up to now_s."""


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

    def poll(self, now_s: float) -> bool:
        """True while connected."""
        return self._connected

    def read(self) -> list[bytes]:
        """The pieces that were given, as they were given."""
        pieces, self._to_host = self._to_host, []
        return pieces

    def write(self, data: bytes) -> None:
        """Keep for the fake; dropped while not connected. A datagram is never in the backlog."""
        if self._connected and data:
            self._to_device.append(bytes(data))
            self.backlog += 0 if self.datagrams else len(data)

    def close(self) -> None:
        """Unplugged for good."""
        self.connected = False
        self._closed, self.cause = True, "closed"

    def take(self) -> bytes:
        """The fake's side: all that the host wrote since the last call."""
        return b"".join(self.take_datagrams())

    def take_datagrams(self) -> list[bytes]:
        """The fake's side: what the host wrote since the last call, one item a write."""
        written, self._to_device, self.backlog = self._to_device, [], 0
        return written

    def give(self, data: bytes) -> None:
        """The fake's side: one piece, or one datagram, for the host; lost while not connected."""
        if self._connected and (data or self.datagrams):
            self._to_host.append(bytes(data))


class _Disturbed:
    """A fake on a MemoryPort, with faults as plain attributes, to be set at any time.

    Offsets count every byte that the device ever sent, whatever became of it. Faults strike in
    this order: alter_at, drop_at, damage and drop, mute; then the delay; then a cut.
    """

    def __init__(self, fake: object, port: MemoryPort, seed: int) -> None:
        self.cut = False  # the plug is out; what is on the way is lost
        self.mute = False  # the device's bytes are swallowed, the host's still arrive
        self.delay_s = 0.0  # the device's bytes arrive late, in order
        self.drop_rate = self.damage_rate = 0.0  # device to host
        self.host_drop_rate = self.host_damage_rate = 0.0  # host to device
        self.alter_at: dict[int, int] = {}  # offset in the device's stream -> XOR mask
        self.drop_at: set[int] = set()
        self.sent = 0  # bytes that the device has sent so far: the offset of its next one
        self._whom, self._port, self._random = fake, port, random.Random(seed)
        self._late: deque[tuple[float, bytes]] = deque()  # due, data
        self._opened = 0  # as the port counted when the fake was last told
        self._pulled = False  # by this wire: a plug that somebody else pulled is theirs to put in

    def step(self, now_s: float) -> None:
        """Move what is due, both ways."""
        if self.cut != self._pulled:
            self._pulled, self._port.connected = self.cut, not self.cut
        if self._port.connected and self._port.opened != self._opened:
            self._opened = self._port.opened
            self._late.clear()
            tell_reconnected(self._whom, now_s)
        for sent in self._exchanged(now_s):
            left = self._thinned(self._altered(sent))
            if left and not self.mute:
                self._late.append((now_s + self.delay_s, left))
        while self._late and self._late[0][0] <= now_s:  # the first holds up all behind it
            self._deliver(self._late.popleft()[1])

    def _exchanged(self, now_s: float) -> list[bytes]:
        """Hand the host's bytes to the fake; what the fake sent, in pieces that belong together."""
        raise NotImplementedError

    def _thinned(self, data: bytes) -> bytes:
        """Chance's share of the device's bytes taken."""
        raise NotImplementedError

    def _deliver(self, data: bytes) -> None:
        self._port.give(data)

    def _altered(self, data: bytes) -> bytes:
        """The device's next bytes with the faults at given offsets."""
        first, self.sent = self.sent, self.sent + len(data)
        if not any(first <= offset < self.sent for offset in (*self.alter_at, *self.drop_at)):
            return data
        return bytes(
            byte ^ self.alter_at.get(offset, 0)
            for offset, byte in enumerate(data, first)
            if offset not in self.drop_at
        )

    def _noisy(self, data: bytes, drop_rate: float, damage_rate: float) -> bytes:
        """Each byte lost or altered by chance."""
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


class Wire(_Disturbed):
    """A stream between a fake and a MemoryPort; rates are per byte."""

    def __init__(self, fake: Fake, port: MemoryPort, seed: int) -> None:
        super().__init__(fake, port, seed)
        self.chunk = 0  # the device's bytes come in pieces of at most so many; 0: as sent
        self._fake = fake

    def _exchanged(self, now_s: float) -> list[bytes]:
        received = self._noisy(self._port.take(), self.host_drop_rate, self.host_damage_rate)
        return [self._fake.exchange(now_s, received)]

    def _thinned(self, data: bytes) -> bytes:
        return self._noisy(data, self.drop_rate, self.damage_rate)

    def _deliver(self, data: bytes) -> None:
        size = self.chunk or len(data)
        for start in range(0, len(data), size):
            self._port.give(data[start : start + size])


class DatagramWire(_Disturbed):
    """Whole datagrams between a fake and a MemoryPort; drop rates are per datagram."""

    def __init__(self, fake: DatagramFake, port: MemoryPort, seed: int) -> None:
        super().__init__(fake, port, seed)
        self._fake = fake

    def _exchanged(self, now_s: float) -> list[bytes]:
        for datagram in self._port.take_datagrams():
            if not self._hit(self.host_drop_rate):
                self._fake.feed_datagram(now_s, self._noisy(datagram, 0.0, self.host_damage_rate))
        return self._fake.poll(now_s)

    def _thinned(self, data: bytes) -> bytes:
        return b"" if self._hit(self.drop_rate) else self._noisy(data, 0.0, self.damage_rate)


class TcpWire:
    """A fake that listens on TCP. One client has the device; others are turned away until it left.

    `cut`, settable: the client is thrown out and nobody gets in.
    """

    def __init__(self, fake: Fake, host: str = "127.0.0.1", port: int = 0) -> None:
        self._listener = socket.create_server((host, port), backlog=8)
        self._listener.setblocking(False)
        self.host, self.port = self._listener.getsockname()[:2]
        self.cut = False
        self.clients = self.turned_away = 0  # so far
        self.lost = 0  # bytes that a client was too slow for
        self._fake = fake
        self._client: socket.socket | None = None
        self._unsent = bytearray()

    def step(self, now_s: float) -> None:
        """Serve the client for what has come; let a new one in."""
        if self.cut:
            self._leave()
        self._send(self._fake.exchange(now_s, self._receive()))
        while (newcomer := self._maybe_newcomer()) is not None:
            if self._client is None and not self.cut:
                newcomer.setblocking(False)
                newcomer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._client, self.clients = newcomer, self.clients + 1
                tell_reconnected(self._fake, now_s)
            else:
                self.turned_away += 1
                newcomer.close()

    def close(self) -> None:
        """No client, no listener any more."""
        self._leave()
        self._listener.close()

    def _maybe_newcomer(self) -> socket.socket | None:
        try:
            return self._listener.accept()[0]
        except OSError:  # none, or gone before we looked
            return None

    def _receive(self) -> bytes:
        if self._client is None:
            return b""
        try:
            received = self._client.recv(READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError:  # reset
            received = b""
        if not received:
            self._leave()
        return received

    def _send(self, data: bytes) -> None:
        if self._client is None:
            return
        if len(self._unsent) + len(data) > TCP_BACKLOG:
            self.lost += len(data)
        else:
            self._unsent += data
        try:
            del self._unsent[: self._client.send(self._unsent) if self._unsent else 0]
        except BlockingIOError:
            pass
        except OSError:  # reset
            self._leave()

    def _leave(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None
        self._unsent.clear()


class UdpWire:
    """A fake that is bound to a UDP port and answers whoever wrote to it last."""

    def __init__(self, fake: DatagramFake, host: str = "127.0.0.1", port: int = 0) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((host, port))
        self.host, self.port = self._socket.getsockname()[:2]
        self._fake = fake
        self._peer: tuple[str, int] | None = None

    def step(self, now_s: float) -> None:
        """Take the datagrams that have come; send what is due, or lose it."""
        for _ in range(1000):  # no flood keeps us here
            try:
                datagram, self._peer = self._socket.recvfrom(READ_SIZE)
            except BlockingIOError:
                break
            except OSError:  # a peer that is gone shows here, once
                continue
            self._fake.feed_datagram(now_s, datagram)
        for datagram in self._fake.poll(now_s):
            try:
                if self._peer is not None:
                    self._socket.sendto(datagram, self._peer)
            except OSError:  # peer gone, or no room: lost, as datagrams are
                continue

    def close(self) -> None:
        """Let go of the port."""
        self._socket.close()


class PtyWire:
    """A fake on a pseudo terminal, which the host opens by `path` as it would a serial line.

    The fake keeps the host's end open too, so that hosts may come and go. No pacing: a pty is fast.
    """

    def __init__(self, fake: Fake) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)  # at once: a fresh pty echoes, and turns CR into LF
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self.cut = False  # nothing passes, as with a pulled plug; the line stays open
        self.lost = 0  # bytes that nobody read
        self._fake = fake
        self._unsent = bytearray()

    def step(self, now_s: float) -> None:
        """Move bytes both ways."""
        received = self._receive()
        sent = self._fake.exchange(now_s, b"" if self.cut else received)
        self._unsent += sent
        if self.cut:
            self._unsent.clear()
        with contextlib.suppress(BlockingIOError):
            del self._unsent[: os.write(self._master, self._unsent) if self._unsent else 0]
        self.lost += len(self._unsent[PTY_BACKLOG:])
        del self._unsent[PTY_BACKLOG:]

    def close(self) -> None:
        """Close both ends."""
        for end in (self._master, self._slave):
            if end >= 0:
                os.close(end)
        self._master = self._slave = -1

    def _receive(self) -> bytes:
        try:
            return os.read(self._master, READ_SIZE)
        except BlockingIOError:
            return b""


def tell_reconnected(fake: object, now_s: float) -> None:
    """A new client has connected; a fake on a serial line does not ask to know."""
    reconnected = getattr(fake, "reconnected", None)
    if reconnected is not None:
        reconnected(now_s)
