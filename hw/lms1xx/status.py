"""What a SICK LMS1xx says about itself: states, device status, contamination, in words.

Source: lms111 sheet, sections 3 and 5.
"""

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
# The sheet calls all but 0 "warning, error or not yet valid"; the recorded device sends 1 with
# scans that are not valid yet. These meanings are recalled, not confirmed.
STATUS_OK, STATUS_ERROR, STATUS_DIRTY, STATUS_BLIND = 0, 1, 2, 4
STATUSES = {
    STATUS_ERROR: "error, or not valid yet",
    STATUS_DIRTY: "dirty window, a warning",
    STATUS_BLIND: "dirty window, an error",
}


def is_usable(status: tuple[int, int]) -> bool:
    """Whether scans with that device status may be believed: a mere warning does not blind.

    Which of both bytes carries the warning is not confirmed: either will do.
    """
    return (status[0] | status[1]) in (STATUS_OK, STATUS_DIRTY)


def status_in_words(status: tuple[int, int]) -> str:
    """A device status with its meaning, if that is known."""
    meaning = STATUSES.get(status[0] | status[1])
    return f"{status[0]} {status[1]}" + (f" ({meaning})" if meaning else "")


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
    def words(self) -> str:
        """What is not well, in one sentence without its subject; "" if all is."""
        words = [
            CONTAMINATIONS.get(self.contamination or 0, ""),
            HOT if self.temperature_ok is False else "",
        ]
        if not self.contamination and self.device_status != (0, 0):
            words.append(f"sends scans with device status {status_in_words(self.device_status)}")
        return ", ".join(word for word in words if word)


def is_dirty(contamination: int | None, device_status: tuple[int, int]) -> bool:
    """Whether the scanner's window is contaminated, be it as a warning."""
    by_status = device_status[0] | device_status[1]
    return bool(contamination or by_status & (STATUS_DIRTY | STATUS_BLIND))
