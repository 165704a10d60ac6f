"""From what a commander wants to the power of both wheels, or zero and the reason in words.

Speed grows no faster than the settings allow and ends at once on any doubt: there is no ramp down
to a standstill that nobody knows to be safe. What stands in the way limits the speed to one from
which the robot can stop before it.
Source: design, section 8; planner link, sections 3 and 5.
"""

import ipaddress
import math
from collections.abc import Sequence
from urllib.parse import urlsplit

from core.config import Config
from core.driving import health
from core.driving.stop_zone import (
    NOTHING,
    STANDING_MPS,
    Motion,
    Obstruction,
    Place,
    StopZone,
)
from core.mapping.method import Maps, is_low
from core.motion.track import Pose
from core.records import OBSTACLE, DriveRequest

Powers = tuple[float, float]  # left and right wheel, -1..1 of full
Barred = tuple[float, float, float]  # x, y and edge of a cell that is in the way; map frame, m

NOT_ENABLED = "the motors are not enabled ([robot] enable_motors)"
SILENT = "the commander has fallen silent"
LOOP_S = 0.1  # so late, at most, a tick may begin: later ones stop the robot
ORDER_S = 0.2  # a zero goes out behind the exchange with the controller that is under way
LONGEST_STEP_S = 0.05  # a late tick may not make the speed jump
START_M = (0.0, 0.0)  # where the map begins
MOVING_MPS = 0.05
FASTER, FASTER_MPS = 1.15, 0.1  # than told: more than a robot that brakes lags behind
SET_OUT_MPS = 0.1  # so much must be allowed before a standing robot moves: else it would inch ahead
NEEDED = (
    (health.SCANNER_OK, "the scanner delivers no scans"),
    (health.AHRS_OK, "the attitude sensor delivers nothing"),
    (health.WHEELS_OK, "the wheels' counters are not read"),
    (health.CLOCKS_LOCKED, "the sensors' clocks are not locked yet"),
    (health.POSE_VALID, "the pose is not known"),
    (health.NO_OVERRUN, "the loop was too late within the last second"),
    (health.MAP_VALID, "the map is not valid"),
)
FORBIDDEN = (
    (health.STOP_ASKED, "the emergency stop is pressed"),
    (health.TOO_STEEP, "the robot stands too steep for its map"),
)


def links_refusal(urls: Sequence[str], has_key: bool) -> str:
    """Why external poses are taken on none of these ports, in words; "" if one takes them."""
    refusals = [link_refusal(url, has_key, True) for url in urls]
    return refusals[0] if all(refusals) else ""


def link_refusal(url: str, has_key: bool, enabled: bool) -> str:
    """Why nobody may drive over the planner link at this URL, in words; "" if one may."""
    if not enabled:
        return NOT_ENABLED
    parts = urlsplit(url)
    if has_key or parts.scheme == "serial" or parts.hostname == "localhost":
        return ""
    try:
        own = ipaddress.ip_address(parts.hostname or "").is_loopback
    except ValueError:
        own = False
    return "" if own else "from another machine it takes a key (planner.key_file)"


def stop_reason(word: int, mode: int, sight: str, others: tuple[str, ...] = ()) -> str:
    """The first reason to stand still, in words; "" if all that is known speaks for driving.

    Args:
        sight: why what the scanner sees is not to be believed.
        others: what comes before everything that is needed.
    """
    if mode == health.REPLAYED:
        return "these are recorded data"
    for bit, message in FORBIDDEN:
        if word & bit:
            return message
    for message in others:
        if message:
            return message
    for bit, message in NEEDED:
        if not word & bit:
            return message
    if mode != health.RUNNING:
        return "mapod is not running as it should"
    return sight


