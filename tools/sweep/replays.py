"""One recording with one set of settings, replayed and scored: a row."""

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path

from app import warm_kernels
from config_file import load_config, with_changes
from core.config import Config, ConfigError, table_from
from recording.reader import Recording, parts_of
from recording.records import RecordingError
from tools.replay.outcome import why_nothing_was_mapped
from tools.replay.player import Player
from tools.replay.sources import drive_in
from tools.sweep.code import code_digest, digest_of
from tools.sweep.look import maybe_look
from tools.sweep.rows import FAILED, Row
from tools.sweep.scores import LOOK_HZ, NAMES, Tally
from tools.sweep.space import Settings, sections_of
from tools.sweep.truth import DriveTruth, TruthError, maybe_truth_in

DECIDES = (
    "recording", "tools/replay", "tools/floor.py", "tools/sweep/look.py", "tools/sweep/replays.py",
    "tools/sweep/scores.py", "tools/sweep/truth.py",
)  # fmt: skip
OTHER_CODE = "the worker has other code of mapod: give all of them the same"
CHANGED = "the recording is not the one that was named: it changed, or the worker sees another one"
_digests: dict[tuple[Path, int, int], str] = {}  # by path, size and time of change


@dataclass(frozen=True, slots=True)
class Drive:
    """A recording, as it is named in rows."""

    name: str
    path: str
    digest: str
    text: str  # of the settings with which it is played, but for what is tried


@dataclass(frozen=True, slots=True)
class ReplayTask:
    """What a worker is told."""

    path: str
    digest: str  # of the recording
    code: str  # digest
    text: str
    settings: Settings


def drive_of(path: Path, name: str, text: str | None) -> Drive:
    """Raises RecordingError, ConfigError, OSError: it cannot be played."""
    recording = drive_in(path)
    try:
        load_config(used := recording.config if text is None else text)
    except ConfigError as error:
        raise ConfigError(f"{path}: its settings are none of this version: {error}") from None
    return Drive(name, str(path.resolve()), recording_digest(path), used)


def recording_digest(path: Path) -> str:
    """Of all its files' bytes."""
    parts = []
    for part in parts_of(path):
        about = part.stat()
        known = part.resolve(), about.st_size, about.st_mtime_ns
        if known not in _digests:
            with part.open("rb") as file:
                _digests[known] = hashlib.file_digest(file, "blake2b").hexdigest()
        parts.append(_digests[known])
    return digest_of(*parts)


def code() -> str:
    return code_digest(*DECIDES)


def task_of(drive: Drive, settings: Settings) -> tuple[str, ReplayTask]:
    """The job and its key, a digest of all that decides it. Raises ConfigError."""
    task = ReplayTask(drive.path, drive.digest, code(), drive.text, settings)
    table = json.dumps(table_from(config_of(task)), sort_keys=True)
    return digest_of(task.digest, table, task.code), task


def config_of(task: ReplayTask) -> Config:
    """Raises ConfigError."""
    config, sections = load_config(task.text), sections_of(task.settings)
    known = table_from(config)
    for name in sections:
        if name not in known:
            raise ConfigError(f"{name}: unknown section; allowed are {', '.join(known)}")
    if "drive" in sections and config.robot.enable_motors:
        raise ConfigError("drive: has no effect on a drive whose motors mapod moved")
    return with_changes(config, **sections)


def row_of(task: ReplayTask) -> Row:
    """Scores, or why there are none."""
    try:
        if task.code != code():
            return {FAILED: OTHER_CODE}
        path = Path(task.path)
        if recording_digest(path) != task.digest:
            return {FAILED: CHANGED}
        return scored(path, config_of(task))
    except (RecordingError, TruthError, ConfigError) as error:
        return {FAILED: str(error)}
    except OSError as error:
        return {FAILED: f"{task.path}: {error.strerror}"}


def scored(path: Path, config: Config) -> Row:
    """Raises RecordingError, TruthError, OSError."""
    recording = Recording(path)
    truth = maybe_truth_in(recording.parts)
    player = Player(recording, config)
    app, tally = player.app, Tally(config.map.cell_m, None if truth is None else DriveTruth(truth))
    warm_kernels(config)
    begun_s, scoring_s, due_s = time.process_time(), 0.0, player.begin_s
    epoch = app.mapper.maps.window.epoch
    while not player.done:
        player.step()
        if player.now_s < due_s:
            continue
        due_s = player.now_s + 1.0 / LOOK_HZ
        looked_s = time.process_time()
        if app.mapper.maps.window.epoch != epoch:
            epoch = app.mapper.maps.window.epoch
            tally.memory.end()
        look = maybe_look(app, player.now_s)
        if look is not None:
            tally.take(look)
        scoring_s += time.process_time() - looked_s
    cpu_s = time.process_time() - begun_s - scoring_s - player.lead_cpu_s
    counts = app.mapper.counts
    if not counts.scans_added:
        return {FAILED: f"no scan was mapped: {why_nothing_was_mapped(player)}"}
    scores = dict.fromkeys(NAMES) | tally.scores()
    scores["scans_lost"] = float(counts.scans_dropped + counts.scans_tilted)
    scores["cpu_ms_per_scan"] = cpu_s / counts.scans_added * 1e3
    facts = {"recorded_s": player.now_s - player.begin_s, "scans": counts.scans_added}
    return facts | {"cpu_s": cpu_s, "is_cut": recording.is_cut, **scores}
