"""The power stage of the fake AX3500: supply, currents, heat, and what takes the power away.

Left open by the sheet and chosen here: the limits of voltage and temperature, and how a load shows.
Source: AX3500 sheet, sections 4 and 7.
"""

import math
from typing import Literal, NamedTuple

Model = Literal["AX3500", "AX1500", "AX2850"]


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
ENCODER_BIT = 0x20  # of the identity
OVERVOLTAGE, OVERTEMPERATURE, UNDERVOLTAGE = 0x01, 0x02, 0x04  # end by themselves
EMERGENCY_STOP = 0x80  # stays until a reset
HIGHEST_V, LOWEST_V, HOTTEST_DEG = 43.0, 8.0, 80.0
SUPPLY_OHM = 0.06  # battery and cables
HEAT_DEG_PER_A2, HEAT_S = 0.06, 90.0  # of the heat sinks

# thermistor bytes at -40, -35 .. 150 C
THERMISTOR = bytes.fromhex(
    "F8 F6 F3 F0 EB E6 E0 D9 D0 C7 BC B1 A5 99 8C 80 74 68 5D"
    "53 4A 41 3A 33 2D 28 23 1F 1B 18 15 13 11 0F 0D 0C 0B 09 08"
)


class PowerStage:
    """Supply and output stage; faults and properties as plain attributes."""

    def __init__(self, model: Model) -> None:
        self.model: Model = model
        self.amps_divider = PROFILES[model].amps_divider  # ?A counts 1/divider A
        self.encoder = True  # whether the encoder module is fitted
        self.status = 0x00  # bits of ^89 to add to those that come by themselves
        self.emergency_stop = False  # the button is pressed; its bit stays until a reset
        self.battery_v = 24.06  # without load
        self.internal_v = 12.02  # of the 12 V supply
        self.amps = (0.0, 0.0)  # battery amps of channel 1 and 2 without load
        self.celsius = (25.0, 25.0)  # heat sinks without load
        self.load_a = 0.0  # what a channel takes at full power, on top
        self._rise_deg = [0.0, 0.0]
        self._shares = (0.0, 0.0)  # of the full power, as applied
        self._heated_s = -math.inf

    @property
    def identity(self) -> int:
        """`^8A`."""
        return PROFILES[self.model].identity | (ENCODER_BIT if self.encoder else 0)

    def condition(self) -> int:
        """`^89`: any bit takes the power away."""
        if self.emergency_stop:
            self.status |= EMERGENCY_STOP
        high, low = self.battery_v > HIGHEST_V, self.battery_v < LOWEST_V
        (one, two), (rise_one, rise_two) = self.celsius, self._rise_deg
        hot = one + rise_one > HOTTEST_DEG or two + rise_two > HOTTEST_DEG
        return (
            self.status
            | (OVERVOLTAGE if high else 0)
            | (UNDERVOLTAGE if low else 0)
            | (OVERTEMPERATURE if hot else 0)
        )

    def amps_bytes(self) -> list[int]:
        """`?A`."""
        return [clamped_byte(self.amps_divider * amps) for amps in self._amps_now()]

    def limit_byte(self) -> int:
        """`^8B` and `^8C`."""
        return clamped_byte(self.amps_divider * PROFILES[self.model].limit_a)

    def thermistor_bytes(self) -> list[int]:
        """`?M`."""
        return [thermistor_from_celsius(celsius) for celsius in self._celsius_now()]

    def voltage_bytes(self) -> list[int]:
        """`?E`: the battery sags under load."""
        sag_v = SUPPLY_OHM * self.load_a * sum(abs(share) for share in self._shares)
        return [
            clamped_byte((self.battery_v - sag_v) * 256 / 55.0),
            clamped_byte(self.internal_v * 256 / 28.5),
        ]

    def heat(self, now_s: float) -> None:
        """Let the heat sinks follow the load for the time gone by."""
        gone_s, self._heated_s = now_s - self._heated_s, now_s
        if not 0.0 < gone_s < math.inf or not (any(self._shares) or any(self._rise_deg)):
            return
        share = 1.0 - math.exp(-gone_s / HEAT_S)
        for channel, power in enumerate(self._shares):
            goal_deg = HEAT_DEG_PER_A2 * (self.load_a * power) ** 2
            self._rise_deg[channel] += share * (goal_deg - self._rise_deg[channel])

    def _amps_now(self) -> list[float]:
        return [
            rest + self.load_a * abs(share)
            for rest, share in zip(self.amps, self._shares, strict=True)
        ]

    def _celsius_now(self) -> list[float]:
        return [rest + rise for rest, rise in zip(self.celsius, self._rise_deg, strict=True)]


def thermistor_from_celsius(celsius: float) -> int:
    """The byte of `?M`, linear between the table's points."""
    place = max(0.0, min(len(THERMISTOR) - 1.0, (celsius + 40.0) / 5.0))
    low = min(int(place), len(THERMISTOR) - 2)
    return round(THERMISTOR[low] + (place - low) * (THERMISTOR[low + 1] - THERMISTOR[low]))


def clamped_byte(value: float) -> int:
    """The nearest of 0..255."""
    return max(0, min(255, round(value)))
