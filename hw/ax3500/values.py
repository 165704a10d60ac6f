"""What an AX3500 tells beside its counters: answers and logging lines as SI values, bits as words.

Source: AX3500 sheet, sections 4, 7 and 8.
"""

from dataclasses import dataclass, field, replace
from typing import Any

from hw.ax3500.lines import (
    LOG_LINE,
    battery_v_from_byte,
    celsius_from_thermistor,
    internal_v_from_byte,
    maybe_byte,
)

READ_STATUS = "^89"
VALUES = {"?V": 2, "?A": 2, "?P": 2, "?R": 2, "?M": 2, "?E": 2, "?I": 3, "?Z": 2, READ_STATUS: 1}
STATUS_BITS = {
    0: "overvoltage",
    1: "overtemperature",
    2: "undervoltage",
    3: "outputs forced off",
    5: "short circuit",
    6: "encoder error",
    7: "emergency stop",
}
AMPS_DIVIDERS = {3: 2.0, 1: 4.0, 2: 1.0}  # bit of the identity: AX3500, AX1500, AX2500/2850

Both = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ControllerState:
    """The newest of each value; None before it was heard, and where it is refused."""

    battery_v: float | None = None
    internal_v: float | None = None
    amps: Both | None = None  # of the battery, channel 1 and 2
    celsius: Both | None = None  # heat sinks
    analog_v: tuple[Both | None, Both | None] = (None, None)  # inputs 1, 2 and 3, 4; 0..5 V
    inputs: tuple[bool, bool] | None = None  # E, F
    emergency_stop: bool | None = None  # True: pressed
    status: int | None = None  # bits of ^89
    powers: Both | None = None  # 0..1, without direction
    speeds_raw: tuple[int, int] | None = None  # steps of the controller's time base
    commands: Both | None = None  # -1..1, of radio or joystick; from logging lines alone
    watchdog_stops: int = 0
    motors_off: str = ""  # what keeps the motors at zero beside status and stop button, in words
    taken_s: dict[str, float] = field(default_factory=dict)  # host clock, by field's name

    @property
    def status_words(self) -> tuple[str, ...]:
        """The set status bits, in words."""
        return words_from_status(self.status or 0)

    @property
    def trouble(self) -> str:
        """Why the motors get nothing, in words; "" where nothing is known against them."""
        if not (self.status or self.emergency_stop or self.motors_off):
            return ""
        words = [f"the controller reports {word}" for word in self.status_words]
        if self.emergency_stop:
            words.append("the emergency stop is pressed")
        if self.motors_off:
            words.append(self.motors_off)
        return "; ".join(words)


def words_from_status(status: int) -> tuple[str, ...]:
    """The set bits of `^89`, in words; bit 4 has no meaning in the manual.

    >>> words_from_status(0x82)
    ('overtemperature', 'emergency stop')
    """
    return tuple(STATUS_BITS.get(k, f"status bit {k}") for k in range(8) if status >> k & 1)


def signed_byte(value: int) -> int:
    """Two's complement: 0x81 is -127."""
    return value - 256 if value >= 128 else value


def volts_from_analog(value: int) -> float:
    """An analog input, 0..5 V, from the raw byte (section 4): -127, 0, 127 are 0, 2.5, 5 V."""
    return max(0.0, 2.5 + 2.5 * signed_byte(value) / 127.0)


def maybe_amps_divider(identity: int | None) -> float | None:
    """By model; None where the model's scale is not known."""
    found = [AMPS_DIVIDERS[bit] for bit in (3, 1, 2) if (identity or 0) >> bit & 1]
    return found[0] if found else None


def state_after_answer(
    state: ControllerState, query: str, texts: list[str], taken_s: float, identity: int | None
) -> ControllerState | None:
    """The state with the values of one answer; None where a line is damaged.

    A refusal (one line `-`) clears the values: what is not told any more is not known.
    """
    if texts == ["-"]:
        return _with(state, _refused(state, query), taken_s)
    numbers = [value for value in map(maybe_byte, texts) if value is not None]
    if len(numbers) != VALUES[query] or len(texts) != len(numbers):
        return None
    if query == "?I" and not set(numbers) <= {0, 1}:
        return None
    return _with(state, _decoded(state, query, numbers, identity), taken_s)


def maybe_state_after_log_line(
    state: ControllerState, text: str, taken_s: float, identity: int | None
) -> ControllerState | None:
    """The state with the values of a logging line (section 8); None where it is none."""
    if not LOG_LINE.fullmatch(text):
        return None
    numbers = list(bytes.fromhex(text[1:]))
    one, two = (signed_byte(number) / 127.0 for number in numbers[:2])
    changes: dict[str, Any] = {"commands": (one, two)}
    for k, query in enumerate(("?V", "?P", "?A", "?M", "?E"), start=1):
        changes |= _decoded(state, query, numbers[2 * k : 2 * k + 2], identity)
    return _with(state, changes, taken_s)


def _refused(state: ControllerState, query: str) -> dict[str, Any]:
    """The fields of a query, unknown."""
    first, second = state.analog_v
    match query:
        case "?E":
            return {"battery_v": None, "internal_v": None}
        case "?I":
            return {"inputs": None, "emergency_stop": None}
        case "?P":
            return {"analog_v": (None, second)}
        case "?R":
            return {"analog_v": (first, None)}
    field_of = {"?V": "powers", "?A": "amps", "?M": "celsius", "?Z": "speeds_raw"}
    return {field_of.get(query, "status"): None}


def _decoded(
    state: ControllerState, query: str, numbers: list[int], identity: int | None
) -> dict[str, Any]:
    match query:
        case "?V":
            return {"powers": (numbers[0] / 127.0, numbers[1] / 127.0)}
        case "?A":
            divider = maybe_amps_divider(identity)
            amps = None if divider is None else (numbers[0] / divider, numbers[1] / divider)
            return {"amps": amps}
        case "?P" | "?R":
            volts = (volts_from_analog(numbers[0]), volts_from_analog(numbers[1]))
            first, second = state.analog_v
            return {"analog_v": (volts, second) if query == "?P" else (first, volts)}
        case "?M":
            return {"celsius": tuple(map(celsius_from_thermistor, numbers))}
        case "?E":
            battery_v, internal_v = (
                battery_v_from_byte(numbers[0]),
                internal_v_from_byte(numbers[1]),
            )
            return {"battery_v": battery_v, "internal_v": internal_v}
        case "?I":
            return {"inputs": (numbers[0] == 1, numbers[1] == 1), "emergency_stop": numbers[2] == 0}
        case "?Z":
            return {"speeds_raw": tuple(map(signed_byte, numbers))}
    return {"status": numbers[0]}


def _with(state: ControllerState, changes: dict[str, Any], taken_s: float) -> ControllerState:
    return replace(state, **changes, taken_s=state.taken_s | dict.fromkeys(changes, taken_s))
