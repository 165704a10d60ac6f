"""Lines of floor that were found before, by the heading of the robot: it may turn and come back.

A robot that turns on a ramp loses the floor beside it behind walls, and meets another slope where
it looks next. When it looks where it has looked before, from near the same place, the plane that
the floor lay on then is the first to try.
Source: design, section 7 (ground).
"""

import math

from core.mapping.beams.ground_plane import GroundPlane
from core.mapping.body import BodyPose

SECTORS = 24  # of the circle
NEAR_M = 2.0  # from the place where a line was found, it may be tried again,
AWAY_RAD = 0.5  # when the robot has turned so far since
TURNING_RADPS = 0.1  # less, over a few scans, is a heading that jitters
SHARE = 0.2  # of a scan, in how fast it turns
GAP_S = 0.5  # between scans: beyond it, nothing is known of it


class Turning:
    """How far the robot turns from scan to scan; a heading that only jitters does not turn."""

    def __init__(self) -> None:
        self._heading, self._t_s, self._radps = (1.0, 0.0), -math.inf, 0.0

    def step(self, t_s: float, heading: tuple[float, float]) -> float:
        """Rad since the scan before, in whatever sense."""
        (ax, ay), (bx, by), passed_s = self._heading, heading, t_s - self._t_s
        self._heading, self._t_s = heading, t_s
        if not 0.0 < passed_s <= GAP_S:
            self._radps = 0.0
            return 0.0
        turned_rad = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        self._radps += SHARE * (turned_rad / passed_s - self._radps)
        return abs(self._radps) * passed_s if abs(self._radps) > TURNING_RADPS else 0.0


class GroundMemory:
    """The newest line found in each sector of heading, with what the robot had turned till then."""

    def __init__(self) -> None:
        self._kept: list[tuple[GroundPlane, BodyPose, float] | None] = [None] * SECTORS
        self._turned_rad = 0.0  # to and fro, since the start

    def forget(self) -> None:
        """All of them."""
        self._kept = [None] * SECTORS

    def turn(self, by_rad: float) -> None:
        """The robot has turned; the sense does not matter."""
        self._turned_rad += by_rad

    def keep(self, line: GroundPlane, body: BodyPose) -> None:
        """A line that was just found."""
        self._kept[_sector(body)] = line, body, self._turned_rad

    def near(self, body: BodyPose) -> list[GroundPlane]:
        """Those that were found from near here, looking the same way, before it turned away."""
        at, found = _sector(body), []
        for sector in (at, at - 1, (at + 1) % SECTORS):
            kept = self._kept[sector]
            if kept is None or self._turned_rad - kept[2] < AWAY_RAD:
                continue
            if math.hypot(kept[1].x_m - body.x_m, kept[1].y_m - body.y_m) <= NEAR_M:
                found.append(kept[0])
        return found


def _sector(body: BodyPose) -> int:
    hx, hy = body.heading
    return int((math.atan2(hy, hx) / (2 * math.pi) + 1.0) * SECTORS) % SECTORS
