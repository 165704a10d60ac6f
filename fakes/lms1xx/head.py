"""The measuring part of the fake LMS111: its clock, its turning mirror, and what each sweep sees.

One turn takes a period; the beam crosses the field of view, 270 of 360 degrees, from its begin.
The telegram goes out 0.1 ms after the beam left the field of view, however much of it is sent; its
"time since start-up" is 3.1 ms before that, as recorded. Filters work on what was measured.

Source: lms111 sheet, sections 3 (filters) and 5 (scan timing, small values).
"""

import math
import random
from collections import deque
from collections.abc import Callable
from datetime import datetime, timedelta

import numpy as np

from fakes.lms1xx.cola import Value
from fakes.lms1xx.faults import Faults
from fakes.lms1xx.scan import (
    AREA_START,
    FIRST_VALID,
    NO_ECHO,
    U16,
    ScanSettings,
    ScanTelegram,
    channels_of,
)
from fakes.lms1xx.settings import MOST_SCANS
from fakes.wires.timing import F64, Quartz

Truth = Callable[[float, F64, F64], F64]

SWEEP_TURN = 0.75  # 270 of 360 deg
SENT_AFTER_S = 0.0001  # the sweep's end
STAMP_US = 3100  # "time since start-up" before the transmission
KEPT_S = 0.9  # a device that was not looked at for longer has lost its oldest scans
DAZZLED, IMPLAUSIBLE, FILTERED = 1, 2, 3  # codes below FIRST_VALID
SAME_MM = 200  # the n-to-1 filter wants an echo so near to the one of the scan before
NOT_VALID_YET = b"\1\0"  # device status of the first scans, as recorded
EPOCH = datetime(1970, 1, 1)
FIRST_TELEGRAM = 63_336  # as recorded


