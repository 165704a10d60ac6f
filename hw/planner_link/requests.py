"""Which drive requests and external poses count: until when the one, for which instant the other.

Either counts if its commander has heard this very run, and it is newer than all that came from that
commander before, whatever it asks for. How late it is, is known against the fastest frame of the
same commander: what lay in a queue for long does not move a robot, and a pose is for when it was
seen. While the request of one commander is valid, no other one drives, also not by another way
(Modbus); anybody may stop.

Memory is bounded. With a key only holders of the key get in, and what they sent must never count
again: when memory is full, the run needs a new session (`is_full`); no old frame is valid for it.
Without a key anybody could fill it: the commander that has been silent longest is forgotten.
Source: planner link, section 3 (DRIVE, EXTERNAL_POSE) and section 9.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass

from core.records import DriveRequest, ExternalPose
from hw.planner_link.messages import LONGEST_VALID_MS, Drive, External, apart

MOST_COMMANDERS = 256  # of one session
DRIFT = 0.001  # of the two clocks against each other, at most
OLDEST_S = 1.0  # a pose from longer ago is of no use
WAITING = 16  # poses that nobody has taken
NO_LINK = -1  # of a request that came by no planner link


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
        if apart(frame, known.t_ms, known.seq) <= (0, 0):
            return "it is older than the newest, or a repetition"
        sent_s = ((frame.t_ms - known.t_ms) % 2**32) / 1000  # after the one before
        passed_s = now_s - known.heard_s
        known.late_s = max(0.0, known.late_s + passed_s - sent_s - DRIFT * passed_s)
        known.seq, known.t_ms, known.heard_s = frame.seq, frame.t_ms, now_s
        self._known[frame.nonce] = self._known.pop(frame.nonce)
        return known.late_s

    def _begin(self, now_s: float, frame: Drive | External) -> float | str:
        if self.is_full:
            return "too many commanders in this session: a new one begins"
        if len(self._known) >= MOST_COMMANDERS:
            del self._known[next(iter(self._known))]
        self._known[frame.nonce] = Commander(frame.seq, frame.t_ms, 0.0, now_s)
        return 0.0


class Counted:
    """How many frames of a sort were taken and refused, and why."""

    def __init__(self, guard: ReplayGuard) -> None:
        self._guard = guard
        self.accepted = 0
        self.refused: Counter[str] = Counter()  # by reason
        self.last_refusal = ""  # why the newest frame was refused; "" if it was not

    def accept(self) -> None:
        self.accepted += 1
        self.last_refusal = ""

    def refuse(self, reason: str) -> None:
        self.refused[reason] += 1
        self.last_refusal = reason


class Requests(Counted):
    """The drive requests of one run of mapod, from all links and ways."""

    def __init__(self, guard: ReplayGuard) -> None:
        super().__init__(guard)
        self.driver = ""  # who drives, or drove last; "" after a stop, and before the first
        self.link = NO_LINK  # by which the driver's request came
        self.newest: DriveRequest | None = None

    def take(self, now_s: float, drive: Drive, refusal: str = "", link: int = 0) -> None:
        """One well-formed, authenticated frame; `refusal`: why none is obeyed on that link."""
        late_s = refusal or self._guard.late_s(now_s, drive)
        if isinstance(late_s, str):
            self.refuse(late_s)
        else:
            wanted = DriveRequest(drive.v_mps, drive.w_radps, now_s + drive.valid_s - late_s)
            stops = drive.valid_s == 0.0
            self._obey(now_s, f"commander {drive.nonce:08x}", link, wanted, stops)

    def ask(self, now_s: float, who: str, v_mps: float, w_radps: float, valid_s: float) -> str:
        """A request that came by no planner link; the reason if it is refused, else "".

        Args:
            who: tells this commander apart, as a message.
            v_mps: forward; `w_radps` counter-clockwise.
            valid_s: how long it holds from now, up to 1 s; 0: stop now.
        """
        if math.isfinite(v_mps + w_radps) and 0.0 <= valid_s <= LONGEST_VALID_MS / 1000:
            wanted = DriveRequest(v_mps, w_radps, now_s + valid_s)
            self._obey(now_s, who, NO_LINK, wanted, valid_s == 0.0)
        else:
            self.refuse("the request is out of range")
        return self.last_refusal

    def _obey(self, now_s: float, who: str, link: int, wanted: DriveRequest, stops: bool) -> None:
        """Whose request is valid, drives alone."""
        rules = self.newest is not None and now_s <= self.newest.valid_until_s
        if stops:  # anybody may
            self.newest, self.driver, self.link = DriveRequest(0.0, 0.0, -math.inf), "", NO_LINK
            self.accept()
        elif rules and self.driver not in ("", who):
            self.refuse("somebody else is driving")
        elif wanted.valid_until_s <= now_s:
            self.refuse("it arrived too late")
        else:
            self.newest, self.driver, self.link = wanted, who, link
            self.accept()


class ExternalPoses(Counted):
    """The poses of a positioning system in one run of mapod."""

    def __init__(self, guard: ReplayGuard) -> None:
        super().__init__(guard)
        self._waiting: deque[ExternalPose] = deque(maxlen=WAITING)

    def take(self, now_s: float, external: External, refusal: str = "") -> None:
        """One well-formed, authenticated frame; `refusal`: why none is taken on that link."""
        late_s = refusal or self._guard.late_s(now_s, external)
        if isinstance(late_s, str):
            self.refuse(late_s)
        elif late_s + external.age_s > OLDEST_S:
            self.refuse("it arrived too late")
        else:
            self._waiting.append(_pose(now_s - late_s - external.age_s, external))
            self.accept()

    def take_all(self) -> list[ExternalPose]:
        """The poses since the last call, in the order of their arrival."""
        poses = list(self._waiting)
        self._waiting.clear()
        return poses


def _pose(t_s: float, external: External) -> ExternalPose:
    return ExternalPose(
        t_s,
        *(external.x_m, external.y_m, external.yaw_rad),
        external.sigma_x_m**2,
        external.correlation * external.sigma_x_m * external.sigma_y_m,
        external.sigma_y_m**2,
        external.sigma_yaw_rad**2,
        *(external.z_m, external.sigma_z_m**2, external.pitch_rad, external.roll_rad),
        external.sigma_tilt_rad,
    )
