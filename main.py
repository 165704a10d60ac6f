"""mapod: laser scanner, attitude and wheel bytes in; obstacle map out on the planner's wire.

Arguments, logging, wiring, the loop, shutdown. The whole app is `App(config, ports)` with
`step(now_s)`; it reads no clock and opens no file, so that it runs live, in a replay and in a test
alike.
"""

import argparse
import asyncio
import contextlib
import logging
import math
import secrets
import signal
import sys
import time
import tomllib
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
import structlog

from core import drive
from core.config import Config, ConfigError, key_from_bytes, load_config
from core.mapper import Mapper
from core.records import Attitude, PoseReport, Scan, WheelCounts
from core.report import report
from core.summary import robot_in_words
from hw.ax3500_session import Ax3500
from hw.ears import Ears
from hw.lms111_condition import STATUS_BLIND, STATUS_DIRTY, ScannerCondition
from hw.lms111_session import Lms111, condition_of
from hw.mti_session import Mti
from hw.planner_link import PlannerLink
from hw.port import PortUrlError, open_port, parse_url
from hw.real_time import take_real_time
from hw.session import DeviceStatus, NoPort, Port

STATE_LOG_S = 1.0  # counters to the log this often


@dataclass(frozen=True, slots=True)
class Ports:
    """The four wires of the app."""

    scanner: Port
    ahrs: Port
    drive: Port
    planner: Port

    def close(self) -> None:
        """Let go of all of them."""
        for port in (self.scanner, self.ahrs, self.drive, self.planner):
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
        self.control = drive.DriveControl(config, self.mapper.obstacles, self.mapper.elevation)
        self._tick_s = 1.0 / config.planner.rate_hz
        self.link = self._new_link(session, key)
        self.log = structlog.get_logger()
        self._linked_s = self._logged_s = self._overrun_s = float("-inf")
        self.ticks = self.slots_missed = 0
        self._drop_ahead = False
        self._states = {"": ("", ""), "requests": ("", "")}

    def _new_link(self, session: int, key: bytes | None) -> PlannerLink:
        config, planner = self.config, self.config.planner
        may_move = config.robot.enable_motors
        return PlannerLink(
            self.ports.planner,
            size=config.obstacle.window_cells,
            cell_mm=round(config.map.cell_m * 1000),
            session=session,
            tick_s=self._tick_s,
            line_baud=parse_url(planner.port).baud,
            key=key,
            stale_ms=max(150, math.ceil(3000 * self._tick_s)),
            drive_refusal=drive.link_refusal(planner.port, key is not None, may_move),
        )

    @property
    def _devices(self) -> dict[str, DeviceStatus]:
        """By the section of mapod.toml that describes them."""
        return {
            "scanner": self.scanner.status,
            "ahrs": self.ahrs.status,
            "drive": self.drive.status,
        }

    def step(self, now_s: float) -> None:
        """One tick: read, map, write. Never waits."""
        self.ticks += 1
        for attitude in self.ahrs.step(now_s):
            self.mapper.add_attitude(attitude)
        for counts in self.drive.step(now_s):
            self.mapper.add_counts(counts)
        for scan in self.scanner.step(now_s):
            self.mapper.add_scan(scan)
        mapped = self.mapper.settle(now_s) > 0
        since_s = now_s - self._linked_s
        self.link.poll(now_s)
        window_trusted, told = self.report(now_s)
        if since_s >= self._tick_s - 1e-6 or (mapped and since_s >= self._tick_s / 2):
            self.link.step(now_s, told, self.mapper.window(window_trusted))
            self._linked_s = now_s
        self._drive(now_s, told)
        self._log(now_s)

    def _drive(self, now_s: float, told: PoseReport) -> None:
        """Wheel power until the next tick: zero unless all is known to be well."""
        pose, request = self.mapper.maybe_pose(now_s), self.link.requests.newest
        vouched, moves = self.mapper.counts.erased == 0, (told.v_mps, told.w_radps)
        if self._linked_s == now_s:
            self._drop_ahead = self.control.drop_ahead(moves, request, pose, vouched)
        if not self.config.robot.enable_motors:
            self.drive.drive(*self.control.halt(drive.NOT_ENABLED))
            return
        dirt, others = self._condition.contamination, (self.link.doubt,)
        doubt = drive.doubt(told.health, told.mode, dirt, others)
        motors_off = self.drive.controller.trouble
        powers = self.control.step(now_s, request, doubt, pose, vouched, motors_off, moves)
        self.drive.drive(*powers)

    def hear(self, now_s: float) -> None:
        """Between ticks: take in what has arrived from the devices. Never waits."""
        for device in (self.ahrs, self.drive, self.scanner):
            device.hear(now_s)

    def stop(self) -> None:
        """Before the ports are closed: motors get zero, a scanner's login is ended."""
        self.drive.stop()
        self.scanner.stop()

    def note_missed(self, now_s: float, slots: int) -> None:
        """The loop came late and skipped slots."""
        self.slots_missed += slots
        self._overrun_s = now_s

    @property
    def _condition(self) -> ScannerCondition:
        return condition_of(self.scanner.stream)

    def report(self, now_s: float) -> tuple[bool, PoseReport]:
        """Whether free may be told, and the pose and health for the planner."""
        return report(
            self.mapper,
            now_s,
            clocks_locked=self.scanner.clock_locked and self.ahrs.clock_locked,
            overrun=now_s - self._overrun_s < 1.0,
            replayed=self._replayed,
            contaminated=is_dirty(self._condition),
            stop_asked=bool(self.drive.controller.emergency_stop),
            drop_ahead=self._drop_ahead,
        )

    def _has_changed(self, name: str, state: str, cause: str) -> bool:
        before, self._states[name] = self._states.get(name), (state, cause)
        return before != (state, cause)

    def _log(self, now_s: float) -> None:
        """A line for each change of a device, or of what may drive; counters once a second."""
        for device, status in self._devices.items():
            if self._has_changed(device, status.state, status.cause):
                tell = self.log.warning if status.cause else self.log.info
                tell("device_changed", device=device, state=status.state, cause=status.cause)
        requests = self.link.requests
        if self.config.robot.enable_motors and self._has_changed("", "", self.control.blocked_by):
            self.log.info("drive_changed", blocked_by=self.control.blocked_by)
        if self._has_changed("requests", "", requests.last_refusal):
            self.log.warning("drive_requests_changed", refused_because=requests.last_refusal)
        if now_s - self._logged_s < STATE_LOG_S:
            return
        self._logged_s = now_s
        for device, status in self._devices.items():
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
        counts = self.mapper.counts
        self.log.debug(
            "ticks_counted",
            ticks=self.ticks,
            slots_missed=self.slots_missed,
            scans_added=counts.scans_added,
            scans_dropped=counts.scans_dropped,
            scans_early=counts.scans_early,
            maps_erased=counts.erased,
            frames_sent=self.link.frames_sent,
            drives_obeyed=requests.accepted,
            drives_refused=requests.refused.total(),
        )


