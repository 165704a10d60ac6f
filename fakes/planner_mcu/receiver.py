"""Fake planner: the public receiver with the faults of a real one, set by attributes.

What it makes of frames is not its own: see `mapod_link`.
"""

import random

from mapod_link.receiver import Receiver


class FakePlanner(Receiver):
    """A planner on a simulated clock.

    Attributes:
        mute, deaf, loss_rate: faults, for tests to set: it answers nothing, it hears nothing, it
            hears each frame with this much less than certainty.
    """

    def __init__(
        self,
        seed: int = 0,
        key: bytes | None = None,
        ack_every: int = 16,
        poll_only: bool = False,
    ) -> None:
        self.mute, self.deaf, self.loss_rate = False, False, 0.0
        self._random = random.Random(seed)
        super().__init__(
            self._random.randint(1, 2**32 - 1) if ack_every else 0,
            key=key,
            ack_every=ack_every,
            poll_only=poll_only,
        )

    def feed_datagram(self, now_s: float, data: bytes) -> bool:
        """One frame, unless a fault keeps it away; whether it was taken."""
        if self.deaf or (self.loss_rate and self._random.random() < self.loss_rate):
            return False
        return super().feed_datagram(now_s, data)

    def poll(self, now_s: float) -> list[bytes]:
        frames = super().poll(now_s)
        return [] if self.mute else frames
