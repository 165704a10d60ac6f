"""Which of the drive requests count, and until when.

A request on the planner link counts if its commander has heard this very run, nobody else is
driving, and it is newer than all that came from that commander before. Its time counts from when it
was sent, as far as the fastest frame of that commander tells: what lay in a queue for long does not
move a robot. Requests that come by another way (Modbus) obey the same rule of who drives.
Source: planner link, section 3 (DRIVE) and section 9.
"""

import math
from collections import Counter

from core.records import DriveRequest
from hw.planner_link.messages import LONGEST_VALID_MS, Drive
from hw.planner_link.replay_guard import ReplayGuard

NO_LINK = -1  # of a request that came by no planner link


class Requests:
    """The drive requests of one run of mapod, from all links and ways."""

    def __init__(self, guard: ReplayGuard) -> None:
        self._guard = guard
        self.driver = ""  # who drives, or drove last; "" after a stop, and before the first
        self.link = NO_LINK  # by which the driver's request came
        self.newest: DriveRequest | None = None
        self.accepted = 0
        self.refused: Counter[str] = Counter()  # by reason
        self.last_refusal = ""  # why the newest frame was refused; "" if it was not

    def take(self, now_s: float, drive: Drive, refusal: str = "", link: int = 0) -> None:
        """One well-formed, where necessary authenticated frame.

        Args:
            refusal: why none is obeyed on that link, as a message; "" if they are.
            link: number of that link.
        """
        reason = refusal or self._take(now_s, drive, link)
        if reason:
            self.refuse(reason)

    def refuse(self, reason: str) -> None:
        """Count a frame that is not obeyed."""
        self.refused[reason] += 1
        self.last_refusal = reason

    def ask(self, now_s: float, who: str, v_mps: float, w_radps: float, valid_s: float) -> str:
        """A request that came by no planner link; the reason if it is refused, else "".

        Args:
            who: tells this commander apart, as a message.
            v_mps: forward; `w_radps` counter-clockwise.
            valid_s: how long it holds from now, up to 1 s; 0: stop now.
        """
        if math.isfinite(v_mps + w_radps) and 0.0 <= valid_s <= LONGEST_VALID_MS / 1000:
            until_s = now_s + valid_s
            reason = self._obey(now_s, who, v_mps, w_radps, valid_s, until_s, NO_LINK)
        else:
            reason = "the request is out of range"
        if reason:
            self.refuse(reason)
        return reason

    def _take(self, now_s: float, drive: Drive, link: int) -> str:
        """The reason if it is refused."""
        late_s = self._guard.late_s(now_s, drive)
        if isinstance(late_s, str):
            return late_s
        until_s = now_s + drive.valid_s - late_s
        who = f"commander {drive.nonce:08x}"
        return self._obey(now_s, who, drive.v_mps, drive.w_radps, drive.valid_s, until_s, link)

    def _obey(
        self,
        now_s: float,
        who: str,
        v_mps: float,
        w_radps: float,
        valid_s: float,
        until_s: float,
        link: int,
    ) -> str:
        """The reason if it is refused; whose request is valid, drives alone."""
        rules = self.newest is not None and now_s <= self.newest.valid_until_s
        if valid_s == 0.0:  # anybody may stop it
            self.newest, self.driver, self.link = DriveRequest(0.0, 0.0, -math.inf), "", NO_LINK
        elif rules and self.driver not in ("", who):
            return "somebody else is driving"
        elif until_s <= now_s:
            return "it arrived too late"
        else:
            self.driver, self.link = who, link
            self.newest = DriveRequest(v_mps, w_radps, until_s)
        self.accepted += 1
        self.last_refusal = ""
        return ""
