"""What came of a replay: counts, the map at its end, the digest of what went to the planner."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from app import App
from core.config import Config
from core.mapping.mapper import MapperCounts
from core.records import U8
from hw.device import DeviceStatus
from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN
from tools.replay.moment import Moment, moment_of


class Replay(Protocol):
    """An app on recorded bytes."""

    config: Config
    app: App
    frames: list[bytes]  # what the newest turn wrote to the first planner

    @property
    def begin_s(self) -> float: ...

    @property
    def now_s(self) -> float: ...

    @property
    def next_s(self) -> float: ...

    @property
    def done(self) -> bool: ...

    @property
    def lacks(self) -> str:
        """Why no scan can have been mapped, as far as the recording itself says; or ""."""

    def step(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a replay."""

    counts: MapperCounts
    link_bytes: int
    link_sha256: str
    obstacle: int
    free: int


class Tally:
    """What goes to the first planner, all in all."""

    def __init__(self) -> None:
        self.bytes, self._digest = 0, hashlib.sha256()

    def take(self, frames: list[bytes]) -> None:
        for frame in frames:
            self.bytes += len(frame)
            self._digest.update(frame)

    def outcome(self, app: App, now_s: float) -> Outcome:
        states = moment_of(app, now_s).states
        cells = int((states == OBSTACLE).sum()), int((states == FREE).sum())
        return Outcome(app.mapper.counts, self.bytes, self._digest.hexdigest(), *cells)


def complaints_of(statuses: Mapping[str, DeviceStatus]) -> list[str]:
    """Of devices by name: those that do not run, or have a cause of trouble, in words."""
    return [
        f"the {name} is {status.state}" + (f": {status.cause}" if status.cause else "")
        for name, status in statuses.items()
        if status.cause or status.state != "running"
    ]


def why_nothing_was_mapped(replay: Replay) -> str:
    if replay.lacks:
        return replay.lacks
    app, counts = replay.app, replay.app.mapper.counts
    causes = complaints_of(app.states.statuses)
    if counts.scans_dropped:
        causes.append(f"{counts.scans_dropped} scans came without an attitude or a pose in time")
    if rejected := app.states.statuses["scanner"].rejected:
        causes.append(f"{rejected} of the scanner's frames were damaged")
    return "; ".join(causes) or "no scan came that could be used"


def differences(replay: Replay, other: Replay) -> list[str]:
    """What a replay with other settings has given, against one with those that were recorded."""
    mine, its = replay.app.mapper.counts, other.app.mapper.counts
    counts = [
        f"{name.replace('_', ' ')} {new} (recorded settings: {old})"
        for name in mine.__slots__
        if (new := getattr(mine, name)) != (old := getattr(its, name))
    ]
    lines = ["; ".join(counts) or "the counts are the same"]
    moment = moment_of(replay.app, replay.now_s)
    states, before = moment.states, _states_at(moment_of(other.app, other.now_s), moment)
    changes = []
    for old, was in NAMES.items():
        for new, now in NAMES.items():
            count = int(((before == old) & (states == new)).sum())
            if old != new and count:
                changes.append(f"{count} {now} instead of {was}")
    cells = f"{int((states != before).sum())} of {states.size} cells differ"
    return [*lines, cells + (f": {', '.join(changes)}" if changes else "")]


NAMES = {UNKNOWN: "unknown", FREE: "free", OBSTACLE: "obstacle"}


def _states_at(moment: Moment, places: Moment) -> U8:
    """Its classes at the middles of other cells; what lies outside of its window is unknown."""
    middles = np.arange(len(places.states)) + 0.5
    scale, size = places.cell_m / moment.cell_m, len(moment.states)
    i, j = (
        np.floor((corner + middles) * scale + 1e-9).astype(np.int64) - own
        for corner, own in zip(places.corner, moment.corner, strict=True)
    )
    inside = ((j >= 0) & (j < size))[:, None] & ((i >= 0) & (i < size))[None, :]
    found = moment.states[np.ix_(j % size, i % size)]
    result: U8 = np.where(inside, found, UNKNOWN).astype(np.uint8)
    return result
