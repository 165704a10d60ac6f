"""What came of a replay: counts, the map at its end, the digest of what went to the planner."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from app import App
from core.config import Config
from core.mapping.mapper import MapperCounts
from core.records import FREE as IS_FREE
from core.records import OBSTACLE as IS_OBSTACLE
from core.records import U8
from hw.device import DeviceStatus
from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN


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

    def outcome(self, app: App) -> Outcome:
        states, _ = told_window(app)
        cells = int((states == OBSTACLE).sum()), int((states == FREE).sum())
        return Outcome(app.mapper.counts, self.bytes, self._digest.hexdigest(), *cells)


def told_window(app: App) -> tuple[U8, tuple[int, int]]:
    """The obstacle map as the app tells it: (size, size) classes, and the cell of [0, 0].

    Row j, column i from the window's lowest corner; without trust, nothing is free.
    """
    window = app.mapper.maps.window
    grid, cells = window.grid, np.asarray(window.cells)
    states = np.full(cells.shape, UNKNOWN, np.uint8)
    states[cells == IS_OBSTACLE] = OBSTACLE
    if app.tiles.trusted:
        states[cells == IS_FREE] = FREE
    states = np.roll(states, (-grid.corner_j, -grid.corner_i), axis=(0, 1))
    return states, (grid.corner_i, grid.corner_j)


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
    states, corner = told_window(replay.app)
    before = _states_at(other, replay.config.map.cell_m, states.shape, corner)
    changes = []
    for old, was in NAMES.items():
        for new, now in NAMES.items():
            count = int(((before == old) & (states == new)).sum())
            if old != new and count:
                changes.append(f"{count} {now} instead of {was}")
    cells = f"{int((states != before).sum())} of {states.size} cells differ"
    return [*lines, cells + (f": {', '.join(changes)}" if changes else "")]


NAMES = {UNKNOWN: "unknown", FREE: "free", OBSTACLE: "obstacle"}


def _states_at(
    replay: Replay, cell_m: float, shape: tuple[int, ...], corner: tuple[int, int]
) -> U8:
    """Its classes at the middles of other cells; what lies outside of its window is unknown."""
    states, (low_i, low_j) = told_window(replay.app)
    own_m = replay.config.map.cell_m
    j = (
        np.floor((corner[1] + np.arange(shape[0]) + 0.5) * cell_m / own_m + 1e-9).astype(int)
        - low_j
    )
    i = (
        np.floor((corner[0] + np.arange(shape[1]) + 0.5) * cell_m / own_m + 1e-9).astype(int)
        - low_i
    )
    inside = ((j >= 0) & (j < len(states)))[:, None] & ((i >= 0) & (i < len(states)))[None, :]
    found = states[np.ix_(j % len(states), i % len(states))]
    result: U8 = np.where(inside, found, UNKNOWN).astype(np.uint8)
    return result