def is_dirty(condition: ScannerCondition) -> bool:
    """Whether the scanner's window is contaminated, be it as a warning."""
    by_status = condition.device_status[0] | condition.device_status[1]
    return bool(condition.contamination or by_status & (STATUS_DIRTY | STATUS_BLIND))


def _baud(url: str) -> int:
    """Bits per second of a serial line; 115200, the AHRS's own, where there is none (tcp)."""
    return parse_url(url).baud or 115_200


def read_key(path: str) -> bytes | None:
    """The planner link's key: 32 bytes, or 64 hex digits; None for "".

    Raises:
        ConfigError: the file can't be read, or holds no key.
    """
    if not path:
        return None
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"planner.key_file: can't read {path!r}: {error.strerror}") from None
    return key_from_bytes(content, path)


def open_ports(config: Config) -> Ports:
    """The four ports, none of them connected yet.

    Raises:
        ConfigError: a URL that names no port.
    """
    urls = {
        "scanner": config.scanner.port,
        "ahrs": config.ahrs.port,
        "drive": config.drive.port,
        "planner": config.planner.port,
    }
    ports = {}
    for section, url in urls.items():
        try:
            ports[section] = open_port(url)
        except PortUrlError as error:
            raise ConfigError(f"{section}.port: {error}") from None
    return Ports(**ports)


