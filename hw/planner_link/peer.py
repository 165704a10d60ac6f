"""What the planner at the far end says of itself, and how much of it is believed.

A HELLO is believed whole where no key is set, and where it has a valid tag of this session. With a
key, one without a tag (who sends it may know no session yet) only begins: its nonce counts, and
how many cells it can hold, until something with a valid tag has come with that nonce. So nobody
without the key can silence a link for longer than until the planner's next frame.

And while signed frames come of a planner, no HELLO without a tag puts another in its place: a flood
of forged ones changes nothing. A planner that has started again is heard `HELD_S` later; while
forged ones come, only once one of its own comes first after `TRIED_S`.

ACKs count in the order of the planner's clock and numbers. With a key that order is kept for each
nonce, and for all frames: anybody may repeat an old HELLO, and then what was signed for it.
Source: planner link, sections 3 (HELLO), 6 and 9.
"""

import math

from hw.planner_link.frames import MAX_FRAME
from hw.planner_link.messages import PLANNER_STOPPED, Ack, Answer, Hello, apart

LEAST_MAX_FRAME = 48  # bytes of a frame that a planner must take to get a map
MOST_NONCES = 256  # of planners in one session
HELD_S = 1.0  # after a new signed frame of a planner no unsigned HELLO displaces it
TRIED_S = 0.1  # so long what an unsigned HELLO has begun may prove itself
LATE_MS = 2000  # an ACK that is older than the newest by more is from a planner started again


class Peer:
    """One planner: nonce, what it can take, whether it only asks, and its newest status."""

    def __init__(self, *, cells: int, push: bool, has_key: bool) -> None:
        self._cells, self._push, self._has_key = cells, push, has_key
        # something with a valid tag has come with this nonce, or no key is set
        self.proven = not has_key
        self.nonce = 0  # of its newest HELLO
        self.max_frame = MAX_FRAME
        self.polled = not push  # nothing is pushed: it asks
        self.refusal = ""  # why no map is announced, as a message
        self.status = 0  # of its newest ACK
        self._signed_s = -math.inf  # when its newest frame with a valid tag came
        self._begun_s = -math.inf  # when the HELLO came that it has begun with
        self._newest: dict[int, tuple[int, int]] = {}  # by nonce: t_ms and seq of the newest frame

    @property
    def stopped(self) -> bool:
        return bool(self.status & PLANNER_STOPPED)

    @property
    def is_full(self) -> bool:
        """No further planner can be told from a replay: a new session is needed."""
        return self._has_key and len(self._newest) >= MOST_NONCES

    def begin_session(self) -> None:
        """No frame that was signed before is valid any more."""
        self._newest.clear()

    def take_hello(self, now_s: float, hello: Hello) -> bool:
        """A planner has started, or says it again; whether all begins anew."""
        before = (self.nonce, self.refusal, self.polled)
        trusted = not self._has_key or (hello.signed and self._is_new(now_s, hello.nonce, hello))
        if not trusted and self._is_held(now_s, hello.nonce):
            return False
        self._begun_s = now_s
        self.proven, self.nonce = trusted, hello.nonce
        self.polled = (trusted and hello.polls) or not self._push
        self.max_frame = hello.max_frame if trusted else MAX_FRAME
        self.refusal = self._refusal_of(hello.max_cells)
        if before == (self.nonce, self.refusal, self.polled):
            return False
        if not self._has_key:  # else anybody could take back that the planner stopped
            self.status = 0
            self._newest.clear()
        return True

    def _is_held(self, now_s: float, nonce: int) -> bool:
        """Whether an unsigned HELLO with that nonce changes nothing."""
        if nonce == self.nonce:
            return self.proven
        return now_s - self._signed_s < HELD_S or now_s - self._begun_s < TRIED_S

    def take(self, now_s: float, frame: Answer) -> bool:
        """Notes a frame that was let pass; whether it is no repetition, which a key lets tell."""
        return not self._has_key or self._is_new(now_s, self.nonce, frame)

    def _is_new(self, now_s: float, nonce: int, frame: Answer) -> bool:
        """Whether a signed frame is newer than all of its nonce; notes it if it is."""
        newest = self._newest.get(nonce)
        if self.is_full if newest is None else apart(frame, *newest) <= (0, 0):
            return False
        self._newest[nonce], self._signed_s = (frame.t_ms, frame.seq), now_s
        return True

    def take_ack(self, now_s: float, ack: Ack) -> bool:
        """Its status, unless a newer one has been taken before; whether it counts."""
        if self._has_key:
            is_new = self._is_new(now_s, self.nonce, ack)
        else:
            newest = self._newest.get(self.nonce, (ack.t_ms, ack.seq))
            ahead = apart(ack, *newest)
            is_new = ahead >= (0, 0) or ahead[0] <= -LATE_MS
            if is_new:
                self._newest[self.nonce] = ack.t_ms, ack.seq
        self.status = ack.status if is_new else self.status
        return is_new

    def _refusal_of(self, max_cells: int) -> str:
        if max_cells < self._cells:
            return (
                f"the planner can hold {max_cells} cells, the window has {self._cells}: "
                "lower obstacle.window_cells"
            )
        if self.max_frame < LEAST_MAX_FRAME:
            return f"the planner takes frames of {self.max_frame} bytes, not of {LEAST_MAX_FRAME}"
        return ""

    def prove(self) -> bool:
        """A first frame with a valid tag has come; whether it shows that a refusal was forged.

        Who signs has got the geometry: a planner that can't hold the window gets none.
        """
        was_refused, self.proven, self.refusal = bool(self.refusal), True, ""
        return was_refused

    def end_polling(self) -> bool:
        """It acknowledges, as none does that only asks; whether it is taken for one no longer."""
        self.polled = not self._push
        return self._push
