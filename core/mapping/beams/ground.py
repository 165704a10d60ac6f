"""The ground ahead, tracked from the floor returns themselves, so that a ramp is no obstacle.

The scanner sees the floor along one line, metres ahead. The tracker follows the height and the
slopes of the floor at that line. A ramp moves them little from scan to scan while the line moves
on, and is followed. A step or a wall holds the line still and lifts it: its cells are steep within
themselves and no longer count, the tracker goes back to what it held before it met them and stays
there. Nearer than the line, the ground is taken to lead straight from under the wheels to it.
Where the line is lost, planes that the robot's own attitude suggests are tried.
Source: design, section 7 (ground).
"""

import math
from collections import deque

import numpy as np

from core.geometry import slope_of
from core.mapping.beams.cells import CellGrid
from core.mapping.beams.ground_memory import GroundMemory, Turning
from core.mapping.beams.ground_plane import (
    LEVEL,
    Ground,
    GroundPlane,
    fit,
    near_plane,
    nearest_due,
    seek,
    turned,
)
from core.mapping.body import BodyPose
from core.mapping.rays import Sweep

KEPT_M, KEPT_SLOPE = 0.05, 0.003  # a line so far off the plane is another one
FLAT_SHARE = 0.4  # of the returns near the plane lie close together, if there is floor at all
LEAST = 15  # returns that make a line
MIDDLE_OF = 5  # scans whose middle offset counts: a step must last
JITTER_M = 0.015  # of the offsets about their middle: from here on a scan is set right by its own
MOST_JITTER_M = 0.05  # more is no jitter but a step
JITTER_SCANS = 20
FOLLOW_M = 0.4  # travel in which the line is followed,
FOLLOW_S = 6.0  # and time, when the robot stands
TURNED_M = 0.8  # travel that a radian of turning counts as: what the attitude is off turns slower
SWEPT_SHARE = 0.3  # where the robot nods, the line is swept over much floor: it tells less of slope
SWEPT_KEPT = 0.9  # of that, from scan to scan
RETURN_M = 8.0  # travel in which the slope goes back to the robot's own
NODDING_BEND, NODDING_RETURN_M = 0.3, 2.0  # a robot that nods tells less of slopes
TURN_M = 1.0  # travel in which the slope across is followed
STEEPEST = math.tan(math.radians(12.0))
NOD = math.tan(math.radians(1.0))  # more than the robot has leant for a while is a nod,
CALM_S, CALM_M = 1.0, 0.5  # after which it takes so long until all that it has done is past
CREST_RAD = math.radians(2.0)  # a line that is lost on a steeper slope went over its crest
CREST_M = -0.02  # there the ground falls away under the line,
CREST_FASTER = 3.0  # which runs ahead of the robot
GUESS_RAD = math.radians(20.0)  # turned without the line in view, the ground is a guess
LEAN_S = 0.7  # in which the robot's own slope is followed
BACK_M = 0.6  # travel by which the tracker goes back when it has lost the line
KEPT = 64
SEEK_GATE = 7.0  # times the gates: within a metre of the plane
SEEN_STEP_M = 0.015  # travel from one line that is kept to the next
LEAST_SEEN, SEEN_M = 16, 0.6  # lines, and metres that they cover, which make a slope
EVEN = 0.5  # of it, at least, in either half: a kerb is steep, and level behind
LEAST_SLOPE = math.tan(math.radians(2.5))  # less may be the attitude that wanders
ROUGH_M = 0.03  # off the slope, at most
FOOT_M = 0.5  # its foot or crest lies between the robot and the line, so well
TRIED_M = (0.0, 0.03, -0.03, 0.06, -0.06)  # offsets of planes that are tried
TRIED_LEVEL_M = (0.0, 0.03, -0.03, 0.05, -0.05)  # and of a level one: a kerb must stay out of reach
LEANS = math.tan(math.radians(2.0))  # the robot's own slope is tried if it is more than nodding
TRIED_SLOPES = (1.0, 0.0, 0.5, 1.5, 2.0)  # of the robot's own: half of it is on a ramp already
TRIED_GATE = 0.25  # of the gates


