"""The whole app as one object: `App(config, ports)` with `step(now_s)`.

It reads no clock and opens no file, so that it runs live, in a replay and in a test alike.
"""

import math
from dataclasses import dataclass
from itertools import chain

import numpy as np
import structlog

from core.config import Config
from core.driving import control as drive
from core.driving.report import report
from core.driving.stall import STALLED, StallWatch
from core.driving.zone import NOT_TRUSTED, ZoneReporter
from core.mapping.layers import UNITS
from core.mapping.mapper import Mapper
from core.mapping.tiles import TileValues
from core.records import Attitude, PoseReport, Scan, WheelCounts
from hw.ax3500.session import Ax3500
from hw.device import DeviceStatus, NoPort, Port
from hw.lms1xx.session import Lms111
from hw.modbus.image import RegisterImage
from hw.mti.session import Mti
from hw.planner_link.receivers import Planners
from hw.planner_link.sender import LinkSettings, Wire
from hw.ports.wires import parse_url

STATE_LOG_S = 1.0  # counters to the log this often
SCAN_WAIT = 0.25  # share of a tick of the link that it waits for a scan which is due
LOOK_S = 0.01  # doubts and ramps are worked out this often where nothing new has come
ZONE_S = 0.045  # the stop zone is worked out this often: at every second or third map frame


@dataclass(frozen=True, slots=True)
class Ports:
    """The wires of the app."""

    scanner: Port
    ahrs: Port
    drive: Port
    planner: Port
    receivers: tuple[Port, ...] = ()  # who else gets the map: the rest of `planner.port`

    def close(self) -> None:
        """Let go of all of them."""
        for port in (self.scanner, self.ahrs, self.drive, self.planner, *self.receivers):
            port.close()


