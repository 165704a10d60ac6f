"""Which of the external poses on the planner link count, and for which instant.

A pose counts if its sender has heard this very run, and it is newer than all that came from that
sender before. Its instant is when it was sent, as far as the fastest frame of that sender tells,
less the age that it was sent with. What is too old to be of use is refused.
Source: planner link, section 3 (EXTERNAL_POSE) and section 9.
"""

from collections import Counter, deque

from core.records import ExternalPose
from hw.planner_link.messages import External
from hw.planner_link.replay_guard import ReplayGuard

OLDEST_S = 1.0  # a pose from longer ago is of no use
WAITING = 16  # poses that nobody has taken


class ExternalPoses:
    """The poses of a positioning system in one run of mapod."""

    def __init__(self, guard: ReplayGuard) -> None:
        self._guard = guard
        self._waiting: deque[ExternalPose] = deque(maxlen=WAITING)
        self.accepted = 0
        self.refused: Counter[str] = Counter()  # by reason
        self.last_refusal = ""  # why the newest frame was refused; "" if it was not

    def take(self, now_s: float, external: External, refusal: str = "") -> None:
        """One well-formed, where necessary authenticated frame.

        Args:
            refusal: why none is taken on that link, as a message; "" if they are.
        """
        if refusal:
            self.refuse(refusal)
            return
        late_s = self._guard.late_s(now_s, external)
        if isinstance(late_s, str):
            self.refuse(late_s)
        elif late_s + external.age_s > OLDEST_S:
            self.refuse("it arrived too late")
        else:
            self._waiting.append(_pose(now_s - late_s - external.age_s, external))
            self.accepted += 1
            self.last_refusal = ""

    def refuse(self, reason: str) -> None:
        """Count a frame that is not used."""
        self.refused[reason] += 1
        self.last_refusal = reason

    def take_all(self) -> list[ExternalPose]:
        """The poses since the last call, in the order of their arrival."""
        poses = list(self._waiting)
        self._waiting.clear()
        return poses


def _pose(t_s: float, external: External) -> ExternalPose:
    return ExternalPose(
        t_s,
        external.x_m,
        external.y_m,
        external.yaw_rad,
        external.sigma_x_m**2,
        external.correlation * external.sigma_x_m * external.sigma_y_m,
        external.sigma_y_m**2,
        external.sigma_yaw_rad**2,
    )
