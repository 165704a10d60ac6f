"""Servers that live on asyncio, between the turns of the loop and in its thread."""

import asyncio
import heapq
import selectors
from collections.abc import Callable, Mapping
from contextvars import Context
from typing import Any, Protocol

from hw.device import DeviceStatus

ROUNDS = 8  # of asyncio's loop at once: who has always more to do goes on at the next turn


class Server(Protocol):
    """What is served."""

    status: DeviceStatus

    def start(self) -> None:
        """Begin, within the running loop."""

    async def stop(self) -> None:
        """End it, and close what is open."""


class Loop(asyncio.SelectorEventLoop):
    """asyncio's loop, which says when it wants to run instead of waiting by itself."""

    def __init__(self) -> None:
        self.selector = selectors.EpollSelector()
        self._due_s: list[float] = []  # a heap of instants, of timers that were cancelled as well
        self._has_more = False
        super().__init__(self.selector)

    def call_soon(  # type: ignore[override]
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        self._has_more = True
        return super().call_soon(callback, *args, context=context)

    def call_at(  # type: ignore[override]
        self,
        when: float,
        callback: Callable[..., object],
        *args: Any,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        heapq.heappush(self._due_s, when)
        return super().call_at(when, callback, *args, context=context)

    @property
    def wait_s(self) -> float:
        """How long it has nothing to do, unless its selector becomes readable."""
        if self._has_more:
            return 0.0
        return self._due_s[0] - self.time() if self._due_s else float("inf")

    def run_once(self) -> None:
        """Whatever is ready, and no wait. A timer that falls due meanwhile has its turn next."""
        now_s, self._has_more = self.time(), False
        self.stop()
        self.run_forever()
        while self._due_s and self._due_s[0] <= now_s:
            heapq.heappop(self._due_s)


class Servers:
    """All servers of a run."""

    def __init__(self, servers: Mapping[str, Server]) -> None:
        self._servers, self._loop = servers, Loop()
        self.statuses = {name: server.status for name, server in servers.items()}
        self._loop.call_soon(self._start)

    @property
    def wait_s(self) -> float:
        return self._loop.wait_s

    def fileno(self) -> int:
        return self._loop.selector.fileno()

    def run(self) -> None:
        for _ in range(ROUNDS):
            self._loop.run_once()
            if self._loop.wait_s > 0.0:
                return

    def close(self) -> None:
        """Stop them; raises what has ended one before, if anything has."""
        try:
            for server in self._servers.values():
                self._loop.run_until_complete(server.stop())
        finally:
            self._loop.close()

    def _start(self) -> None:
        for server in self._servers.values():
            server.start()
