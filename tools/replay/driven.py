"""The wheels of a drive whose motors mapod moved, for an app with other settings.

Such an app would move them otherwise, and would ask the controller other things than were answered.
So the drive is played once as it was, and what its controller measured and told then is handed to
the other app at the same instants. Whatever that one wants of the motors comes to nothing. For one
replay an app beside it does the same (`followers.py`); this is for many replays of one drive.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from config_file import load_config
from core.config import Config
from core.records import WheelCounts
from hw.device import DeviceStatus
from hw.registry import Drive
from recording.reader import Recording
from tools.replay.player import Player


@dataclass(frozen=True, slots=True)
class Told:
    """What a drive gave with one step of its app."""

    t_s: float  # host clock of the recording
    counts: Sequence[WheelCounts]
    status: DeviceStatus
    trouble: str
    emergency_stop: bool


class ListeningDrive:
    """A drive, and a log of what it gives."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self.log: list[Told] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._drive, name)

    def step(self, now_s: float) -> Sequence[WheelCounts]:
        counts, drive = self._drive.step(now_s), self._drive
        status = replace(drive.status, rejections=[])
        told = Told(now_s, counts, status, drive.trouble, drive.emergency_stop)
        if counts or not self.log or replace(told, t_s=self.log[-1].t_s) != self.log[-1]:
            self.log.append(told)
        return counts


class RecordedDrive:
    """Gives at each step what a drive has given by then."""

    identity, settled, due_s = "as it was recorded", True, math.inf

    def __init__(self, drive: Drive, log: Sequence[Told]) -> None:
        """`drive`: whose place it takes."""
        self.status, self.port = DeviceStatus(drive.status.name), drive.port
        self.trouble, self.emergency_stop = drive.trouble, drive.emergency_stop
        self._log, self._at = log, 0

    @property
    def has_heard(self) -> bool:
        return False

    def hear(self, now_s: float) -> None: ...

    keep = hear

    def step(self, now_s: float) -> Sequence[WheelCounts]:
        counts: list[WheelCounts] = []
        while self._at < len(self._log) and self._log[self._at].t_s <= now_s:
            told = self._log[self._at]
            counts += told.counts
            for name in ("state", "cause", "heard_s", "losses", "rejected"):
                setattr(self.status, name, getattr(told.status, name))
            self.trouble, self.emergency_stop = told.trouble, told.emergency_stop
            self._at += 1
        return counts

    def drive(self, left: float, right: float) -> None: ...

    def stop(self) -> None: ...

    def measured(self) -> dict[str, float]:
        return {}


def drive_log(recording: Recording) -> list[Told]:
    """What the drive of a run gave, by playing the run as it was. Raises RecordingError."""
    found: list[ListeningDrive] = []

    def listening(drive: Drive) -> Drive:
        found.append(ListeningDrive(drive))
        return found[0]

    player = Player(recording, new_drive=listening)
    while not player.done:
        player.step()
    return found[0].log


def needs_log(recording: Recording, config: Config) -> bool:
    """Whether an app with these settings would move motors otherwise than the recorded one."""
    own = load_config(recording.config)
    return own.robot.enable_motors and config != own


def what_if(recording: Recording, config: Config, log: Sequence[Told] | None) -> Player:
    """A replay with other settings. `log`: of `drive_log`, where `needs_log`."""
    if log is None:
        return Player(recording, config)
    return Player(recording, config, new_drive=lambda drive: RecordedDrive(drive, log))
