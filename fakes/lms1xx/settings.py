"""What hosts set in a fake LMS111 and when it counts: at once, after Run, after the next power-up.

Source: lms111 sheet, sections 3 and 4.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from functools import partial

from fakes.lms1xx import cola
from fakes.lms1xx.cola import RefusedError
from fakes.lms1xx.cola_values import Value
from fakes.lms1xx.head import F64, MOST_SCANS, LaserHead
from fakes.lms1xx.scan import (
    AREA_START,
    AREA_STOP,
    CONTENT,
    MODES,
    OUTPUT_RANGE,
    Content,
    ScanSettings,
)

PLAIN = {"LFPmeanfilter": ("BHB", (0, 2, 0)), "LFPnto1filter": ("B", (0,)),
         "MSsuppmode": ("B", (0,))}  # fmt: skip

Write = Callable[[tuple[int, ...]], None]


class SettableHead(LaserHead):
    """A laser head with settings: those written, those it measures with, those it keeps."""

    def __init__(self, ranges_m_at: Callable[[float, F64, F64], F64], seed: int) -> None:
        super().__init__(ranges_m_at, seed)
        self.stores = 0  # times that its memory was written
        self._settings = self._stored = ScanSettings()
        self._plain = {name: values for name, (_, values) in PLAIN.items()}
        self._plain_stored = dict(self._plain)
        self._binary_next = True  # EIHstCola; counts from the next connection on
        self._changed_s = -math.inf  # device time at which that was set

    def _load(self) -> None:
        """At power-up: what was stored."""
        self._settings = self._active = self._stored
        self._plain = dict(self._plain_stored)
        self._changed_s = -math.inf
        self._set_filters()

    def _writers(self) -> dict[str, tuple[str, Write]]:
        """Variable -> kinds of its values, and what takes them."""
        return {
            "LMPoutputRange": (OUTPUT_RANGE, self._set_output_range),
            "LMDscandatacfg": (CONTENT, self._set_content),
            "EIHstCola": ("B", self._set_dialect),
            **{plain: (PLAIN[plain][0], partial(self._set_plain, plain)) for plain in PLAIN},
        }

    def _set_filters(self) -> None:
        """As they are set; they count from now on."""
        on, scans, _ = self._plain["LFPmeanfilter"]
        self.mean_scans = scans if on else 0
        self.two_in_a_row = bool(self._plain["LFPnto1filter"][0])

    def _store(self) -> list[Value]:
        self._stored, self._plain_stored = self._settings, dict(self._plain)
        self.stores += 1
        return [("B", 1)]

    def _set_content(self, values: tuple[int, ...]) -> None:
        content = Content.maybe_from(values)
        if content is None:
            raise RefusedError(cola.CONDITION_FAILED)
        self._settings = replace(self._settings, content=content)

    def _set_dialect(self, values: tuple[int, ...]) -> None:
        if values[0] > 1:
            raise RefusedError(cola.CONDITION_FAILED)
        self._binary_next, self._changed_s = bool(values[0]), self._clock.device_s

    def _set_plain(self, name: str, values: tuple[int, ...]) -> None:
        if values[0] > 1 or (name == "LFPmeanfilter" and not 2 <= values[1] <= MOST_SCANS):
            raise RefusedError(cola.CONDITION_FAILED)
        self._plain[name] = values

    def _set_scan_config(self, values: tuple[int, ...]) -> list[Value]:
        frequency, sectors, resolution, start, stop = values
        bad_frequency = frequency not in (mode[0] for mode in MODES)
        bad_resolution = resolution not in (mode[1] for mode in MODES)
        status = bad_frequency + 2 * bad_resolution
        if not status and (frequency, resolution) not in MODES:
            status = 2
        elif not status and not AREA_START <= start < stop <= AREA_STOP:
            status = 4
        elif not status and sectors != 1:
            status = 5
        if not status:
            self._settings = replace(self._settings, frequency=frequency, resolution=resolution)
        return [("B", status), *self._settings.scan_config()]

    def _set_output_range(self, values: tuple[int, ...]) -> None:
        count, _, start, stop = values
        if count != 1 or not AREA_START <= start <= stop <= AREA_STOP:
            raise RefusedError(cola.CONDITION_FAILED)
        self._settings = replace(self._settings, start=start, stop=stop)

    def _set_time(self, values: tuple[int, ...]) -> list[Value]:
        try:
            when = datetime(*values)  # type: ignore[arg-type]
        except ValueError:
            return [("B", 0)]
        if not 1970 <= when.year < 2100:
            return [("B", 0)]
        self._clock_set = when - timedelta(microseconds=self._uptime_us(self._clock.device_s))
        return [("B", 1)]
