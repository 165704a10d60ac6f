"""The motors of the fake AX3500: who commands them in which mode, and what they get.

Source: AX3500 sheet, sections 1, 3 and 7.
"""

import re
from typing import Protocol

from fakes.ax3500.flash import Parameters
from fakes.ax3500.power import PROFILES, Model

FULL = 127
POWER = re.compile("[ABab][0-7][0-9A-Fa-f]")
MIXED = (1, 5)  # of ^01, bits 2:0


class Wheels(Protocol):
    """What hangs on the controller."""

    def counts(self) -> tuple[float, float]:
        """Encoder counts of channel 1 and 2, now; any real numbers."""

    def set_power(self, one: float, two: float) -> None:
        """Power of both channels, -1..1."""


class Motors(Parameters):
    """Commands of the radio and of the serial line; in mixed mode they are speed and steering."""

    def __init__(self, wheels: Wheels, mode: int, model: Model) -> None:
        super().__init__(mode, model)
        self.radio_overrides = False  # the radio moves the wheels in RS-232 mode too
        self.outputs = {"C": False, "D": False}  # digital ones, as the line has set them
        self._wheels = wheels
        self._commands, self._radio, self._applied = [0, 0], [0, 0], (0, 0)
        self._awake, self._follows_radio = True, False
        self._motor_mode = self.parameters[0x01]

    def command(self, one: int, two: int) -> None:
        """Sticks of the radio, -127..127: they count in R/C mode, else if `radio_overrides`."""
        self._radio = [_clamped(int(one)), _clamped(int(two))]
        if self.radio_overrides:
            self._commands = list(self._radio)
        self._apply()

    def wanted(self) -> list[int]:
        """Commands of the one who commands in this mode."""
        return self._radio if self._follows_radio else self._commands

    def powers(self) -> tuple[int, int]:
        """What the motors get, -127..127."""
        one, two = self.wanted()
        if self.condition() or not self._awake:
            return 0, 0
        if self._motor_mode & 0x07 in MIXED:
            one, two = one + two, one - two
        return _clamped(one), _clamped(two)

    def _obey(self, order: str) -> bool:
        """What `!` asks of motors and outputs; False: nothing that it knows."""
        if order in ("C", "c") or (order in ("D", "d") and PROFILES[self.model].output_d):
            self.outputs[order.upper()] = order.isupper()
        elif POWER.fullmatch(order):
            power = int(order[1:], 16)
            self._commands["AB".index(order[0].upper())] = power if order[0] in "AB" else -power
        else:
            return False
        return True

    def _halt(self) -> None:
        """Forget what the line commanded."""
        self._commands = [0, 0]

    def _adopt_motor_mode(self) -> None:
        """Flash takes effect, at a reset or `^FF`."""
        self._motor_mode = self.parameters[0x01]

    def _apply(self) -> None:
        powers = self.powers()
        if powers != self._applied:
            self._applied = powers
            self._shares = (powers[0] / FULL, powers[1] / FULL)
            self._wheels.set_power(*self._shares)


def _clamped(power: int) -> int:
    return max(-FULL, min(FULL, power))
