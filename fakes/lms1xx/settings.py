"""What a fake LMS111 is, and what hosts set in it and is kept over a loss of power.

The texts of the LMS10x are recorded; those of the sisters are made after them.
Source: lms111 sheet, sections 1, 3, 4 and 6.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

from fakes.lms1xx import cola
from fakes.lms1xx.cola import WRITE_DENIED, RefusedError, Value
from fakes.lms1xx.scan import (
    AREA_START,
    AREA_STOP,
    CONTENT,
    MODES,
    OUTPUT_RANGE,
    Content,
    ScanSettings,
)

MOST_SCANS = 100  # of the mean filter
FILTERS = {"LFPmeanfilter": ("BHB", (0, 2, 0)), "LFPnto1filter": ("B", (0,)),
           "MSsuppmode": ("B", (0,))}  # fmt: skip

Write = Callable[[tuple[int, ...]], None]


@dataclass(frozen=True, slots=True)
class Model:
    """One kind of device."""

    ident: tuple[bytes, bytes]  # DeviceIdent
    firmware: bytes
    max_range_m: float = 20.0
    telegram_version: int = 1
    refuse: dict[str, int] = field(default_factory=dict)  # kind and name -> sFA code


LMS10X = (b"LMS10x_FieldEval", b"V1.36-21.10.2010")
MODELS = {
    "LMS111": Model(LMS10X, b"V1.80.2  "),
    "LMS100": Model(LMS10X, b"V1.80.1"),
    "LMS100-1.23": Model(LMS10X, b"V1.23", refuse={"sWN LMPoutputRange": WRITE_DENIED}),
    "LMS151": Model(
        (b"LMS15x_FieldEval", b"V1.36-21.10.2010"), b"V1.80.1", max_range_m=50.0, telegram_version=0
    ),
}


class Settings:
    """The settings of one device. They count for its scans from Run on."""

    def __init__(self) -> None:
        self.scan = self._stored = ScanSettings()
        self.filters = {name: values for name, (_, values) in FILTERS.items()}
        self._filters_stored = dict(self.filters)

    def load(self) -> None:
        """At power-up: what was stored."""
        self.scan, self.filters = self._stored, dict(self._filters_stored)

    def store(self) -> list[Value]:
        """Keep all; the values of the answer."""
        self._stored, self._filters_stored = self.scan, dict(self.filters)
        return [("B", 1)]

    def writers(self) -> dict[str, tuple[str, Write]]:
        """Variable -> kinds of its values, and what takes them."""
        return {
            "LMPoutputRange": (OUTPUT_RANGE, self._set_output_range),
            "LMDscandatacfg": (CONTENT, self._set_content),
            **{name: (FILTERS[name][0], partial(self._set_filter, name)) for name in FILTERS},
        }

    def _set_content(self, values: tuple[int, ...]) -> None:
        content = Content(*values)
        if not content.is_possible:
            raise RefusedError(cola.CONDITION_FAILED)
        self.scan = replace(self.scan, content=content)

    def _set_filter(self, name: str, values: tuple[int, ...]) -> None:
        if values[0] > 1 or (name == "LFPmeanfilter" and not 2 <= values[1] <= MOST_SCANS):
            raise RefusedError(cola.CONDITION_FAILED)
        self.filters[name] = values

    def set_scan_config(self, values: tuple[int, ...]) -> list[Value]:
        """What `mLMPsetscancfg` asks for; the values of the answer."""
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
            self.scan = replace(self.scan, frequency=frequency, resolution=resolution)
        return [("B", status), *self.scan.scan_config()]

    def _set_output_range(self, values: tuple[int, ...]) -> None:
        count, _, start, stop = values
        if count != 1 or not AREA_START <= start <= stop <= AREA_STOP:
            raise RefusedError(cola.CONDITION_FAILED)
        self.scan = replace(self.scan, start=start, stop=stop)
