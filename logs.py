"""What goes to the log: its set-up, and the lines about devices, drive requests and ticks."""

import functools
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from core.config import Config
from core.driving.control import DriveControl
from core.driving.monitor import Monitor
from core.mapping.mapper import Mapper
from hw.device import DeviceStatus
from hw.planner_link.receivers import Planners
from hw.runtime.threads import LogWriter
from wiring import Devices

if TYPE_CHECKING:
    from cleaner import Cleaner

COUNTS_S = 1.0  # counters to the log this often
MEASURED_S = 60.0  # and what devices have measured of themselves
WEIGHTS = {"error": 3, "warning": 4, "info": 6, "debug": 7}  # sd-daemon(3)


LEVELS = ("debug", "info", "warning", "error")  # as they rise
COLOURS = {"debug": "", "info": "\x1b[32m", "warning": "\x1b[33m", "error": "\x1b[31m"}
PLAIN = "\x1b[0m"
QUOTED = set(" =\t\r\n\"'")  # a text with one of these stands between quotes

Line = Callable[[str, str, Mapping[str, Any]], str]  # of a level, an event and its keys
Listener = Callable[[str, str, Mapping[str, Any]], None]


class EventLog:
    """Takes events, each with keys, and writes a line for each; none where it is not set up."""

    def __init__(self) -> None:
        self._writer: LogWriter | None = None
        self.also: Listener | None = None  # is told of each line, from whatever thread
        self._levels: tuple[str, ...] = LEVELS
        self._line: Line = json_line

    def set_up(self, writer: LogWriter, level: str, line: Line) -> None:
        """Write to this from now on, nothing below the level."""
        self._writer, self._line = writer, line
        self._levels = LEVELS[LEVELS.index(level) :]

    def debug(self, event: str, **keys: Any) -> None:
        self._tell("debug", event, keys)

    def info(self, event: str, **keys: Any) -> None:
        self._tell("info", event, keys)

    def warning(self, event: str, **keys: Any) -> None:
        """A person may have to act."""
        self._tell("warning", event, keys)

    def close(self) -> None:
        self._writer = None

    def _tell(self, level: str, event: str, keys: dict[str, Any]) -> None:
        """To the first line that goes out again: how many before it did not."""
        if self._writer is None or level not in self._levels:
            return
        if self.also is not None:
            self.also(level, event, keys)
        if dropped := self._writer.take_dropped():
            keys["lines_dropped"] = dropped
        self._writer.write(self._line(level, event, keys) + "\n")


def json_line(level: str, event: str, keys: Mapping[str, Any]) -> str:
    about = {"timestamp": utc_now(), "level": level, "event": event}
    return json.dumps(about | dict(keys), default=str)


def person_line(level: str, event: str, keys: Mapping[str, Any], has_colours: bool = False) -> str:
    """`2026-03-01T12:00:00.000000Z [info   ] map_saved      file=hall.map moving=False`"""
    shown = f"{level:<7}"
    shown = f"{COLOURS[level]}{shown}{PLAIN}" if has_colours else shown
    return f"{utc_now()} [{shown}] {_words(event, keys)}"


def journal_line(level: str, event: str, keys: Mapping[str, Any]) -> str:
    """For systemd's journal, which keeps the time by itself and takes the weight from a prefix."""
    return f"<{WEIGHTS[level]}>{_words(event, keys)}"


def is_journal(fd: int, named: str) -> bool:
    """Whether a descriptor is the journal's stream, `device:inode`, that systemd has named."""
    found = os.fstat(fd)
    return f"{found.st_dev}:{found.st_ino}" == named


def _words(event: str, keys: Mapping[str, Any]) -> str:
    values = " ".join(f"{name}={_shown(value)}" for name, value in sorted(keys.items()))
    return f"{event:<30} {values}".rstrip()


def utc_now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _shown(value: Any) -> str:
    return value if isinstance(value, str) and not set(value) & QUOTED else repr(value)


LOG = EventLog()