class GroundTracker:
    """The ground by which heights are told: `model`, for the kernels."""

    def __init__(self, cells: CellGrid, max_beams: int) -> None:
        self._cells = cells
        self.model = LEVEL
        self.before = LEVEL  # the same when the line was lost
        self.found = False  # the newest scan saw the line
        self.line: GroundPlane | None = None
        # lines that were found, each with the robot's heading then
        self._history: deque[tuple[GroundPlane, tuple[float, float]]] = deque(maxlen=KEPT)
        self._memory, self._turning = GroundMemory(), Turning()
        self._anchor = np.zeros(2)
        self._found = np.zeros((max_beams, 5))
        # lines while it is lost: place along the way, height, travel
        self._seen: deque[tuple[float, float, float]] = deque(maxlen=2 * KEPT)
        self.lost_s = math.inf  # since when it is lost
        self.is_new = False  # the newest scan found it anew
        self._last_s = -math.inf
        self._swept_m = 0.0  # how far the line moves from scan to scan
        self._candidates = 0  # returns of the newest scan that might have been floor
        self._nodded = (-math.inf, -math.inf)  # when, and after how much travel
        self._heading = (1.0, 0.0)  # of the newest scan,
        self._turned_rad = 0.0  # and how far the robot had turned to it,
        self._lost_turned_rad = 0.0  # and since the line was lost
        self._leaning = (0.0, 0.0)  # slope of the robot along and across its way, over a while
        self._offsets: deque[float] = deque(maxlen=MIDDLE_OF)
        self._jitter_m = self._jitter_m2 = 0.0

    def warm(self) -> None:
        """Run the kernel that only a lost line needs, once."""
        seek(self._found, 0, np.zeros(3))

    def erase(self) -> None:
        """Forget the line."""
        self.line, self.found = None, False
        self._history.clear()
        self._memory.forget()
        self._offsets.clear()
        self._seen.clear()
        self._lost_turned_rad = 0.0
        self._last_s, self.lost_s = -math.inf, math.inf

    @property
    def jitters(self) -> bool:
        """Whether scans lie so differently that nothing a few centimetres high can be told."""
        return self._jitter_m2 > JITTER_M**2

    def is_calm(self, t_s: float, body: BodyPose) -> bool:
        """Whether the robot has not nodded for a while: wheels on a bump lift the lens unseen."""
        nodded_s, at_m = self._nodded
        return t_s - nodded_s > CALM_S and abs(body.travel_m - at_m) > CALM_M

    def is_sure(self, body: BodyPose) -> bool:
        """Whether what lies below the ground ahead is low: not behind the crest of a ramp."""
        return self.found or abs(self.slope_rad(body)[0]) < CREST_RAD

    @property
    def is_guess(self) -> bool:
        """Whether the robot turns, and has turned far since it last saw the line."""
        return self._lost_turned_rad > GUESS_RAD and self._turned_rad > 0.0

    def is_even(self, body: BodyPose) -> bool:
        """Whether the ground at the line is about as steep as under the robot.

        Else that what lies between rises evenly is a guess: LEANS * 8 m / 4 = 7 cm wrong at most.
        """
        return abs(math.tan(self.slope_rad(body)[0]) - self._leaning[0]) <= LEANS

    def slope_rad(self, body: BodyPose) -> tuple[float, float]:
        """Slope of the ground ahead (along, across): up ahead and up to the left are positive."""
        line = self.line
        if line is None:
            return 0.0, 0.0
        (hx, hy), gx, gy = body.heading, line.slope_x, line.slope_y
        return math.atan(gx * hx + gy * hy), math.atan(gy * hx - gx * hy)

    def follow(self, sweep: Sweep, body: BodyPose) -> None:
        """Take the floor returns of a scan, before they are added to the cells."""
        line, was_found = self.line, self.found
        self._jitter_m = 0.0
        self._lean(sweep.t_s, body)
        self._turned_rad = self._turning.step(sweep.t_s, body.heading)
        self._memory.turn(self._turned_rad)
        if line is None:
            line = GroundPlane(body.x_m, body.y_m, body.z_m, 0.0, 0.0, body.travel_m)
        else:
            line = turned(line, self._heading, body)
        self._heading = body.heading
        line = self._moved(line, sweep, body)
        fitted = self._fitted(line, sweep, body)
        in_view = self._candidates >= 2 * LEAST
        if fitted is None and was_found and in_view and self._history:
            self._offsets.clear()
            line = self._moved(self._before(body), sweep, body)
            fitted = self._fitted(line, sweep, body)
        self.is_new = False
        turned_away = self._lost_turned_rad > GUESS_RAD
        if (fitted is None and (in_view or turned_away)) or self.line is None:
            tried = self._tried(sweep, body)
            if tried is None and fitted is None and in_view:
                tried = self._climbed(line, sweep, body)
            self.is_new = tried is not None and math.isfinite(self.lost_s)
            fitted = tried or fitted
        if fitted is None and math.isinf(self.lost_s):
            self.lost_s = sweep.t_s
            self._set(line, body)
            self.before = self.model
        self.found = fitted is not None
        if not self.found:
            self._offsets.clear()
        elif not self.is_new:
            self.lost_s = math.inf
            self._seen.clear()
        self.line = fitted or line
        self._set(self.line, body, self._jitter_m)
        self._last_s = sweep.t_s
        self._lost_turned_rad = 0.0 if self.found else self._lost_turned_rad + self._turned_rad
        if self.found:
            self._memory.keep(self.line, body)
        if self.found and (
            not self._history
            or abs(body.travel_m - self._history[-1][0].travel_m) > BACK_M / KEPT * 2
        ):
            self._history.append((self.line, body.heading))

    def _lean(self, t_s: float, body: BodyPose) -> None:
        """Follow the robot's own slope slowly: one that nods stands on level ground."""
        (hx, hy), (gx, gy) = body.heading, body.slopes
        now = (gx * hx + gy * hy, gy * hx - gx * hy)
        off = max(abs(now[0] - self._leaning[0]), abs(now[1] - self._leaning[1]))
        if off > NOD and not math.isinf(self._last_s):
            self._nodded = t_s, body.travel_m
        share = 1.0 if math.isinf(self._last_s) else 1.0 - math.exp((self._last_s - t_s) / LEAN_S)
        self._leaning = (
            self._leaning[0] + share * (now[0] - self._leaning[0]),
            self._leaning[1] + share * (now[1] - self._leaning[1]),
        )

    def _set(self, line: GroundPlane, body: BodyPose, jitter_m: float = 0.0) -> None:
        """The model for a line, seen from where the robot stands.

        A jitter of the attitude turns all that a scan shows about the robot.
        """
        hx, hy = body.heading
        ahead_m = hx * (line.x_m - body.x_m) + hy * (line.y_m - body.y_m)
        aside_m = hx * (line.y_m - body.y_m) - hy * (line.x_m - body.x_m)
        across = line.slope_y * hx - line.slope_x * hy
        turn = jitter_m / ahead_m if ahead_m > 0.5 else 0.0
        z_m = line.z_m + jitter_m
        along = line.slope_x * hx + line.slope_y * hy
        if ahead_m > 0.5:
            along = (z_m - across * aside_m - body.z_m) / ahead_m
        near_x, near_y = along * hx - across * hy, along * hy + across * hx
        far_x, far_y = line.slope_x + turn * hx, line.slope_y + turn * hy
        self.model = Ground(
            z_m - far_x * line.x_m - far_y * line.y_m,
            far_x,
            far_y,
            body.z_m - near_x * body.x_m - near_y * body.y_m,
            near_x,
            near_y,
            hx,
            hy,
            hx * line.x_m + hy * line.y_m,
            jitter_m,
        )

    def _moved(self, line: GroundPlane, sweep: Sweep, body: BodyPose) -> GroundPlane:
        """The line where this scan should see it, on the same plane."""
        self._set(line, body)
        if not nearest_due(sweep.origins, sweep.rays, self.model, self._anchor):
            return line
        x, y = float(self._anchor[0]), float(self._anchor[1])
        return GroundPlane(x, y, line.height_m(x, y), line.slope_x, line.slope_y, body.travel_m)

    def _before(self, body: BodyPose) -> GroundPlane:
        """The line as it was a while ago."""
        history = self._history
        while len(history) > 1 and abs(body.travel_m - history[-1][0].travel_m) < BACK_M:
            history.pop()
        return turned(*history[-1], body)

    def _look(
        self, line: GroundPlane, sweep: Sweep, body: BodyPose, gate: float
    ) -> tuple[int, int, float, float]:
        near, candidates = self._near(line, sweep, body, gate)
        n, offset_m, slope = fit(self._found, near)
        if n < FLAT_SHARE * near:
            n = 0
        return int(n), candidates, float(offset_m), float(slope)

    def _near(
        self, line: GroundPlane, sweep: Sweep, body: BodyPose, gate: float
    ) -> tuple[int, int]:
        """How many returns lie near a line's plane, into `_found`, and how many might have."""
        self._set(line, body)
        self._anchor[:] = line.x_m, line.y_m
        near, candidates = near_plane(
            sweep.origins,
            sweep.rays,
            sweep.ranges_m,
            self.model,
            self._anchor,
            gate,
            self._cells.window,
            self._cells.flat,
            self._found,
        )
        return int(near), int(candidates)

    def _fitted(self, line: GroundPlane, sweep: Sweep, body: BodyPose) -> GroundPlane | None:
        """The line moved towards what the scan shows; none if it does not show it."""
        n, candidates, offset_m, across = self._look(line, sweep, body, 1.0)
        self._candidates = candidates
        if n < max(LEAST, 0.1 * candidates):
            return None
        self._offsets.append(offset_m)
        middle_m = sorted(self._offsets)[len(self._offsets) // 2]
        far_m = math.hypot(line.x_m - body.x_m, line.y_m - body.y_m)
        if abs(middle_m) > KEPT_M + KEPT_SLOPE * far_m:
            return None
        jitter_m = offset_m - middle_m
        self._jitter_m2 += (min(jitter_m**2, MOST_JITTER_M**2) - self._jitter_m2) / JITTER_SCANS
        self._jitter_m = jitter_m if self.jitters and abs(jitter_m) <= MOST_JITTER_M else 0.0
        return self._followed(line, body, sweep.t_s, middle_m, across)

    def _followed(
        self, line: GroundPlane, body: BodyPose, t_s: float, middle_m: float, across: float
    ) -> GroundPlane:
        """The line moved by part of how far off it was found, and of its slope across."""
        passed_s = max(0.0, min(1.0, t_s - self._last_s))
        last = self.line
        before_m = last.travel_m if last else body.travel_m
        moved_m = abs(body.travel_m - before_m)
        if middle_m < CREST_M and self.slope_rad(body)[0] > CREST_RAD:
            moved_m *= CREST_FASTER
        led_m = moved_m + TURNED_M * self._turned_rad
        stay = math.exp(-led_m / FOLLOW_M - passed_s / FOLLOW_S)
        most_m = STEEPEST * led_m + 0.02 * passed_s
        rise_m = max(-most_m, min(most_m, (1.0 - stay**2) * middle_m))
        swept_m = math.hypot(line.x_m - last.x_m, line.y_m - last.y_m) if last else 0.0
        self._swept_m = max(swept_m, SWEPT_KEPT * self._swept_m)
        over_m = max(moved_m, SWEPT_SHARE * self._swept_m, 1e-3)
        bend = (1.0 - math.exp(-moved_m / FOLLOW_M)) ** 2 * middle_m / over_m
        if body.travel_m < before_m:
            bend = -bend
        tilt = (1.0 - math.exp(-led_m / TURN_M - passed_s / FOLLOW_S)) * across
        self._offsets = deque((off_m - rise_m for off_m in self._offsets), MIDDLE_OF)
        hx, hy = body.heading
        along = line.slope_x * hx + line.slope_y * hy
        on_ramp = math.hypot(*self._leaning) > LEANS
        nods = not on_ramp and not self.is_calm(t_s, body)
        bend *= NODDING_BEND if nods else 1.0
        return_m = NODDING_RETURN_M if nods else RETURN_M
        bend += (self._leaning[0] - along) * min(1.0, abs(body.travel_m - before_m) / return_m)
        slope_x = _limited(line.slope_x + bend * hx - tilt * hy)
        slope_y = _limited(line.slope_y + bend * hy + tilt * hx)
        return GroundPlane(line.x_m, line.y_m, line.z_m + rise_m, slope_x, slope_y, body.travel_m)

    def _again(self, sweep: Sweep, body: BodyPose) -> tuple[GroundPlane | None, int]:
        """The remembered plane that most of the returns lie on, if many do, and how many."""
        best, most = None, LEAST
        for kept in self._memory.near(body):
            line = self._moved(kept, sweep, body)
            n, candidates, _, _ = self._look(line, sweep, body, TRIED_GATE)
            if n > most and n >= 0.3 * candidates:
                best, most = line, n
        return best, most

    def _tried(self, sweep: Sweep, body: BodyPose) -> GroundPlane | None:
        """The plane through the robot's wheels that most of the returns lie on, if many do."""
        best, most = self._again(sweep, body)
        (hx, hy), (along, across) = body.heading, self._leaning
        leans = self.line is None or math.hypot(along, across) > LEANS
        for share in TRIED_SLOPES if leans else (0.0,):
            slopes = (
                _limited(share * (along * hx - across * hy)),
                _limited(share * (along * hy + across * hx)),
            )
            for offset_m in TRIED_M if leans else TRIED_LEVEL_M:
                z_m = body.z_m + offset_m
                line = GroundPlane(body.x_m, body.y_m, z_m, *slopes, body.travel_m)
                line = self._moved(line, sweep, body)
                n, candidates, _, _ = self._look(line, sweep, body, TRIED_GATE)
                if n > most * 1.1 and n >= 0.3 * candidates:
                    best, most = line, n
        if best is not None:
            self._history.clear()
            self._offsets.clear()
        return best

    def _climbed(self, line: GroundPlane, sweep: Sweep, body: BodyPose) -> GroundPlane | None:
        """The plane of lines that rise or fall evenly, if it leads down or up to the robot: a ramp.

        A kerb's top is level, a wall stands still: neither does.
        """
        near, candidates = self._near(line, sweep, body, SEEK_GATE)
        at = np.zeros(3)
        n = int(seek(self._found, near, at))
        if n < max(2 * LEAST, FLAT_SHARE * candidates):
            return None
        (hx, hy), x_m, y_m = body.heading, float(at[1]), float(at[2])
        if self._seen and abs(body.travel_m - self._seen[-1][2]) < SEEN_STEP_M:
            return None
        seen = (hx * x_m + hy * y_m, line.height_m(x_m, y_m) + float(at[0]), body.travel_m)
        self._seen.append(seen)
        u, z, _ = np.array(self._seen).T
        if len(u) < LEAST_SEEN or float(np.ptp(u)) < SEEN_M:
            return None
        slope, height_m = slope_of(u, z), float(z.mean())
        rough_m = float(np.abs(z - height_m - slope * (u - u.mean())).max())
        half = len(u) // 2
        halves = slope_of(u[:half], z[:half]), slope_of(u[half:], z[half:])
        if not min(halves) * max(halves) > 0.0 or min(map(abs, halves)) < EVEN * abs(slope):
            return None
        rise_m = height_m + slope * (float(u[-1]) - float(u.mean())) - body.z_m
        ahead_m = float(u[-1]) - hx * body.x_m - hy * body.y_m
        if not (LEAST_SLOPE <= abs(slope) <= STEEPEST and rough_m <= ROUGH_M):
            return None
        if not -FOOT_M <= ahead_m - rise_m / slope <= ahead_m + FOOT_M:
            return None
        self._history.clear()
        self._seen.clear()
        return GroundPlane(x_m, y_m, body.z_m + rise_m, slope * hx, slope * hy, body.travel_m)


def _limited(slope: float) -> float:
    return max(-STEEPEST, min(STEEPEST, slope))
