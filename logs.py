"""What goes to the log: its set-up, and the lines about devices, drive requests and ticks."""

import logging
import os
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass, field
from typing import Any

import structlog

from core.config import Config
from core.driving.control import DriveControl
from core.mapping.mapper import Mapper
from hw.device import DeviceStatus
from hw.planner_link.receivers import Planners
from hw.runtime.threads import LogWriter
from wiring import Devices

COUNTS_S = 1.0  # counters to the log this often
MEASURED_S = 60.0  # and what devices have measured of themselves
WEIGHTS = {"error": 3, "warning": 4, "info": 6, "debug": 7}  # sd-daemon(3)


def set_up_logging(config: Config, fd: int) -> LogWriter:
    """structlog to a descriptor, for a person or as JSON lines; to be closed at the end.

    systemd's journal has the time of a line by itself, and takes its weight from a prefix.
    """
    writer, in_journal = LogWriter(fd), is_journal(fd, os.environ.get("JOURNAL_STREAM", ""))

    def add_dropped(logger: Any, name: str, event: MutableMapping[str, Any]) -> Mapping[str, Any]:
        """To the first line that goes out again: how many before it did not."""
        if dropped := writer.take_dropped():
            event["lines_dropped"] = dropped
        return event

    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            *([] if in_journal else [structlog.processors.TimeStamper(fmt="iso", utc=True)]),
            add_dropped,
            structlog.processors.JSONRenderer()
            if config.log.format == "json"
            else structlog.dev.ConsoleRenderer(colors=os.isatty(fd)),
            *([add_weight] if in_journal else []),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(
            logging.getLevelNamesMapping()[config.log.level.upper()]
        ),
        logger_factory=structlog.WriteLoggerFactory(writer),  # type: ignore[arg-type]
    )
    return writer


def is_journal(fd: int, named: str) -> bool:
    """Whether a descriptor is the journal's stream, `device:inode`, that systemd has named."""
    found = os.fstat(fd)
    return f"{found.st_dev}:{found.st_ino}" == named


def add_weight(logger: Any, name: str, line: Any) -> str:
    """The line with its syslog weight before it, as `journalctl --priority` knows it."""
    return f"<{WEIGHTS.get(name, 6)}>{line}"


@dataclass(slots=True)
class LoopCounts:
    """How the loop kept its pace."""

    ticks: int = 0
    slots_missed: int = 0
    late_s: list[float] = field(default_factory=list)  # of the ticks since the last log


class StateLog:
    """A line for each change of a device, or of what may drive; counters once a second."""

    def __init__(
        self,
        devices: Devices,
        mapper: Mapper,
        planners: Planners,
        maybe_control: DriveControl | None,
    ) -> None:
        """`maybe_control`: of motors that are enabled."""
        self._devices, self._mapper, self._planners = devices.by_section, mapper, planners
        self._maybe_control = maybe_control
        self.statuses = {name: device.status for name, device in self._devices.items()}
        self._log = structlog.get_logger()
        self._states = {"": ("", ""), "requests": ("", ""), "poses": ("", "")}
        self._counted_s = self._measured_s = float("-inf")

    def step(self, now_s: float, loop: LoopCounts) -> None:
        """Log what is new, and what is due."""
        for device, status in self.statuses.items():
            if self._has_changed(device, status.state, status.cause):
                self._tell_device(device, status)
        requests, poses = self._planners.requests, self._planners.external_poses
        control = self._maybe_control
        if control is not None and self._has_changed("", "", control.blocked_by):
            self._log.info("drive_changed", blocked_by=control.blocked_by)
        if self._has_changed("requests", "", requests.last_refusal):
            self._log.warning("drive_requests_changed", refused_because=requests.last_refusal)
        if self._has_changed("poses", "", poses.last_refusal):
            self._log.warning("external_poses_changed", refused_because=poses.last_refusal)
        if now_s - self._counted_s >= COUNTS_S:
            self._counted_s = now_s
            self._tell_counts(loop)
        if now_s - self._measured_s >= MEASURED_S:
            self._measured_s = now_s
            for name, source in self._devices.items():
                if source.status.state == "running" and (measured := source.measured()):
                    self._log.info("device_measured", device=name, **measured)

    def describe(self, now_s: float) -> str:
        """What runs and what does not, for who supervises the app: `docs/service.md` has its form.

        `scanner running; ahrs running; drive starting: no answer; planner heard`
        """
        states: dict[str, tuple[str, str]] = {
            name: (status.state, status.cause) for name, status in self.statuses.items()
        }
        for number, link in enumerate(self._planners.links, 1):
            cause, state = link.wire.port.cause, "told" if link.frames_sent else "open"
            states["planner" if number == 1 else f"planner {number}"] = (
                ("closed", cause) if cause else ("heard" if link.heard(now_s) else state, "")
            )
        return "; ".join(
            f"{name} {state}" + (f": {cause.replace(';', ',')}" if cause else "")
            for name, (state, cause) in states.items()
        )

    def _has_changed(self, name: str, state: str, cause: str) -> bool:
        new = (state, cause)
        if self._states.get(name) == new:
            return False
        self._states[name] = new
        return True

    def _tell_device(self, name: str, status: DeviceStatus) -> None:
        about = {"device": name, "state": status.state, "cause": status.cause}
        if status.session is not None:
            about["session"] = status.session.value
        if status.state == "running" and name in self._devices and self._devices[name].identity:
            about["identity"] = self._devices[name].identity
        (self._log.warning if status.cause else self._log.info)("device_changed", **about)

    def _tell_counts(self, loop: LoopCounts) -> None:
        for device, status in self.statuses.items():
            if status.rejections:
                newest = status.rejections[-1]
                self._log.warning(
                    "frames_rejected",
                    device=device,
                    total=status.rejected,
                    skipped_bytes=status.skipped_bytes,
                    newest_reason=newest.reason,
                )
                status.rejections.clear()
        counts, late_s, requests = self._mapper.counts, sorted(loop.late_s), self._planners.requests
        loop.late_s.clear()
        self._log.debug(
            "ticks_counted",
            ticks=loop.ticks,
            slots_missed=loop.slots_missed,
            latest_s=round(late_s[-1], 6) if late_s else None,
            late_p50_s=round(late_s[len(late_s) // 2], 6) if late_s else None,
            scans_added=counts.scans_added,
            scans_dropped=counts.scans_dropped,
            scans_early=counts.scans_early,
            scans_tilted=counts.scans_tilted,
            maps_erased=counts.erased,
            **self._planners.counters,
            drives_obeyed=requests.accepted,
            drives_refused=requests.refused.total(),
            poses_outlying=self._mapper.odometry.positioning.outliers,
        )
