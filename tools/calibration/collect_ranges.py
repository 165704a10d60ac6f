"""What a scanner reads straight ahead of targets that a person puts there, one after the other.

Opens the scanner's port and no other, so that nothing can move. Only scans that begin after the
person has said that the target stands count. Refuses with the device's own cause where it does not
run, and where nothing is seen straight ahead.
"""

import contextlib
import math
import os
import select
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from core.config import Config
from core.records import F64, Scan
from hw.device import NoPort, Port
from hw.ports.wires import open_port
from tools.calibration.collect_floor import READY_S, STEP_S, RefusedError
from tools.calibration.ranges import Target, target_of
from tools.replay.outcome import complaints_of
from wiring import Ports, devices_on

SILENT_S = 15.0  # without a scan, once it ran; a new start fits in
SETTLE_S = 0.5  # after the person has said so: a hand goes away
MOST_EMPTY = 0.2  # of the scans of a target may show nothing straight ahead


@dataclass(frozen=True, slots=True)
class Plan:
    """Where the targets are to stand, and what of the scans counts."""

    distances_m: tuple[float, ...]
    scans: int  # of each target
    within_rad: float  # to either side of straight ahead


class Helper(Protocol):
    """Who puts the targets there."""

    def ask(self, distance_m: float) -> None: ...

    def has_placed(self) -> bool:
        """Never waits. Raises RefusedError: nobody is there."""


class Vouched:
    """The targets stand where they are to be, as somebody has said beforehand."""

    def ask(self, distance_m: float) -> None:
        pass

    def has_placed(self) -> bool:
        return True


class Person:
    """At a terminal: presses return when the target stands."""

    def __init__(self, terminal: int, tell: Callable[[str], None]) -> None:
        """terminal: a file descriptor to read from."""
        self._terminal, self._tell = terminal, tell

    def ask(self, distance_m: float) -> None:
        self._tell(f"put the target {distance_m:g} m ahead of the lens, and press return")

    def has_placed(self) -> bool:
        while select.select([self._terminal], [], [], 0.0)[0]:
            pressed = os.read(self._terminal, 1)
            if not pressed:
                raise RefusedError("nobody is there to press return: --yes vouches for the targets")
            if pressed == b"\n":
                return True
        return False


def ahead_m(scan: Scan, within_rad: float) -> F64:
    """Distances (n,) along straight ahead of what the beams near it meet.

    Raises:
        RefusedError: there is no such beam.
    """
    bearings_rad = scan.first_rad + scan.step_rad * np.arange(scan.ranges_m.shape[1])
    near = np.abs(bearings_rad) <= within_rad
    if not near.any():
        nearest_deg = math.degrees(np.abs(bearings_rad).min())
        raise RefusedError(
            f"no beam within +-{math.degrees(within_rad):g} deg of straight ahead, the nearest is "
            f"at {nearest_deg:.1f} deg: --within more, or widen the used field of view"
        )
    distances_m = scan.ranges_m[0, near] * np.cos(bearings_rad[near])
    return np.asarray(distances_m[np.isfinite(distances_m)])


class RangeCollector:
    """The scanner on its port, and target after target once it runs."""

    def __init__(self, config: Config, port: Port, plan: Plan, helper: Helper) -> None:
        """config: with a correction of nothing."""
        nowhere = NoPort()
        devices = devices_on(Ports(port, nowhere, nowhere, nowhere), config)
        self.scanner = devices.scanner
        self.targets: list[Target] = []
        self._plan, self._helper = plan, helper
        self._reads_m: list[float] = []
        self._empty = 0
        self._heard_s, self._patience_s = math.inf, READY_S
        self._asked = False
        self._placed_s = math.inf  # when the present target stood

    @property
    def done(self) -> bool:
        return len(self.targets) == len(self._plan.distances_m)

    @property
    def counted(self) -> int:
        """Scans that count, of all targets."""
        return len(self.targets) * self._plan.scans + len(self._reads_m)

    def step(self, now_s: float) -> None:
        """Never waits. Raises RefusedError: the scanner does not run, or sees no target."""
        self._heard_s = min(self._heard_s, now_s)
        scans = self.scanner.step(now_s)
        if not scans and now_s - self._heard_s > self._patience_s:
            raise RefusedError(f"no scan for {self._patience_s:g} s: {self.words()}")
        for scan in scans if self.scanner.clock_locked else ():
            if not isinstance(scan, Scan):
                raise RefusedError("only a scanner of one plane can be calibrated")
            self._heard_s, self._patience_s = now_s, SILENT_S
            self._take(scan)
        if self._patience_s == SILENT_S and not self.done:
            self._ask(now_s)

    def _ask(self, now_s: float) -> None:
        """Whoever puts the target there, once the scanner runs."""
        if not self._asked:
            self._helper.ask(self._plan.distances_m[len(self.targets)])
            self._asked = True
        if self._placed_s == math.inf and self._helper.has_placed():
            self._placed_s = now_s + SETTLE_S

    def _take(self, scan: Scan) -> None:
        seen_m = ahead_m(scan, self._plan.within_rad)
        if scan.t_s < self._placed_s or self.done:
            return
        if seen_m.size:
            self._reads_m.append(float(np.median(seen_m)))
        else:
            self._empty += 1
        true_m = self._plan.distances_m[len(self.targets)]
        if self._empty > MOST_EMPTY * self._plan.scans:
            raise RefusedError(
                f"nothing is seen straight ahead in {self._empty} of "
                f"{self._empty + len(self._reads_m)} scans: is the target at {true_m:g} m within "
                "the scanner's range, bright enough, and square to it?"
            )
        if len(self._reads_m) == self._plan.scans:
            self.targets.append(target_of(true_m, self._reads_m))
            self._reads_m, self._empty = [], 0
            self._asked, self._placed_s = False, math.inf

    def words(self) -> str:
        told = f"{len(self.targets)} of {len(self._plan.distances_m)} targets measured"
        return "; ".join([told, *complaints_of({"scanner": self.scanner.status})])


def collect(
    config: Config, plan: Plan, helper: Helper, advance: Callable[[float, str], None]
) -> Sequence[Target]:
    """`advance` gets the scans that count, and words. Raises RefusedError, PortUrlError."""
    with contextlib.closing(open_port(config.scanner.port)) as port:
        collector = RangeCollector(config, port, plan, helper)
        with contextlib.ExitStack() as stack:
            stack.callback(collector.scanner.stop)
            told = -1
            while not collector.done:
                collector.step(time.monotonic())
                if collector.counted != told:
                    told = collector.counted
                    advance(told, collector.words())
                time.sleep(STEP_S)
    return collector.targets
