"""The drive registers: one request of four registers in, what became of it out.

A request is obeyed whole or not at all. Its time counts from when it arrived, so that what waited
here behind other requests is valid for that much less. Whether it is obeyed is the app's to say.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from hw.modbus.encoding import bounded, thousandths_signed
from hw.modbus.layout import DRIVE, DRIVE_BLOCK, DRIVE_REQUEST
from hw.modbus.pdu import Refusal

MOST_VALID_MS, NO_SPEED = 1000, 0x8000
TAKEN, REFUSED = 0, 1
LATE = "it arrived too late"
RESULTS = {LATE: 2, "somebody else is driving": 3}  # any other reason: REFUSED

Ask = Callable[[float, str, float, float, float], str]  # now, who, v, w, valid: reason, "" if taken


def nobody_asks(now_s: float, who: str, v_mps: float, w_radps: float, valid_s: float) -> str:
    """Stands where an app takes no drive requests."""
    return "nobody takes drive requests"


class Request(NamedTuple):
    """The four registers as they were written."""

    v_mms: int
    w_mrads: int
    valid_ms: int
    sequence: int


class DriveRegisters:
    """The drive block of one run of mapod."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._request = Request(0, 0, 0, 0)
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
        if v == NO_SPEED or w == NO_SPEED or valid_ms > MOST_VALID_MS:
            return Refusal.VALUE
        self._request = Request(_signed(v), _signed(w), valid_ms, sequence)
        reason = self._take(now_s, arrived_s, who, self._request)
        self._result = RESULTS.get(reason, REFUSED) if reason else TAKEN
        if not reason:
            self._taken = sequence
        return Refusal.NONE

    def _take(self, now_s: float, arrived_s: float, who: str, request: Request) -> str:
        """The reason if it is not obeyed."""
        valid_s = request.valid_ms / 1000.0
        if request.valid_ms:
            valid_s -= max(0.0, now_s - arrived_s)
            if valid_s <= 0.0:
                return LATE
        reason = self._ask(now_s, who, request.v_mms / 1000.0, request.w_mrads / 1000.0, valid_s)
        if not reason:
            self._until_s = now_s + valid_s
        return reason

    def pack(self, now_s: float) -> bytes:
        """The block as it is now."""
        return DRIVE_BLOCK.pack(
            {
                "drive_v": self._request.v_mms,
                "drive_w": self._request.w_mrads,
                "drive_valid": self._request.valid_ms,
                "drive_sequence": self._request.sequence,
                "ack_sequence": self._request.sequence,
                "ack_result": self._result,
                "ack_taken": self._taken,
                "ack_left": bounded((self._until_s - now_s) * 1000.0, 0, MOST_VALID_MS),
                "driven_v": thousandths_signed(self.driven[0]),
                "driven_w": thousandths_signed(self.driven[1]),
            }
        )


def _signed(word: int) -> int:
    """A register as int16."""
    return word - 0x10000 if word & 0x8000 else word
