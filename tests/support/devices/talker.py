"""A fake that tests of wires put words into, for streams and for datagrams."""

import select
from collections.abc import Callable

PATIENCE = 400  # steps of 5 ms at most, for what the kernel does in microseconds


def until(done: Callable[[], object], step: Callable[[], None]) -> None:
    """Step until it is done, with up to 5 ms between steps."""
    for _ in range(PATIENCE):
        if done():
            return
        step()
        select.select([], [], [], 0.0 if done() else 0.005)
    raise AssertionError("nothing came of it")


def has_grown(count: Callable[[], int], before: int) -> bool:
    return count() == before + 1


class Talker:
    """Sends what it is told to, and remembers what it heard."""

    def __init__(self) -> None:
        self.says = b""
        self.says_datagrams: list[bytes] = []
        self.heard = b""
        self.heard_datagrams: list[bytes] = []
        self.clients: list[float] = []

    def exchange(self, now_s: float, received: bytes) -> bytes:
        self.heard += received
        says, self.says = self.says, b""
        return says

    def feed_datagram(self, now_s: float, data: bytes) -> None:
        self.heard_datagrams.append(data)

    def poll(self, now_s: float) -> list[bytes]:
        says, self.says_datagrams = self.says_datagrams, []
        return says

    def reconnected(self, now_s: float) -> None:
        self.clients.append(now_s)
