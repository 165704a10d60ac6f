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


class Beside(Protocol):
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


class Nothing:
    """Nobody is served."""

    statuses: Mapping[str, DeviceStatus] = {}
    wait_s = math.inf

    def fileno(self) -> int:
        return -1

    def run(self) -> None: ...

    def close(self) -> None: ...


class WakeUp:
    """Knows which ports are listened to, by their descriptors; these are open, or not, at any time.

    A descriptor's number comes again for another wire, so it counts as the same one only together
    with its port and the number of its connection. Each is armed for one event at a time: who is
    not listened to wakes nobody, not even within the system.
    """

    def __init__(self, beside: Beside, clock: Callable[[], float] = time.monotonic) -> None:
        self._epoll = select.epoll()
        self._beside, self._clock = beside, clock
        self._known: dict[int, tuple[Port, int]] = {}  # by descriptor: whose, of which connection
        self._armed: set[int] = set()
        self._beside_fd = beside.fileno()
        if self._beside_fd >= 0:
            self._epoll.register(self._beside_fd, select.EPOLLIN)

    def wait(
        self, due_s: float, ports: Sequence[Port], hears_s: Sequence[float]
    ) -> Collection[Port]:
        """Those of these ports that have become readable; none: it is due, or a server has run.

        Args:
            hears_s: from when on each is listened to.
        """
        while True:
            now_s = self._clock()
            until_s = min(due_s, self._listen(now_s, ports, hears_s))
            wait_s = min(until_s - now_s, self._beside.wait_s)
            found = [fd for fd, _ in self._epoll.poll(max(0.0, wait_s))]
            self._armed.difference_update(found)
            if has_run := self._beside_fd in found or self._beside.wait_s <= 0.0:
                self._beside.run()
            readable = [self._known[fd][0] for fd in found if fd in self._known]
            if readable or has_run or not self._clock() < due_s:
                return readable

    def close(self) -> None:
        self._epoll.close()

    def _listen(self, now_s: float, ports: Sequence[Port], hears_s: Sequence[float]) -> float:
        """Arm who is to be heard now; when the next one is."""
        next_s, listed = math.inf, set[int]()
        for port, from_s in zip(ports, hears_s, strict=False):
            fd = port.fileno()
            if fd < 0:
                continue
            if from_s > now_s:
                next_s = min(next_s, from_s)
                continue
            listed.add(fd)
            if self._known.get(fd) != (port, port.opened):
                self._forget(fd)
                self._epoll.register(fd, select.EPOLLIN | select.EPOLLONESHOT)
                self._known[fd] = (port, port.opened)
            elif fd not in self._armed:
                self._epoll.modify(fd, select.EPOLLIN | select.EPOLLONESHOT)
            self._armed.add(fd)
        for fd in self._armed - listed:
            self._forget(fd)
        return next_s

    def _forget(self, fd: int) -> None:
        if self._known.pop(fd, None):
            with contextlib.suppress(OSError):  # closed meanwhile: the system has let it go
                self._epoll.unregister(fd)
        self._armed.discard(fd)
