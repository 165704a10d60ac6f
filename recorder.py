"""A run that is recorded: stand-ins for its ports and its app, and the writer beside it.

What they see they only read: a recorded run is the run that it would have been. The writer is a
process of its own, started before the loop takes its rights; docs/recording.md has all of it.
"""

import base64
import json
import math
import time
from collections.abc import Callable, Collection, Mapping
from datetime import UTC, datetime
from typing import Any, cast

from app import App, Plan, Ports
from config_file import text_from
from core.config import Config
from core.driving.control import NOT_ENABLED
from core.driving.zone import NOT_TRUSTED
from core.saved.encoding import Arrays, bytes_from_arrays
from hw.device import Port
from logs import LOG
from recording.ports import abilities, recorded
from recording.process import WriterProcess
from recording.records import (
    ASK,
    ASKED,
    FLIGHT,
    FORM,
    PLANNED,
    READABLE,
    RESTORED,
    SEEN,
    STEP,
    STOP,
    TURN,
)
from recording.taker import StateTaker
from recording.tap import AnyTap, Tap

REPORTS_S = 1.0  # the writer's reports are read so often
FLIGHT_AFTER_S = 1.0  # of what follows is in it, too: the robot comes to rest
FLIGHT_PAUSE_S = 10.0  # from one flight that is kept by itself to the next
LAST_S = 3.0  # that the end of the program waits, for the writer to take all and to end


class Troubles:
    """Finds in an app what the last seconds are to be kept for."""

    def __init__(self, app: App) -> None:
        self._pilot, self._requests = app.pilot, app.planners.requests
        self._devices = app.devices.by_section
        self._was_driven = self._was_trusted = False
        self._losses = dict.fromkeys(self._devices, 0)

    def newest(self, now_s: float) -> tuple[str, str] | None:
        """What has just gone wrong: as a word and as a message."""
        found = None
        control, request = self._pilot.control, self._requests.newest
        is_halted = self._was_driven and control.blocked_by not in ("", NOT_ENABLED)
        if is_halted and request is not None and now_s <= request.valid_until_s:
            found = "stop", control.blocked_by
        self._was_driven = bool(control.v_mps or control.w_radps)
        is_trusted = self._pilot.zone is not NOT_TRUSTED
        if self._was_trusted and not is_trusted:
            found = "fault", "the map or the pose is not to be trusted any more"
        self._was_trusted = is_trusted
        for name, device in self._devices.items():
            if device.status.losses != self._losses[name]:
                self._losses[name] = device.status.losses
                found = f"{name}-lost", f"the {name}: {device.status.cause}"
        return found


class RecordedApp:
    """An app, and a record of each call that moves it on."""

    def __init__(self, app: App, tap: AnyTap, look: Callable[[float], None]) -> None:
        """`look` is called after each step, until the app is told to stop."""
        self._app, self._tap, self._look = app, tap, look
        ports = (*app.ports.of_devices, app.ports.planner, *app.ports.receivers)
        self._bits = {port: 1 << number for number, port in enumerate(ports)}
        self._ticks, self._stops = 0, False
        if app.perception is not None:
            from recording.frames import bytes_from_seen  # for who has a depth camera

            app.perception.note = lambda seen: tap.note(tap.clock(), SEEN, 0, bytes_from_seen(seen))
        if app.cleaner is not None:
            from recording.plans import bytes_from_planned  # for who plans over the floor

            app.cleaner.note = lambda planned: tap.note(
                tap.clock(), PLANNED, 0, bytes_from_planned(planned)
            )
        if app.image is not None and app.image.drive is not None:
            self._ask, app.image.drive.ask = app.image.drive.ask, self._asked

    def __getattr__(self, name: str) -> Any:
        return getattr(self._app, name)

    @property
    def plan(self) -> Plan:
        """Asked for before each turn: found sooner than by `__getattr__`."""
        return self._app.plan

    def step(self, now_s: float) -> None:
        self._tap.calls += 1
        self._tap.note(now_s, STEP)
        self._app.step(now_s)
        self._done(now_s)

    def turn(self, now_s: float, readable: Collection[Port] = ()) -> None:
        self._tap.calls += 1
        bits = sum([self._bits[port] for port in readable])
        self._tap.note(now_s, TURN, 0, READABLE.pack(bits))
        self._app.turn(now_s, readable)
        self._done(now_s)

    def stop(self) -> None:
        self._tap.calls += 1
        self._tap.note(self._tap.clock(), STOP)
        self._stops = True
        self._app.stop()

    def _asked(self, now_s: float, who: str, v_mps: float, w_radps: float, valid_s: float) -> str:
        """A drive request by Modbus, between two calls."""
        self._tap.note(now_s, ASK, 0, ASKED.pack(v_mps, w_radps, valid_s) + who.encode())
        return self._ask(now_s, who, v_mps, w_radps, valid_s)

    def _done(self, now_s: float) -> None:
        if self._app.loop.ticks != self._ticks:  # a step
            self._ticks = self._app.loop.ticks
            if not self._stops:
                self._look(now_s)
        self._tap.flush(now_s)


