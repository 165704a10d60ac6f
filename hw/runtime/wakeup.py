"""Waits until a turn of the loop is due, or until bytes arrive on a port that is listened to.

Bytes read only at the next tick would be stamped up to a tick late. Reads no bytes.
Late by a millisecond at most where nothing arrives: the system waits in whole ones.
"""

import contextlib
import math
import select
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Protocol

from hw.device import DeviceStatus, Port


class EventSource(Protocol):
    """What else is waited for, and runs between two turns: servers."""

    @property
    def statuses(self) -> Mapping[str, DeviceStatus]:
        """How they are, by what the log calls them."""

    @property
    def wait_s(self) -> float:
        """Seconds from now until it wants to run, though nothing arrives."""

    def fileno(self) -> int:
        """Readable when it wants to run; -1: never."""

    def run(self) -> None:
        """Do what there is to do, and come back."""

    def close(self) -> None:
        """End, for good."""


class NoEvents:
    """Nobody is served."""

    statuses: Mapping[str, DeviceStatus] = {}
    wait_s = math.inf

    def fileno(self) -> int:
        return -1

    def run(self) -> None: ...

    def close(self) -> None: ...


class WakeUp:
    """Listens to ports that are open, or not, at any time; each is armed for one event at a time.

    So who is not listened to wakes nobody, not even within the system. A descriptor's number comes
    again for another wire: it counts as the same one only together with its port and the number of
    its connection.
    """

    def __init__(self, servers: EventSource, clock: Callable[[], float] = time.monotonic) -> None:
        self._epoll = select.epoll()
        self._servers, self._clock = servers, clock
        self._ports: Sequence[Port] = ()  # as given last
        self._fds: list[int] = []  # of them; -1: not open
        self._known: dict[int, tuple[Port, int]] = {}  # by descriptor: whose, of which connection
        self._armed: set[int] = set()
        self._servers_fd = servers.fileno()
        if self._servers_fd >= 0:
            self._epoll.register(self._servers_fd, select.EPOLLIN)

    def wait(
        self, due_s: float, ports: Sequence[Port], hears_s: Sequence[float]
    ) -> Collection[Port]:
        """Those of these ports that have become readable; none: it is due, or a server has run.

        Args:
            ports: the same sequence again stands for the same connections.
            hears_s: from when on each is listened to.
        """
        if ports is not self._ports:
            self._adopt(ports)
        while True:
            now_s = self._clock()
            until_s = min(due_s, self._arm(now_s, hears_s))
            wait_s = min(until_s - now_s, self._servers.wait_s)
            readable, has_run = list[Port](), self._servers.wait_s <= 0.0
            for fd, _ in self._epoll.poll(max(0.0, wait_s)):
                self._armed.discard(fd)
                has_run |= fd == self._servers_fd
                if fd in self._known:
                    readable.append(self._known[fd][0])
            if has_run:
                self._servers.run()
            if readable or has_run or not self._clock() < due_s:
                return readable

    def close(self) -> None:
        self._epoll.close()

    def _adopt(self, ports: Sequence[Port]) -> None:
        """Know these ports and no others; none of the new ones is armed yet."""
        self._ports, self._fds = ports, [port.fileno() for port in ports]
        known = {port.fileno(): (port, port.opened) for port in ports if port.fileno() >= 0}
        for fd, which in self._known.items():
            if known.get(fd) != which:
                self._armed.discard(fd)
                with contextlib.suppress(OSError):  # closed meanwhile: the system has let it go
                    self._epoll.unregister(fd)
        for fd, which in known.items():
            if self._known.get(fd) != which:
                self._epoll.register(fd, select.EPOLLONESHOT)
        self._known = known

    def _arm(self, now_s: float, hears_s: Sequence[float]) -> float:
        """Listen to whom it is time for, and to nobody else; when it is time for the next one."""
        next_s, armed = math.inf, self._armed
        for fd, from_s in zip(self._fds, hears_s, strict=False):
            is_heard = from_s <= now_s
            if not is_heard and from_s < next_s:
                next_s = from_s
            if is_heard is (fd in armed) or fd not in self._known:
                continue
            try:
                self._epoll.modify(fd, select.EPOLLONESHOT | (select.EPOLLIN if is_heard else 0))
            except OSError:  # closed: its port will say so
                continue
            (armed.add if is_heard else armed.discard)(fd)
        return next_s
