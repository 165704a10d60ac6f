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
import numpy.typing as npt

from fakes.lms1xx.cola_values import Value
from fakes.lms1xx.kernels import DAZZLED, codes_from
from fakes.lms1xx.scan import (
    AREA_START,
    FIRST_VALID,
    NO_ECHO,
    U16,
    ScanSettings,
    ScanTelegram,
    channels_of,
    time_values,
)
from fakes.wires.timing import Quartz

F64 = npt.NDArray[np.float64]

SWEEP_TURN = 0.75  # 270 of 360 deg
SENT_AFTER_S = 0.0001  # the sweep's end
STAMP_US = 3100  # "time since start-up" before the transmission
KEPT_S = 0.9  # a device that was not looked at for longer has lost its oldest scans
IMPLAUSIBLE, FILTERED = 2, 3  # codes below FIRST_VALID, as DAZZLED
SAME_MM = 200  # the n-to-1 filter wants an echo so near to the one of the scan before
MOST_SCANS = 100  # of the mean filter
NOT_VALID_YET = b"\1\0"  # device status of the first scans, as recorded
EPOCH = datetime(1970, 1, 1)
FIRST_TELEGRAM = 63_336  # as recorded
OUTPUTS = ((0, 0xFC), (0, 0x112), (1, 0x5D), *[(2, 0)] * 8)  # state, changes; recorded


