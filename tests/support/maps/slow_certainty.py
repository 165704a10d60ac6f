"""Method `certainty` a second time, from docs/certainty.md: plain Python, cells in dicts, no haste.

It shares no code with `core/mapping/certainty`, but for the settings and the codes of causes.
"""

import math
from dataclasses import dataclass, field

from core.mapping import causes

Cell = tuple[int, int]
Reading = tuple[float, float, float, float]  # x, y, z, limit


@dataclass
class SlowSettings:
    """Those of the section, and the bounds of floor."""

    gain: int = 1
    most: int = 6
    free_from: int = 3
    cas: bool = True
    cas_certainty: int = 2
    cas_height_m: float = 0.08
    h_pos_m: float = 0.1
    h_neg_m: float = -0.1
    robot_m: float = 1.0


def weighted_median(pairs: list[tuple[float, int]]) -> float:
    """The smallest height up to which the weights reach half of all."""
    half = sum(weight for _, weight in pairs) / 2
    reached = 0
    for height, weight in sorted(pairs):
        reached += weight
        if reached >= half:
            return height
    raise ValueError("of none there is no median")


@dataclass
class SlowCertainty:
    """Elevation and certainty of an endless map, on level ground at height 0."""

    settings: SlowSettings
    cell_m: float
    heights: dict[Cell, float] = field(default_factory=dict)
    lows: dict[Cell, float] = field(default_factory=dict)
    certainties: dict[Cell, int] = field(default_factory=dict)
    reset: set[Cell] = field(default_factory=set)

    def add(self, scan: list[Reading]) -> None:
        """(9) and (10) for each cell that a scan met."""
        passes: dict[Cell, list[Reading]] = {}
        for reading in scan:
            if reading[2] <= self.settings.robot_m:
                at = math.floor(reading[0] / self.cell_m), math.floor(reading[1] / self.cell_m)
                passes.setdefault(at, []).append(reading)
        for at, readings in passes.items():
            self.update(at, readings)

    def update(self, at: Cell, readings: list[Reading]) -> None:
        _, _, z, limit = max(readings, key=lambda reading: reading[2])
        more = self.settings.gain * sum(reading[2] >= z - limit for reading in readings)
        self.reset.discard(at)
        if at in self.heights and abs(z - self.heights[at]) > limit:
            del self.heights[at], self.lows[at], self.certainties[at]
            self.reset.add(at)
            return
        self.certainties[at] = min(self.certainties.get(at, 0) + more, self.settings.most)
        self.heights[at] = max(z, self.heights.get(at, z))
        low = min(reading[2] for reading in readings)
        self.lows[at] = min(low, self.lows.get(at, low))

    def near(self, at: Cell) -> list[Cell]:
        steps = (-1, 0, 1)
        around = [(at[0] + di, at[1] + dj) for dj in steps for di in steps if (di, dj) != (0, 0)]
        return [other for other in around if other in self.heights]

    def median(self, cells: list[Cell]) -> float:
        return weighted_median([(self.heights[c], self.certainties[c]) for c in cells])

    def corrupt(self, at: Cell) -> bool:
        settings, near = self.settings, self.near(at)
        if not settings.cas or self.certainties.get(at, 0) > settings.cas_certainty or not near:
            return False
        if at not in self.heights or abs(self.heights[at] - self.median(near)) <= (
            settings.cas_height_m
        ):
            return False
        return not any(
            self.certainties[other] > settings.cas_certainty
            and abs(self.heights[other] - self.heights[at]) <= settings.cas_height_m
            for other in near
        )

    def filled(self, at: Cell) -> float:
        """(11)"""
        if at in self.heights and not self.corrupt(at):
            return self.heights[at]
        sound = [other for other in self.near(at) if not self.corrupt(other)]
        return self.median(sound) if len(sound) >= 3 else math.nan

    def cause(self, at: Cell) -> int:
        settings = self.settings
        if at not in self.heights:
            return causes.RESET if at in self.reset else causes.UNSEEN
        if self.corrupt(at):
            return causes.CORRUPT
        height = self.heights[at]
        if height >= settings.h_pos_m or self.lows[at] <= settings.h_neg_m:
            return causes.TOO_HIGH if height >= settings.h_pos_m else causes.TOO_LOW
        sound = [self.lows[other] for other in self.near(at) if not self.corrupt(other)]
        if sound and height - min(sound) >= min(settings.h_pos_m, -settings.h_neg_m):
            return causes.BRINK
        if self.certainties[at] < settings.free_from:
            return causes.UNCERTAIN
        if len(sound) < 6:
            return causes.EDGE
        around = [other for other in self.near(at) if not self.corrupt(other)]
        high_m = max(self.heights[other] for other in around)
        step_m = min(settings.h_pos_m, -settings.h_neg_m)
        beyond = high_m >= settings.h_pos_m or min(sound) <= settings.h_neg_m
        return causes.BESIDE if beyond or high_m - self.lows[at] >= step_m else causes.FLOOR


def groups_left(ranges: list[float], gap_m: float, least: int) -> list[float]:
    """Range clustering."""
    groups: list[list[int]] = []
    for k, r in enumerate(ranges):
        joins = k > 0 and abs(r - ranges[k - 1]) <= gap_m
        if joins:
            groups[-1].append(k)
        else:
            groups.append([k])
    large = {k for group in groups if len(group) >= least for k in group}
    return [r if k in large else math.nan for k, r in enumerate(ranges)]


def supported(ranges: list[float], others: list[tuple[list[float], float]], near_m: float) -> str:
    """(12): "1" for each reading that another scan supports, "0" for each that none does.

    others: ranges, and by how many beams they lie ahead.
    """
    told = ""
    for k, r in enumerate(ranges):
        beams = [(o, math.floor(k + shift + 0.5) + d) for o, shift in others for d in (-1, 0, 1)]
        same = [o[j] for o, j in beams if 0 <= j < len(o)]
        told += "1" if any(abs(other - r) <= near_m for other in same) else "0"
    return told


def shadows_left(ranges: list[float], step: float, least: float, window: int) -> list[float]:
    """The shadow filter: angles between the beam and the line from its reading to another."""
    gone = set()
    for i, near in enumerate(ranges):
        here = [j for j in range(len(ranges)) if abs(j - i) <= window]
        for j in here:
            if j == i or not (near > 0.0 and ranges[j] > 0.0):
                continue
            apart = (j - i) * step
            line = ranges[j] * math.cos(apart) - near, ranges[j] * math.sin(apart)
            off = math.acos(max(-1.0, min(1.0, -line[0] / math.hypot(*line))))
            if off < least or off > math.pi - least:
                gone |= {k for k in here if ranges[k] > near}
    return [0.0 if k in gone else r for k, r in enumerate(ranges)]
