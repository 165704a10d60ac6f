"""What a sweep is to do: recordings and settings, checked before anything is run."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from core.config import ConfigError
from recording.reader import parts_of
from tools.sweep.replays import Drive, ReplayTask, drive_of, task_of
from tools.sweep.rows import Row
from tools.sweep.space import Settings

LATER = re.compile(r"(.+)\.(\d+)\.mcap")  # a file with which a recording goes on


class PlanError(Exception):
    """There is nothing to sweep; the text says why."""


@dataclass(frozen=True, slots=True)
class Planned:
    """One job, as people know it."""

    drive: Drive
    settings: Settings
    task: ReplayTask


def recordings_in(paths: Sequence[Path]) -> list[tuple[Path, str]]:
    """First files of recordings and their names, none twice. Raises PlanError, OSError."""
    found: dict[Path, tuple[Path, str]] = {}
    for path in paths:
        if not path.exists():
            raise PlanError(f"{path}: no such file or folder")
        files = sorted(path.rglob("*.mcap")) if path.is_dir() else [path]
        if not files:
            raise PlanError(f"{path} holds no recording (*.mcap)")
        later = {part.resolve() for file in files if not _is_later(file) for part in _later(file)}
        for file in files:
            if file.resolve() not in later:
                name = file.relative_to(path).as_posix() if path.is_dir() else file.name
                found.setdefault(file.resolve(), (file, name))
    return _told_apart(list(found.values()))


def _is_later(file: Path) -> bool:
    return LATER.fullmatch(file.name) is not None


def _later(file: Path) -> list[Path]:
    return parts_of(file)[1:]


def _told_apart(found: list[tuple[Path, str]]) -> list[tuple[Path, str]]:
    """With names that are none of another's."""
    names = [name for _, name in found]
    return [(path, name if names.count(name) == 1 else str(path)) for path, name in found]


def planned(
    paths: Sequence[Path], all_settings: Sequence[Settings], text: str | None
) -> dict[str, Planned]:
    """All jobs, by key.

    Args:
        text: settings for all recordings, instead of the recorded ones.

    Raises:
        PlanError, RecordingError, ConfigError, OSError: one of them cannot be run.
    """
    drives = [drive_of(path, name, text) for path, name in recordings_in(paths)]
    jobs: dict[str, Planned] = {}
    for settings in all_settings:
        for drive in drives:
            try:
                key, task = task_of(drive, settings)
            except ConfigError as error:
                raise ConfigError(f"--set {error}") from None
            jobs.setdefault(key, Planned(drive, settings, task))
    return jobs


def table_of(jobs: dict[str, Planned], rows: dict[str, Row]) -> list[Row]:
    """One line for each job that has ended, in the order of the plan."""
    return [
        {
            "drive": job.drive.name,
            "recording": job.drive.digest,
            **job.settings,
            **rows[key],
            "code": job.task.code,
            "key": key,
        }
        for key, job in jobs.items()
        if key in rows
    ]
