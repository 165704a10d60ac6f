"""Which frames count and have arrived: tags, numbers, the gap that may hide something, ACK's mask.

Source: planner link, sections 5, 6 and 9.
"""

import math
from collections import deque
from dataclasses import dataclass

from mapod_link.bodies import Geometry
from mapod_link.frames import AUTH, Frame, int16, tag_is_right

SESSIONS_KEPT = 4096  # sessions left behind, which are not taken up again with a key
ALL_BITS = 0xFFFFFFFF
SILENCE_MS, HALF = 60_000, 2**31  # between two frames: numbers may have wrapped unseen


@dataclass(slots=True)
class Ignored:
    """How many frames were left alone."""

    repeated: int = 0  # older than the newest, or twice
    types: int = 0  # of no type for a receiver
    maps: int = 0  # of another geometry


class Numbers:
    """The books of one direction.

    Attributes:
        last: number of the newest frame that counted.
        mask: bit i: frame last - 1 - i counted as well.
        gap: newest frame that may have changed cells unseen; None: nothing is suspect.
        taken: how many frames counted.
        gaps, missing: how often numbers were left out, and how many.
    """

    def __init__(self, key: bytes | None = None) -> None:
        self._key = key
        self._left_sessions: deque[int] = deque(maxlen=SESSIONS_KEPT)
        self.any = False  # a frame has counted: the others mean something
        self.last = self.mask = self.t_ms = 0
        self.counted_s = self.map_s = -math.inf  # newest frame; newest map that was taken over
        self.gap: int | None = None
        self.taken = self.gaps = self.missing = 0

    def is_genuine(self, frame: Frame, geom: Geometry | None, nonce: int) -> bool:
        """Whether its tag is right, where there is a key; no session that was left comes back.

        Args:
            geom: which names the session: the frame's own, or the newest.
        """
        if self._key is None:
            return True
        if geom is None or not frame.flags & AUTH or geom.session in self._left_sessions:
            return False
        return tag_is_right(frame, self._key, geom.session, nonce)

    def leave(self, session: int) -> None:
        """The sender runs anew, as another session."""
        self._left_sessions.append(session)

    def is_newer(self, frame: Frame) -> bool:
        """Whether a frame is to be taken. With a key its clock may not go back either.

        A session ends before the sender's clock wraps, so the clocks compare as plain numbers.
        """
        if not self.any:
            return True
        if self._key is not None and frame.t_ms < self.t_ms:
            return False
        return self.is_after_silence(frame) or int16(frame.seq - self.last) > 0

    def is_after_silence(self, frame: Frame) -> bool:
        """So long after the newest that numbers tell neither what is newer nor what was missed."""
        return self.any and SILENCE_MS <= (frame.t_ms - self.t_ms) % 2**32 < HALF

    def count(self, now_s: float, frame: Frame, begins: bool) -> None:
        """A frame that is taken; `begins`: numbers before it say nothing."""
        if begins or not self.any:
            self.mask = 0
        else:
            step = int16(frame.seq - self.last)
            if step > 1:
                self.gap = frame.seq - 1
                self.gaps, self.missing = self.gaps + 1, self.missing + step - 1
            self.mask = (self.mask << step | 1 << (step - 1)) & ALL_BITS if step <= 32 else 0
        self.taken += 1
        self.any, self.last, self.t_ms, self.counted_s = True, frame.seq, frame.t_ms, now_s

    def repair(self, repaired: int) -> None:
        """A map frame says that all up to that number was told again, or has arrived."""
        if self.gap is not None and int16(repaired - self.gap) >= 0:
            self.gap = None
