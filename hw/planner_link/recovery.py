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

ACK_WINDOW = 33  # frames that an ACK speaks of
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

    def note_map(self, sent: SentMap) -> None:
        if not self.in_step:
            return  # all is sent again as soon as ACKs come
        self._sent.append(sent)
        if len(self._sent) > REMEMBERED:
            self._sent.clear()
            self.in_step = False

    def note_round(self, first_seq: int) -> None:
        """A whole round of the refresh, begun with that frame, is sent with the next one."""
        self.repaired = max(self.repaired, first_seq - 1)

    def settle(self) -> None:
        """If nothing lost is left to be sent again, in frames up to the next, ACKs say how far."""
        if self._map.lost == 0 and self.in_step:
            self.repaired = max(self.repaired, self._covered)

    def lags(self, seq: int) -> bool:
        """Whether `repaired` is so far behind that a receiver might take it for the future."""
        return seq - self.repaired > MOST_LAG

    def take(self, newest: int, ack: Ack, geom_id: int) -> bool:
        """An ACK of frames of this epoch, `newest` unwrapped; False if the planner lacks GEOM."""
        if ack.geom_id != geom_id or ack.status & NEED_GEOM:
            self.in_step = False
            return False
        if 0 < self._geom_seq <= newest:
            self.in_step &= _arrived(self._geom_seq, newest, ack.mask)
            self._geom_seq = 0
        if not self.in_step:
            # It ignored what came before the geometry, or was silent for long: all of it again
            self.in_step = True
            self._map.publish_again()
            self._sent.clear()
        self._settle_frames(newest, ack.mask)
        self._covered = max(self._covered, newest)
        return True

    def _settle_frames(self, newest: int, mask: int) -> None:
        seen: tuple[int, int] | None = None
        while self._sent and self._sent[0].seq <= newest:
            sent = self._sent.popleft()
            if _arrived(sent.seq, newest, mask):
                seen = sent.origin
            else:
                self.frames_lost += 1
                self._map.mark_lost(sent.cells, sent.origin)
        if seen is not None:
            self._map.note_seen(seen, [sent.origin for sent in self._sent])


def _arrived(seq: int, newest: int, mask: int) -> bool:
    age = newest - seq
    return age == 0 or (age < ACK_WINDOW and bool(mask >> (age - 1) & 1))
