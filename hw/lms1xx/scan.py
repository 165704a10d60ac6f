"""Scan telegrams to scans: device angles to bearings, device time to host time, used beams only.

When a beam left is taken from the end of the sweep: a telegram can't leave before its last beam.
(Recorded telegrams say that transmission began 3.1 ms after the sweep, which takes 15 ms.)
Source: lms111 sheet, sections 1 and 5; design, section 4.
"""

import math
from functools import lru_cache

import numpy as np
from msgspec import Struct

from core.records import F64, Scan
from hw.clock import DeviceClock
from hw.device import BadFrame
from hw.lms1xx.options import AHEAD_DEG, Lms1xxOptions
from hw.lms1xx.telegrams import (
    FIELD_FIRST,
    FIELD_LAST,
    Channel,
    ScanTelegram,
    ranges_m_from_channel,
)

FIRST_DEG, LAST_DEG = FIELD_FIRST / 10_000, FIELD_LAST / 10_000


class Sweep(Struct, frozen=True, eq=False):
    """What all scans of one layout have in common."""

    part: slice  # the used beams
    first_rad: float
    step_rad: float
    beam_dt_s: float
    first_s: float  # from the sweep's begin to the first used beam
    whole_s: float


class ScanMaker:
    """One scanner's telegrams to scans. Its clock lives on from connection to connection."""

    def __init__(self, options: Lms1xxOptions) -> None:
        self.clock = DeviceClock(1e-6, 2**32)
        self._options = options
        self._sweep = lru_cache(1)(self._new_sweep)

    def scan(self, telegram: ScanTelegram) -> Scan | BadFrame:
        """The used part of a telegram; BadFrame if it has no distances there."""
        sent_s = self.clock.host_s(telegram.sent_us, telegram.arrived_s)
        channel = telegram.channels.get("DIST1") or telegram.channels.get("DIST2")
        if channel is None:
            return BadFrame("scan telegram without distances", b"")
        sweep = self._sweep(telegram.scan_hz, *channel.layout)
        if sweep.part.start >= sweep.part.stop:
            return BadFrame("scan telegram without a beam in the used field of view", b"")
        begin_s = min(self.clock.host_s_near(telegram.scan_us), sent_s - sweep.whole_s)
        return Scan(
            t_s=begin_s + sweep.first_s,
            beam_dt_s=sweep.beam_dt_s,
            first_rad=sweep.first_rad,
            step_rad=sweep.step_rad,
            ranges_m=self._ranges_m(telegram, channel, sweep.part),
            counter=telegram.scan_counter,
            arrived_s=telegram.arrived_s,
        )

    def _new_sweep(self, scan_hz: float, begin_deg: float, step_deg: float, beams: int) -> Sweep:
        to_first = (self._options.first_deg - begin_deg) / step_deg
        to_last = (self._options.last_deg - begin_deg) / step_deg
        first = max(0, math.ceil(to_first - 1e-3))  # angles come in 1/10000 deg
        last = min(beams - 1, math.floor(to_last + 1e-3))
        deg_per_s = 360.0 * scan_hz
        first_deg = begin_deg + first * step_deg
        return Sweep(
            part=slice(first, last + 1),
            first_rad=math.radians(first_deg - AHEAD_DEG),
            step_rad=math.radians(step_deg),
            beam_dt_s=step_deg / deg_per_s,
            first_s=(first_deg - FIRST_DEG) / deg_per_s,
            whole_s=(LAST_DEG - FIRST_DEG) / deg_per_s,
        )

    def _ranges_m(self, telegram: ScanTelegram, like: Channel, part: slice) -> F64:
        """(echoes, n); NaN where nothing was measured, and for an echo not sent."""
        echo, echoes_m = self._options.echo, list[F64]()  # each (1, n)
        for content in ("DIST1",) if echo == "first" else ("DIST1", "DIST2"):
            channel = telegram.channels.get(content)
            if channel is not None and channel.layout == like.layout:  # the same beams
                echoes_m.append(ranges_m_from_channel(channel, (None, part)))
            else:
                echoes_m.append(np.full((1, part.stop - part.start), math.nan))
        if echo == "first":
            return echoes_m[0]
        if echo == "both":
            return np.concatenate(echoes_m)
        first_m, second_m = echoes_m
        return np.where(np.isnan(second_m), first_m, second_m)  # one echo is the last, too
