"""Waits until a turn of the loop is due, or until bytes arrive on a port that is listened to.

Bytes read only at the next tick would be stamped up to a tick late. Reads no clock and no bytes.
Late by a millisecond at most where nothing arrives: the system waits in whole ones.
"""

import contextlib
import math
import select
from collections.abc import Collection, Mapping, Sequence
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
    with its port and the number of its connection.
    """

    def __init__(self, beside: Beside) -> None:
        self._epoll = select.epoll()
        self._beside = beside
        self._on: dict[int, tuple[Port, int]] = {}  # by descriptor: whose, of which connection
        self._beside_fd = beside.fileno()
        if self._beside_fd >= 0:
            self._epoll.register(self._beside_fd, select.EPOLLIN)

    def wait(self, longest_s: float, ports: Sequence[Port]) -> Collection[Port]:
        """Those of these ports that have become readable; none: the time is over."""
        self._listen(ports)
        longest_s = min(longest_s, self._beside.wait_s)
        readable = [fd for fd, _ in self._epoll.poll(max(0.0, longest_s))]
        if self._beside_fd in readable or self._beside.wait_s <= 0.0:
            self._beside.run()
        return [self._on[fd][0] for fd in readable if fd in self._on]

    def close(self) -> None:
        self._epoll.close()

    def _listen(self, ports: Sequence[Port]) -> None:
        wanted = {fd: (port, port.opened) for port in ports if (fd := port.fileno()) >= 0}
        if wanted == self._on:
            return
        for fd, which in self._on.items():
            if wanted.get(fd) != which:
                with contextlib.suppress(OSError):  # closed meanwhile: the system has let it go
                    self._epoll.unregister(fd)
        for fd, which in wanted.items():
            if self._on.get(fd) != which:
                self._epoll.register(fd, select.EPOLLIN)
        self._on = wanted
