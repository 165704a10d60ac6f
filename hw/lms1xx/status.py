"""What a SICK LMS1xx says about itself: states, device status, contamination; what each means.

Source: lms111 sheet, sections 3 and 5.
"""

from collections.abc import Collection
from dataclasses import dataclass, field

READY = 7
CONFIGURING, IDLE = 2, 3
STATES = {
    0: "undefined",
    1: "initialising",
    2: "being configured",
    3: "idle",
    4: "its mirror is speeding up",
    5: "in preparation",
    6: "ready, but not for measurement",
    7: "measuring",
}
CONFIG_FAULTS = {
    1: "bad frequency",
    2: "bad resolution",
    3: "bad frequency and resolution",
    4: "bad area",
}
CONTAMINATIONS = {
    1: "has a dirty window (warning): clean it",
    2: "has a dirty window (error): clean it",
    3: "has a window too dirty to see through: clean it",
}
TOO_DIRTY = 2  # contamination from which "nothing there" is not believed
HOT = "is out of its range of temperatures"
TOO_DIRTY = 2  # contamination from which a scan's "nothing there" is not believed
STATUS_OK = 0
STATUS_DOUBT = "a warning, an error, or not valid yet"  # all that the sheet says of other values


def is_usable(status: tuple[int, int], accepted: Collection[int]) -> bool:
    """Whether scans with that device status may be believed.

    Which of its two bytes says what is not documented, so both count as one value.

    Args:
        accepted: values beside 0 for which a person has found out that scans are good.
    """
    value = status[0] | status[1]
    return value == STATUS_OK or value in accepted


@dataclass(frozen=True, slots=True)
class ScannerCondition:
    """How the scanner is, as far as it has said."""

    contamination: int | None = None  # 0 clean, 1 warning, 2 error, 3 fatal
    temperature_ok: bool | None = None
    device_status: tuple[int, int] = (0, 0)  # of the newest scan
    beams_lost: dict[str, int] = field(default_factory=dict)  # used beams of it, by cause
    firmware: str = ""
    serial_number: int | None = None

    @property
    def message(self) -> str:
        """What is not well, in one sentence without its subject; "" if all is."""
        faults = [
            CONTAMINATIONS.get(self.contamination or 0, ""),
            HOT if self.temperature_ok is False else "",
            describe_status(self.device_status) if any(self.device_status) else "",
        ]
        return ", ".join(fault for fault in faults if fault)


def describe_status(status: tuple[int, int]) -> str:
    """A device status that is not 0, without its subject."""
    return f"sends scans with device status {status[0]} {status[1]} ({STATUS_DOUBT})"
