"""Replies with ranges to scans: steps to bearings, device time to host time, codes to nothing.

Step k of a turn is measured k / steps of a turn after the stamp. How long the device keeps a scan
before it sends it is not documented: it is learnt from its time synchronisation, in which a stamp
is sent at once. Source: urg04lx sheet, sections 1, 4, 5 and 6.
"""

import math

import numpy as np
from msgspec import Struct

from core.records import F64, Scan
from hw.clock import DeviceClock
from hw.device import BadFrame
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.scip import Reply, ScipError, number_in, numbers_in
from hw.urg04lx.sensor import KINDS, LEAST_RANGE_MM, MOST_TWO_CHARACTERS, Sensor

TICK_S, WRAP_TICKS = 1e-3, 1 << 24
LEARNT_SCANS, LONGEST_HELD_S = 20, 0.1  # how long the device keeps a scan: by the first of them


class Window(Struct, frozen=True):
    """The steps that are asked for."""

    sensor: Sensor
    first: int
    last: int
    cluster: int

    @classmethod
    def of(cls, sensor: Sensor, options: Urg04lxOptions) -> "Window":
        """The used field of view, as far as the sensor has it."""
        deg_a_step = math.degrees(sensor.step_rad)
        first = sensor.front_step + math.ceil(options.from_deg / deg_a_step - 1e-6)
        last = sensor.front_step + math.floor(options.to_deg / deg_a_step + 1e-6)
        cluster = options.cluster
        return cls(sensor, max(first, sensor.first_step), min(last, sensor.last_step), cluster)

    @property
    def beams(self) -> int:
        return -(-(self.last - self.first + 1) // self.cluster)

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
        self.clock = DeviceClock(TICK_S, WRAP_TICKS)
        self.invalid: dict[str, int] = {}  # beams of the newest scan without a range, by their kind
        self._options, self._counter = options, 0
        self._last_ticks: int | None = None
        self._sync: tuple[int, float] | None = None  # a stamp, and the instant of its sending
        self._held_s, self._learnt = 0.0, 0

    def begin(self) -> None:
        """A new stream, maybe of a device that has restarted."""
        self._last_ticks = self._sync = None

    @property
    def knows_held(self) -> bool:
        """Whether it is known how long the device keeps a scan: the same on each connection."""
        return self._learnt >= LEARNT_SCANS

    def synchronise(self, ticks: int, sent_s: float) -> None:
        """A stamp that left the device then, or sooner: the least delayed counts."""
        if self._sync is not None:
            first, first_s = self._sync
            if _passed_s(first, ticks) - (sent_s - first_s) < 0.0:
                return
        self._sync = ticks, sent_s

    def scan(self, reply: Reply, window: Window, line_s: float) -> tuple[Scan, int] | BadFrame:
        """A scan, and how many before it never came; line_s: that its bytes take on the wire."""
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
                return BadFrame("scan repeated", b"")
            turns = _passed_s(last, ticks) / (sensor.turn_s * (1 + self._options.skip_scans))
            missed = max(0, round(turns) - 1) if turns < LEARNT_SCANS else 0
        measured_s = window.measured_s + line_s
        self._learn(ticks, reply.arrived_s - measured_s)
        begun_s = self.clock.host_s(ticks, reply.arrived_s - measured_s - self._held_s)
        begun_s = min(begun_s, reply.arrived_s - measured_s)
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

    def _learn(self, ticks: int, latest_s: float) -> None:
        """How long the device keeps a scan at least; latest_s: its stamp, if it keeps none."""
        if self._sync is None or self._learnt >= LEARNT_SCANS:
            return
        held_s = latest_s - (self._sync[1] + _passed_s(self._sync[0], ticks))
        held_s = min(max(held_s, 0.0), LONGEST_HELD_S)
        self._held_s = held_s if self._learnt == 0 else min(held_s, self._held_s)
        self._learnt += 1

    def _ranges_m(self, raw: F64, sensor: Sensor) -> F64:
        """(n,) corrected; NaN where there is none, whatever the reason."""
        most_mm = float(sensor.most_mm)
        if self._options.characters == 2:
            most_mm = min(most_mm, MOST_TWO_CHARACTERS - 1)
        self.invalid = {
            kind: found
            for kind, codes in KINDS.items()
            if (found := int(np.isin(raw, codes).sum()))
        }
        is_range = (raw >= max(LEAST_RANGE_MM, sensor.least_mm)) & (raw <= most_mm)
        return np.where(is_range, self._options.corrected_m(raw / 1000.0), math.nan)


def _passed_s(before: int, after: int) -> float:
    """From one stamp to another one, less than half a wrap away."""
    half = WRAP_TICKS // 2
    return ((after - before + half) % WRAP_TICKS - half) * TICK_S
