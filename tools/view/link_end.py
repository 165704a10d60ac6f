"""The planner's end of the link in an asyncio loop. A wire that goes is opened again."""

import asyncio
import time
from collections.abc import Callable

from mapod_link.wires import Wire, wire_from_url
from tools.terminal.planner_end import Meter, PlannerEnd, WatchingReceiver

POLL_S = 0.05  # answers are due so often, whatever arrives
REOPEN_S = 1.0


class LinkEnd:
    """A receiver that lives for as long as the server, on one wire after another.

    Attributes:
        epoch: counts the geometries and runs of the sender; nothing of one is true of the next.
        trouble: why there is no wire, in words; "" while there is one.
    """

    def __init__(self, wire: Wire, key: bytes | None = None) -> None:
        self.url, self.epoch, self.trouble = wire.url, 0, ""
        self.receiver = WatchingReceiver(key)
        self._end: PlannerEnd | None = PlannerEnd(wire, self.receiver)
        self._geometry: object = None
        self._watched = -1  # file descriptor
        self._reopen_s = 0.0

    @property
    def meter(self) -> Meter:
        return self._end.meter if self._end else Meter()

    @property
    def peer(self) -> object:
        """Where the frames come from; None while nobody is there."""
        return self._end.wire.peer if self._end else None

    @staticmethod
    def now_s() -> float:
        return time.monotonic()

    async def run(self, each_poll: Callable[[float], None]) -> None:
        """For ever: takes what arrives as it arrives; `each_poll(now_s)` 20 times a second."""
        loop = asyncio.get_running_loop()
        while True:
            if self._end is None:
                self._maybe_reopen()
            self.step()
            self._watch(loop)
            each_poll(self.now_s())
            await asyncio.sleep(POLL_S)

    def step(self) -> None:
        """Take what lies there, and send what is due."""
        if self._end is None:
            return
        try:
            self._end.step(0.0)
        except OSError as error:
            self._lose(error)
            return
        geom = self.receiver.geom
        geometry = (geom.session, *geom.layout) if geom else None
        if geometry is not None and geometry != self._geometry:
            self._geometry, self.epoch = geometry, self.epoch + 1
            self._end.meter = Meter()  # clocks of another run

    def close(self) -> None:
        if self._end is not None:
            self._end.wire.close()

    def _watch(self, loop: asyncio.AbstractEventLoop) -> None:
        fd = self._end.wire.fileno() if self._end else -1
        if fd != self._watched:
            if self._watched >= 0:
                loop.remove_reader(self._watched)
            if fd >= 0:
                loop.add_reader(fd, self.step)
            self._watched = fd

    def _lose(self, error: OSError) -> None:
        self.trouble = f"the wire is gone: {error.strerror or error}"
        if self._watched >= 0:
            asyncio.get_running_loop().remove_reader(self._watched)
        self.close()
        self._end, self._watched, self._reopen_s = None, -1, self.now_s() + REOPEN_S

    def _maybe_reopen(self) -> None:
        if self.now_s() < self._reopen_s:
            return
        try:
            self._end, self.trouble = PlannerEnd(wire_from_url(self.url), self.receiver), ""
        except OSError:
            self._reopen_s = self.now_s() + REOPEN_S