def set_up_logging(config: Config, fd: int) -> LogWriter:
    """The log to a descriptor, for a person or as JSON lines; to be closed at the end."""
    writer = LogWriter(fd)
    if is_journal(fd, os.environ.get("JOURNAL_STREAM", "")):
        line = journal_line
    elif config.log.format == "json":
        line = json_line
    else:
        line = functools.partial(person_line, has_colours=os.isatty(fd))
    LOG.set_up(writer, config.log.level, line)
    return writer


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
        maybe_driving: tuple[DriveControl, Monitor] | None,
    ) -> None:
        """`maybe_driving`: of motors that are enabled."""
        self._devices, self._mapper, self._planners = devices.by_section, mapper, planners
        self._maybe_driving = maybe_driving
        self.maybe_cleaner: Cleaner | None = None  # who plans paths over the floor
        self.statuses = {name: device.status for name, device in self._devices.items()}
        self._states = {"": ("", ""), "requests": ("", ""), "poses": ("", ""), "monitor": ("", "")}
        self._states["coverage doubted"] = self._states["attitude"] = ("", "")
        self._begun = (-1, 0, planners.session, False)  # see `_tell_restarts`; -1: not known yet
        self._rejected = [0] * len(planners.links)  # answers, as far as told
        self._counted_s = self._measured_s = float("-inf")

    def step(self, now_s: float, loop: LoopCounts) -> None:
        """Log what is new, and what is due."""
        for device, status in self.statuses.items():
            if self._has_changed(device, status.state, status.cause):
                self._tell_device(device, status)
        requests, poses = self._planners.requests, self._planners.external_poses
        if self._maybe_driving is not None:
            control, monitor = self._maybe_driving
            if self._has_changed("", "", control.blocked_by):
                LOG.info("drive_changed", blocked_by=control.blocked_by)
            if self._has_changed("monitor", "", monitor.why) and monitor.why:
                LOG.warning("drive_halted", because=monitor.why)
        if self._has_changed("requests", "", requests.last_refusal):
            LOG.warning("drive_requests_changed", refused_because=requests.last_refusal)
        if self._has_changed("poses", "", poses.last_refusal):
            LOG.warning("external_poses_changed", refused_because=poses.last_refusal)
        if self._has_changed("attitude", "", self._mapper.doubt):
            tell = LOG.warning if self._mapper.doubt else LOG.info
            tell("attitude_changed", doubted_because=self._mapper.doubt)
        self._tell_cleaner()
        self._tell_restarts()
        if now_s - self._counted_s >= COUNTS_S:
            self._counted_s = now_s
            self._tell_counts(loop)
        if now_s - self._measured_s >= MEASURED_S:
            self._measured_s = now_s
            for name, source in self._devices.items():
                if source.status.state == "running" and (measured := source.measured()):
                    LOG.info("device_measured", device=name, **measured)

    def _tell_cleaner(self) -> None:
        """What a floor cleaner is about now, and why it plans nothing."""
        cleaner = self.maybe_cleaner
        if cleaner is None:
            return
        if self._has_changed("coverage", cleaner.goal, cleaner.why):
            seen_m2, clean_m2 = round(cleaner.seen_m2, 2), round(cleaner.clean_m2, 2)
            tell = LOG.warning if cleaner.goal == "stuck" else LOG.info
            tell(
                "coverage_changed", goal=cleaner.goal, because=cleaner.why, seen_m2=seen_m2,
                clean_m2=clean_m2,
            )  # fmt: skip
        if self._has_changed("coverage doubted", "", cleaner.doubt):
            LOG.info("coverage_doubted", because=cleaner.doubt)

    def _tell_restarts(self) -> None:
        """That the map or the session began anew, and why."""
        mapper, planners = self._mapper, self._planners
        epoch, erased, session, loaded = self._begun
        now = (mapper.maps.window.epoch, mapper.counts.erased, planners.session, mapper.continued)
        if now == self._begun:
            return
        self._begun = now
        if now[1] != erased:
            LOG.warning("map_erased", because=mapper.odometry.broken_by)
        elif now[0] != epoch and epoch >= 0 and now[3] == loaded:
            LOG.warning("map_erased", because="the robot stands on other ground")
        if now[2] != session:
            LOG.warning("session_renewed", because=planners.renewed_because)

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
        (LOG.warning if status.cause else LOG.info)("device_changed", **about)

    def _tell_links(self) -> None:
        """What planners sent that was no frame, and why one gets no map."""
        for k, link in enumerate(self._planners.links):
            if link.counters.answers_rejected != self._rejected[k]:
                self._rejected[k] = link.counters.answers_rejected
                LOG.warning(
                    "answers_rejected",
                    planner=k + 1,
                    total=link.counters.answers_rejected,
                    newest_reason=link.counters.rejected_because,
                )
            if self._has_changed(f"planner {k + 1}", "", link.peer.refusal) and link.peer.refusal:
                LOG.warning("map_refused", planner=k + 1, because=link.peer.refusal)

    def _tell_counts(self, loop: LoopCounts) -> None:
        for device, status in self.statuses.items():
            if status.rejections:
                newest = status.rejections[-1]
                LOG.warning(
                    "frames_rejected",
                    device=device,
                    total=status.rejected,
                    skipped_bytes=status.skipped_bytes,
                    newest_reason=newest.reason,
                )
                status.rejections.clear()
        self._tell_links()
        counts, late_s, requests = self._mapper.counts, sorted(loop.late_s), self._planners.requests
        loop.late_s.clear()
        LOG.debug(
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
            attitudes_doubted=self._mapper.gravity.times,
            **self._planners.counters,
            drives_obeyed=requests.accepted,
            drives_refused=requests.refused.total(),
            poses_outlying=self._mapper.odometry.outliers,
        )
