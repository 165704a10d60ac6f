"""Loopback sockets and ptys for tests of ports: time is simulated, only bytes are waited for."""

import contextlib
import os
import select
import tty
from collections.abc import Callable, Iterator

from hw.device import Port

START_S = 100.0


def until(done: Callable[[], object]) -> None:
    """Give the kernel, and threads of ours, all the time that they need to bring it about."""
    for _ in range(60_000):
        if done():
            return
        select.select([], [], [], 0.0005)
    raise AssertionError("it did not come about")


def opened(port: Port, now_s: float = START_S) -> Port:
    until(lambda: port.poll(now_s))
    return port


def is_lost(port: Port, now_s: float) -> bool:
    """Whether it is found out, by reading, that the wire is gone."""
    return not port.read() and not port.poll(now_s)


def read_all(port: Port, size: int) -> bytes:
    """The next `size` bytes of a port, or more."""
    data = bytearray()

    def enough() -> bool:
        data.extend(b"".join(port.read()))
        return len(data) >= size

    until(enough)
    return bytes(data)


@contextlib.contextmanager
def pty_at(path: str = "") -> Iterator[tuple[int, str]]:
    """A serial device until the block ends: its own end, which never waits, and the host's path.

    Args:
        path: a link to it there; "" for the name that the kernel gives.
    """
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    if path:
        os.symlink(os.ttyname(slave), path)
    try:
        yield master, path or os.ttyname(slave)
    finally:
        if path:
            os.unlink(path)
        os.close(slave)
        with contextlib.suppress(OSError):  # a test may have closed it
            os.close(master)
