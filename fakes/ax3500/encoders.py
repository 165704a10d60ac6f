"""The encoder module of the fake AX3500: two 32-bit counters, and registers that hang it.

Destinations, distances and the mailbox, which mapod has no use for, are left out.

Source: AX3500 sheet, sections 4 to 7.
"""

import math
from collections.abc import Callable
from typing import Literal

TOP, BOTTOM, TURN = 2**31 - 1, -(2**31), 2**32  # of a counter
COUNTS_PER_PULSE = 4  # all edges of both tracks
KNOWN_ADDRESSES, SETTINGS = range(0x84, 0x9C), range(0xA2, 0xA7)
TIME_BASES, TIME_BASE_MOST = (0xA2, 0xA3), 63


def hex_from_counter(count: int) -> str:
    """The fewest hex digits whose first one, below 8 or not, still tells the sign.

    >>> [hex_from_counter(count) for count in (0, 8, 250, -1, -235, -2**31)]
    ['0', '08', '0FA', 'F', 'F15', '80000000']
    """
    digits = 1
    while not -8 * 16 ** (digits - 1) <= count < 8 * 16 ** (digits - 1):
        digits += 1
    return f"{count % 16**digits:0{digits}X}"


class EncoderModule:
    """Counts what the wheels do. An address that it does not know hangs it: `hung`.

    A new one shows the wheels' own counts; a reset begins at zero.

    Args:
        counts: encoder counts of channel 1 and 2 at the time of the call; any real numbers.
    """

    def __init__(self, counts: Callable[[], tuple[float, float]]) -> None:
        self.rollover: Literal["wrap", "zero"] = "wrap"  # what a counter does beyond its ends
        self.offset = (0, 0)  # added to what the wheels say
        self.pulses_per_turn = 500
        self.hung = False
        self._counts = counts
        self._before = self._now = (-math.inf, counts())  # two samples, time and counts
        self._counters, self._counted = [0, 0], [0, 0]
        self._settings = dict.fromkeys(SETTINGS, 0) | dict.fromkeys(TIME_BASES, 4)

    def sample(self, now_s: float) -> None:
        """Look at the wheels; between two samples they turn evenly."""
        if self._now[0] < now_s:
            self._before = self._now
        self._now = now_s, self._counts()

    def reset(self, at_s: float) -> None:
        """Counters at zero; a module that hangs hangs on."""
        self._count_to(at_s)
        self._counters = [0, 0]

    def maybe_read(self, which: int, at_s: float) -> int | None:
        """The value of `?Q` 0..6, at its instant; 4..6 clear what they read. None: no such one."""
        channels = {0: (0,), 1: (1,), 2: (0, 1), 4: (0,), 5: (1,), 6: (0, 1)}.get(which)
        if channels is None:
            return None
        self._count_to(at_s)
        value = _wrapped(sum(self._counters[channel] for channel in channels))
        if which >= 4:
            self._clear(channels)
        return value

    def order(self, which: int, at_s: float) -> bool:
        """`!Q` 0..2: clear; False: no such one."""
        channels = {0: (0,), 1: (1,), 2: (0, 1)}.get(which)
        if channels is None:
            return False
        self._count_to(at_s)
        self._clear(channels)
        return True

    def speeds(self) -> tuple[int, int]:
        """`?Z`: speed of both, in the unit of the time base, -127..127."""
        (then_s, then), (now_s, now) = self._before, self._now
        if not 0.0 < now_s - then_s < math.inf:
            return 0, 0
        rpms = [
            60.0 * (b - a) / (now_s - then_s) / (COUNTS_PER_PULSE * self.pulses_per_turn)
            for a, b in zip(then, now, strict=True)
        ]
        one, two = (
            rpm * self.pulses_per_turn * (self._settings[base] + 1) / 58593.75
            for rpm, base in zip(rpms, TIME_BASES, strict=True)
        )
        return _clamped(one), _clamped(two)

    def maybe_register(self, address: int) -> int | None:
        """One byte of the module; None: the address was a bad one, and the module hangs."""
        if address in KNOWN_ADDRESSES:
            return 0x00
        self.hung = address not in self._settings
        return self._settings.get(address)

    def set_register(self, address: int, value: int) -> bool:
        """Write one byte; False: not one that can be written."""
        most = TIME_BASE_MOST if address in TIME_BASES else 255
        if address not in self._settings or value > most:
            return False
        self._settings[address] = value
        return True

    def _clear(self, channels: tuple[int, ...]) -> None:
        for channel in channels:
            self._counters[channel] = 0

    def _count_to(self, at_s: float) -> None:
        """Bring both counters to an instant, over their ends where they come there."""
        (then_s, then), (now_s, now) = self._before, self._now
        share = 1.0
        if -math.inf < then_s < now_s:
            share = min(1.0, max(0.0, (at_s - then_s) / (now_s - then_s)))
        for channel in (0, 1):
            turned = then[channel] + share * (now[channel] - then[channel])
            counted = math.floor(turned) + self.offset[channel]
            count = self._counters[channel] + counted - self._counted[channel]
            self._counted[channel] = counted
            if self.rollover == "wrap":
                count = _wrapped(count)
            elif count > TOP:
                count %= TOP + 1
            elif count < BOTTOM:
                count = -(-count % (1 - BOTTOM))
            self._counters[channel] = count


def _wrapped(count: int) -> int:
    return (count - BOTTOM) % TURN + BOTTOM


def _clamped(value: float) -> int:
    return max(-127, min(127, round(value)))
