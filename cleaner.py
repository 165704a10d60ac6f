"""A floor cleaner in the app: paths over the floor that the depth camera has seen, for planners.

Plans are made beside the loop, from what frames told and where the machine was; one enters at a
tick, and nothing else of them moves the app: so a recording keeps that alone, and its replay is the
same to the bit. Where anything is in doubt there is no new plan, and nothing of the old one is to
be driven. It drives nothing itself: the planner does, and the stop zone judges that as ever.
Source: docs/coverage.md, "In the app".
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from msgspec.structs import replace

from beside import Work
from core.coverage_settings import CoverageSettings
from core.driving.control import Barred
from core.mapping.mapper import Mapper
from core.paths.cleaning.planned import Place, Planned, Progress
from core.records import PathReport

if TYPE_CHECKING:
    from core.paths.cleaning.live import LiveCleaning  # polygons: not for a replay

STEP_S = 0.1  # places and paths are looked at so often
ASK_S = 0.25  # from one call to the thread to the next
FIRST_FRAMES = 6  # that tell something, before the first plan
LOOK_S = 1.2  # that it stands and looks at what it has come to see
MOVED_M, MOVED_RAD = 0.03, 0.06  # less is standing still
NO_FLOOR = "no floor has been seen yet"
ERASED = "the map was erased: nobody knows where floor and dock are"


class Cleaner:
    """What the app knows of the cleaning of one floor.

    Args:
        live: who plans; None: nobody, for plans are replayed.
        work: who does what `live` is asked for.

    Attributes:
        path: what planners are told.
        goal, why: of what is driven now, in words; "done": it is back at the dock.
        doubt: why nothing may be driven or planned, in words; "": it may.
        note: is told of each plan that enters; None: nobody is.
    """

    def __init__(
        self,
        settings: CoverageSettings,
        mapper: Mapper,
        live: "LiveCleaning | None",
        work: Work[Planned | None],
    ) -> None:
        self.path = PathReport(0, (), None)
        self.goal, self.why, self.doubt = "wait", NO_FLOOR, ""
        self.seen_m2 = self.clean_m2 = 0.0
        self.note: Callable[[Planned], None] | None = None
        self._mapper, self._live, self._work = mapper, live, work
        self._wait_s = settings.wait_s
        self._progress = Progress(())
        self._epoch = mapper.counts.erased
        self._stepped_s = self._asked_s = -math.inf
        self._maybe_place: Place | None = None  # the newest that was told to who plans
        self._arrived_s = math.inf  # since when it is at the path's end
        self._gained_s = math.inf  # since when it has come no nearer to the point `_ahead`,
        self._left_m, self._ahead = math.inf, 0  # to which so much was left
        self._maybe_barred: Barred | None = None  # what was in the way since then

    def step(self, now_s: float, doubt: str, frames: int, barred: Barred | None) -> bool:
        """Take in what was planned, follow the machine, ask for what is next; whether a plan came.

        Args:
            doubt: why pose, map or frames are not to be trusted, in words.
            frames: how many of the camera have told something.
            barred: what keeps the machine from where it is asked to go; None: nothing does.
        """
        planned = self._work.maybe_take()
        if planned is not None and self.note is not None:
            self.note(replace(planned, epoch=planned.epoch - self._epoch))
        is_erased = self._mapper.counts.erased != self._epoch
        self.doubt = ERASED if is_erased else doubt
        pose = self._mapper.maybe_pose(now_s)
        if self.doubt or pose is None:
            self._forget_motion()
            self._tell_ahead(None)
            return False
        epoch = self._epoch if self._live is not None else 0
        if planned is not None and planned.epoch == epoch:
            self._enter(planned)
        if planned is not None or now_s - self._stepped_s >= STEP_S - 1e-6:
            self._stepped_s = now_s
            self._follow(now_s, (pose.x_m, pose.y_m, pose.yaw_rad), barred)
            self._ask(now_s, (pose.x_m, pose.y_m, pose.yaw_rad), frames)
        return planned is not None

    def _enter(self, planned: Planned) -> None:
        self.goal, self.why = planned.goal, planned.why
        self.seen_m2, self.clean_m2 = planned.seen_m2, planned.clean_m2
        self._progress = Progress(planned.segments)
        self._arrived_s, self._maybe_barred = math.inf, None
        self._gained_s, self._left_m, self._ahead = planned.t_s, math.inf, 0
        self.path = PathReport(self.path.version + 1, planned.segments, None)

    def _forget_motion(self) -> None:
        """Whoever carries the machine meanwhile sweeps nothing."""
        self._maybe_place = None
        self._arrived_s, self._maybe_barred = math.inf, None

    def _tell_ahead(self, ahead: int | None) -> None:
        if ahead != self.path.ahead:
            self.path = replace(self.path, ahead=ahead)

    def _follow(self, now_s: float, place: Place, barred: Barred | None) -> None:
        """Where the machine is on the path, and since when it stands."""
        sweeps = self.goal == "sweep" and self._progress.sweeps
        self._progress.step(place[0], place[1])
        self._tell_ahead(self._progress.ahead if self.path.segments else None)
        before = self._maybe_place
        if before is None or _has_moved(before, place):
            if self._live is not None:
                self._live.drive(before or place, place, sweeps)
            self._maybe_place = place
        left_m, ahead = self._progress.left_m(place), self._progress.ahead
        if ahead != self._ahead or left_m < self._left_m - MOVED_M:
            self._gained_s, self._left_m, self._ahead = now_s, left_m, ahead
            self._maybe_barred = None
        if barred is not None:  # who drives lets go now and then, or goes back a little
            self._maybe_barred = barred
        if self._progress.is_done:
            self._arrived_s = min(self._arrived_s, now_s)
        if self._progress.is_done and self.goal == "home":
            self.goal, self.why = "done", ""
            self.path = PathReport(self.path.version + 1, (), None)

    def _wanted(self, now_s: float, frames: int) -> str:
        """What is asked for now: "new", "other" or "", as `Request` has it."""
        if self.path.version == 0:
            return "new" if frames >= FIRST_FRAMES else ""
        if self.goal == "wait":
            return "other" if now_s - self._asked_s >= self._wait_s else ""
        if self._progress.is_done:
            waits_s = LOOK_S if self.goal == "look" else 0.0
            return "new" if now_s - self._arrived_s >= waits_s else ""
        is_barred = self._maybe_barred is not None and now_s - self._gained_s >= self._wait_s
        return "other" if is_barred else ""

    def _ask(self, now_s: float, place: Place, frames: int) -> None:
        """Have what waits taken in, and planned what is due."""
        live = self._live
        if live is None or not self._work.is_idle or self.goal in ("done", "stuck"):
            return
        wants = self._wanted(now_s, frames)
        if not wants and now_s - self._asked_s < ASK_S:
            return
        from core.paths.cleaning.live import Request  # polygons: not for a replay

        if wants or self.goal != "wait":
            self._asked_s = now_s
        barred = self._maybe_barred if wants == "other" else None
        rest = self._progress.rest[: None if self.goal == "sweep" else 0]
        asked = Request(now_s, self._epoch, place, wants, barred, rest)
        self._work.give(lambda: live.step(asked))

    def warm(self) -> None:
        """Run every kernel once, so that none is compiled while a robot drives."""
        if self._live is not None:
            self._live.warm()


def _has_moved(before: Place, now: Place) -> bool:
    turned = abs(math.remainder(now[2] - before[2], math.tau))
    return math.dist(before[:2], now[:2]) >= MOVED_M or turned >= MOVED_RAD
