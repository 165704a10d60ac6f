"""One page at a time drives the robot, for as long as a hand is on it and its picture is fresh.

Each message of a page is a request of the planner link that ends by itself after 0.3 s, so that the
robot stops whatever dies: hand, browser, network, or this server. Speeds are shares of what the
stop zone allows and of the robot's own limits. The far end decides again, and last.
"""

import math
from dataclasses import dataclass

from mapod_link.bodies import RUNNING
from tools.view.link_end import LinkEnd

VALID_S = 0.3
DEAD_MAN_S = 0.3  # of silence
PICTURE_S = 0.5  # how old the newest state may be that a page has seen
STOPS, STOP_PERIOD_S = 3, 0.1  # told so often, for one may get lost
STANDS_MPS, STANDS_RADPS = 0.02, 0.03
PATIENCE_S = 1.0  # for a robot to set out
NO_HAND = "the dead man's key is not held"
OLD_PICTURE = "what the page shows is too old to drive by"
ANOTHER = "another page drives"
STANDS = "the robot stands: let go and hold again. Are its motors enabled? Its log tells why"


@dataclass(frozen=True, slots=True)
class Limits:
    """How fast a page may drive, and why it may not at all."""

    v_mps: float  # besides what the stop zone allows
    w_radps: float
    refusal: str = ""


@dataclass(frozen=True, slots=True)
class Wish:
    """What the driving page asks for, as shares of -1 to 1."""

    v: float
    w: float
    begun_s: float
    heard_s: float


class Driving:
    """Who drives, and what is asked of the robot.

    Attributes:
        why_not: why the newest wish came to nothing; "" where it was passed on.
    """

    def __init__(self, end: LinkEnd, limits: Limits) -> None:
        self.limits = limits
        self._end = end
        self._page: object = None  # who drives
        self._wish: Wish | None = None
        self._asked = (0.0, 0.0)  # m/s, rad/s
        self._stops, self._stopped_s = 0, -math.inf

    def drive(self, now_s: float, page: object, v: float, w: float, seen_s: float) -> str:
        """One message of a page; why it is not obeyed, or "".

        Args:
            v, w: shares of -1 to 1, forward and counter-clockwise.
            seen_s: `t_s` of the newest state that the page had.
        """
        if self._page not in (None, page):
            return ANOTHER
        why_not = self.limits.refusal or self._why_not(now_s, seen_s)
        if why_not:
            self.stop(now_s, page)
            return why_not
        begun_s = self._wish.begun_s if self._wish else now_s
        self._page, self._wish = page, Wish(v, w, begun_s, now_s)
        self._stops, self._asked = 0, self._speeds(now_s, v, w)
        self._end.receiver.drive(now_s, *self._asked, VALID_S)
        self._end.step()
        return ""

    def stop(self, now_s: float, page: object) -> None:
        """The page lets go; of one that does not drive, nothing."""
        if self._page is page and self._wish is not None:
            self._page, self._wish, self._asked = None, None, (0.0, 0.0)
            self._stops, self._stopped_s = STOPS, -math.inf
            self.poll(now_s)
            self._end.step()

    def poll(self, now_s: float) -> None:
        """To be called 20 times a second: the dead man's watch, and stops that are due."""
        if self._wish is not None and now_s - self._wish.heard_s > DEAD_MAN_S:
            self.stop(now_s, self._page)
        elif self._stops and now_s - self._stopped_s >= STOP_PERIOD_S:
            self._stops, self._stopped_s = self._stops - 1, now_s
            self._end.receiver.drive(now_s, 0.0, 0.0, 0.0)

    def told_to(self, page: object, now_s: float) -> dict[str, object]:
        """`driving` of the state message."""
        if self._wish is None:
            return {"by": None, "v": 0.0, "w": 0.0, "why_not": self.limits.refusal}
        mine = self._page is page
        (v_mps, w_radps), why_not = self._asked, self._why_it_stands(now_s) if mine else ""
        by = "you" if mine else "another page"
        return {"by": by, "v": v_mps, "w": w_radps, "why_not": why_not}

    def _why_not(self, now_s: float, seen_s: float) -> str:
        receiver, pose = self._end.receiver, self._end.receiver.pose
        if not -DEAD_MAN_S <= now_s - seen_s <= PICTURE_S:
            return OLD_PICTURE
        if self._end.trouble:
            return self._end.trouble
        if pose is None or receiver.blank:
            return "no map has arrived"
        if receiver.stale(now_s):
            return "the robot is not heard any more"
        return "" if pose.mode in RUNNING else f"the robot does not run: mode {pose.mode}"

    def _speeds(self, now_s: float, v: float, w: float) -> tuple[float, float]:
        ahead_mps, behind_mps = self._end.receiver.allowed_mps(now_s)
        most_mps = min(ahead_mps if v > 0 else behind_mps, self.limits.v_mps)
        return v * most_mps, w * self.limits.w_radps

    def _why_it_stands(self, now_s: float) -> str:
        """Why nothing moves though it is asked to, as far as anybody here can know."""
        receiver, wish = self._end.receiver, self._wish
        pose, zone = receiver.pose, receiver.stop_zone
        if wish is None or pose is None or now_s - wish.begun_s < PATIENCE_S:
            return ""
        if abs(pose.v_mps) >= STANDS_MPS or abs(pose.w_radps) >= STANDS_RADPS:
            return ""
        if wish.v and not self._asked[0]:
            return f"that way is barred: {zone.describe() if zone else 'no stop zone has arrived'}"
        why = receiver.advice(now_s)[1]
        return why or STANDS
