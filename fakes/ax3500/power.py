"""The power stage of the fake AX3500: who commands it, what the motors get, what takes it away.

Left open by the sheet and chosen here: the limits of voltage and temperature, how a load shows, and
that in mixed mode channel 1 gets the sum, channel 2 the difference.
Source: AX3500 sheet, sections 1, 3, 4 and 7.
"""

import re
from typing import Protocol

from fakes.ax3500.properties import PROFILES, Properties

OVERVOLTAGE, OVERTEMPERATURE, UNDERVOLTAGE = 0x01, 0x02, 0x04  # end by themselves
EMERGENCY_STOP = 0x80  # stays until a reset
HIGHEST_V, LOWEST_V, HOTTEST_DEG = 43.0, 8.0, 80.0
SUPPLY_OHM = 0.06  # battery and cables
FULL = 127
POWER = re.compile("[ABab][0-7][0-9A-Fa-f]")
MIXED = (1, 5)  # of ^01, bits 2:0

# thermistor bytes at -40, -35 .. 150 C
THERMISTOR = bytes.fromhex(
    "F8 F6 F3 F0 EB E6 E0 D9 D0 C7 BC B1 A5 99 8C 80 74 68 5D"
    "53 4A 41 3A 33 2D 28 23 1F 1B 18 15 13 11 0F 0D 0C 0B 09 08"
)


class Wheels(Protocol):
    """What hangs on the controller."""

    def counts(self) -> tuple[float, float]:
        """Encoder counts of channel 1 and 2, now; any real numbers."""

    def set_power(self, one: float, two: float) -> None:
        """Power of both channels, -1..1."""


class PowerStage:
    """Supply, and commands of radio and line; in mixed mode these are speed and steering."""

    def __init__(self, of: Properties, wheels: Wheels) -> None:
        self.awake, self.follows_radio = True, False
        self._of, self._wheels = of, wheels
        self._commands, self._radio, self._applied = [0, 0], [0, 0], (0, 0)
        self._motor_mode = of.parameters[0x01]

    def condition(self) -> int:
        """`^89`: any bit takes the power away."""
        of = self._of
        if of.emergency_stop:
            of.status |= EMERGENCY_STOP
        return (
            of.status
            | (OVERVOLTAGE if of.battery_v > HIGHEST_V else 0)
            | (UNDERVOLTAGE if of.battery_v < LOWEST_V else 0)
            | (OVERTEMPERATURE if max(of.celsius) > HOTTEST_DEG else 0)
        )

    def amps_bytes(self) -> list[int]:
        """`?A`."""
        of = self._of
        return [
            clamped_byte(of.amps_divider * (rest + of.load_a * abs(power) / FULL))
            for rest, power in zip(of.amps, self._applied, strict=True)
        ]

    def limit_byte(self) -> int:
        """`^8B` and `^8C`."""
        return clamped_byte(self._of.amps_divider * PROFILES[self._of.model].limit_a)

    def thermistor_bytes(self) -> list[int]:
        """`?M`."""
        return [thermistor_from_celsius(celsius) for celsius in self._of.celsius]

    def voltage_bytes(self) -> list[int]:
        """`?E`: the battery sags under load."""
        load_a = self._of.load_a * sum(abs(power) / FULL for power in self._applied)
        return [
            clamped_byte((self._of.battery_v - SUPPLY_OHM * load_a) * 256 / 55.0),
            clamped_byte(self._of.internal_v * 256 / 28.5),
        ]

    def steer(self, one: int, two: int) -> None:
        self._radio = [_clamped(int(one)), _clamped(int(two))]
        if self._of.radio_overrides:
            self._commands = list(self._radio)
        self.apply()

    def obey(self, order: str) -> bool:
        """What `!` asks of motors and outputs; False: nothing that it knows."""
        knows_d = PROFILES[self._of.model].output_d
        if order in ("C", "c") or (order in ("D", "d") and knows_d):
            self._of.outputs[order.upper()] = order.isupper()
        elif POWER.fullmatch(order):
            power = int(order[1:], 16)
            self._commands["AB".index(order[0].upper())] = power if order[0] in "AB" else -power
        else:
            return False
        return True

    def halt(self) -> None:
        """Forget what the line commanded."""
        self._commands = [0, 0]

    def adopt_motor_mode(self) -> None:
        """Flash takes effect, at a reset or `^FF`."""
        self._motor_mode = self._of.parameters[0x01]

    def wanted(self) -> list[int]:
        return self._radio if self.follows_radio else self._commands

    def powers(self) -> tuple[int, int]:
        """What the motors get, -127..127."""
        one, two = self.wanted()
        if self.condition() or not self.awake:
            return 0, 0
        if self._motor_mode & 0x07 in MIXED:
            one, two = one + two, one - two
        return _clamped(one), _clamped(two)

    def apply(self) -> None:
        powers = self.powers()
        if powers != self._applied:
            self._applied = powers
            self._wheels.set_power(powers[0] / FULL, powers[1] / FULL)


def thermistor_from_celsius(celsius: float) -> int:
    """The byte of `?M`, linear between the table's points."""
    place = max(0.0, min(len(THERMISTOR) - 1.0, (celsius + 40.0) / 5.0))
    low = min(int(place), len(THERMISTOR) - 2)
    return round(THERMISTOR[low] + (place - low) * (THERMISTOR[low + 1] - THERMISTOR[low]))


def clamped_byte(value: float) -> int:
    return max(0, min(255, round(value)))


def _clamped(power: int) -> int:
    return max(-FULL, min(FULL, power))
