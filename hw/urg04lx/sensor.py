"""What a Hokuyo scanner says of itself: statuses, error codes instead of ranges, its geometry.

Source: urg04lx sheet, sections 1, 3, 5 and 6.
"""

import math
import re
from collections.abc import Mapping

from msgspec import Struct

from hw.urg04lx.scip import Reply

OK, DATA, LASER_OFF, SUSPENDED, RESUMED = "00", "99", "10", range(21, 50), "98"
UNKNOWN = ("0D", "0E")  # commands, as in the mode of time synchronisation
RATE_KEPT = ("03", "04")  # it has that rate, or none: by USB
SCIP1_REFUSES = "E"
LEAST_RANGE_MM = 20  # smaller values say why there is no range
MOST_STEPS = 10_000  # as many as four digits of a request can name
MOST_TWO_CHARACTERS = 4095  # as far as two characters reach: so far, or farther
SCANS = ("GD", "GS", "MD", "MS")  # commands
OF_SCANS = {  # statuses 01 to 07 mean something else with each command
    "01": "the first step is no number",
    "02": "the last step is no number",
    "03": "the cluster is no number",
    "04": "the last step is beyond its range",
    "05": "the last step is before the first",
    "06": "the interval is no number",
    "07": "the count of scans is no number",
}
OF_ANY = {
    "0A": "it cannot build a reply",
    "0B": "its buffer is short, or a command was repeated",
    "0C": "too few parameters",
    "0D": "it does not know the command",
    "0E": "it does not know the command",
    "0F": "too few parameters",
    "0G": "the text of the request is too long",
    "0H": "the text of the request has wrong letters",
    "0I": "it waits for new firmware",
    LASER_OFF: "its laser is off",
    SCIP1_REFUSES: "it has restarted, and speaks SCIP 1.1",
}


def describe_status(status: str, command: str) -> str:
    """What a status other than good means, in answer to that command.

    >>> describe_status("10", "GD0044072500"), describe_status("63", "MD0044072500000")
    ('its laser is off (status 10)', 'it has trouble with its hardware (status 63)')
    >>> describe_status("01", "BM"), describe_status("01", "TM2")
    ('its laser has a fault (status 01)', 'status 01 of TM2')
    """
    known = OF_ANY.get(status, "")
    if status in OF_SCANS and command[:2] in SCANS:
        known = OF_SCANS[status]
    elif (status, command) == ("01", "BM"):
        known = "its laser has a fault"
    elif status in OF_SCANS:
        return f"status {status} of {command}"
    elif status.isdigit():
        number = int(status)
        known = known or ("it has stopped to check an error" if number in SUSPENDED else "")
        known = known or ("it has trouble with its hardware" if 50 <= number <= 97 else "")
    return f"{known or 'it says what is not documented'} (status {status})"


class Sensor(Struct, frozen=True):
    """What `PP` tells: steps of a turn, and which of them are measured."""

    model: str
    least_mm: int
    most_mm: int
    steps: int  # of a whole turn
    first_step: int
    last_step: int
    front_step: int
    turns_per_min: float

    @property
    def turn_s(self) -> float:
        return 60.0 / self.turns_per_min

    @property
    def step_rad(self) -> float:
        return math.tau / self.steps


NAMES = {
    "DMIN": "least_mm",
    "DMAX": "most_mm",
    "ARES": "steps",
    "AMIN": "first_step",
    "AMAX": "last_step",
    "AFRT": "front_step",
    "SCAN": "turns_per_min",
}


def texts_of(reply: Reply) -> Mapping[str, str]:
    """The lines KEY:text; of VV, PP and II."""
    pairs = (line.decode("latin-1").rstrip(";").partition(":") for line in reply.lines)
    return {key.strip(): text.strip() for key, _, text in pairs}


def maybe_sensor(reply: Reply) -> Sensor | None:
    """What an answer to PP tells, if that can be a scanner."""
    texts = texts_of(reply)
    numbers = {name: texts.get(key, "") for key, name in NAMES.items()}
    if not all(text.isdecimal() and len(text) <= 6 for text in numbers.values()):
        return None
    found = Sensor(texts.get("MODL", ""), **{name: int(text) for name, text in numbers.items()})
    is_turn = found.steps > 0 and found.turns_per_min > 0
    is_part = 0 <= found.first_step <= found.last_step < min(2 * found.steps, MOST_STEPS)
    is_range = 0 < found.least_mm < found.most_mm
    is_ahead = found.first_step <= found.front_step <= found.last_step
    return found if is_turn and is_part and is_range and is_ahead else None


def maybe_ticks(reply: Reply) -> int | None:
    """The device's time in an answer to II: 24 bits of ms, in hexadecimal."""
    text = texts_of(reply).get("TIME", "")
    return int(text, 16) if re.fullmatch(r"[0-9A-Fa-f]{6}", text) else None
