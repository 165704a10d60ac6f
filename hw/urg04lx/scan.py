"""Replies with ranges to scans: steps to bearings, device time to host time, codes to nothing.

Step k of a turn is measured k / steps of a turn after the stamp. How long a scan takes from its
last beam to us is not documented, and depends on the line: it is learnt from the device's time
synchronisation, in which a stamp is sent at once. Source: urg04lx sheet, sections 1, 4, 5 and 6.
"""

import math

import numpy as np
from msgspec import Struct

from core.records import F64, Scan
from hw.clock import DeviceClock
from hw.device import BadFrame
from hw.exchange import StartAgainError
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.scip import Reply, ScipError, number_in, numbers_in
from hw.urg04lx.sensor import LEAST_RANGE_MM, MOST_TWO_CHARACTERS, Sensor
from hw.urg04lx.sight import Sight

TICK_S, WRAP_TICKS = 1e-3, 1 << 24
LEARNT_SCANS, LONGEST_HELD_S = 20, 1.5  # how long a scan takes to us: by the first of them
EARLY_S = 0.02  # a scan can't arrive sooner than this before its end, by a stamp told late


class Window(Struct, frozen=True):
    """The steps that are asked for."""

    sensor: Sensor
    first: int
    last: int
    cluster: int

    @classmethod
    def of(cls, sensor: Sensor, options: Urg04lxOptions) -> "Window":
        """The used field of view, as far as the sensor has it, in whole clusters.

        Of a part of one it is not documented whether it is sent.
        """
        deg_a_step = math.degrees(sensor.step_rad)
        first = sensor.front_step + math.ceil(options.from_deg / deg_a_step - 1e-6)
        last = sensor.front_step + math.floor(options.to_deg / deg_a_step + 1e-6)
        first, last = max(first, sensor.first_step), min(last, sensor.last_step)
        last -= (last - first + 1) % options.cluster
        return cls(sensor, first, last, options.cluster)

    @property
    def beams(self) -> int:
        return (self.last - self.first + 1) // self.cluster

    @property
    def text(self) -> str:
        """As requests have it."""
        return f"{self.first:04}{self.last:04}{self.cluster:02}"

    @property
    def measured_s(self) -> float:
        """From the stamp to the last beam."""
        return self.last / self.sensor.steps * self.sensor.turn_s


class ScanMaker:
    """One scanner's replies to scans. Its clock lives on from connection to connection."""

    def __init__(self, options: Urg04lxOptions) -> None:
        self.clock, self.sight = DeviceClock(TICK_S, WRAP_TICKS), Sight()
        self._options, self._counter = options, 0
        self._last_ticks: int | None = None
        self._sync: tuple[int, float] | None = None  # a stamp, and the instant of its sending
        self._held_s, self._learnt, self._way = 0.0, 0, ""

    def begin(self, way: str) -> bool:
        """A new stream, maybe of a device that has restarted; whether its time is to be learnt.

        way: what the time that a scan takes depends on.
        """
        self._last_ticks = self._sync = None
        if way != self._way:
            self._way, self._held_s, self._learnt = way, 0.0, 0
        return self._learnt < LEARNT_SCANS

    def synchronise(self, ticks: int, sent_s: float) -> None:
        """A stamp that left the device then, or sooner: the least delayed counts."""
        if self._sync is not None:
            first, first_s = self._sync
            if _passed_s(first, ticks) - (sent_s - first_s) < 0.0:
                return
        self._sync = ticks, sent_s

    def hear_time(self, ticks: int, sent_s: float) -> None:
        """Of a device whose scans wait until they are asked for, so that they tell no time."""
        self.clock.host_s(ticks, sent_s)

    def scan(self, reply: Reply, window: Window) -> tuple[Scan, int] | BadFrame | None:
        """A scan, and how many before it never came; None: it was there before, or has no time."""
        sensor = window.sensor
        try:
            ticks = number_in(reply.lines[0]) if reply.lines else -1
            raw = numbers_in(reply.data, self._options.characters)
        except ScipError as error:
            return BadFrame(str(error), b"")
        if not 0 <= ticks < WRAP_TICKS:
            return BadFrame("scan without a time stamp", b"")
        if raw.size != window.beams:
            return BadFrame(f"{raw.size} points instead of {window.beams}", b"")
        missed, last, self._last_ticks = 0, self._last_ticks, ticks
        if last is not None:
            if last == ticks:
                return None
            turns = _passed_s(last, ticks) / (sensor.turn_s * (1 + self._options.skip_scans))
            missed = max(0, round(turns) - 1) if turns < LEARNT_SCANS else 0
        latest_s = reply.arrived_s - window.measured_s
        if self._options.stream:
            self._learn(ticks, latest_s)
            begun_s = self.clock.host_s(ticks, latest_s - self._held_s)
        elif self.clock.samples:
            begun_s = self.clock.host_s_near(ticks)
        else:
            return None
        begun_s = min(begun_s, latest_s)
        self._counter = (self._counter + 1 + missed) % (1 << 16)
        middle = window.first + 0.5 * (window.cluster - 1)
        scan = Scan(
            t_s=begun_s + middle / sensor.steps * sensor.turn_s,
            beam_dt_s=window.cluster / sensor.steps * sensor.turn_s,
            first_rad=(middle - sensor.front_step) * sensor.step_rad,
            step_rad=window.cluster * sensor.step_rad,
            ranges_m=self._ranges_m(raw, sensor)[None, :],
            counter=self._counter,
            arrived_s=reply.arrived_s,
        )
        return scan, missed

    @property
    def knows_delay(self) -> bool:
        """How long a scan takes from its last beam to us; else their times are late by that."""
        return self._learnt > 0 or not self._options.stream

    def _learn(self, ticks: int, latest_s: float) -> None:
        """How long a scan takes to us at least; latest_s: its begin, if that were no time."""
        if self._sync is None or self._learnt >= LEARNT_SCANS:
            return
        passed_s = _passed_s(self._sync[0], ticks)
        held_s = latest_s - (self._sync[1] + passed_s)
        if passed_s < 0.0 or not -EARLY_S <= held_s <= LONGEST_HELD_S:
            raise StartAgainError("the scanner's clock began anew")
        self._held_s = held_s if self._learnt == 0 else min(held_s, self._held_s)
        self._learnt += 1

    def _ranges_m(self, raw: F64, sensor: Sensor) -> F64:
        """(n,) corrected; NaN where there is none, whatever the reason."""
        most_mm = float(sensor.most_mm)
        if self._options.characters == 2:
            most_mm = min(most_mm, MOST_TWO_CHARACTERS - 1)
        least_mm = float(max(LEAST_RANGE_MM, sensor.least_mm))
        ranges_m, has_none = raw / 1000.0, (raw < least_mm) | (raw > most_mm)
        ranges_m[has_none] = math.nan
        self.sight.look(raw, least_mm, most_mm, raw.size - int(np.count_nonzero(has_none)))
        return self._options.corrected_m(ranges_m)


def _passed_s(before: int, after: int) -> float:
    """From one stamp to another one, less than half a wrap away."""
    half = WRAP_TICKS // 2
    return ((after - before + half) % WRAP_TICKS - half) * TICK_S
