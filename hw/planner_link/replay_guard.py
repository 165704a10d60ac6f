"""Who sends on the planner link: whether a frame is new, and how long it was on its way.

Frames of one commander are ordered by its clock and their number, whatever they ask for; none
counts twice. How late a frame is, is known against the fastest one of the same commander.

Memory is bounded. With a key only holders of the key get in, and what they sent must never count
again: when memory is full, the run needs a new session (`is_full`); no old frame is valid for it.
Without a key anybody could fill it: the commander that has been silent longest is forgotten.
Source: planner link, section 3 (DRIVE, EXTERNAL_POSE) and section 9.
"""

from dataclasses import dataclass

from hw.planner_link.messages import Drive, External

MOST_COMMANDERS = 256  # of one session
DRIFT = 0.001  # of the two clocks against each other, at most


@dataclass(slots=True)
class Commander:
    """What is known of one commander, by the nonce of its HELLO."""

    seq: int
    t_ms: int
    late_s: float  # by how much the newest frame took longer than the fastest one
    heard_s: float


class ReplayGuard:
    """All commanders of one run of mapod, the one that was heard last at the end."""

    def __init__(self, session: int, *, has_key: bool = False) -> None:
        self._session, self._has_key = session, has_key
        self._known: dict[int, Commander] = {}

    def restart(self, session: int) -> None:
        """A new session: what was sent for the old one counts no more."""
        self._session = session
        self._known.clear()

    @property
    def is_full(self) -> bool:
        """No further commander can be told from a replay: a new session is needed."""
        return self._has_key and len(self._known) >= MOST_COMMANDERS

    def late_s(self, now_s: float, frame: Drive | External) -> float | str:
        """How much longer than the fastest a new frame took (s), or why it does not count."""
        if frame.session != self._session:
            return "it was meant for another run of mapod"
        known = self._known.get(frame.nonce)
        if known is None:
            return self._begin(now_s, frame)
        if not _is_newer(frame, known):
            return "it is older than the newest, or a repetition"
        sent_s = ((frame.t_ms - known.t_ms) % 2**32) / 1000  # after the one before
        passed_s = now_s - known.heard_s
        known.late_s = max(0.0, known.late_s + passed_s - sent_s - DRIFT * passed_s)
        known.seq, known.t_ms, known.heard_s = frame.seq, frame.t_ms, now_s
        self._known[frame.nonce] = self._known.pop(frame.nonce)
        return known.late_s

    def _begin(self, now_s: float, frame: Drive | External) -> float | str:
        """The first frame of a commander."""
        if self.is_full:
            return "too many commanders in this session: a new one begins"
        if len(self._known) >= MOST_COMMANDERS:
            del self._known[next(iter(self._known))]
        self._known[frame.nonce] = Commander(frame.seq, frame.t_ms, 0.0, now_s)
        return 0.0


def _is_newer(frame: Drive | External, known: Commander) -> bool:
    """By time, and within one millisecond by number: numbers alone wrap within minutes."""
    later_ms = (frame.t_ms - known.t_ms + 2**31) % 2**32 - 2**31
    ahead = (frame.seq - known.seq + 2**15) % 2**16 - 2**15
    return later_ms > 0 or (later_ms == 0 and ahead > 0)
