"""Sampling instants of an MTi on the host's clock, from its time stamp or its sample counter.

A sample leaves the device 2.55 ms after its instant and then takes its bytes' time on the wire;
all else that delays it varies, so the clock filter takes it out. Without stamp and counter the
arrival is all there is: good to what the wire and the adapter make of it, and never "locked".
Source: MTi sheet, sections 5 and 7 ("Time stamp of a sample").
"""

import math

from hw.clock import DeviceClock
from hw.mti.sample import MtSample

LATENCY_S = 0.00255  # sampling instant to first byte, with orientation
FINE_TICK_S = 1e-4
FINE_WRAP, FINE_DAY = 2**32, 864_000_000  # the second on 10 and 100 series
FINE_NEAR = 600_000  # a minute around the wrap
COUNTER_WRAP = 2**16
WATCH_S = 2.0  # counts of a window; 16 ms bursts and a stalled host move its ends
RATE_TOLERANCE = 0.1
ARRIVAL_UNCERTAINTY_S = 0.02  # an adapter as shipped holds bytes back for 16 ms


class SampleTimes:
    """Takes samples as they arrive; `period_s`: of the sample counter, `byte_s`: on the wire."""

    def __init__(self, period_s: float, byte_s: float) -> None:
        self._byte_s = byte_s
        self._by_counter = DeviceClock(period_s, COUNTER_WRAP)
        self._by_stamp = DeviceClock(FINE_TICK_S, FINE_WRAP)
        self._newest: DeviceClock | None = None  # that told the last time; None: its arrival did
        self.locked = False  # the device's clock is known well enough
        self._days, self._last_ticks = 0, 0

    @property
    def uncertainty_s(self) -> float:
        """Typical error of the last time, beyond a constant delay."""
        return ARRIVAL_UNCERTAINTY_S if self._newest is None else self._newest.uncertainty_s

    def t_s(self, sample: MtSample, arrived_s: float, wire_bytes: int) -> float:
        """When it was taken; `arrived_s`: its frame's last byte, both host clock."""
        sent_s = arrived_s - LATENCY_S - wire_bytes * self._byte_s
        if sample.fine_ticks is not None:
            clock, ticks = self._by_stamp, self._without_day_wrap(sample.fine_ticks)
        elif sample.counter is not None:
            clock, ticks = self._by_counter, sample.counter
        else:
            self._newest, self.locked = None, False
            return sent_s
        t_s = clock.host_s(ticks, sent_s)
        self._newest, self.locked = clock, clock.locked
        return t_s

    def _without_day_wrap(self, ticks: int) -> int:
        """Some devices count up to a day, others to 2^32: made one."""
        if FINE_DAY - FINE_NEAR <= self._last_ticks < FINE_DAY and ticks < FINE_NEAR:
            self._days += 1
        self._last_ticks = ticks
        return (self._days * FINE_DAY + ticks) % FINE_WRAP


class RateWatch:
    """Whether the counter steps as often as was set: some devices take what they can't do."""

    def __init__(self, period_s: float) -> None:
        self.remark = ""  # while it does not
        self._period_s = period_s
        self._steps, self._since_s = 0, math.nan

    def count(self, steps: int, arrived_s: float) -> None:
        """So many steps of the counter with the sample that arrived then; 0: it began anew."""
        if steps == 0 or math.isnan(self._since_s):
            self._steps, self._since_s = 0, arrived_s
            return
        self._steps += steps
        passed_s = arrived_s - self._since_s
        if passed_s < max(WATCH_S, 20 * self._period_s):
            return
        share = self._steps * self._period_s / passed_s
        given_hz, wanted_hz = self._steps / passed_s, 1 / self._period_s
        self.remark = (
            f"the MTi sends {given_hz:.0f} samples a second, not {wanted_hz:.0f} as it was told"
            if abs(share - 1) > RATE_TOLERANCE
            else ""
        )
        self._steps, self._since_s = 0, arrived_s