class LaserHead:
    """Measures with `settings` from `begin_s` on.

    Args:
        ranges_m_at: (instant of the first point, instants (n,), bearings (n,) rad) to ranges (n,),
            or (2, n) with second echoes; m, NaN or inf for no return, -inf where it is dazzled;
            host clock; bearing 0 is straight ahead.
        version: of its telegrams.
    """

    def __init__(
        self, faults: Faults, ranges_m_at: Truth, seed: int, version: int, settings: ScanSettings
    ) -> None:
        self.clock = Quartz()
        self.clock_set = EPOCH  # date and time at which its clock showed 0
        self.settings = settings
        self.begin_s: float | None = None  # device time of the first sweep
        self._faults, self._ranges_m_at, self._version = faults, ranges_m_at, version
        self._random, self._noise = random.Random(seed), np.random.default_rng(seed)
        self._next_sweep = 0  # that was not yet due
        self._telegrams = FIRST_TELEGRAM
        self._last_telegram: list[Value] = []
        self._last_sweep = -1  # whose telegram that is
        self._measured_mm: deque[U16] = deque(maxlen=MOST_SCANS)  # first echoes, newest last

    def power_up(self) -> None:
        self.clock.restart()
        self.clock_set = EPOCH
        self.begin_s, self._next_sweep, self._last_telegram = None, 0, []

    def sweep_from(self, begin_s: float) -> None:
        """The first sweep begins then, on the device's clock."""
        self.begin_s, self._next_sweep, self._last_sweep = begin_s, 0, -1
        self._measured_mm.clear()

    def hit(self, rate: float) -> bool:
        return rate > 0 and self._random.random() < rate

    def uptime_us(self, device_s: float) -> int:
        """What its counter shows then, without its wrap."""
        return self._faults.clock_offset_us + math.floor(device_s * 1e6)

    def date(self, device_s: float) -> datetime:
        """Date and time on its own clock, in steps of 1 ms."""
        return self.clock_set + timedelta(milliseconds=self.uptime_us(device_s) // 1000)

    def _sent_device_s(self, sweep: int) -> float:
        assert self.begin_s is not None
        return self.begin_s + (sweep + SWEEP_TURN) * self.settings.period_s + SENT_AFTER_S

    def latest_sweep(self) -> int:
        """Number of the last sweep whose telegram could go out by now; below 0: none yet."""
        if self.begin_s is None:
            return -1
        period_s = self.settings.period_s
        first_s = self.begin_s + SWEEP_TURN * period_s + SENT_AFTER_S
        return math.floor((self.clock.device_s - first_s) / period_s + 1e-9)

    @property
    def has_news(self) -> bool:
        return self.latest_sweep() >= self._next_sweep

    def due_scans(self, is_wanted: bool) -> list[tuple[float, list[Value]]]:
        """When each of the telegrams since the last call goes out, and its values."""
        latest, settings, due = self.latest_sweep(), self.settings, []
        kept = math.ceil(KEPT_S / settings.period_s) if is_wanted else 0
        for sweep in range(max(self._next_sweep, latest + 1 - kept), latest + 1):
            if sweep % settings.content.interval or self.hit(self._faults.drop_rate):
                if self._faults.two_in_a_row or self._faults.mean_scans:
                    self.echoes_mm(sweep)  # filters look at each sweep, sent or not
                continue
            due.append((self.clock.host_s(self._sent_device_s(sweep)), self.scan(sweep)))
        self._next_sweep = max(self._next_sweep, latest + 1)
        return due

    def scan(self, sweep: int) -> list[Value]:
        """The telegram of a sweep that is over, without type and name."""
        is_new = sweep != self._last_sweep and not self._faults.frozen
        if is_new or not self._last_telegram:
            self._last_telegram, self._last_sweep = self._measured(sweep), sweep
        return self._last_telegram

    def _measured(self, sweep: int) -> list[Value]:
        faults, settings, sent_s = self._faults, self.settings, self._sent_device_s(sweep)
        content, settled = settings.content, sweep >= faults.settling_scans
        sent_us = self.uptime_us(sent_s)
        self._telegrams += 1
        return ScanTelegram(
            status=bytes([0, faults.device_status & 0xFF]) if settled else NOT_VALID_YET,
            telegrams=self._telegrams - 1,
            scans=faults.first_scan + sweep,
            scan_us=sent_us - STAMP_US,
            sent_us=sent_us,
            outputs=b"\4\0" if settled else b"\1\0",
            frequency=settings.frequency,
            shots=settings.frequency * 36 // settings.resolution * 10,
            channels=channels_of(settings, self.echoes_mm(sweep)),
            encoders=(faults.encoder,) if content.encoder else (),
            position=content.position,
            name=faults.name.encode("latin-1") if content.name else None,
            comment=faults.comment.encode("latin-1") if content.comment else None,
            when=self.date(sent_s) if content.time else None,
            version=self._version,
        ).values()

    def echoes_mm(self, sweep: int) -> tuple[U16, U16]:
        """The codes (n,) of the points of a sweep that are sent: first and second echo."""
        assert self.begin_s is not None
        settings = self.settings
        index = settings.first_index + np.arange(settings.points, dtype=np.float64)
        turned_deg = index * (settings.resolution / 10_000)
        device_s = self.begin_s + (sweep + turned_deg / 360.0) * settings.period_s
        bearings_rad = np.radians(turned_deg + AREA_START / 10_000 - 90.0)
        times_s = self.clock.host_times_s(device_s)
        true_m = np.atleast_2d(self._ranges_m_at(float(times_s[0]), times_s, bearings_rad))
        first = self._filtered(self._codes(true_m[0]))
        if len(true_m) > 1:
            return first, self._codes(true_m[1])
        return first, np.full_like(first, NO_ECHO)

    def _codes(self, true_m: F64) -> U16:
        """What is measured of true ranges (n,): noise, nothing beyond its reach, bad light."""
        faults, noise = self._faults, self._noise.standard_normal(len(true_m))
        measured_m = true_m + faults.offset_m + faults.noise_m * noise
        raw = np.rint(1000 * measured_m)
        is_seen = (measured_m <= faults.max_range_m) & (raw >= FIRST_VALID)  # false for NaN, too
        codes: U16 = np.where(is_seen, raw, NO_ECHO).astype(np.uint16)
        codes[true_m == -math.inf] = DAZZLED
        rates = (faults.dazzled_rate, faults.implausible_rate, faults.filtered_rate)
        for code, rate in zip((DAZZLED, IMPLAUSIBLE, FILTERED), rates, strict=True):
            if rate > 0:
                codes[self._noise.random(len(codes)) < rate] = code
        return codes

    def _filtered(self, codes: U16) -> U16:
        """After the filters that are on; each looks at what was measured, not at what was sent."""
        if self._measured_mm and len(self._measured_mm[-1]) != len(codes):
            self._measured_mm.clear()
        before = self._measured_mm[-1] if self._measured_mm else np.zeros_like(codes)
        self._measured_mm.append(codes)
        out, mean_scans = codes, self._faults.mean_scans
        if self._faults.two_in_a_row:
            near = np.abs(codes.astype(np.int32) - before) <= SAME_MM
            near &= before >= FIRST_VALID
            out = np.where((codes >= FIRST_VALID) & ~near, np.uint16(FILTERED), codes)
        if mean_scans > 1:
            rows = np.array(list(self._measured_mm)[-mean_scans:])
            valid = rows >= FIRST_VALID
            mean = (rows * valid).sum(0) / np.maximum(valid.sum(0), 1)
            out = np.where(out >= FIRST_VALID, np.round(mean), out).astype(np.uint16)
        return out
