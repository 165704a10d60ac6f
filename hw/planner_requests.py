"""Which of the drive requests on the planner link count, and until when.

A request counts if its commander has heard this very run, nobody else is driving, and it is newer
than all that came from that commander before. Its time counts from when it was sent, as far as the
fastest frame of that commander tells: what lay in a queue for long does not move a robot.
Source: planner link, section 3 (DRIVE) and section 9 (docs/planner-link.md).
"""

import math
from collections import Counter
from dataclasses import dataclass

from core.records import DriveRequest
from hw.planner_frames import Drive

MOST_COMMANDERS = 256  # of one run: what each has sent is kept, so that none of it counts twice
DRIFT = 0.001  # of the two clocks against each other, at most


@dataclass(slots=True)
class Commander:
    """What is known of one commander, by the nonce of its HELLO."""

    seq: int
    t_ms: int
    late_s: float  # by how much the newest frame took longer than the fastest one
    heard_s: float


class Requests:
    """The drive requests of one run of mapod."""

    def __init__(self, session: int, refusal: str) -> None:
        self._session, self._refusal = session, refusal
        self._commanders: dict[int, Commander] = {}
        self._driving = 0  # nonce of whose request is obeyed
        self.newest: DriveRequest | None = None
        self.accepted = 0
        self.refused: Counter[str] = Counter()  # by reason
        self.last_refusal = ""  # why the newest frame was refused; "" if it was not

    def take(self, now_s: float, drive: Drive) -> None:
        """One well-formed, where necessary authenticated frame."""
        reason = self._take(now_s, drive)
        if reason:
            self.refuse(reason)

    def refuse(self, reason: str) -> None:
        """Count a frame that is not obeyed."""
        self.refused[reason] += 1
        self.last_refusal = reason

    def _take(self, now_s: float, drive: Drive) -> str:
        """The reason if it is refused."""
        if self._refusal:
            return self._refusal
        if drive.session != self._session:
            return "it was meant for another run of mapod"
        known = self._commanders.get(drive.nonce)
        if known is None and len(self._commanders) >= MOST_COMMANDERS:
            return "there were too many commanders in this run: restart mapod"
        if known is not None and not _is_newer(drive, known):
            return "it is older than the newest, or a repetition"
        late_s = self._note(now_s, drive, known)
        until_s = now_s + drive.valid_s - late_s
        rules = self.newest is not None and now_s <= self.newest.valid_until_s
        if drive.valid_s == 0.0:  # anybody may stop it
            self.newest, self._driving = DriveRequest(0.0, 0.0, -math.inf), 0
        elif rules and self._driving not in (0, drive.nonce):
            return "somebody else is driving"
        elif until_s <= now_s:
            return "it arrived too late"
        else:
            self._driving = drive.nonce
            self.newest = DriveRequest(drive.v_mps, drive.w_radps, until_s)
        self.accepted += 1
        self.last_refusal = ""
        return ""

    def _note(self, now_s: float, drive: Drive, known: Commander | None) -> float:
        """Keep its number and time; how much longer than the fastest it was on its way."""
        if known is None:
            self._commanders[drive.nonce] = Commander(drive.seq, drive.t_ms, 0.0, now_s)
            return 0.0
        sent_s = ((drive.t_ms - known.t_ms) % 2**32) / 1000  # after the one before
        passed_s = now_s - known.heard_s
        known.late_s = max(0.0, known.late_s + passed_s - sent_s - DRIFT * passed_s)
        known.seq, known.t_ms, known.heard_s = drive.seq, drive.t_ms, now_s
        return known.late_s


def _is_newer(drive: Drive, known: Commander) -> bool:
    """By time, and within one millisecond by number: numbers alone wrap within minutes."""
    later_ms = (drive.t_ms - known.t_ms + 2**31) % 2**32 - 2**31
    ahead = (drive.seq - known.seq + 2**15) % 2**16 - 2**15
    return later_ms > 0 or (later_ms == 0 and ahead > 0)
