"""Which output of an MTi fits its line: bytes a second against the baud rate.

A sample that the line cannot carry is lost in the device, or the device says "timer overflow". So
what is not needed is left out first (magnetic field, acceleration), then the rate of turn, which
mapod can do without, and only then the rate is lowered.
Source: MTi sheet, sections 3, 4, 5 and 7.
"""

from dataclasses import dataclass

from hw.mti.mtdata import (
    CALIBRATED,
    COUNTER,
    NO_ACCELERATION,
    NO_MAGNETIC,
    ORIENTATION,
    MtDataDecoder,
)
from hw.mti.sample import EULER

FRAME_BYTES = 5  # around the data
LINE_SHARE = 0.97  # of the baud rate: 55-byte frames at 200 Hz are 95.5 % of 115200
TICKS_PER_S = 115200  # of the period
MIN_PERIOD, MAX_PERIOD = 225, 0xFFFF
EULER_COUNTER = EULER << 2 | COUNTER

PACKET_COUNTER, FINE_TIME, RATE_OF_TURN, MAGNETIC = 0x1020, 0x1060, 0x8020, 0xC020
QUATERNION_PACKET, EULER_PACKET = 0x2010, 0x2030
PACKET_BYTES = {  # with head
    PACKET_COUNTER: 5,
    FINE_TIME: 7,
    QUATERNION_PACKET: 19,
    EULER_PACKET: 15,
    RATE_OF_TURN: 15,
    MAGNETIC: 15,
}
ALWAYS = 0xFFFF  # the "rate" of packets that come with every message
NAMES = {  # of outputs without which something is missing
    QUATERNION_PACKET: "2010 (quaternion, float32, ENU)",
    EULER_PACKET: "2030 (Euler angles, float32, ENU)",
    RATE_OF_TURN: "8020 (rate of turn, float32)",
}
NEW_RATES_HZ = (400, 200, 100, 80, 50, 40, 25, 20, 16, 10, 8, 5, 4, 2, 1)  # parts of 400


@dataclass(frozen=True, slots=True)
class LegacyOutput:
    """Output mode and settings of MTData, and its period."""

    mode: int
    settings: int
    period: int  # 1/115200 s
    remark: str = ""  # what is not as configured


@dataclass(frozen=True, slots=True)
class NewOutput:
    """Outputs of MTData2: identifier and Hz."""

    outputs: tuple[tuple[int, int], ...]
    rate_hz: int
    remark: str = ""


LEGACY_CHOICES = (  # mode, settings, whether the rate of turn is in it
    (CALIBRATED | ORIENTATION, EULER_COUNTER, True),
    (CALIBRATED | ORIENTATION, EULER_COUNTER | NO_MAGNETIC, True),
    (CALIBRATED | ORIENTATION, EULER_COUNTER | NO_MAGNETIC | NO_ACCELERATION, True),
    (ORIENTATION, EULER_COUNTER, False),
)
NEW_CHOICES = (
    (PACKET_COUNTER, FINE_TIME, QUATERNION_PACKET, RATE_OF_TURN, MAGNETIC),
    (PACKET_COUNTER, FINE_TIME, QUATERNION_PACKET, RATE_OF_TURN),
    (PACKET_COUNTER, FINE_TIME, EULER_PACKET, RATE_OF_TURN),
    (PACKET_COUNTER, FINE_TIME, EULER_PACKET),
)


def carried_hz(data_size: int, baud: int) -> float:
    """How many messages of so many data bytes a line carries in a second.

    >>> round(carried_hz(50, 115200))
    203
    """
    return LINE_SHARE * baud / 10 / (FRAME_BYTES + data_size)


def legacy_output(rate_hz: float, baud: int) -> LegacyOutput:
    """The fullest output at this rate; the smallest at a lower one where none fits."""
    period = min(MAX_PERIOD, max(MIN_PERIOD, round(TICKS_PER_S / rate_hz)))
    wanted_hz = TICKS_PER_S / period
    for mode, settings, with_rate in LEGACY_CHOICES:
        if carried_hz(MtDataDecoder(mode, settings).size, baud) >= wanted_hz:
            remark = "" if with_rate else _without_rate(baud, rate_hz)
            return LegacyOutput(mode, settings, period, remark)
    mode, settings, _ = LEGACY_CHOICES[-2]
    most_hz = carried_hz(MtDataDecoder(mode, settings).size, baud)
    period = min(MAX_PERIOD, -int(-TICKS_PER_S // most_hz))
    return LegacyOutput(mode, settings, period, _too_slow(baud, TICKS_PER_S / period, rate_hz))


def new_outputs(rate_hz: float, baud: int) -> list[NewOutput]:
    """What to ask for, in this order, until the device takes it; never empty."""
    wanted_hz, found = max(1, round(rate_hz)), []
    for choice in NEW_CHOICES:
        if _carried_hz_of(choice, baud) >= wanted_hz:
            remark = "" if RATE_OF_TURN in choice else _without_rate(baud, rate_hz)
            found.append(_new_output(choice, wanted_hz, remark))
    choice = NEW_CHOICES[2]
    most_hz = min(_carried_hz_of(choice, baud), wanted_hz - 1)
    lower_hz = next((hz for hz in NEW_RATES_HZ if hz <= most_hz), 1)
    return [*found, _new_output(choice, lower_hz, _too_slow(baud, lower_hz, rate_hz))]


def _carried_hz_of(choice: tuple[int, ...], baud: int) -> float:
    return carried_hz(sum(PACKET_BYTES[identifier] for identifier in choice), baud)


def _new_output(choice: tuple[int, ...], rate_hz: int, remark: str) -> NewOutput:
    always = (PACKET_COUNTER, FINE_TIME)
    outputs = tuple((output, ALWAYS if output in always else rate_hz) for output in choice)
    return NewOutput(outputs, rate_hz, remark)


def _without_rate(baud: int, rate_hz: float) -> str:
    return (
        f"{baud} baud carry no rate of turn at {rate_hz:g} samples a second: "
        "raise the baud rate or lower the rate"
    )


def _too_slow(baud: int, given_hz: float, rate_hz: float) -> str:
    return (
        f"{baud} baud carry {given_hz:.4g} samples a second, not {rate_hz:g} as configured: "
        "raise the baud rate"
    )
