"""The whole app as one object: `App(config, ports)` with `step(now_s)`.

It reads no clock and opens no file, so that it runs live, in a replay and in a test alike.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from core.config import Config
from core.driving.control import LOOP_S, Powers, stop_reason
from core.driving.health import doubt, stale_s
from core.driving.monitor import Monitor, Seen
from core.driving.pilot import Pilot
from core.driving.report import report
from core.mapping.layers import ON_ASKING, UNITS
from core.mapping.mapper import Mapper
from core.mapping.rays import span_s
from core.mapping.tiles import TileValues
from core.records import Attitude, ExternalPose, PathReport, PoseReport, Scan, WheelCounts
from hw.device import Port
from hw.planner_link.objects import ObjectSource
from logs import LoopCounts, StateLog
from wiring import (
    Devices,
    Ports,
    devices_on,
    maybe_cleaner,
    maybe_image,
    maybe_perception,
    no_ports,
    planners_on,
)

if TYPE_CHECKING:
    from beside import Work
    from core.objects.seen import Seen as Frame
    from core.paths.cleaning.planned import Planned

__all__ = ["App", "Ports", "warm_kernels"]

SCAN_WAIT = 0.25  # share of a tick of the link that it waits for a scan which is due
LOOK_S = 0.01  # doubts and ramps are worked out this often where nothing new has come
OVERRUN_S = 1.0  # for so long a loop that was too late is told
TURNS = 32  # between two steps: who sends without end does not keep the app from its ticks


@dataclass(slots=True)
class LinkPace:
    """When to tell the planner: with each scan, and between scans once a tick of the link."""

    tick_s: float
    told_s: float = -math.inf
    mapped_s: float = -math.inf
    is_untold: bool = False  # the newest map

    def is_due(self, now_s: float, mapped: bool) -> bool:
        if mapped:
            self.mapped_s, self.is_untold = now_s, True
        return now_s >= self.due_s - 1e-6

    def told(self, now_s: float) -> None:
        self.told_s, self.is_untold = now_s, False

    @property
    def due_s(self) -> float:
        """When to tell next. A new map waits for half a tick after what was told last, at most.

        While scans come, a tick is held back a little. Else one that falls just before a scan would
        leave the scan untold for a whole tick, again and again.
        """
        if self.is_untold:
            return self.told_s + self.tick_s / 2
        tick_s, scans_end_s = self.told_s + self.tick_s, self.mapped_s + 2 * self.tick_s
        return min(max(tick_s, scans_end_s), tick_s + SCAN_WAIT * self.tick_s)


@dataclass(slots=True)
class StepTimes:
    """What steps have been for, and whether they came in time."""

    period_s: float
    stepped_s: float = math.inf  # begin of the newest step; inf: none yet
    looked_s: float = -math.inf
    overrun_s: float = -math.inf  # newest step that began too late
    turns: int = 0  # without a step, since the newest one

    def begin(self, now_s: float, due_s: float) -> None:
        """A step begins. The first one is never late."""
        if now_s - max(due_s, self.stepped_s + self.period_s) > LOOP_S:
            self.overrun_s = now_s
        self.stepped_s = now_s


@dataclass(slots=True)
class Plan:
    """What the live loop waits for.

    The lists are in the devices' order; behind them come planners that may drive.
    """

    step_s: float = -math.inf  # when the next step is due,
    devices_s: list[float] = field(default_factory=list)  # and each device, though nothing arrives
    # whose bytes are worth a turn: the same list for the same connections,
    ports: list[Port] = field(default_factory=list)
    opened: list[int] = field(default_factory=list)  # by their numbers,
    hears_s: list[float] = field(default_factory=list)  # each from when on

    @property
    def due_s(self) -> float:
        """When the next turn is due."""
        return min([self.step_s, *self.devices_s])


@dataclass(slots=True)
class VectorSources:
    """What planners are told of besides the map."""

    objects: ObjectSource | None  # None: there is no depth camera
    path: PathReport | None = None  # None: nobody plans here


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
        devices: Devices | None = None,
        frames: "Work[Frame] | None" = None,
        plans: "Work[Planned | None] | None" = None,
    ) -> None:
        """What there is for the whole run.

        Args:
            devices: others than the settings name, for a replay that has no bytes of them.
            frames: who looks at frames of the depth camera; None: the app itself, at a tick.
            plans: likewise, who plans paths over the floor.
        """
        self.config, self.ports, self._replayed = config, ports, replayed
        self.devices = devices or devices_on(ports, config)
        self.mapper = Mapper(config)
        self.pilot = Pilot(config, self.mapper)
        self.perception = maybe_perception(config, self.devices, self.mapper, frames)
        self.cleaner = maybe_cleaner(config, self.mapper, self.perception, plans)
        self.vectors = VectorSources(self.perception.objects if self.perception else None)
        self.monitor = Monitor(config)
        self.planners = planners_on(ports, config, session, key)
        self.tiles = TileValues(self.mapper, config.scanner)
        self.image = maybe_image(config, self.planners, session, version)
        self.loop = LoopCounts()
        watched = (self.pilot.control, self.monitor) if config.robot.enable_motors else None
        self.states = StateLog(self.devices, self.mapper, self.planners, watched)
        self.states.maybe_cleaner = self.cleaner
        self.plan = Plan()
        self._pace = LinkPace(1.0 / config.planner.rate_hz)
        self._times = StepTimes(1.0 / config.loop.rate_hz)
        self._scan_stale_s = stale_s(config.scanner.options.spec.period_s)
        self._may_move, self._stops = config.robot.enable_motors, False
        listened = [device.port for device in self.devices.of_scans]
        is_told = config.motion.source == "external"  # the place, over the planner's ports
        listened += [ports.planner, *ports.receivers] if self._may_move or is_told else []
        self._listened = tuple(listened)

    def step(self, now_s: float) -> None:
        """One tick: read, map, write. Never waits."""
        self.loop.ticks += 1
        self._times.begin(now_s, self.plan.step_s)
        attitudes, counted = self.devices.ahrs.step(now_s), self.devices.drive.step(now_s)
        scans, asked = self.devices.scanner.step(now_s), self.planners.requests.newest
        for attitude in attitudes:
            self.mapper.add_attitude(attitude)
            self.monitor.turned(attitude)
        for counts in counted:
            self.mapper.add_counts(counts)
            self.pilot.counted(counts)
            self.monitor.counted(counts)
        for scan in scans:
            self.mapper.add_scan(scan)
            self.monitor.scanned(span_s(scan)[1])
        mapped = self.mapper.settle(now_s) > 0
        if self.perception is not None:
            mapped |= self.perception.step(now_s)
        self.planners.poll(now_s)
        poses = self.planners.external_poses.take_all()
        for pose in poses:
            self.mapper.odometry.add_external(pose)
        has_news = bool(attitudes or counted or scans or mapped or poses)
        has_news = has_news or self.planners.requests.newest is not asked
        is_due = self._pace.is_due(now_s, mapped)
        if has_news or is_due or now_s - self._times.looked_s >= LOOK_S - 1e-6:
            self._look(now_s, is_due)

    def _look(self, now_s: float, is_due: bool) -> None:
        """What all of it comes to now: for the planner, if it is due, the motors and the log."""
        self._times.looked_s = now_s
        window_trusted, told = self.report(now_s)
        self._clean(now_s, told)
        if is_due:
            self.tell(now_s, told, window_trusted)
            self._pace.told(now_s)
            self.pilot.look_ahead(now_s, told, self.planners.requests.newest)
        if self._may_move:
            self._drive(now_s, told)
        self.states.step(now_s, self.loop)

    def _clean(self, now_s: float, told: PoseReport) -> None:
        """Path and place of a machine that cleans floors."""
        cleaner, perception = self.cleaner, self.perception
        if cleaner is None or perception is None:
            return
        blind = "the depth camera tells nothing" if perception.is_stale(now_s) else ""
        doubt = stop_reason(told.health, told.mode, self.devices.scanner.doubt or blind)
        cleaner.step(now_s, doubt, perception.counts["used"], self.pilot.control.maybe_barred)
        self.vectors.path = cleaner.path

    def tell(self, now_s: float, told: PoseReport, trusted: bool) -> None:
        self.pilot.look_around(now_s, told, trusted, self.planners.requests.newest)
        self.tiles.now_s, self.tiles.doubt = now_s, 0 if trusted else doubt(told.health)
        window = self.mapper.window(trusted)
        self.planners.step(now_s, told, window, self.pilot.zone, self.tiles, self.vectors)
        if self.image is not None:
            spread = self.mapper.odometry.covariance
            self.image.publish(
                now_s,
                told,
                self.pilot.zone,
                window,
                planner_heard=self.planners.heard(now_s),
                driven=(self.pilot.control.v_mps, self.pilot.control.w_radps),
                sigma_m=math.sqrt(spread[0, 0] + spread[1, 1]),
                sigma_rad=math.sqrt(spread[2, 2]),
            )

    def _drive(self, now_s: float, told: PoseReport) -> None:
        """Wheel power until the next tick; none while the program ends."""
        if self._stops:
            self.devices.drive.drive(*self.pilot.control.halt("mapod ends"))
            return
        powers = self.pilot.powers(
            now_s,
            told,
            self.planners.requests.newest,
            sight=self.devices.scanner.doubt,
            commander=self.planners.stop_reason,
            motors_off=self.devices.drive.trouble,
        )
        self.devices.drive.drive(*self._let_out(now_s, powers))

    def _let_out(self, now_s: float, powers: Powers) -> Powers:
        """What the monitor lets pass, which stands behind all that works out a motion."""
        let_out = self.monitor.passed(now_s, powers, self.seen(now_s))
        if let_out != powers:
            self.pilot.halted(now_s, self.monitor.why)
        return let_out

    def seen(self, now_s: float) -> Seen:
        """What the monitor looks at beside the records."""
        mapper, request = self.mapper, self.planners.requests.newest
        window, pose = mapper.maps.window, mapper.maybe_pose(now_s)
        return Seen(request, pose, window, mapper.newest_scan_s, mapper.off_start_m)

    def turn(self, now_s: float, readable: Collection[Port] = ()) -> None:
        """Live: do what is due, and take in what has arrived at these ports. Never waits.

        A scan that has become complete, or the attitude that one waited for, does not wait for its
        tick: this is one then.
        """
        if now_s >= self.plan.step_s or not self._hear(now_s, readable):
            self.step(now_s)
            self._times.turns = 0
            self.plan = self._planned()

    def _hear(self, now_s: float, readable: Collection[Port]) -> bool:
        """Whether that was enough: there is nothing in it that a step must follow."""
        plan, heard, is_held_up, has_news = self.plan, 0, False, False
        ahrs, _, scanner = self.devices.of_scans
        self._times.turns += 1
        for k, device in enumerate(self.devices.of_scans):
            is_readable, is_due = device.port in readable, plan.devices_s[k] <= now_s
            heard += is_readable
            if is_readable or is_due:
                is_awaited = device is scanner or (device is ahrs and self.mapper.waits)
                idles = device is ahrs and not (is_awaited or is_due)
                (device.keep if idles else device.hear)(now_s)
                has_news |= is_awaited and device.has_heard
                plan.devices_s[k], plan.hears_s[k] = device.due_s, device.status.hears_s
                is_held_up |= plan.devices_s[k] == -math.inf
        if is_held_up or self._times.turns >= TURNS:
            self.plan = self._planned()
        if heard < len(readable):  # a planner's: to drive, or to stop, waits for nothing
            return False
        return not has_news

    def _planned(self) -> Plan:
        """What the next turn waits for. While anything starts, is held up, or ends: for a tick."""
        times, plan, step_s = self._times, self.plan, self._pace.due_s
        if self._may_move:
            step_s = min(step_s, times.looked_s + LOOK_S)
        devices_s = [device.due_s for device in self.devices.of_scans]
        hears_s = [-math.inf] * len(self._listened)
        if not self.mapper.waits:  # for the next attitude
            hears_s[: len(devices_s)] = [device.status.hears_s for device in self.devices.of_scans]
        is_worn = times.turns >= TURNS
        opened = [] if is_worn else [port.opened for port in self._listened]
        ports = plan.ports if opened == plan.opened else list(self._listened)[: len(opened)]
        is_held_up = self.planners.backlog or -math.inf in devices_s
        if is_worn or self._stops or is_held_up or self.perception is not None:
            step_s = times.stepped_s + times.period_s
            devices_s = [math.inf if due_s == -math.inf else due_s for due_s in devices_s]
        return Plan(step_s, devices_s, ports, opened, hears_s)

    def stop(self) -> None:
        """The program ends: motors get zero, a scanner's login is ended. Step until `settled`."""
        self._stops = True
        self.devices.drive.stop()
        self.devices.scanner.stop()
        self.devices.ahrs.stop()
        if self.devices.depth is not None:
            self.devices.depth.stop()

    @property
    def settled(self) -> bool:
        """After `stop`: all devices have taken what they were told; ports may be closed."""
        return all(device.settled for device in self.devices.every)

    def report(self, now_s: float) -> tuple[bool, PoseReport]:
        """Whether free may be told, and the pose and health for the planner."""
        is_blind = self.perception is not None and self.perception.is_stale(now_s)
        return report(
            self.mapper,
            now_s,
            clocks_locked=self.devices.scanner.clock_locked and self.devices.ahrs.clock_locked,
            overrun=now_s - self._times.overrun_s < OVERRUN_S,
            replayed=self._replayed,
            impaired=self.devices.scanner.is_impaired or is_blind,
            stop_asked=self.devices.drive.emergency_stop,
            drop_ahead=self.pilot.drop_ahead,
            stalled=self.pilot.stalled,
            scan_stale_s=self._scan_stale_s,
        )


