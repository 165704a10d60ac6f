"""What a fake LMS111 is, and what hosts set in it and is kept over a loss of power.

The texts of the LMS10x are recorded; those of the sisters are made after them.
Source: lms111 sheet, sections 1, 3, 4 and 6.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from fakes.lms1xx.cola import CONDITION_FAILED, WRITE_DENIED, RefusedError, Value, fields
from fakes.lms1xx.scan import AREA_START, AREA_STOP, MODES, Content, ScanSettings

MOST_SCANS = 100  # of the mean filter
REPORTED_RESOLUTION = 5000  # in LMPoutputRange of many, at whatever resolution they scan
SCAN_CONFIG = "IHIii"  # of LMPscancfg and mLMPsetscancfg


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


def _is_area(count: int, step: int, start: int, stop: int) -> bool:
    return count == 1 and AREA_START <= start <= stop <= AREA_STOP


WRITABLE: dict[str, tuple[str, tuple[int, ...], Callable[..., bool]]] = {
    # kinds of its values, values as delivered, which are taken
    "LMPoutputRange": ("HIii", (1, 5000, AREA_START, AREA_STOP), _is_area),
    "LMDscandatacfg": ("BBBBBBBBBBBH", Content(), lambda *values: Content(*values).is_possible),
    "LFPmeanfilter": ("BHB", (0, 2, 0), lambda on, scans, _: on <= 1 and 2 <= scans <= MOST_SCANS),
    "LFPnto1filter": ("B", (0,), lambda on: on <= 1),
    "MSsuppmode": ("B", (0,), lambda fog: fog <= 1),
}


class Settings:
    """The settings of one device. They count for its scans from Run on."""

    def __init__(self) -> None:
        self._mode = MODES[0]
        self._values = {name: delivered for name, (_, delivered, _) in WRITABLE.items()}
        self._stored = self._mode, dict(self._values)

    def load(self) -> None:
        self._mode, self._values = self._stored[0], dict(self._stored[1])

    def store(self) -> list[Value]:
        """Keep all; the values of the answer."""
        self._stored = self._mode, dict(self._values)
        return [("B", 1)]

    @property
    def scan(self) -> ScanSettings:
        _, _, start, stop = self._values["LMPoutputRange"]
        return ScanSettings(*self._mode, start, stop, Content(*self._values["LMDscandatacfg"]))

    @property
    def filters(self) -> tuple[int, bool]:
        """Over how many scans the mean filter works (0: it is off); the n-to-1 filter."""
        on, scans, _ = self._values["LFPmeanfilter"]
        return scans if on else 0, bool(self._values["LFPnto1filter"][0])

    def read(self, name: str, untrue_step: bool) -> list[Value]:
        kinds, values = WRITABLE[name][0], self._values[name]
        if name == "LMPoutputRange":
            step = REPORTED_RESOLUTION if untrue_step else self._mode[1]
            values = (values[0], step, *values[2:])
        return fields(kinds, *values)

    def write(self, name: str, values: tuple[int, ...]) -> None:
        """As a host says.

        Raises:
            RefusedError: it does not take such values.
        """
        if not WRITABLE[name][2](*values):
            raise RefusedError(CONDITION_FAILED)
        self._values[name] = values

    def read_scan_config(self) -> list[Value]:
        """Of LMPscancfg: the area is always that of the mirror."""
        frequency, resolution = self._mode
        return fields(SCAN_CONFIG, frequency, 1, resolution, AREA_START, AREA_STOP)

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
            self._mode = (frequency, resolution)
        return [("B", status), *self.read_scan_config()]
