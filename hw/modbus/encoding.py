"""SI numbers to what a register holds: scaled, rounded, kept within its range.

What is not known never looks better than it is: an age or an obstacle's distance that is not a
number becomes the worst value of its register.
"""

import math

from hw.modbus.layout import NOT_KNOWN


def bounded(value: float, lowest: int, highest: int) -> int:
    """Rounded, within the range; 0 for what is no number.

    >>> bounded(1.6, 0, 10), bounded(-3.0, 0, 10), bounded(math.inf, 0, 10), bounded(math.nan, 0, 1)
    (2, 0, 10, 0)
    """
    if math.isnan(value):
        return 0
    return round(max(lowest, min(highest, value)))


def mm_signed(metres: float) -> int:
    """A coordinate, int32 mm.

    >>> mm_signed(-1.2346)
    -1235
    """
    return bounded(metres * 1000.0, -(2**31), 2**31 - 1)


def way(metres: float) -> int:
    """A free way or an allowed speed in thousandths, rounded down, at most 65534.

    >>> way(1.9999), way(math.nan), way(math.inf)
    (1999, 0, 65534)
    """
    return int(max(0.0, min(65534.0, metres * 1000.0))) if not math.isnan(metres) else 0


def distance_mm(metres: float) -> int:
    """To an obstacle, rounded down; inf is "none is known", no number is 0: right here.

    >>> distance_mm(0.3), distance_mm(math.inf), distance_mm(100.0), distance_mm(math.nan)
    (300, 65535, 65534, 0)
    """
    return NOT_KNOWN if metres == math.inf else way(metres)


def age_ms(seconds: float) -> int:
    """An age; 65535 when there is none, or it is 65.5 s and more.

    >>> age_ms(0.0124), age_ms(math.inf), age_ms(math.nan), age_ms(70.0), age_ms(-0.001)
    (12, 65535, 65535, 65535, 0)
    """
    return bounded(seconds * 1000.0, 0, NOT_KNOWN) if not math.isnan(seconds) else NOT_KNOWN


def cdeg_signed(radians: float) -> int:
    """An angle or a rate of turn, int16 hundredths of a degree.

    >>> cdeg_signed(math.pi / 2), cdeg_signed(-math.pi)
    (9000, -18000)
    """
    return bounded(math.degrees(radians) * 100.0, -32768, 32767)


def heading_cdeg(yaw_rad: float) -> int:
    """0 to 35999, counter-clockwise from x.

    >>> heading_cdeg(-math.pi / 2), heading_cdeg(-1e-9), heading_cdeg(math.nan)
    (27000, 0, 0)
    """
    return round(math.degrees(yaw_rad) * 100.0) % 36000 if math.isfinite(yaw_rad) else 0


def thousandths_signed(value: float) -> int:
    """A speed in mm/s or a rate in mrad/s, int16."""
    return bounded(value * 1000.0, -32768, 32767)
