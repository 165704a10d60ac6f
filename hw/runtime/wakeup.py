"""Wakes the app the moment bytes arrive, by the descriptors of the ports that are open.

Bytes read only at the next tick would be stamped up to a tick late. Reads no clock and no bytes:
what is called does that. Refuses to let a wire that never stops keep the loop from its ticks.
"""

from collections.abc import Callable, Iterable
from typing import Protocol

from hw.device import Port

CALLS = 32  # between two ticks, of all wires together; what arrives beyond waits for the tick


class Loop(Protocol):
    """The two calls of an asyncio loop that are used."""

    def add_reader(self, fd: int, callback: Callable[[], object], /) -> object: ...

    def remove_reader(self, fd: int, /) -> object: ...


class WakeUp:
    """Listens to the ports that are open; to be told after each tick, which may open or close some.

    A descriptor's number comes again for another wire, so it counts as the same one only together
    with its port and the number of its connection.
    """

    def __init__(self, loop: Loop, ports: Iterable[Port], hear: Callable[[], None]) -> None:
        self._loop, self._ports, self._hear = loop, tuple(ports), hear
        self._on: dict[int, tuple[int, int]] = {}  # by descriptor: which port, which connection
        self._left = 0  # calls until the next tick

    def after_tick(self) -> None:
        self._left = CALLS
        self._listen()

    def close(self) -> None:
        self._left = 0
        self._listen()

    def _listen(self) -> None:
        wanted = {
            port.fileno(): (number, port.opened)
            for number, port in enumerate(self._ports)
            if self._left > 0 and port.fileno() >= 0
        }
        if wanted == self._on:
            return
        for fd, which in self._on.items():
            if wanted.get(fd) != which:
                self._loop.remove_reader(fd)
        for fd, which in wanted.items():
            if self._on.get(fd) != which:
                self._loop.add_reader(fd, self._wake)
        self._on = wanted

    def _wake(self) -> None:
        """Bytes, or the end of a connection, which reading finds and closes."""
        self._left -= 1
        self._hear()
        self._listen()