class LaserHead:
    """Measures with `settings` from `begin_s` on. Public attributes are for tests to set.

    Args:
        ranges_m_at: (instant of the first point, instants (n,), bearings (n,) rad) to ranges (n,),
            or (2, n) with second echoes; m, NaN or inf for no return, -inf where it is dazzled;
            host clock; bearing 0 is straight ahead.
    """

    def __init__(self, ranges_m_at: Callable[[float, F64, F64], F64], seed: int) -> None:
        self.frozen = False  # the same telegram again and again
        self.drop_rate = 0.0  # of scans, which are then missing in the scan counter
        self.drift_ppm = 0.0
        self.clock_offset_us = 0  # what its clock shows at power-up
        self.noise_m = 0.012  # 1 sigma; the sheet's statistical error
        self.offset_m = 0.0  # by which all it measures is too far; the sheet: up to 0.03
        self.settling_scans = 7  # that carry device status 01 00
        self.contamination = 0  # of the window, as LCMstate tells: 1 warning, 2 error, 3 fatal
        self.device_status = 0  # of settled scans, second byte; no value but 0 is documented
        self.dazzled_rate = 0.0  # of beams
        self.implausible_rate = 0.0  # of beams
        self.filtered_rate = 0.0  # of beams
        self.max_range_m = 20.0
        self.name, self.comment = "not defined", ""  # that a telegram may carry
        self.encoder = (0, 0)  # position, speed
        self.mean_scans = 0  # of the mean filter; 0: off
        self.two_in_a_row = False  # the n-to-1 filter: an echo counts if the scan before had it
        self._ranges_m_at = ranges_m_at
        self._random, self._noise = random.Random(seed), np.random.default_rng(seed)
        codes_from(np.zeros(1), 0.0, 0.0, np.zeros(1), 0.0)  # is not compiled while a host waits
        self._clock = Quartz()
        self._clock_set = EPOCH  # date and time at which its clock showed 0
        self._active = ScanSettings()
        self._points_of: ScanSettings | None = None  # whose points these are:
        self._turns, self._bearings_rad = np.zeros(0), np.zeros(0)
        self._begin_s: float | None = None  # device time of the first sweep
        self._next_sweep = 0  # that was not yet due
        self._telegrams = FIRST_TELEGRAM
        self._version = 1  # of the telegram
        self._last_telegram: list[Value] = []
        self._last_sweep = -1  # whose telegram that is
        self._measured_mm: deque[U16] = deque(maxlen=MOST_SCANS)  # first echoes, newest last

    @property
    def settings(self) -> ScanSettings:
        """What it measures with."""
        return self._active

    def _sweep_from(self, begin_s: float) -> None:
        """The first sweep begins then, on the device's clock."""
        self._begin_s, self._next_sweep, self._last_sweep = begin_s, 0, -1
        self._measured_mm.clear()

    def _hit(self, rate: float) -> bool:
        return rate > 0 and self._random.random() < rate

    def _uptime_us(self, device_s: float) -> int:
        return self.clock_offset_us + math.floor(device_s * 1e6)

    def _date(self, device_s: float) -> datetime:
        """Date and time on its own clock, in steps of 1 ms."""
        uptime_ms = self._uptime_us(device_s) // 1000
        return self._clock_set + timedelta(milliseconds=uptime_ms)

    def _sent_device_s(self, sweep: int) -> float:
        """Device time at which the telegram of a sweep goes out."""
        assert self._begin_s is not None
        return self._begin_s + (sweep + SWEEP_TURN) * self._active.period_s + SENT_AFTER_S

    def _latest_sweep(self) -> int:
        """Number of the last sweep whose telegram could go out by now; below 0: none yet."""
        if self._begin_s is None:
            return -1
        period_s = self._active.period_s
        first_s = self._begin_s + SWEEP_TURN * period_s + SENT_AFTER_S
        return math.floor((self._clock.device_s - first_s) / period_s + 1e-9)

    def _due_telegrams(self, subscribed: set[str]) -> list[tuple[float, str, list[Value]]]:
        """Events (due, name, values) since the last call that somebody has subscribed to."""
        latest, active, due = self._latest_sweep(), self._active, []
        if "LIDoutputstate" in subscribed and self._next_sweep <= self.settling_scans <= latest:
            due.append(self._outputs_told(self.settling_scans))
        if "LMDscandata" in subscribed:
            kept = math.ceil(KEPT_S / active.period_s)
            for sweep in range(max(self._next_sweep, latest + 1 - kept), latest + 1):
                if sweep % active.content.interval or self._hit(self.drop_rate):
                    if self.two_in_a_row or self.mean_scans:
                        self._echoes_mm(sweep)  # filters look at each sweep, sent or not
                    continue
                due_s = self._clock.host_s(self._sent_device_s(sweep))
                due.append((due_s, "LMDscandata", self._scan(sweep)))
        self._next_sweep = max(self._next_sweep, latest + 1)
        return due

    def _scan(self, sweep: int) -> list[Value]:
        """The telegram of a sweep that is over, without type and name."""
        is_new = sweep != self._last_sweep and not self.frozen
        if is_new or not self._last_telegram:
            self._last_telegram, self._last_sweep = self._measured(sweep), sweep
        return self._last_telegram

    def _measured(self, sweep: int) -> list[Value]:
        active, sent_s = self._active, self._sent_device_s(sweep)
        content, settled = active.content, sweep >= self.settling_scans
        sent_us = self._uptime_us(sent_s)
        self._telegrams += 1
        return ScanTelegram(
            status=bytes([0, self.device_status & 0xFF]) if settled else NOT_VALID_YET,
            telegrams=self._telegrams - 1,
            scans=sweep,
            scan_us=sent_us - STAMP_US,
            sent_us=sent_us,
            outputs=b"\4\0" if settled else b"\1\0",
            frequency=active.frequency,
            shots=active.frequency * 36 // active.resolution * 10,
            channels=channels_of(active, self._echoes_mm(sweep)),
            encoders=(self.encoder,) if content.encoder else (),
            position=content.position,
            name=self.name.encode("latin-1") if content.name else None,
            comment=self.comment.encode("latin-1") if content.comment else None,
            when=self._date(sent_s) if content.time else None,
            version=self._version,
        ).values()

    def _echoes_mm(self, sweep: int) -> tuple[U16, U16]:
        """The codes (n,) of the points of a sweep that are sent: first and second echo."""
        assert self._begin_s is not None
        active = self._active
        if self._points_of is not active:
            self._points_of, (self._turns, self._bearings_rad) = active, _points(active)
        device_s = self._begin_s + (sweep + self._turns) * active.period_s
        times_s, bearings_rad = self._clock.host_times_s(device_s), self._bearings_rad
        true_m = np.atleast_2d(self._ranges_m_at(float(times_s[0]), times_s, bearings_rad))
        first = self._filtered(self._codes(true_m[0]))
        if len(true_m) > 1:
            return first, self._codes(true_m[1])
        return first, np.full_like(first, NO_ECHO)

    def _codes(self, true_m: F64) -> U16:
        """What is measured of true ranges (n,): noise, nothing beyond its reach, bad light."""
        noise = self._noise.standard_normal(len(true_m))
        codes = codes_from(true_m, self.offset_m, self.noise_m, noise, self.max_range_m)
        rates = (self.dazzled_rate, self.implausible_rate, self.filtered_rate)
        for code, rate in zip((DAZZLED, IMPLAUSIBLE, FILTERED), rates, strict=True):
            if rate > 0:
                codes[self._noise.random(len(codes)) < rate] = code
        return codes

    def _filtered(self, codes: U16) -> U16:
        """After the filters that are on; each looks at what was measured, not at what was sent."""
        before, out = self._measured_mm[-1] if self._measured_mm else None, codes
        if before is not None and len(before) != len(codes):
            self._measured_mm.clear()
            before = None
        self._measured_mm.append(codes)
        if self.two_in_a_row:
            near = np.zeros(len(codes), dtype=bool)
            if before is not None:
                near = np.abs(codes.astype(np.int32) - before) <= SAME_MM
                near &= before >= FIRST_VALID
            out = np.where((codes >= FIRST_VALID) & ~near, np.uint16(FILTERED), codes)
        if self.mean_scans > 1:
            rows = np.array(list(self._measured_mm)[-self.mean_scans :])
            valid = rows >= FIRST_VALID
            mean = (rows * valid).sum(0) / np.maximum(valid.sum(0), 1)
            out = np.where(out >= FIRST_VALID, np.round(mean), out).astype(np.uint16)
        return out

    def _outputs_told(self, sweep: int) -> tuple[float, str, list[Value]]:
        """The event of the outputs' change after the first scans."""
        device_s = self._sent_device_s(sweep)
        values: list[Value] = [("H", 1), ("I", self._uptime_us(device_s) % 2**32)]
        for output in OUTPUTS:
            values += zip("BI", output, strict=True)
        values += [("H", 1), *time_values(self._date(device_s))]
        return self._clock.host_s(device_s), "LIDoutputstate", values


def _points(settings: ScanSettings) -> tuple[F64, F64]:
    """Of the points (n,) that are sent: how far the mirror has turned, 0..1, and the bearings."""
    index = settings.first_index + np.arange(settings.points, dtype=np.float64)
    turned_deg = index * (settings.resolution / 10_000)
    return turned_deg / 360.0, np.radians(turned_deg + AREA_START / 10_000 - 90.0)
