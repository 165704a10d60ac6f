"""The measuring part of the fake URG-04LX: its clock and timer, its motor, and what each scan sees.

The motor turns from power-up on; the time stamp is the timer at step 0, and a scan is complete when
the beam has left the measuring range. It sees only while the laser is on.

Source: urg04lx sheet, sections 1 and 4.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fakes.urg04lx.faults import Faults
from fakes.urg04lx.models import Model
from fakes.urg04lx.optics import IMPOSSIBLE, Measured, Optics
from fakes.urg04lx.scip import I32
from fakes.wires.timing import F64, Quartz

Truth = Callable[[float, F64, F64], F64]

TIMER = 1 << 24  # wraps there, ms
MOST = (1 << 18) - 1  # mm that three characters can tell
KEPT_S = 0.9  # a device that was not looked at for longer has lost its oldest scans


class Scan(NamedTuple):
    """One turn with the laser on."""

    stamp_ms: int
    values: I32  # (last + 1,) of all steps, mm or a code


class Head:
    """One scanner's motor and lens.

    Args:
        ranges_m_at: (instant of the first step, instants (n,), bearings (n,) rad) to ranges (n,),
            or (2, n) of which the first row counts; m, NaN or inf for nothing, -inf where it is
            dazzled; host clock; bearing 0 is straight ahead, to the left is positive. Of thin rays:
            what a wide beam makes of an edge is the lens's own.
    """

    def __init__(self, faults: Faults, model: Model, ranges_m_at: Truth, seed: int) -> None:
        self.clock = Quartz()
        self.measured: Measured | None = None  # of the last scan, with its truth
        self._faults, self._model, self._ranges_m_at = faults, model, ranges_m_at
        self._optics, self._random = Optics(model, seed), np.random.default_rng(seed)
        self._steps = np.arange(model.amin, model.amax + 1, dtype=np.float64)
        self.power_up()

    def power_up(self) -> None:
        self.clock.restart()
        self._lit_from: int | None = None  # number of the first scan with the laser on
        self._cached: tuple[int, Scan] | None = None
        self.reset()

    def reset(self) -> None:
        """Timer and speed as they were delivered."""
        self._zero_s = self.clock.device_s
        self.turn()

    def turn(self, slower: float = 0.0) -> None:
        """At the nominal speed, or by a share less; a scan begins with it."""
        self.dark()
        self._begin_s = self.clock.device_s
        self._period_s = 60.0 / self._model.rpm / (1.0 - slower)

    @property
    def period_s(self) -> float:
        return self._period_s

    @property
    def is_lit(self) -> bool:
        return self._lit_from is not None

    def light(self) -> None:
        """Laser on: the next whole turn is the first scan."""
        turns = (self.clock.device_s - self._begin_s) / self._period_s
        self._lit_from = math.ceil(turns - 1e-9)

    def dark(self) -> None:
        self._lit_from, self._cached = None, None

    def timer_ms(self, device_s: float | None = None) -> int:
        """What its timer shows then, or now."""
        since_s = (self.clock.device_s if device_s is None else device_s) - self._zero_s
        return (self._faults.timer_ms + math.floor(1000 * since_s + 1e-6)) % TIMER

    def done_s(self, scan: int) -> float:
        """The host instant at which a scan is complete."""
        turns = scan + self._model.amax / self._model.ares
        return self.clock.host_s(self._begin_s + turns * self._period_s)

    @property
    def next_scan(self) -> int:
        """Number of the first scan that is not complete yet and sees."""
        assert self._lit_from is not None
        turns = (self.clock.device_s - self._begin_s) / self._period_s
        done = math.floor(turns - self._model.amax / self._model.ares + 1e-9) + 1
        return max(self._lit_from, done)

    @property
    def latest(self) -> int | None:
        """Number of the last complete scan; None: none yet."""
        if self._lit_from is None or self.next_scan == self._lit_from:
            return None
        return self.next_scan - 1

    @property
    def oldest(self) -> int:
        """Number of the oldest scan that it still knows."""
        return self.next_scan - math.ceil(KEPT_S / self._period_s)

    def scan(self, number: int) -> Scan:
        if self._cached is None or self._cached[0] != number:
            begin_s = self._begin_s + number * self._period_s
            is_old = self._faults.frozen and self._cached is not None
            values = self._cached[1].values if is_old and self._cached else self._values(begin_s)
            self._cached = number, Scan(self.timer_ms(begin_s), values)
        return self._cached[1]

    def _values(self, begin_s: float) -> I32:
        faults, model = self._faults, self._model
        times_s = self.clock.host_times_s(begin_s + self._steps / model.ares * self._period_s)
        bearings_rad: F64 = 2 * np.pi / model.ares * (self._steps - model.afrt)
        echoes_m = np.atleast_2d(self._ranges_m_at(float(times_s[0]), times_s, bearings_rad))
        true_m: F64 = echoes_m[0] + faults.offset_m
        inside = slice(model.amin, model.amax + 1)
        remissions = np.full(model.last + 1, faults.remission)
        _set(remissions, faults.remission_at)
        measured = self._optics.measured(
            true_m, self._random, faults.noise, faults.mixed, remissions[inside]
        )
        values = np.full(model.last + 1, IMPOSSIBLE, np.int32)
        values[inside] = measured.values
        _set(values, faults.values_at)
        self.measured = measured
        return values


def _set(steps: npt.NDArray[Any], given: Mapping[int, float]) -> None:
    """Put what is given for single steps in its place; steps that there are not are left out."""
    for step, value in given.items():
        if 0 <= step < len(steps):
            steps[step] = max(0, min(value, MOST))
