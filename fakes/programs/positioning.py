"""The fake positioning system on UDP, where mapod reaches it as one more planner."""

import random

from fakes.positioning.system import FakePositioning, Seen
from mapod_link.receiver import Receiver
from mapod_link.wires import UdpWire


class PositioningOnUdp:
    """Its end of the planner link; `url` is what mapod's `planner.port` has to name."""

    def __init__(self, world: Seen, seed: int) -> None:
        self.system, self._wire = FakePositioning(world, seed), UdpWire("127.0.0.1", 0)
        nonce = random.Random(seed).randint(1, 2**32 - 1)
        self._receiver = Receiver(nonce, poll_only=True)
        self.url = self._wire.url

    def step(self, now_s: float) -> None:
        self._wire.feed(self._receiver)
        self.system.step(now_s, self._receiver)
        for frame in self._receiver.poll(now_s):
            self._wire.write(frame)

    def close(self) -> None:
        self._wire.close()
