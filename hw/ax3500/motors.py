"""Motor commands for an AX3500: which one is due, and zero on any doubt.

A command counts as done only when the controller has acknowledged it. What the wheels may do is
not judged here, only whether somebody still wants it: a wish lives for 0.1 s. After trouble even
a fresh wish is not enough: zero must be wished first, so that nobody is surprised by a stick that
was held all the time.

How long a zero takes at most: it waits for the exchange under way, 0.2 s, then goes out before
anything else; where that exchange failed it is written at once for both channels, blindly. What is
not acknowledged OVERDUE_S later is left to the controller's own watchdog: the session falls
silent, which stops the motors 1 s later whatever the line does to our bytes. A controller whose
watchdog is off gets no commands at all.
Source: AX3500 sheet, sections 1, 2, 3 and 7 (`^00`, `^01`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hw.ax3500.lines import CR
from hw.ax3500.schedule import CHANGE_S, REFRESH_S

FULL = 0x7F
WISH_S = 0.1  # a wish that is not repeated ends
REPEAT_S = 0.02  # a zero, or a refused command
OVERDUE_S = 0.2  # a zero on the way for so long, and a failed exchange: fall silent
SEPARATE, MIXED = (0, 4), (1, 5)  # bits 2:0 of ^01
NO_WATCHDOG = 1  # of ^00: RS-232 mode without watchdog
UNKNOWN_MODE = "the controller's motor mode is not known yet"


def encode_motor(channel: int, power: int, *, enabled: bool) -> bytes:
    """`!Ahh` and its kin: channel 1 or 2, power -127..127; ValueError unless motors are enabled.

    >>> encode_motor(2, -16, enabled=True)
    b'!b10\\r'
    """
    if not enabled:
        raise ValueError("motors: not enabled by the settings")
    if channel not in (1, 2) or not -FULL <= power <= FULL:
        raise ValueError(f"motors: channel 1..2 and -127..127, given {channel}, {power}")
    letter = "AB"[channel - 1] if power >= 0 else "ab"[channel - 1]
    return f"!{letter}{abs(power):02X}".encode("ascii") + CR


@dataclass(slots=True)
class _Channel:
    """What one motor was told."""

    acknowledged: int | None = None  # the newest power; None: not known
    acknowledged_s: float = -math.inf
    sent_s: float = -math.inf
    may_move: bool = False  # sent something, and no zero was acknowledged since


class Motors:
    """What is wanted of two channels, what was acknowledged, and the command between them."""

    def __init__(self, enabled: bool, left: int, right: int, inverted: Sequence[int]) -> None:
        self.enabled = enabled
        self.refusal = UNKNOWN_MODE if enabled else ""  # why no command may be sent
        self._order = (left - 1, right - 1)  # which channel each wheel hangs on
        self._signs = [-1.0 if channel in inverted else 1.0 for channel in (1, 2)]
        self._mixed = False
        self._wish: tuple[float, float] = (0.0, 0.0)
        self._fresh, self._wish_s, self._now_s = False, -math.inf, -math.inf
        self._channels = (_Channel(), _Channel())
        self._zero_first, self._zero_first_s = True, -math.inf  # and since when
        self._blocked = False
        self._trouble = "no connection yet"  # until zero is wished after it; "": none

    @property
    def usable(self) -> bool:
        return self.enabled and not self.refusal

    @property
    def may_move(self) -> bool:
        """Whether a motor may have power, as far as commands tell."""
        return any(channel.may_move for channel in self._channels)

    @property
    def is_overdue(self) -> bool:
        """Whether motors that may move have not taken a zero for too long."""
        return self.may_move and self._zero_first and self._now_s - self._zero_first_s > OVERDUE_S

    @property
    def why_off(self) -> str:
        """Why a wish has no effect; "" where it has, and where motors are disabled."""
        if not self.enabled or self.refusal or not self._trouble:
            return self.refusal
        return f"motors wait until zero is asked for (let go of the stick): {self._trouble}"

    @property
    def turns_wish_down(self) -> bool:
        """Whether somebody wants the wheels to turn and is not obeyed."""
        alive = self._now_s - self._wish_s <= WISH_S
        return alive and bool(self.why_off) and not self._wishes_zero()

    def wish(self, left: float, right: float) -> None:
        """Fractions -1..1 of full power from the next step on; NaN means zero."""
        self._wish, self._fresh = (left, right), True

    def look(self, now_s: float) -> None:
        """Once a step: how old the wish is, and whether it ends the wait after trouble."""
        self._now_s = now_s
        if not self._fresh:
            return
        self._fresh, self._wish_s = False, now_s
        if self.usable and not self._blocked and not self._zero_first and self._wishes_zero():
            self._trouble = ""

    def adopt_modes(self, input_mode: int | None, motor_mode: int | None, watched: bool) -> None:
        """From `^00` and `^01`, None where unreadable; watched: the watchdog is known to be on."""
        mode = None if motor_mode is None else motor_mode & 0x07
        self._mixed = mode in MIXED
        self.refusal = ""
        if mode is None:
            self.refusal = "motors stay off: the controller does not tell its motor mode (^01)"
        elif mode not in SEPARATE + MIXED:
            self.refusal = f"motors stay off: motor mode {mode} (^01) steers positions, not speeds"
            self._have_stopped()  # modes change by a restart, which stopped the motors
        elif input_mode is None and not watched:
            self.refusal = "motors stay off: the controller does not tell its input mode (^00)"
        elif input_mode == NO_WATCHDOG and not watched:
            self.refusal = "motors stay off: RS-232 mode without watchdog (^00 is 01, must be 02)"
        self.doubt()

    def forget_modes(self, trouble: str) -> None:
        """The conversation starts anew: nothing is sent before the modes are known again."""
        if self.enabled:
            self.refusal = UNKNOWN_MODE
        self.doubt(trouble)

    def doubt(self, trouble: str = "") -> None:
        """Zero, acknowledged, before all else; after `trouble`, wished anew as well."""
        if not self._zero_first:
            self._zero_first, self._zero_first_s = True, self._now_s
        self._wish, self._wish_s, self._fresh = (0.0, 0.0), -math.inf, False
        for channel in self._channels:
            channel.acknowledged, channel.sent_s = None, -math.inf
        self._trouble = trouble or self._trouble

    def maybe_command(self, blocked: str) -> tuple[int, int] | None:
        """Channel 1 or 2 and its power -127..127, if one is due; blocked: why zero only."""
        if not self.enabled:
            return None
        self._blocked = bool(blocked)
        self._trouble = self._trouble or blocked
        if self.refusal and not self.may_move:
            return None
        if self._zero_first and all(channel.acknowledged == 0 for channel in self._channels):
            self._zero_first = False
        targets = self._targets()
        # zeros first, then who has waited longer: else one wheel may never get its turn
        for k in sorted((0, 1), key=lambda k: (targets[k] != 0, self._channels[k].sent_s)):
            channel, power = self._channels[k], targets[k]
            wait_s = REPEAT_S if power == 0 or channel.acknowledged is None else CHANGE_S
            stale = power != 0 and self._now_s - channel.acknowledged_s >= REFRESH_S
            due = self._now_s - channel.sent_s >= wait_s
            if due and (stale or channel.acknowledged != power):
                return k + 1, power
        return None

    def sent(self, channel: int, power: int) -> bytes:
        told = self._channels[channel - 1]
        told.sent_s, told.acknowledged = self._now_s, None
        told.may_move = True  # also by a zero: the line may make anything of it
        return encode_motor(channel, power, enabled=self.enabled)

    def acknowledged(self, channel: int, power: int) -> None:
        told = self._channels[channel - 1]
        told.acknowledged, told.acknowledged_s = power, self._now_s
        told.may_move = power != 0

    def have_starved(self) -> None:
        """We were silent for longer than the watchdog waits, so it has stopped the motors."""
        self._have_stopped()
        self._zero_first_s = self._now_s
        self.doubt("the line failed, and the controller's watchdog had to stop them")

    def _have_stopped(self) -> None:
        for channel in self._channels:
            channel.may_move = False

    def stop_bytes(self) -> bytes:
        """Zero for both without waiting for anything; b"" where nothing may be sent."""
        if not self.usable and not (self.enabled and self.may_move):
            return b""
        zeros = [encode_motor(channel, 0, enabled=self.enabled) for channel in (1, 2)]
        return CR + b"".join(zeros)  # CR ends a query that was half written

    def _wishes_zero(self) -> bool:
        return all(abs(power) * FULL < 0.5 for power in self._wish)  # NaN is not zero here

    def _targets(self) -> tuple[int, int]:
        idle = not self.usable or self._zero_first or bool(self._trouble)
        if idle or self._now_s - self._wish_s > WISH_S or not all(map(math.isfinite, self._wish)):
            return 0, 0
        motors = [0.0, 0.0]
        for channel, power in zip(self._order, self._wish, strict=True):
            motors[channel] = power
        one, two = (
            max(-1.0, min(1.0, sign * power))
            for sign, power in zip(self._signs, motors, strict=True)
        )
        if self._mixed:  # channel 1 the common part, channel 2 the difference
            one, two = (one + two) / 2.0, (one - two) / 2.0
        return round(FULL * one), round(FULL * two)
