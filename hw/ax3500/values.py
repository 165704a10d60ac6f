"""What an AX3500 tells beside its counters: answers as SI values, status bits with their meaning.

Source: AX3500 sheet, sections 4 and 7.
"""

from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from hw.ax3500.lines import BATTERY_V, INTERNAL_V, celsius_from_thermistor, maybe_byte

READ_STATUS, READ_INPUTS = "^89", "?I"
VALUES = {READ_STATUS: 1, READ_INPUTS: 3, "?E": 2, "?A": 2, "?M": 2}  # lines of each answer
STATUS_BITS = {
    0: "overvoltage",
    1: "overtemperature",
    2: "undervoltage",
    3: "outputs forced off",
    5: "short circuit",
    6: "encoder error",
    7: "emergency stop",
}
POWER_OFF = 0b1010_1111  # bits with which the counters may still be believed
AMPS_DIVIDERS = {3: 2.0, 1: 4.0, 2: 1.0}  # bit of the identity: AX3500, AX1500, AX2500/2850

Both = tuple[float, float]


class ControllerState(Struct, frozen=True):
    """The newest of each value; None before it was heard, and where it is refused."""

    battery_v: float | None = None
    internal_v: float | None = None
    amps: Both | None = None  # of the battery, channel 1 and 2
    celsius: Both | None = None  # heat sinks
    emergency_stop: bool | None = None  # True: pressed
    status: int | None = None  # bits of ^89
    taken_s: dict[str, float] = {}  # host clock, by query
    trouble: str = ""  # why the motors get nothing; "" where nothing is known against them

    @property
    def cuts_off(self) -> bool:
        """Whether it says that the power stage is off, which is all that is wrong."""
        status = self.status or 0
        return (status > 0 or self.emergency_stop is True) and not status & ~POWER_OFF

    def measured(self) -> dict[str, float]:
        numbers = {"battery_v": self.battery_v, "internal_v": self.internal_v}
        for name, both in (("amps", self.amps), ("celsius", self.celsius)):
            numbers[f"{name}_1"], numbers[f"{name}_2"] = both or (None, None)
        return {name: round(number, 2) for name, number in numbers.items() if number is not None}


def describe_status(status: int) -> tuple[str, ...]:
    """The set bits of `^89`; bit 4 has no meaning in the manual.

    >>> describe_status(0x82)
    ('overtemperature', 'emergency stop')
    """
    return tuple(STATUS_BITS.get(k, f"status bit {k}") for k in range(8) if status >> k & 1)


def state_after_answer(
    state: ControllerState, query: str, texts: list[str], taken_s: float, identity: int | None
) -> ControllerState | None:
    """The state with the values of one answer; None where a line is damaged.

    A refusal (one line `-`) clears the values: what is not told any more is not known.
    """
    if texts == ["-"]:
        changes: dict[str, Any] = dict.fromkeys(_decoded(query, [0, 0, 0], identity))
    else:
        numbers = [value for value in map(maybe_byte, texts) if value is not None]
        if len(numbers) != VALUES[query] or len(texts) != len(numbers):
            return None
        if query == READ_INPUTS and not set(numbers) <= {0, 1}:
            return None
        changes = _decoded(query, numbers, identity)
    changes["taken_s"] = state.taken_s | {query: taken_s}
    new = replace(state, **changes)
    reasons = [f"the controller reports {bit}" for bit in describe_status(new.status or 0)]
    reasons += ["the emergency stop is pressed"] if new.emergency_stop else []
    return replace(new, trouble="; ".join(reasons))


def _decoded(query: str, numbers: list[int], identity: int | None) -> dict[str, Any]:
    match query:
        case "?A":
            divider = _maybe_amps_divider(identity)
            return {"amps": divider and (numbers[0] / divider, numbers[1] / divider)}
        case "?M":
            return {"celsius": tuple(map(celsius_from_thermistor, numbers[:2]))}
        case "?E":
            battery_v, internal_v = numbers[0] * BATTERY_V, numbers[1] * INTERNAL_V
            return {"battery_v": battery_v, "internal_v": internal_v}
        case "?I":  # inputs E and F have no reader
            return {"emergency_stop": numbers[2] == 0}
    return {"status": numbers[0]}


def _maybe_amps_divider(identity: int | None) -> float | None:
    found = [AMPS_DIVIDERS[bit] for bit in (3, 1, 2) if (identity or 0) >> bit & 1]
    return found[0] if found else None
