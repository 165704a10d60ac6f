"""A receiver on a wire, for a planner that wants maps and nothing else: blocking, one thread.

`update` has to be called often, ten times a second or more: it takes what has arrived and answers.
"""

import secrets
import time
from collections.abc import Callable

from mapod_link.receiver import Receiver
from mapod_link.tiles import MOST_CELLS, Tile
from mapod_link.wires import Wire, wire_from_url

SLICE_S = 0.02  # answers are due every so often


class Link:
    """A receiver and its wire. Every method that waits keeps both alive meanwhile.

    Attributes:
        receiver: all that is known; its methods want the time as `link.now_s()`.
        url: with the port that a bound socket got.
    """

    def __init__(self, wire: Wire, receiver: Receiver) -> None:
        self._wire, self.receiver = wire, receiver
        self._peer: object = None  # who answers went to last

    def __enter__(self) -> "Link":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def url(self) -> str:
        return self._wire.url

    @staticmethod
    def now_s() -> float:
        """The clock by which frames arrive: the monotonic one."""
        return time.monotonic()

    def update(self, timeout_s: float = 0.1) -> bool:
        """Take what arrives and answer, until a frame was taken (True) or the time is over (False).

        Raises:
            OSError: the wire is gone.
        """
        before, until_s = self.receiver.numbers.taken, self.now_s() + timeout_s
        while True:
            now_s = self.step(min(SLICE_S, until_s - self.now_s()))
            if self.receiver.numbers.taken > before or now_s >= until_s:
                return self.receiver.numbers.taken > before

    def step(self, wait_s: float) -> float:
        """Wait for bytes, take them, answer once; gives the time. `OSError`: the wire is gone."""
        self._wire.wait(wait_s)
        self._wire.feed(self.receiver)
        if self._wire.peer != self._peer:  # somebody, who has not heard of us
            self._peer = self._wire.peer
            self.receiver.greet()
        now_s = self.now_s()
        if self._peer is not None:
            for frame in self.receiver.poll(now_s):
                self._wire.write(frame)
        return now_s

    def wait_for(self, holds: Callable[[Receiver], bool], timeout_s: float) -> bool:
        """Update until it holds; False if the time is over before."""
        until_s = self.now_s() + timeout_s
        while not holds(self.receiver):
            if self.now_s() >= until_s:
                return False
            self.update(min(SLICE_S, until_s - self.now_s()))
        return True

    def advice(self) -> tuple[str, str]:
        return self.receiver.advice(self.now_s())

    def allowed_mps(self) -> tuple[float, float]:
        """How fast ahead and back, by the sender's stop zone, as of now."""
        return self.receiver.allowed_mps(self.now_s())

    def stale(self) -> bool:
        return self.receiver.stale(self.now_s())

    def drive(self, v_mps: float, w_radps: float, valid_s: float = 0.3) -> bool:
        """Ask the robot to move; at least three times within `valid_s`. See `Receiver.drive`."""
        asked = self.receiver.drive(self.now_s(), v_mps, w_radps, valid_s)
        self.update(0.0)
        return asked

    def tile(
        self,
        layer: str,
        i: int,
        j: int,
        width: int,
        height: int,
        *,
        in_window: bool = False,
        timeout_s: float = 5.0,
    ) -> Tile:
        """A rectangle, see `Receiver.ask_tile`; not `complete` if refused or too late."""
        tile = self.receiver.ask_tile(layer, i, j, width, height, in_window=in_window)
        if not self.wait_for(lambda _: tile.done, timeout_s):
            self.receiver.tiles.drop(tile)
        return tile

    def close(self) -> None:
        self._wire.close()


def open_link(
    url: str,
    *,
    key: bytes | None = None,
    ack_every: int = 4,
    max_cells: int = MOST_CELLS,
    poll_only: bool = False,
) -> Link:
    """The planner's end of the link, as mapod's setting `planner.port` names it.

    Args:
        url: "udp://host:port" (is bound), "tcp://host:port" (listens), "serial:///path?baud=115200".
        key: 32 bytes, as in the sender's key file; None: no authentication.
        ack_every: frames per acknowledgement, besides one each 100 ms; 0: say nothing at all.
        max_cells: of the largest window that is taken.
        poll_only: the sender is to push nothing; tiles are all that is asked for.

    Raises:
        ValueError: not such a URL, or not such a key.
        OSError: the port is taken, or there is no such line.
    """
    nonce = secrets.randbelow(2**32 - 1) + 1 if ack_every else 0
    receiver = Receiver(
        nonce, key=key, ack_every=ack_every, max_cells=max_cells, poll_only=poll_only
    )
    return Link(wire_from_url(url), receiver)
