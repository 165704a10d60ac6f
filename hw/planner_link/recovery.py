"""What has arrived at one planner, and up to which frame nothing is missing any more.

Of each frame with cells it is known which marks it cleared, until an ACK speaks of it; these cells
of a lost one are marked to be sent again. `repaired` never goes back within an epoch.
Source: planner link, section 6.
"""

from collections import deque

from msgspec import Struct

from core.records import I32
from hw.planner_link.messages import NEED_GEOM, Ack
from hw.planner_link.published import PublishedMap

REMEMBERED = 512  # MAP frames without an ACK
MOST_LAG = 2**14  # frames: half of what a receiver can tell from the future


class SentMap(Struct, frozen=True):
    """A frame on its way: what to send again if it gets lost."""

    seq: int  # unwrapped
    cells: I32  # (k,) raster indices of those that were marked: the others it merely repeated
    origin: tuple[int, int]


class Repair:
    """The bookkeeping of one planner's acknowledgements."""

    def __init__(self, ring: PublishedMap, seq: int) -> None:
        """Before the frame after `seq`."""
        self._map = ring
        self.epoch_seq = seq + 1  # first frame of this epoch
        self.repaired = self._covered = seq
        self._sent: deque[SentMap] = deque()
        self._geom_seq = 0  # first GEOM frame of this epoch, while nobody knows of its arrival
        self.in_step = True  # ACKs, if any come, tell of every MAP frame of this epoch
        self.begun_again = False  # with the newest ACK: it knew nothing of what was told before
        self.frames_lost = 0

    def begin_epoch(self, seq: int) -> None:
        """After frame `seq`, both ends start from unknown."""
        self._sent.clear()
        self.repaired = self._covered = seq
        self.epoch_seq, self._geom_seq = seq + 1, 0
        self.in_step = True

    def note_geom(self, seq: int) -> None:
        """A GEOM frame goes out: what comes before the epoch's first one is ignored."""
        if seq == self.epoch_seq:
            self._geom_seq = seq

    def note_map(self, seq: int, cells: I32, origin: tuple[int, int]) -> int:
        """MAP frame `seq` goes out, its cells as of `SentMap`; the `repaired` that it tells.

        If nothing lost is left to be sent again, in frames up to this one, ACKs say how far.
        """
        if self.in_step:  # else all is sent again as soon as ACKs come
            if self.repaired < self._covered and self._map.lost == 0:
                self.repaired = self._covered
            self._sent.append(SentMap(seq, cells, origin))
            if len(self._sent) > REMEMBERED:
                self._sent.clear()
                self.in_step = False
        return self.repaired

    def take(self, newest: int, ack: Ack, geom_id: int) -> bool:
        """An ACK of frames of this epoch, `newest` unwrapped; False if the planner lacks GEOM."""
        if ack.geom_id != geom_id or ack.status & NEED_GEOM:
            self.in_step = False
            return False
        arrived = ack.mask << 1 | 1  # bit k: frame newest - k
        if 0 < self._geom_seq <= newest:
            self.in_step &= bool(arrived >> newest - self._geom_seq & 1)
            self._geom_seq = 0
        self.begun_again = not self.in_step
        if self.begun_again:
            # It ignored what came before the geometry, or was silent for long: all of it again
            self.in_step = True
            self._map.publish_again()
            self._sent.clear()
        seen: tuple[int, int] | None = None
        while self._sent and self._sent[0].seq <= newest:
            sent = self._sent.popleft()
            if arrived >> newest - sent.seq & 1:
                seen = sent.origin
            else:
                self.frames_lost += 1
                self._map.mark_lost(sent.cells, sent.origin)
        if seen is not None:
            self._map.note_seen(seen, (sent.origin for sent in self._sent))
        self._covered = max(self._covered, newest)
        return True
