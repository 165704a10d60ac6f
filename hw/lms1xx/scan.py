"""Scan telegrams to scans: device angles to bearings, device time to host time, used beams only.

When a beam left is taken from the end of the sweep: a telegram can't leave before its last beam.
(Recorded telegrams say that transmission began 3.1 ms after the sweep, which takes 15 ms.)
Source: lms111 sheet, sections 1 and 5; design, section 4.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from core.records import F64, Scan
from hw.clock import DeviceClock
from hw.device import BadFrame
from hw.lms1xx.cola import DialectSetting
from hw.lms1xx.status import ScannerCondition
from hw.lms1xx.telegrams import (
    FIELD_FIRST,
    FIELD_LAST,
    Channel,
    Echo,
    ScanTelegram,
    beams_lost,
    ranges_m_from_channel,
)

AHEAD_DEG = 90.0  # the device angle that is bearing 0
FIRST_DEG, LAST_DEG = FIELD_FIRST / 10_000, FIELD_LAST / 10_000
POOL = 1 << 18  # ranges: ten seconds of 541 at 50 Hz, and four times what one read can hold


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanSettings:
    """What is asked of the scanner; device angles."""

    scan_rate_hz: float
    angular_step_deg: float
    first_deg: float
    last_deg: float
    echo: Echo
    dialect: DialectSetting = "auto"
    accepted_status: Collection[int] = ()  # device status, beside 0, of scans that are used


class RangePool:
    """Room for ranges, allocated once; what is taken stays untouched until the pool went round."""

    def __init__(self, size: int) -> None:
        self._values = np.empty(size)
        self._next = 0

    def take(self, echoes: int, beams: int) -> F64:
        """(echoes, beams), contiguous, filled with whatever was there."""
        size = echoes * beams
        if self._next + size > self._values.size:
            self._next = 0
        taken = self._values[self._next : self._next + size]
        self._next += size
        return taken.reshape(echoes, beams)


class ScanMaker:
    """One scanner's telegrams to scans. Its clock lives on from connection to connection."""

    def __init__(self, settings: ScanSettings) -> None:
        self.clock = DeviceClock(1e-6, 2**32)
        self._settings = settings
        self._pool = RangePool(POOL)

    def scan(self, telegram: ScanTelegram) -> Scan | BadFrame:
        """The used part of a telegram; BadFrame if it has no distances there."""
        sent_s = self.clock.host_s(telegram.sent_us, telegram.arrived_s)
        channel = telegram.channels.get("DIST1") or telegram.channels.get("DIST2")
        if channel is None:
            return BadFrame("scan telegram without distances", b"")
        part = self._part(channel)
        if part.start >= part.stop:
            return BadFrame("scan telegram without a beam in the used field of view", b"")
        deg_per_s = 360.0 * telegram.scan_hz
        first_deg = channel.first_deg + part.start * channel.step_deg
        sweep_s = (LAST_DEG - FIRST_DEG) / deg_per_s
        begin_s = min(self.clock.host_s_near(telegram.scan_us), sent_s - sweep_s)
        return Scan(
            t_s=begin_s + (first_deg - FIRST_DEG) / deg_per_s,
            beam_dt_s=channel.step_deg / deg_per_s,
            first_rad=math.radians(first_deg - AHEAD_DEG),
            step_rad=math.radians(channel.step_deg),
            ranges_m=self._ranges_m(telegram, channel, part),
            counter=telegram.scan_counter,
            arrived_s=telegram.arrived_s,
        )

    def with_beams(self, condition: ScannerCondition, telegram: ScanTelegram) -> ScannerCondition:
        """The same, with the used beams of the first echo that measured nothing, by cause."""
        channel = telegram.channels.get("DIST1") or telegram.channels.get("DIST2")
        if channel is None:
            return condition
        return replace(condition, beams_lost=beams_lost(channel, self._part(channel)))

    def _part(self, channel: Channel) -> slice:
        """Indices of the beams within the used field of view."""
        to_first = (self._settings.first_deg - channel.first_deg) / channel.step_deg
        to_last = (self._settings.last_deg - channel.first_deg) / channel.step_deg
        first = max(0, math.ceil(to_first - 1e-3))  # angles come in 1/10000 deg
        last = min(len(channel.raw) - 1, math.floor(to_last + 1e-3))
        return slice(first, last + 1)

    def _ranges_m(self, telegram: ScanTelegram, channel: Channel, part: slice) -> F64:
        """(echoes, n) of the pool; NaN where nothing was measured, and for an echo not sent."""
        echo = self._settings.echo
        ranges_m = self._pool.take(2 if echo == "both" else 1, part.stop - part.start)
        rows = ("DIST1", "DIST2") if echo == "both" else ("DIST1" if echo == "first" else "DIST2",)
        for content, row in zip(rows, ranges_m, strict=True):
            self._fill(telegram.channels.get(content), channel, part, row)
        if echo == "last":  # of a beam with one echo, it is the first
            first_m = np.empty(ranges_m.shape[1])
            self._fill(telegram.channels.get("DIST1"), channel, part, first_m)
            np.copyto(ranges_m[0], first_m, where=np.isnan(ranges_m[0]))
        return ranges_m

    @staticmethod
    def _fill(wanted: Channel | None, like: Channel, part: slice, row: F64) -> None:
        """Ranges of a channel whose beams are those of `like`; NaN if there is none."""
        if wanted is None or (len(wanted.raw), wanted.first_deg, wanted.step_deg) != (
            len(like.raw),
            like.first_deg,
            like.step_deg,
        ):
            row.fill(math.nan)
        else:
            ranges_m_from_channel(wanted, part, row)
