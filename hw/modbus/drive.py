"""The drive registers: one request of four registers in, what became of it out.

A request is obeyed whole or not at all. Its time counts from when it arrived, so that what waited
here behind other requests is valid for that much less. Whether it is obeyed is the app's to say.
"""

import math
from collections.abc import Callable

from hw.modbus.layout import DRIVE, DRIVE_BLOCK, DRIVE_REQUEST, Refusal, bounded, thousandths_signed

MOST_VALID_MS, NO_SPEED = 1000, 0x8000
TAKEN, REFUSED = 0, 1
LATE = "it arrived too late"
RESULTS = {LATE: 2, "somebody else is driving": 3}  # any other reason: REFUSED

Ask = Callable[[float, str, float, float, float], str]  # now, who, v, w, valid: reason, "" if taken


class DriveRegisters:
    """The drive block of one run of mapod."""

    def __init__(self, ask: Ask) -> None:
        self.ask = ask  # who takes requests; may be another one in between
        self._asked = (0, 0, 0, 0)  # the four registers of the newest request
        self._result = TAKEN  # of it
        self._taken, self._until_s = 0, -math.inf  # number of the newest that was obeyed; its end
        self.driven = (0.0, 0.0)  # m/s, rad/s: what the motors are commanded to

    def write(self, now_s: float, arrived_s: float, who: str, at: int, words: list[int]) -> Refusal:
        """Written registers `words` from `at` on, which arrived at `arrived_s` on the host clock.

        Refused are anything but all four together, and values out of their range: nothing is
        taken of these.
        """
        if at != DRIVE or len(words) != DRIVE_REQUEST:
            return Refusal.VALUE
        v, w, valid_ms, sequence = words
        if NO_SPEED in (v, w) or valid_ms > MOST_VALID_MS:
            return Refusal.VALUE
        v_mms, w_mrads = _signed(v), _signed(w)
        self._asked = (v_mms, w_mrads, valid_ms, sequence)
        valid_s = max(0.0, valid_ms / 1000.0 - max(0.0, now_s - arrived_s))
        reason = LATE
        if valid_s > 0.0 or valid_ms == 0:  # a stop is never too late
            reason = self.ask(now_s, who, v_mms / 1000.0, w_mrads / 1000.0, valid_s)
        if not reason:
            self._taken, self._until_s = sequence, now_s + valid_s
        self._result = RESULTS.get(reason, REFUSED) if reason else TAKEN
        return Refusal.NONE

    def pack(self, now_s: float) -> bytes:
        v_mms, w_mrads, valid_ms, sequence = self._asked
        return DRIVE_BLOCK.pack(
            {
                "drive_v": v_mms,
                "drive_w": w_mrads,
                "drive_valid": valid_ms,
                "drive_sequence": sequence,
                "ack_sequence": sequence,
                "ack_result": self._result,
                "ack_taken": self._taken,
                "ack_left": bounded((self._until_s - now_s) * 1000.0, 0, MOST_VALID_MS),
                "driven_v": thousandths_signed(self.driven[0]),
                "driven_w": thousandths_signed(self.driven[1]),
            }
        )


def _signed(word: int) -> int:
    return word - 0x10000 if word & 0x8000 else word