class Recorder:
    """Writes a run down beside the loop: `ports` and `begin` give what is used in place."""

    def __init__(
        self, config: Config, version: str, tap: AnyTap, maybe_process: WriterProcess | None = None
    ) -> None:
        """`maybe_process`: the one that the tap leads to."""
        self.trouble = ""  # why what was to be recorded ended before the run
        self._config, self._version = config, version
        self._tap, self._maybe_process = tap, maybe_process
        self._ports: list[tuple[str, Port]] = []
        self._reported_s = self._flight_s = float("-inf")
        self._troubles: Troubles | None = None
        self._states: StateTaker | None = None

    def ports(self, ports: Ports) -> Ports:
        """Ports that tell of all that happens to these."""
        planners = ports.planner, *ports.receivers
        names = ["scanner", "ahrs", "drive", *["planner"] * len(planners)]
        self._ports = list(zip(names, (*ports.of_devices, *planners), strict=True))
        scanner, ahrs, drive, planner, *others = (
            cast(Port, recorded(port, number, self._tap, self._tap.clock))
            for number, (_, port) in enumerate(self._ports)
        )
        return Ports(scanner, ahrs, drive, planner, tuple(others), ports.depth)

    def begin(self, app: App, has_key: bool, loaded: Arrays | None) -> App:
        """The app, which tells when it is called.

        Args:
            loaded: the map that it goes on from.
        """
        keys = self._config.record
        metadata = self._metadata(app.planners.session, has_key, loaded)
        wanted = {"path": keys.path, "max_mb": keys.max_mb, "file_mb": keys.file_mb}
        wanted |= {"flight": keys.flight, "flight_keep": keys.flight_keep}
        wanted |= {"shape": shape_of(self._config)}
        self._tap.begin({"metadata": metadata, **wanted})
        LOG.also = self._tell_line
        self._troubles = Troubles(app)
        self._states = StateTaker(
            self._tap, app.mapper, app.pilot, app.tiles, app.report, keys.rate_hz
        )
        return cast(App, RecordedApp(app, self._tap, self._look))

    def restored(self, now_s: float) -> None:
        """The loaded map was taken over at this instant."""
        self._tap.note(now_s, RESTORED)

    def flight(self, now_s: float, cause: str, message: str, after_s: float = 0.0) -> None:
        """Have the last seconds kept, and the next ones up to `after_s`."""
        if self._tap.trouble:
            LOG.warning("flight_not_saved", cause=cause, reason=self._tap.trouble)
            return
        why = json.dumps({"cause": cause, "message": message, "after_s": after_s}).encode()
        self._tap.note(now_s, FLIGHT, 0, why)

    def close(self) -> None:
        """The run is over: what is still on its way is written."""
        LOG.also, until_s = None, time.monotonic() + LAST_S
        self._tap.end(LAST_S)
        if self._maybe_process is not None:
            if not self._maybe_process.close(until_s - time.monotonic()):
                LOG.warning("recording_not_finished", waited_s=LAST_S)
            self._read_reports()
            self._maybe_process.let_go()

    def _look(self, now_s: float) -> None:
        """After a step: whether anything is to be kept, and how the writer is."""
        assert self._troubles is not None
        assert self._states is not None
        self._states.look(now_s)
        found = self._troubles.newest(now_s)
        if found and now_s - self._flight_s >= FLIGHT_PAUSE_S:
            self._flight_s = now_s
            self.flight(now_s, *found, FLIGHT_AFTER_S)
        if now_s - self._reported_s >= REPORTS_S:
            self._reported_s = now_s
            self._read_reports()

    def _metadata(self, session: int, has_key: bool, loaded: Arrays | None) -> dict[str, str]:
        started = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        return {
            "form": FORM,
            "version": self._version,
            "config": text_from(self._config),
            "ports": json.dumps([name for name, _ in self._ports]),
            "wires": json.dumps([abilities(port) for _, port in self._ports]),
            "started_utc": started,
            "utc_offset_s": repr(time.time() - time.monotonic()),
            "session": str(session),
            "has_key": "true" if has_key else "false",
            "load_map": base64.b64encode(bytes_from_arrays(loaded)).decode() if loaded else "",
            "recording": f"{started}-{session:08x}",
        }

    def _tell_line(self, level: str, event: str, keys: Mapping[str, Any]) -> None:
        self._tap.line(self._tap.clock(), level, event, keys)

    def _read_reports(self) -> None:
        """What the writer says, for the log; and whether it is still there."""
        for report in self._maybe_process.reports() if self._maybe_process else []:
            event, is_well = report.pop("event"), report.pop("is_well")
            (LOG.info if is_well else LOG.warning)(event, **report)
            if event == "recording_ended" and not is_well:
                self.trouble = self.trouble or str(report["reason"])
        if self._tap.trouble and not self.trouble:
            self.trouble = self._tap.trouble
            LOG.warning("recording_ended", reason=self.trouble)


def shape_of(config: Config) -> dict[str, Any]:
    """What pictures need to know of the robot (`recording.foxglove.RobotShape`)."""
    robot, scanner = config.robot, config.scanner
    angles = scanner.mount_roll_deg, scanner.mount_tilt_deg, scanner.mount_yaw_deg
    return {
        "front_m": robot.front_m,
        "rear_m": robot.rear_m,
        "width_m": robot.width_m,
        "laser_xyz_m": (scanner.mount_x_m, scanner.mount_y_m, scanner.mount_z_m),
        "laser_rpy_rad": tuple(map(math.radians, angles)),
    }


def started_recorder(config: Config, version: str) -> Recorder:
    """Of a run on a robot: with the writer as a process beside it."""
    process = WriterProcess()
    return Recorder(config, version, Tap(process.pipe), process)
