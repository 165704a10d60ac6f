"""Which of the drive requests on the planner link count, and until when.

A request counts if its commander has heard this very run, nobody else is driving, and it is newer
than all that came from that commander before. Its time counts from when it was sent, as far as the
fastest frame of that commander tells: what lay in a queue for long does not move a robot.
Source: planner link, section 3 (DRIVE) and section 9 (docs/planner-link.md).
"""

import math
from collections import Counter

from core.records import DriveRequest
from hw.planner_commanders import Commanders
from hw.planner_frames import Drive


class Requests:
    """The drive requests of one run of mapod."""

    def __init__(self, session: int, refusal: str, commanders: Commanders | None = None) -> None:
        self._refusal, self._commanders = refusal, commanders or Commanders(session)
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
        late_s = self._commanders.late_s(now_s, drive)
        if isinstance(late_s, str):
            return late_s
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
