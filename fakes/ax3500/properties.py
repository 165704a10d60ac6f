"""What can be set of the fake AX3500 by name: faults, what its sheet leaves open, its flash.

Left open by the sheet and chosen here: the boot takes 0.7 s; and all that says "whether".
Source: AX3500 sheet, sections 4 and 7.
"""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

Model = Literal["AX3500", "AX1500", "AX2850"]
Mode = Literal["rc", "rs232", "rs232_watchdog", "analog"]
MODES: tuple[Mode, ...] = ("rc", "rs232", "rs232_watchdog", "analog")  # as ^00 counts them


class Profile(NamedTuple):
    """What tells one controller of the family from another."""

    identity: int  # ^8A, without the encoder's bit
    amps_divider: float  # of ?A and the limits
    limit_a: float
    output_d: bool  # whether it knows !D


PROFILES: dict[Model, Profile] = {
    "AX3500": Profile(0x48, 2.0, 60.0, False),
    "AX1500": Profile(0x02, 4.0, 30.0, False),
    "AX2850": Profile(0x04, 1.0, 120.0, True),
}
FACTORY = {  # parameter -> value
    **dict.fromkeys((0x01, 0x02, 0x07, 0x08, 0x0B), 0x00),
    0x03: 0x20,
    0x04: 0x01,
    **dict.fromkeys((0x0C, 0x0F, 0x10, 0x11), 0x10),
    0x80: 0x01,
    0x81: 0x01,
    0x88: 0x10,
    **dict.fromkeys(range(0x82, 0x88), 0x10),
}


@dataclass(kw_only=True)
class Properties:
    """A record, to be set at any time."""

    model: Model
    parameters: dict[int, int]  # flash
    paced: bool = True  # whether characters take their time on the wire
    amps_divider: float = 0.0  # ?A counts 1/divider A; 0: the model's
    mute: bool = False  # hears and counts, says nothing
    deaf: bool = False  # hears nothing: no echo, no answer, and the watchdog strikes
    frozen: bool = False  # its counters stand still, whatever the wheels do
    late_s: float = 0.0  # all that it says arrives so late
    counter_offset: tuple[int, int] = (0, 0)  # moves the counters, say close to their ends
    rollover: Literal["wrap", "zero"] = "wrap"  # what a counter does beyond its ends
    reply_delay_s: float = 0.001  # from a command's CR to its answer
    boot_s: float = 0.7  # deaf after a reset
    reset_after: int = 0  # characters to hear until it resets by itself; 0: it does not
    w_rate: float = 0.0  # chance of a W in front of each character sent
    echoes: bool = True  # whether it sends back what it hears
    echoes_take_over: bool = False  # whether the ten CR come back
    plus_after_read: bool = True  # after ^nn and *nn
    minus_on_empty: bool = False  # to a lone CR
    lf_after_cr: bool = False  # LF after each CR sent
    says_ok: bool = True  # OK after the ten CR, and after the prompt in RS-232 mode
    refuse: set[str] = field(default_factory=set)  # lines that it answers with a minus, say ?R
    register_sign: Literal["*", "$"] = "*"  # of the encoder module; $ before firmware 1.7
    log_numbers: int = 13  # in a logging line: 12, 13, 14 or 16
    analog_v: tuple[float, float, float, float] = (2.5, 2.5, 2.5, 2.5)  # inputs 1..4
    inputs: tuple[int, int] = (0, 0)  # E and F
    outputs: dict[str, bool] = field(default_factory=lambda: {"C": False, "D": False})  # as set
    radio_overrides: bool = False  # the radio moves the wheels in RS-232 mode too
    encoder: bool = True  # whether the encoder module is fitted
    status: int = 0x00  # bits of ^89 to add to those that come by themselves
    emergency_stop: bool = False  # the button is pressed; its bit stays until a reset
    battery_v: float = 24.06  # without load
    internal_v: float = 12.02  # of the 12 V supply
    amps: tuple[float, float] = (0.0, 0.0)  # battery amps of channel 1 and 2 without load
    celsius: tuple[float, float] = (25.0, 25.0)  # heat sinks
    load_a: float = 0.0  # what a channel takes at full power, on top
    never_written: set[int] = field(default_factory=set)  # parameters not readable until written
    flash_writes: int = 0
    watchdog_stops: int = 0

    def __post_init__(self) -> None:
        self.amps_divider = self.amps_divider or PROFILES[self.model].amps_divider