def warm_kernels(config: Config) -> None:
    """Run every kernel once on made-up records, so that none is compiled while a robot drives."""
    app = App(config, no_ports(config), session=0)
    level = (1.0, 0.0, 0.0, 0.0)
    for t_s in (0.0, 0.05):
        upright = (0.0, 0.0, 9.81)
        app.mapper.add_attitude(Attitude(t_s, level, (0.0,) * 3, accel_mps2=upright))
        app.mapper.add_counts(WheelCounts(t_s, 0.0, 0.0, 0))
        if config.motion.source == "external":
            app.mapper.odometry.add_external(
                ExternalPose(t_s, 0.0, 0.0, 0.0, 1e-4, 0.0, 1e-4, 1e-4)
            )
    ranges_m = np.full((config.scanner.options.spec.echoes, 3), 1.0)
    app.mapper.add_scan(Scan(0.0, 0.001, -0.1, 0.1, ranges_m, counter=0, arrived_s=0.05))
    app.mapper.settle(0.05)
    for t_s in (0.02, 0.04):
        app.mapper.odometry.add_external(ExternalPose(t_s, 0.0, 0.0, 0.0, 1e-4, 0.0, 1e-4, 1e-4))
    app.mapper.settle(0.05)
    app.mapper.odometry.correct_slip((1.0, 0.0), 0.0)
    app.mapper.attitudes.turn_all(app.mapper.attitudes.orientation.pay_all())
    app.mapper.maps.warm()
    if app.perception is not None:
        app.perception.warm()
    if app.cleaner is not None:
        app.cleaner.warm()
    for now_s in (0.05, 1.0):
        window_trusted, told = app.report(now_s)
        app.tell(now_s, told, window_trusted)
        app.monitor.warm(app.seen(now_s))
        app.pilot.control.drop_ahead((0.1, 0.1), None, app.mapper.maybe_pose(now_s))
    one = np.zeros(1, dtype=np.int64)
    for name in UNITS:
        app.mapper.maybe_values(name, one, one)
    app.tiles.doubt = 0
    app.tiles.maybe_scan()
    for name in ON_ASKING:
        app.tiles.values(name, 0, 0, 1, 0, 1)