class App:
    """Everything that lives for the whole run, made here and nowhere else."""

    def __init__(
        self,
        config: Config,
        ports: Ports,
        *,
        session: int,
        key: bytes | None = None,
        replayed: bool = False,
        version: str = "",
    ) -> None:
        self.config, self.ports, self._replayed = config, ports, replayed
        scanner, wheels, robot = config.scanner, config.drive, config.robot
        self.scanner = Lms111(
            ports.scanner,
            dialect=scanner.dialect,
            scan_rate_hz=scanner.scan_rate_hz,
            angular_step_deg=scanner.angular_step_deg,
            first_deg=scanner.first_deg,
            last_deg=scanner.last_deg,
            echo=scanner.echo,
            accepted_status=scanner.accepted_status,
        )
        self.ahrs = Mti(ports.ahrs, rate_hz=config.ahrs.rate_hz, baud=_baud(config.ahrs.port))
        turns_per_s = robot.max_speed_mps / (2 * math.pi * robot.wheel_radius_m) * robot.gear_ratio
        self.drive = Ax3500(
            ports.drive,
            poll_hz=wheels.poll_hz,
            left_channel=wheels.left_channel,
            right_channel=wheels.right_channel,
            inverted_channels=tuple(wheels.invert),
            enter_rs232=wheels.enter_rs232,
            max_counts_per_s=turns_per_s * 4 * robot.encoder_ppr,
            enable_motors=robot.enable_motors,
        )
        self.mapper = Mapper(config)
        self.control = drive.DriveControl(config, self.mapper.maps)
        self._stall = StallWatch(config)
        self._tick_s = 1.0 / config.planner.rate_hz
        self.planners = self._new_planners(session, key)
        self.tiles = TileValues(self.mapper.maps)
        self._zones = ZoneReporter(self.control, self.mapper.maps.window, robot.max_speed_mps)
        self.zone = NOT_TRUSTED
        self.image = self._maybe_image(session, version)
        self.statuses = {  # by the section of mapod.toml that describes them
            "scanner": self.scanner.status,
            "ahrs": self.ahrs.status,
            "drive": self.drive.status,
        }
        self.servers: dict[str, DeviceStatus] = {}  # of the register image, by name, for the log
        self.log = structlog.get_logger()
        self._linked_s = self._logged_s = self._overrun_s = self._zone_s = float("-inf")
        self._mapped_s = self._looked_s = float("-inf")
        self.ticks = self.slots_missed = 0
        self._late_s: list[float] = []  # of the ticks since the last log
        self._drop_ahead = False
        self._states = {"": ("", ""), "requests": ("", ""), "poses": ("", "")}

    def _new_planners(self, session: int, key: bytes | None) -> Planners:
        config, planner = self.config, self.config.planner
        may_move, has_key = config.robot.enable_motors, key is not None
        ports = (self.ports.planner, *self.ports.receivers)
        return Planners(
            [
                Wire(
                    port,
                    line_baud=parse_url(url).baud,
                    drive_refusal=drive.link_refusal(url, has_key, may_move),
                    pose_refusal=drive.link_refusal(url, has_key, True),
                )
                for port, url in zip(ports, planner.ports, strict=True)
            ],
            LinkSettings(
                size=config.obstacle.window_cells,
                cell_mm=round(config.map.cell_m * 1000),
                tick_s=self._tick_s,
                key=key,
                stale_ms=max(150, math.ceil(3000 * self._tick_s)),
                push=planner.push,
            ),
            session,
        )

    def _maybe_image(self, session: int, version: str) -> RegisterImage | None:
        """What Modbus clients read; none where nobody may."""
        config = self.config
        if not config.modbus.ports:
            return None
        return RegisterImage(
            size=config.obstacle.window_cells,
            cell_mm=round(config.map.cell_m * 1000),
            session=session,
            version=version,
            ask=self.planners.requests.ask,
            drive_refusal=drive.modbus_refusal(config),
        )

    def step(self, now_s: float) -> None:
        """One tick: read, map, write. Never waits."""
        self.ticks += 1
        attitudes, counted = self.ahrs.step(now_s), self.drive.step(now_s)
        scans, asked = self.scanner.step(now_s), self.planners.requests.newest
        for attitude in attitudes:
            self.mapper.add_attitude(attitude)
        for counts in counted:
            self.mapper.add_counts(counts)
            self._stall.counted(counts)
        for scan in scans:
            self.mapper.add_scan(scan)
        mapped = self.mapper.settle(now_s) > 0
        self._mapped_s = now_s if mapped else self._mapped_s
        self.planners.poll(now_s)
        poses = self.planners.take_external_poses()
        for pose in poses:
            self.mapper.odometry.add_external(pose)
        has_news = bool(attitudes or counted or scans or mapped or poses)
        has_news = has_news or self.planners.requests.newest is not asked
        is_due = self._is_due(now_s, mapped)
        if has_news or is_due or now_s - self._looked_s >= LOOK_S - 1e-6:
            self._look(now_s, is_due)

    def _look(self, now_s: float, is_due: bool) -> None:
        """What all of it comes to now: for the planner, if it is due, the motors and the log."""
        self._looked_s = now_s
        window_trusted, told = self.report(now_s)
        if is_due:
            self.tell(now_s, told, window_trusted)
            self._linked_s = now_s
        self._drive(now_s, told)
        self._log(now_s)

    def _is_due(self, now_s: float, mapped: bool) -> bool:
        """Whether to tell now: with each scan, and between scans once a tick of the link.

        While scans come, a tick is held back a little: else one that falls just before a scan would
        leave the scan untold for a whole tick, again and again.
        """
        since_s, scans_come = now_s - self._linked_s, now_s - self._mapped_s < 2 * self._tick_s
        longest_s = self._tick_s * (1 + SCAN_WAIT if scans_come else 1)
        return since_s >= longest_s - 1e-6 or (mapped and since_s >= self._tick_s / 2)

    def tell(self, now_s: float, told: PoseReport, trusted: bool) -> None:
        """Everything to everybody who listens."""
        self._look_around(now_s, told, trusted)
        self.tiles.trusted = trusted
        window = self.mapper.window(trusted)
        self.planners.step(now_s, told, window, self.zone, self.tiles)
        if self.image is not None:
            spread = self.mapper.odometry.covariance
            self.image.publish(
                now_s,
                told,
                self.zone,
                window,
                planner_heard=self.planners.heard(now_s),
                driven=(self.control.v_mps, self.control.w_radps),
                sigma_m=math.sqrt(spread[0, 0] + spread[1, 1]),
                sigma_rad=math.sqrt(spread[2, 2]),
            )

    def _look_around(self, now_s: float, told: PoseReport, trusted: bool) -> None:
        """Bring the stop zone up to now: at once when trust comes or goes, else now and then."""
        known = self.zone is not NOT_TRUSTED
        if trusted and known and now_s - self._zone_s < ZONE_S:
            return
        self._zone_s = now_s
        asked = self.planners.requests.newest
        self.zone = self._zones.report(
            self.mapper.maybe_pose(now_s),
            trusted,
            (told.v_mps, told.w_radps),
            asked if asked is not None and now_s <= asked.valid_until_s else None,
            self._start_vouched,
        )

    @property
    def _start_vouched(self) -> bool:
        """The map still is that of the start, whose ground the settings vouch for."""
        return self.mapper.counts.erased == 0 and not self.mapper.continued

    def _drive(self, now_s: float, told: PoseReport) -> None:
        """Wheel power until the next tick: zero unless all is known to be well."""
        pose, request = self.mapper.maybe_pose(now_s), self.planners.requests.newest
        vouched = self._start_vouched
        moves = told.v_mps, told.w_radps
        if self._linked_s == now_s:
            self._drop_ahead = self.control.drop_ahead(moves, request, pose, vouched)
        if not self.config.robot.enable_motors:
            self.drive.drive(*self.control.halt(drive.NOT_ENABLED))
            return
        dirt = self.scanner.stream.contamination
        others = (self.planners.stop_reason, STALLED if self._stall.stalled else "")
        doubt = drive.doubt(told.health, told.mode, dirt, others)
        motors_off = self.drive.controller.trouble
        powers = self.control.step(now_s, request, doubt, pose, vouched, motors_off, moves)
        self._stall.told(now_s, *powers)
        self.drive.drive(*powers)

    def hear(self, now_s: float) -> None:
        """Between ticks: take in what has arrived from the devices. Never waits.

        A scan that has become complete, or the attitude that one waited for, does not wait for its
        tick: this is one then.
        """
        for device in (self.ahrs, self.drive, self.scanner):
            device.hear(now_s)
        if self.scanner.has_heard or (self.ahrs.has_heard and self.mapper.waits):
            self.step(now_s)

    def stop(self) -> None:
        """Before the ports are closed: motors get zero, a scanner's login is ended."""
        self.drive.stop()
        self.scanner.stop()

    def note_tick(self, late_s: float) -> None:
        """The loop begins a tick so long after its time."""
        self._late_s.append(late_s)

    def note_missed(self, now_s: float, slots: int) -> None:
        """The loop came late and skipped slots."""
        self.slots_missed += slots
        self._overrun_s = now_s

    def report(self, now_s: float) -> tuple[bool, PoseReport]:
        """Whether free may be told, and the pose and health for the planner."""
        return report(
            self.mapper,
            now_s,
            clocks_locked=self.scanner.clock_locked and self.ahrs.clock_locked,
            overrun=now_s - self._overrun_s < 1.0,
            replayed=self._replayed,
            contaminated=self.scanner.is_impaired,
            stop_asked=bool(self.drive.controller.emergency_stop),
            drop_ahead=self._drop_ahead,
            stalled=self._stall.stalled,
        )

    def _has_changed(self, name: str, state: str, cause: str) -> bool:
        new = (state, cause)
        if self._states.get(name) == new:
            return False
        self._states[name] = new
        return True

    def _log(self, now_s: float) -> None:
        """A line for each change of a device, or of what may drive; counters once a second."""
        for device, status in chain(self.statuses.items(), self.servers.items()):
            if self._has_changed(device, status.state, status.cause):
                tell = self.log.warning if status.cause else self.log.info
                tell("device_changed", device=device, state=status.state, cause=status.cause)
        requests = self.planners.requests
        if self.config.robot.enable_motors and self._has_changed("", "", self.control.blocked_by):
            self.log.info("drive_changed", blocked_by=self.control.blocked_by)
        if self._has_changed("requests", "", requests.last_refusal):
            self.log.warning("drive_requests_changed", refused_because=requests.last_refusal)
        poses = self.planners.external_poses
        if self._has_changed("poses", "", poses.last_refusal):
            self.log.warning("external_poses_changed", refused_because=poses.last_refusal)
        if now_s - self._logged_s < STATE_LOG_S:
            return
        self._logged_s = now_s
        for device, status in chain(self.statuses.items(), self.servers.items()):
            if status.rejections:
                newest = status.rejections[-1]
                self.log.warning(
                    "frames_rejected",
                    device=device,
                    total=status.rejected,
                    skipped_bytes=status.skipped_bytes,
                    newest_reason=newest.reason,
                )
                status.rejections.clear()
        counts, late_s = self.mapper.counts, sorted(self._late_s)
        self._late_s.clear()
        self.log.debug(
            "ticks_counted",
            ticks=self.ticks,
            slots_missed=self.slots_missed,
            latest_s=round(late_s[-1], 6) if late_s else None,
            late_p50_s=round(late_s[len(late_s) // 2], 6) if late_s else None,
            scans_added=counts.scans_added,
            scans_dropped=counts.scans_dropped,
            scans_early=counts.scans_early,
            scans_tilted=counts.scans_tilted,
            maps_erased=counts.erased,
            **self.planners.counters,
            drives_obeyed=requests.accepted,
            drives_refused=requests.refused.total(),
            poses_outlying=self.mapper.odometry.positioning.outliers,
        )


def _baud(url: str) -> int:
    """Bits per second of a serial line; 115200, the AHRS's own, where there is none (tcp)."""
    return parse_url(url).baud or 115_200


def warm_kernels(config: Config) -> None:
    """Run every kernel once on made-up records, so that none is compiled while a robot drives."""
    nowhere = NoPort()
    others = (nowhere,) * (len(config.planner.ports) - 1)
    app = App(config, Ports(nowhere, nowhere, nowhere, nowhere, others), session=0)
    level = (1.0, 0.0, 0.0, 0.0)
    for t_s in (0.0, 0.05):
        app.mapper.add_attitude(Attitude(t_s, level, (0.0, 0.0, 0.0)))
        app.mapper.add_counts(WheelCounts(t_s, 0.0, 0.0, 0))
    ranges_m = np.full((2 if config.scanner.echo == "both" else 1, 3), 1.0)
    app.mapper.add_scan(Scan(0.0, 0.001, -0.1, 0.1, ranges_m, counter=0, arrived_s=0.05))
    app.mapper.settle(0.05)
    app.mapper.attitudes.turn_all(0.0)
    app.mapper.maps.warm()
    for now_s in (0.05, 1.0):
        window_trusted, told = app.report(now_s)
        app.tell(now_s, told, window_trusted)
        app.control.drop_ahead((0.1, 0.1), None, app.mapper.maybe_pose(now_s), True)
    for name in UNITS:
        app.mapper.maybe_layer(name)
