"""The encoder module of the fake AX3500: two 32-bit counters, and addresses that hang it.

Speeds, destinations, distances and the mailbox, which mapod has no use for, are left out.

Source: AX3500 sheet, sections 4 to 7.
"""

import math
from collections.abc import Callable

from fakes.ax3500.properties import Properties

TOP, BOTTOM, TURN = 2**31 - 1, -(2**31), 2**32  # of a counter
KNOWN_ADDRESSES = {*range(0x84, 0x9C), *range(0xA2, 0xA7)}


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

    def __init__(self, of: Properties, counts: Callable[[], tuple[float, float]]) -> None:
        self.hung = False
        self._of, self._turned = of, counts
        self._before = self._now = (-math.inf, counts())  # two samples, time and counts
        self._counters, self._counted = [0, 0], [0, 0]

    def sample(self, now_s: float) -> None:
        """Look at the wheels; between two samples they turn evenly."""
        if self._now[0] < now_s:
            self._before = self._now
        self._now = now_s, self._now[1] if self._of.frozen else self._turned()

    def reset(self, at_s: float) -> None:
        """Counters at zero; a module that hangs hangs on."""
        self._count_to(at_s)
        self._counters = [0, 0]

    def maybe_read(self, which: int, at_s: float) -> int | None:
        """The value of `?Q` 0..6, at its instant; 4..6 clear what they read. None: no such one."""
        if which == 3 or which > 6:
            return None
        self._count_to(at_s)
        value = sum(self._counters) if which % 4 == 2 else self._counters[which % 4]
        if which >= 4:
            self._clear(which % 4)
        return _wrapped(value)

    def order(self, which: int, at_s: float) -> bool:
        if which > 2:
            return False
        self._count_to(at_s)
        self._clear(which)
        return True

    def maybe_register(self, address: int) -> int | None:
        """One byte of the module; None: the address was a bad one, and the module hangs."""
        self.hung = address not in KNOWN_ADDRESSES
        return None if self.hung else 0x00

    def _clear(self, which: int) -> None:
        """Channel 0 or 1; 2: both."""
        for channel in (0, 1):
            if which in (channel, 2):
                self._counters[channel] = 0

    def _count_to(self, at_s: float) -> None:
        """Bring both counters to an instant, over their ends where they come there."""
        (then_s, then), (now_s, now) = self._before, self._now
        share = 1.0
        if -math.inf < then_s < now_s:
            share = min(1.0, max(0.0, (at_s - then_s) / (now_s - then_s)))
        for channel in (0, 1):
            turned = then[channel] + share * (now[channel] - then[channel])
            counted = math.floor(turned) + self._of.counter_offset[channel]
            count = self._counters[channel] + counted - self._counted[channel]
            self._counted[channel] = counted
            if self._of.rollover == "wrap":
                count = _wrapped(count)
            elif count > TOP:
                count %= TOP + 1
            elif count < BOTTOM:
                count = -(-count % (1 - BOTTOM))
            self._counters[channel] = count


def _wrapped(count: int) -> int:
    return (count - BOTTOM) % TURN + BOTTOM