class DriveControl:
    """One robot's motion as commanded: limits, ramps, and what stands in the way."""

    def __init__(self, config: Config, maps: Maps) -> None:
        robot = config.robot
        self._robot, self._full_mps = robot, config.drive.full_power_mps
        self._maps = maps
        self.zone = StopZone(
            robot.front_m,
            robot.rear_m,
            robot.width_m,
            robot.stop_margin_m,
            robot.brake_mps2,
            health.stale_s(config.scanner.options.spec.period_s) + LOOP_S + ORDER_S,
        )
        self.off_start_m = 0.0  # the map's origin may be so far from where the run began; inf: any
        self.v_mps = self.w_radps = 0.0  # commanded now
        self.blocked_by = ""  # why it stands although somebody wants it to move, in words
        self.maybe_barred: Barred | None = None  # the cell that it stands before, if one it is
        self._last_s = -math.inf
        self._let_go_for = ""  # what made the motors unwilling while somebody wanted them to turn

    @property
    def clear(self) -> Place:
        """x, y and radius of the ground where unknown counts as free; inf: everywhere.

        The settings vouch for the ground about where the run began, as far as that is known.
        """
        robot = self._robot
        radius_m = robot.start_clear_m - self.off_start_m if robot.unknown_stops else math.inf
        return (*START_M, max(0.0, radius_m))

    def halt(self, reason: str) -> Powers:
        self.v_mps = self.w_radps = 0.0
        self.blocked_by, self.maybe_barred = reason, None
        return 0.0, 0.0

    def step(
        self,
        now_s: float,
        request: DriveRequest | None,
        stop_reason: str,
        pose: Pose | None,
        motors_off: str,
        moves: Motion,
    ) -> Powers:
        """Wheel power until the next step.

        Args:
            stop_reason: why to stand still, in words.
            moves: as measured. A robot that is faster than it was told (downhill, or full power is
                more than the settings say) is slowed down for what is in the way of its real speed.
            motors_off: why the motors do not obey; when that ends, a request that was there all
                the time moves nothing: somebody may stand at the emergency stop.
        """
        passed_s = max(0.0, min(LONGEST_STEP_S, now_s - self._last_s))
        self._last_s = now_s
        asks = request is not None and now_s <= request.valid_until_s and _is_motion(request)
        self._let_go_for = (motors_off or self._let_go_for) if asks else ""
        if stop_reason or motors_off or pose is None:
            return self.halt(stop_reason or motors_off or "the pose is not known")
        if self._let_go_for:
            return self.halt(f"until the commander lets go once: {self._let_go_for}")
        if request is None or not now_s <= request.valid_until_s:
            return self.halt(SILENT if request is not None and _is_motion(request) else "")
        wanted = self._limited(request.v_mps, request.w_radps)
        if not all(map(math.isfinite, wanted)):
            return self.halt("the request is no number")
        stands = not (self.v_mps or self.w_radps)
        self._ramp(wanted, passed_s)
        motion = (self.v_mps, self.w_radps)
        rate_mps, measured_mps = self.zone.rate_mps(*motion), self.zone.rate_mps(*moves)
        is_faster = measured_mps > FASTER * rate_mps + FASTER_MPS
        rate_mps = measured_mps if is_faster else rate_mps
        found = self.look(pose, motion, self.zone.rate_mps(*wanted))
        if is_faster:  # it still rolls, maybe on another arc
            rolls_to = self.look(pose, moves, 0.0)
            found = min(found, rolls_to, key=lambda one: one.free_m)
        allowed_mps = self.zone.allowed_mps(found.free_m)
        if rate_mps >= STANDING_MPS and allowed_mps <= (SET_OUT_MPS if stands else 0.0):
            return self._stand_before(found)
        share = min(1.0, allowed_mps / rate_mps) if rate_mps >= STANDING_MPS else 1.0
        self.v_mps, self.w_radps = share * motion[0], share * motion[1]
        self.blocked_by, self.maybe_barred = "", None
        return self._powers()

    def _stand_before(self, found: Obstruction) -> Powers:
        powers, cell_m = self.halt(self.describe(found)), self._maps.window.grid.cell_m
        self.maybe_barred = (found.i + 0.5) * cell_m, (found.j + 0.5) * cell_m, cell_m
        return powers

    def drop_ahead(self, moves: Motion, request: DriveRequest | None, pose: Pose | None) -> bool:
        """Whether the way to a stop, as the robot moves or else is asked to, leads to a drop."""
        if pose is None:
            return False
        found = self.look(pose, self.heading_for(moves, request), 0.0)
        return found.state == OBSTACLE and self.is_drop(found)

    def heading_for(self, moves: Motion, request: DriveRequest | None) -> Motion:
        """As the robot moves, or else as it is asked to within the settings' limits; or zero."""
        if self.zone.rate_mps(*moves) >= MOVING_MPS:
            return moves
        return self._limited(request.v_mps, request.w_radps) if request else (0.0, 0.0)

    def describe(self, found: Obstruction) -> str:
        if found.state != OBSTACLE:
            return "ground in the way was not seen to be free"
        return "a drop is in the way" if self.is_drop(found) else "an obstacle is in the way"

    def at_full_speed(self, motion: Motion) -> Motion:
        """As fast as the settings allow on the arc of a motion that is not zero."""
        robot = self._robot
        share = max(abs(motion[0]) / robot.max_speed_mps, abs(motion[1]) / robot.max_turn_radps)
        return motion[0] / share, motion[1] / share

    def _limited(self, v_mps: float, w_radps: float) -> Motion:
        """Within the settings' limits, on the same arc."""
        robot = self._robot
        excess = max(1.0, abs(v_mps) / robot.max_speed_mps, abs(w_radps) / robot.max_turn_radps)
        return v_mps / excess, w_radps / excess

    def _ramp(self, wanted: Motion, passed_s: float) -> None:
        robot = self._robot
        self.v_mps = _towards(
            self.v_mps, wanted[0], robot.max_accel_mps2 * passed_s, robot.brake_mps2 * passed_s
        )
        turn = robot.max_turn_accel_radps2 * passed_s
        self.w_radps = _towards(self.w_radps, wanted[1], turn, turn)

    def look(self, pose: Pose, motion: Motion, from_mps: float, for_s: float = 0.0) -> Obstruction:
        """What a motion would meet on its way to a stop (`StopZone.look`)."""
        if not any(motion):
            return NOTHING
        window, place = self._maps.window, (pose.x_m, pose.y_m, pose.yaw_rad)
        return self.zone.look(window.grid, window.cells, place, motion, self.clear, from_mps, for_s)

    def is_drop(self, obstacle: Obstruction) -> bool:
        """Whether that is lower than the ground, or ground that did not show."""
        return is_low(self._maps, obstacle.i, obstacle.j)

    def _powers(self) -> Powers:
        rim_mps = 0.5 * self._robot.track_width_m * self.w_radps
        left = (self.v_mps - rim_mps) / self._full_mps
        right = (self.v_mps + rim_mps) / self._full_mps
        excess = max(1.0, abs(left), abs(right))
        return left / excess, right / excess


def _is_motion(request: DriveRequest) -> bool:
    return bool(request.v_mps or request.w_radps)


def _towards(value: float, wanted: float, faster: float, slower: float) -> float:
    """`value` moved towards `wanted`: away from zero by `faster` at most, to it by `slower`."""
    if value * wanted < 0.0:
        wanted = 0.0
    most = faster if abs(wanted) > abs(value) else slower
    return value + max(-most, min(most, wanted - value))