def set_up_logging(config: Config) -> None:
    """structlog to stderr, for a person or as JSON lines."""
    renderer = (
        structlog.processors.JSONRenderer()
        if config.log.format == "json"
        else structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(
            logging.getLevelNamesMapping()[config.log.level.upper()]
        ),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )


async def keep_pace(app: App, period_s: float, stop: asyncio.Event) -> None:
    """Step the app at a fixed rate until told to stop; missed slots are skipped and counted.

    Between ticks it hears what arrives, so that stamps are true to the instant of reading.
    """
    due_s, ports = time.monotonic(), app.ports
    ears = Ears(
        asyncio.get_running_loop(),
        (ports.scanner, ports.ahrs, ports.drive),
        lambda: app.hear(time.monotonic()),
    )
    while not stop.is_set():
        await asyncio.sleep(max(0.0, due_s - time.monotonic()))
        app.step(time.monotonic())
        ears.after_tick()
        now_s = time.monotonic()
        slots = max(1, math.ceil((now_s - due_s) / period_s))
        if slots > 1:
            app.note_missed(now_s, slots - 1)
        due_s += period_s * slots
    ears.close()


async def serve(config: Config, ports: Ports, key: bytes | None) -> None:
    """Run the app until SIGINT or SIGTERM."""
    log = structlog.get_logger()
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    warm_kernels(config)
    app = App(config, ports, session=secrets.randbits(32), key=key)
    locked, fifo = take_real_time()
    log.info("real_time_taken", memory_locked=locked, sched_fifo=fifo)
    log.info("app_started", version=version(), planner=config.planner.port)
    try:
        await keep_pace(app, 1.0 / config.loop.rate_hz, stop)
    finally:
        app.stop()
    log.info("app_stopped", ticks=app.ticks, slots_missed=app.slots_missed)


def warm_kernels(config: Config) -> None:
    """Run every kernel once on made-up records, so that none is compiled while a robot drives."""
    nowhere = NoPort()
    app = App(config, Ports(nowhere, nowhere, nowhere, nowhere), session=0)
    level = (1.0, 0.0, 0.0, 0.0)
    for t_s in (0.0, 0.05):
        app.mapper.add_attitude(Attitude(t_s, level, (0.0, 0.0, 0.0)))
        app.mapper.add_counts(WheelCounts(t_s, 0.0, 0.0, 0))
    ranges_m = np.full((2 if config.scanner.echo == "both" else 1, 3), 1.0)
    app.mapper.add_scan(Scan(0.0, 0.001, -0.1, 0.1, ranges_m, counter=0, arrived_s=0.05))
    app.mapper.settle(0.05)
    for now_s in (0.05, 1.0):
        window_trusted, told = app.report(now_s)
        app.link.step(now_s, told, app.mapper.window(window_trusted))
        app.control.drop_ahead((0.1, 0.1), None, app.mapper.maybe_pose(now_s), True)


def version() -> str:
    """The version in pyproject.toml: of the checkout, or as installed from it."""
    path = Path(__file__).parent / "pyproject.toml"
    if not path.exists():
        return metadata.version("mapod")
    return str(tomllib.loads(path.read_text(encoding="utf-8"))["project"]["version"])


def run(arguments: list[str] | None = None) -> int:
    """The command line; gives the exit status."""
    parser = argparse.ArgumentParser(prog="main.py", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--config", default="mapod.toml", help="settings (default: mapod.toml)")
    parser.add_argument("--check", action="store_true", help="check the settings, tell, and end")
    parser.add_argument("--warm", action="store_true", help="compile the kernels, and end")
    parser.add_argument("--version", action="version", version=f"mapod {version()}")
    options = parser.parse_args(arguments)
    try:
        config = load_config(Path(options.config).read_text(encoding="utf-8"))
        key = read_key(config.planner.key_file)
        ports = open_ports(config)
    except (ConfigError, OSError, UnicodeDecodeError) as error:
        print(f"{options.config}: {error}", file=sys.stderr)
        return 2
    with contextlib.closing(ports):
        if options.check:
            print(robot_in_words(config, parse_url(config.planner.port).baud))
        elif options.warm:
            warm_kernels(config)
        else:
            set_up_logging(config)
            asyncio.run(serve(config, ports, key))
    return 0


if __name__ == "__main__":
    sys.exit(run())
