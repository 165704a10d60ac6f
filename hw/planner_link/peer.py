"""What the planner at the far end says of itself, and how much of it is believed.

A HELLO is believed whole where no key is set, and where it has a valid tag of this session. With a
key, one without a tag (who sends it may know no session yet) only begins: its nonce counts, and
how many cells it can hold, until something with a valid tag has come with that nonce. So nobody
without the key can silence a link for longer than until the planner's next frame.
Source: planner link, sections 3 (HELLO) and 9.
"""

from hw.planner_link.frames import MAX_FRAME
from hw.planner_link.messages import PLANNER_STOPPED, Hello

LEAST_MAX_FRAME = 48  # bytes of a frame that a planner must take to get a map


class Peer:
    """One planner: nonce, what it can take, whether it only asks, and its newest status."""

    def __init__(self, *, cells: int, push: bool, has_key: bool) -> None:
        self._cells, self._push, self._has_key = cells, push, has_key
        self._proven = False  # something with a valid tag has come with this nonce
        self.nonce = 0  # of its newest HELLO
        self.max_frame = MAX_FRAME
        self.polled = not push  # nothing is pushed: it asks
        self.refusal = ""  # why no map is announced, as a message
        self.status = 0  # of its newest ACK

    @property
    def stopped(self) -> bool:
        """It says that it stopped."""
        return bool(self.status & PLANNER_STOPPED)

    def take_hello(self, hello: Hello, is_replayed: bool) -> bool:
        """A planner has started, or says it again; whether all begins anew."""
        before = (self.nonce, self.refusal, self.polled)
        trusted = not self._has_key or (hello.signed and not is_replayed)
        if not trusted and self._proven and hello.nonce == self.nonce:
            return False
        self._proven, self.nonce = trusted and self._has_key, hello.nonce
        self.polled = (trusted and hello.polls) or not self._push
        self.max_frame = hello.max_frame if trusted else MAX_FRAME
        self.refusal = self._refusal_of(hello.max_cells)
        if before == (self.nonce, self.refusal, self.polled):
            return False
        if not self._has_key:  # else anybody could take back that the planner stopped
            self.status = 0
        return True

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
        """A frame with a valid tag has come; whether it shows that a refusal was forged.

        Who signs has got the geometry: a planner that can't hold the window gets none.
        """
        if not self._has_key or self._proven:
            return False
        self._proven, was_refused, self.refusal = True, bool(self.refusal), ""
        return was_refused

    def end_polling(self) -> bool:
        """It acknowledges, as none does that only asks; whether it was taken for one."""
        was_polled = self.polled
        self.polled = not self._push
        return was_polled and not self.polled
