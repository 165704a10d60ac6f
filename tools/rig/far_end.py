"""The planner's end of the link as a meter: when the frames of each scan's map arrived.

Frames are matched with scans from this end alone: a POSE frame tells the tick's time and how old
the newest mapped scan was, in steps of 4 ms, and scans are 20 ms apart or more. The first tick that
tells of a scan carries its map; it has arrived when the last of its frames has. The kernel stamps
datagrams, so that it does not matter when this process gets to run.
"""

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.frames import POSE, Frame

AGE_S, AGE_AT, AGE_MOST = 0.004, 20, 255  # in a POSE frame's body: unit, offset, "that or more"
NEAR_S = 0.009  # a mapped scan's instant, as told and as stamped, are no farther apart


@dataclass(frozen=True, slots=True)
class Sent:
    """A scan as its fake stamped it; host monotonic seconds."""

    measured_s: float  # its last beam
    sent_s: float  # its last byte, handed to the system


@dataclass(frozen=True, slots=True)
class Burst:
    """What arrived of one tick of the link; host monotonic seconds."""

    t_ms: int  # of the tick, modulo 2^32
    arrived_s: float  # the last frame
    age: int | None = None  # of the newest mapped scan, in steps of AGE_S

    @property
    def maybe_mapped_s(self) -> float | None:
        """When the newest scan of the map was measured, to some 2 ms; None: long ago, or never."""
        if self.age is None or self.age >= AGE_MOST:
            return None
        ago_ms = (round(self.arrived_s * 1000) - self.t_ms + 2**31) % 2**32 - 2**31
        return self.arrived_s - ago_ms / 1000 - (self.age + 0.5) * AGE_S


@dataclass(frozen=True, slots=True)
class Told:
    """A scan whose map has arrived at the planner's end."""

    scan: Sent
    arrived_s: float

    @property
    def latency_s(self) -> float:
        """From the scan's last byte to the last byte of its map."""
        return self.arrived_s - self.scan.sent_s


class FarEnd(FakePlanner):
    """A planner that keeps when each tick's frames arrived; the newest burst may still grow."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__(seed, None, ack_every=4)
        self.bursts: list[Burst] = []

    def note(self, now_s: float, frame: Frame) -> None:
        super().note(now_s, frame)
        if not self.bursts or self.bursts[-1].t_ms != frame.t_ms:
            self.bursts.append(Burst(frame.t_ms, now_s))
        age = frame.body[AGE_AT] if frame.type == POSE else self.bursts[-1].age
        self.bursts[-1] = replace(self.bursts[-1], arrived_s=now_s, age=age)


def scans_from_file(path: Path) -> list[Sent]:
    rows = (line.split() for line in path.read_text(encoding="ascii").splitlines())
    return [Sent(float(row[1]), float(row[2])) for row in rows if len(row) == 3]


def told_scans(scans: Sequence[Sent], bursts: Sequence[Burst]) -> tuple[list[Told], int]:
    """Each scan that some tick was the first to tell of; and how many ticks fit no scan."""
    instants_s = [scan.measured_s for scan in scans]
    told: list[Told] = []
    newest, strangers = -1, 0
    for burst in bursts:
        mapped_s = burst.maybe_mapped_s
        if mapped_s is None:
            continue
        at = bisect.bisect(instants_s, mapped_s)
        near = min(
            range(max(0, at - 1), min(at + 1, len(scans))),
            key=lambda k: abs(instants_s[k] - mapped_s),
            default=None,
        )
        if near is None or abs(instants_s[near] - mapped_s) > NEAR_S:
            strangers += 1
        elif near > newest:
            newest = near
            told.append(Told(scans[near], burst.arrived_s))
    return told, strangers
