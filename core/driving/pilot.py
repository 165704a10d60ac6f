"""What the robot may do now: the stop zone, and the power of its wheels, from maps and requests.

It moves only where motors are enabled, all inputs are well and nothing is in the way.
Source: design, section 8.
"""

from core.config import Config
from core.driving.control import NOT_ENABLED, DriveControl, Powers, stop_reason
from core.driving.stall import STALLED, StallWatch
from core.driving.zone import NOT_TRUSTED, ZoneReporter
from core.mapping.mapper import Mapper
from core.motion.track import Pose
from core.records import DriveRequest, PoseReport, WheelCounts

ZONE_S = 0.045  # the stop zone is worked out this often: at every second or third map frame


class Pilot:
    """Stop zone, drive control and stall watch of one robot."""

    def __init__(self, config: Config, mapper: Mapper) -> None:
        self._mapper, self._may_move = mapper, config.robot.enable_motors
        self.control = DriveControl(config, mapper.maps)
        self.zone = NOT_TRUSTED
        self.drop_ahead = False  # on the way to a stop
        self.stalled = False  # the wheels' counters do not follow what the wheels are told
        self._stall = StallWatch(config)
        self._zones = ZoneReporter(
            self.control,
            mapper.maps.window,
            config.robot.max_speed_mps,
            has_sectors=bool(config.modbus.ports),  # whose clients alone read them
        )
        self._zone_s = float("-inf")

    def counted(self, counts: WheelCounts) -> None:
        self._stall.counted(counts)
        self.stalled = self._stall.stalled

    def look_around(
        self, now_s: float, told: PoseReport, trusted: bool, request: DriveRequest | None
    ) -> None:
        """Bring the stop zone up to now: at once when trust comes or goes, else now and then."""
        known = self.zone is not NOT_TRUSTED
        if trusted and known and now_s - self._zone_s < ZONE_S:
            return
        self._zone_s = now_s
        self.zone = self._zones.report(
            self._maybe_pose(now_s),
            trusted,
            (told.v_mps, told.w_radps),
            request if request is not None and now_s <= request.valid_until_s else None,
        )

    def look_ahead(self, now_s: float, told: PoseReport, request: DriveRequest | None) -> None:
        """Whether the way to a stop leads to a drop."""
        pose, moves = self._maybe_pose(now_s), (told.v_mps, told.w_radps)
        self.drop_ahead = self.control.drop_ahead(moves, request, pose)

    def powers(
        self,
        now_s: float,
        told: PoseReport,
        request: DriveRequest | None,
        *,
        sight: str,
        commander: str,
        motors_off: str,
    ) -> Powers:
        """Wheel power until the next tick: zero unless all is known to be well.

        Args:
            sight: why what the scanner sees is not to be believed, in words.
            commander: likewise why nobody's request is.
            motors_off: why the motors do not obey.
        """
        if not self._may_move:
            return self.control.halt(NOT_ENABLED)
        others = (commander, STALLED if self.stalled else "")
        powers = self.control.step(
            now_s,
            request,
            stop_reason(told.health, told.mode, sight, others),
            self._maybe_pose(now_s),
            motors_off,
            (told.v_mps, told.w_radps),
        )
        self._stall.told(now_s, *powers)
        return powers

    def halted(self, now_s: float, reason: str) -> None:
        """The power of this instant did not go out, in words why: speeds begin at zero again."""
        self.control.halt(reason)
        self._stall.told(now_s, 0.0, 0.0)

    def _maybe_pose(self, now_s: float) -> Pose | None:
        """The pose now; the control is told how far off the run's start may be from its map."""
        self.control.off_start_m = self._mapper.off_start_m
        return self._mapper.maybe_pose(now_s)
