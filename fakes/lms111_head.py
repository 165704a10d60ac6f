"""The measuring part of the fake LMS111: its clock, its turning mirror, and what each sweep sees.

One turn takes a period; the beam crosses the field of view, 270 of 360 degrees, from its begin.
The telegram goes out 0.1 ms after the beam left the field of view, however much of it is sent; its
"time since start-up" is 3.1 ms before that, as recorded.

Source: lms111 sheet, section 5 (scan timing).
"""

import math
import random
import struct
from collections.abc import Callable
from datetime import datetime, timedelta

import numpy as np
import numpy.typing as npt

from fakes.lms111_scan import (
    AREA_START,
    FIRST_VALID,
    NO_ECHO,
    U16,
    ScanSettings,
    ScanTelegram,
    channels_of,
    time_block,
)
from fakes.timing import Quartz

F64 = npt.NDArray[np.float64]

SWEEP_TURN = 0.75  # 270 of 360 deg
SENT_AFTER_S = 0.0001  # the sweep's end
STAMP_US = 3100  # "time since start-up" before the transmission
KEPT_S = 0.9  # a device that was not looked at for longer has lost its oldest scans
MAX_RANGE_M = 20.0
EPOCH = datetime(1970, 1, 1)
FIRST_TELEGRAM = 63_336  # as recorded
OUTPUTS = ((0, 0xFC), (0, 0x112), (1, 0x5D), *[(2, 0)] * 8)  # state, changes; recorded


class LaserHead:
    """Measures with `settings` from `begin_s` on. Public attributes are for tests to set.

    Args:
        ranges_m_at: (instant of the first point, instants (n,), bearings (n,) rad) to ranges (n,)
            m, NaN or inf for no return; host clock; bearing 0 is straight ahead.
    """

    def __init__(self, ranges_m_at: Callable[[float, F64, F64], F64], seed: int) -> None:
        self.frozen = False  # the same telegram again and again
        self.drop_rate = 0.0  # of scans, which are then missing in the scan counter
        self.drift_ppm = 0.0
        self.clock_offset_us = 0  # what its clock shows at power-up
        self.noise_m = 0.012
        self.settling_scans = 7  # that carry device status 01 00
        self._ranges_m_at = ranges_m_at
        self._random, self._noise = random.Random(seed), np.random.default_rng(seed)
        self._clock = Quartz()
        self._clock_set = EPOCH  # date and time at which its clock showed 0
        self._active = ScanSettings()
        self._begin_s: float | None = None  # device time of the first sweep
        self._next_sweep = 0  # that was not yet due
        self._telegrams = FIRST_TELEGRAM
        self._last_telegram = b""

    @property
    def settings(self) -> ScanSettings:
        """What it measures with."""
        return self._active

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
        turns = (self._clock.device_s - self._sent_device_s(0)) / self._active.period_s
        return math.floor(turns + 1e-9)

    def _due_telegrams(self, subscribed: set[str]) -> list[tuple[float, bytes]]:
        """Events (due, payload) since the last call that somebody has subscribed to."""
        latest, active, due = self._latest_sweep(), self._active, []
        if "LIDoutputstate" in subscribed and self._next_sweep <= self.settling_scans <= latest:
            due.append(self._outputs_told(self.settling_scans))
        if "LMDscandata" in subscribed:
            kept = math.ceil(KEPT_S / active.period_s)
            for sweep in range(max(self._next_sweep, latest + 1 - kept), latest + 1):
                if sweep % active.content.interval or self._hit(self.drop_rate):
                    continue
                due_s = self._clock.host_s(self._sent_device_s(sweep))
                due.append((due_s, b"sSN LMDscandata " + self._scan(sweep)))
        self._next_sweep = max(self._next_sweep, latest + 1)
        return due

    def _scan(self, sweep: int) -> bytes:
        """The telegram of a sweep that is over, without type and name."""
        if not self.frozen or not self._last_telegram:
            self._last_telegram = self._measured(sweep)
        return self._last_telegram

    def _measured(self, sweep: int) -> bytes:
        active, sent_s = self._active, self._sent_device_s(sweep)
        content, settled = active.content, sweep >= self.settling_scans
        sent_us = self._uptime_us(sent_s)
        self._telegrams += 1
        return ScanTelegram(
            status=b"\0\0" if settled else b"\1\0",
            telegrams=self._telegrams - 1,
            scans=sweep,
            scan_us=sent_us - STAMP_US,
            sent_us=sent_us,
            outputs=b"\4\0" if settled else b"\1\0",
            frequency=active.frequency,
            shots=active.frequency * 36 // active.resolution * 10,
            channels=channels_of(active, self._ranges_mm(sweep)),
            encoders=((0, 0),) if content.encoder else (),
            position=content.position,
            name=b"not defined" if content.name else None,
            comment=b"" if content.comment else None,
            when=self._date(sent_s) if content.time else None,
        ).encode()

    def _ranges_mm(self, sweep: int) -> U16:
        """The codes (n,) of the points of a sweep that are sent."""
        assert self._begin_s is not None
        active = self._active
        index = active.first_index + np.arange(active.points, dtype=np.float64)
        turned_deg = index * (active.resolution / 10_000)
        device_s = self._begin_s + (sweep + turned_deg / 360.0) * active.period_s
        times_s = self._clock.host_times_s(device_s)
        bearings_rad = np.radians(turned_deg + AREA_START / 10_000 - 90.0)
        true_m = self._ranges_m_at(float(times_s[0]), times_s, bearings_rad)
        measured_m = true_m + self.noise_m * self._noise.standard_normal(len(index))
        seen = np.isfinite(measured_m) & (measured_m <= MAX_RANGE_M)
        raw = np.round(1000 * np.where(seen, measured_m, 0.0))
        return np.where(raw >= FIRST_VALID, raw, NO_ECHO).astype(np.uint16)

    def _outputs_told(self, sweep: int) -> tuple[float, bytes]:
        """The event of the outputs' change after the first scans."""
        device_s = self._sent_device_s(sweep)
        values = struct.pack(">HI", 1, self._uptime_us(device_s) % 2**32)
        values += b"".join(struct.pack(">BI", *output) for output in OUTPUTS)
        values += b"\0\1" + time_block(self._date(device_s))
        return self._clock.host_s(device_s), b"sSN LIDoutputstate " + values
