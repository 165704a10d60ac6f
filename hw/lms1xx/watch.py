"""While a SICK LMS1xx measures: asks how it is, and judges its telegrams. No I/O, no clock.

It refuses to deliver what is not known to be good: a repeated telegram, a device status that is not
documented as good, a window too dirty to see through. Source: lms111 sheet, sections 3 and 5.
"""

import math
from operator import attrgetter
from typing import Any

from hw.device import BadFrame
from hw.lms1xx import commands
from hw.lms1xx.commands import Command
from hw.lms1xx.exchange import ColaExchange
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.setup import covers
from hw.lms1xx.status import CONTAMINATIONS, HOT, TOO_DIRTY, describe_status
from hw.lms1xx.telegrams import Refusal, ScanTelegram

UNUSABLE_S = 0.5  # without a scan that may be believed, after which it runs no longer
CHECK_EVERY_S = 2.5  # by turns: each question every 5 s
CHECK_ANSWER_S = 2.0
GIVE_UP = 2
_layout_of = attrgetter("layout")


class Checkup:
    """The questions of one connection: contamination, and temperature with the state.

    One at a time, while scans go on; one that was refused or not answered twice is asked no more.
    """

    def __init__(self, cola: ColaExchange) -> None:
        now_s = cola.exchange.now_s
        self._dialect, self._memory = cola.dialect, cola.memory
        self._topics = [commands.READ_CONTAMINATION, commands.READ_STATE]
        self._unanswered = {topic.name: 0 for topic in self._topics}
        self._due_s, self._asked_s = now_s + 0.5, now_s
        self._asked: Command | None = None

    def out(self, now_s: float) -> bytes:
        """The bytes of the next question, if it is due."""
        if self._asked is not None and now_s - self._asked_s >= CHECK_ANSWER_S:
            self._fail(self._asked)
        if self._asked is not None or now_s < self._due_s or not self._topics:
            return b""
        self._asked, self._asked_s = self._topics.pop(0), now_s
        self._due_s = now_s + CHECK_EVERY_S
        return self._asked.encode(self._dialect)

    @property
    def due_s(self) -> float:
        """When there is something to do, if nothing is heard."""
        if self._asked is not None:
            return self._asked_s + CHECK_ANSWER_S
        return self._due_s if self._topics else math.inf

    def hear(self, event: Any) -> None:
        """Remember what it says, if it answers what was asked."""
        asked = self._asked
        if asked is None:
            return
        if isinstance(event, Refusal):
            self._fail(asked)
        elif asked.is_answered_by(event):
            self._unanswered[asked.name] = 0
            self._topics.append(asked)
            self._asked = None
            if asked is commands.READ_CONTAMINATION:
                self._memory.contamination = commands.maybe_number(event)
            elif (state := commands.maybe_state(event)) is not None and state[1] is not None:
                self._memory.temperature_ok = state[1]

    def _fail(self, asked: Command) -> None:
        self._unanswered[asked.name] += 1
        if self._unanswered[asked.name] < GIVE_UP:
            self._topics.append(asked)
        self._asked = None


class TelegramWatch:
    """Takes the telegrams of one subscription, and sets the status by them."""

    def __init__(self, cola: ColaExchange, options: Lms1xxOptions) -> None:
        self._cola, self._options = cola, options
        self._accepted = frozenset((0, *options.accepted_status))
        self._status, self._memory = cola.status, cola.memory
        self._last: ScanTelegram | None = None
        self._usable_s = -math.inf  # host clock, last telegram that may be believed
        self._told: tuple[object, ...] = ()  # what the cause was last made of

    def take(self, now_s: float, telegram: ScanTelegram) -> bool:
        """Hand it to the side that measures, if it may be believed; counts those that never came.

        Gives False for a telegram that was there before.
        """
        last, self._last = self._last, telegram
        if last is not None:
            here = telegram.telegram_counter, telegram.sent_us
            if here == (last.telegram_counter, last.sent_us):
                self._status.reject(BadFrame("scan telegram repeated", b""))
                return False
            gap = (telegram.scan_counter - last.scan_counter - 1) % 2**16
            passed_s = (telegram.scan_us - last.scan_us) % 2**32 * 1e-6
            if gap <= 1.5 * passed_s * telegram.scan_hz + 1:  # else the counter began anew
                self._status.missed += gap
        memory, status = self._memory, telegram.status
        memory.serial_number, dirt = telegram.serial_number, memory.contamination or 0
        # which byte of its status says what is not documented
        if status[0] | status[1] not in self._accepted:
            self._refuse(now_s, describe_status(status))
            return True
        if dirt >= TOO_DIRTY and dirt in CONTAMINATIONS:
            self._refuse(now_s, CONTAMINATIONS[dirt])
            return True
        self._usable_s = now_s
        memory.telegrams.append(telegram)
        layouts = tuple(map(_layout_of, telegram.channels.values()))
        told = telegram.scan_hz, memory.contamination, memory.temperature_ok, status, layouts
        if self._told != told:
            self._told = told
            self._status.state, self._status.cause = "running", self._remark(telegram)
            self._cola.exchange.succeed()
        return True

    def _refuse(self, now_s: float, doubt: str) -> None:
        """It is not believed; when that goes on, the scanner runs no longer."""
        if now_s - self._usable_s >= UNUSABLE_S:
            self._status.fall_back("starting", f"the scanner {doubt}")
            self._told = ()

    def _remark(self, telegram: ScanTelegram) -> str:
        options, channels = self._options, telegram.channels
        faults = list(self._cola.remarks)
        channel = channels.get("DIST1") or channels.get("DIST2")
        if channel is not None:
            is_hz, is_deg = telegram.scan_hz, channel.step_deg
            if (is_hz, is_deg) != (options.scan_rate_hz, options.angular_step_deg):
                faults.append(
                    f"scans at {is_hz:g} Hz in steps of {is_deg:g} deg, configured are "
                    f"{options.scan_rate_hz:g} Hz and {options.angular_step_deg:g} deg"
                )
            last_deg = channel.first_deg + (len(channel.raw) - 1) * is_deg
            span_deg = (channel.first_deg - is_deg / 2, last_deg + is_deg / 2)
            if not covers(span_deg, (options.first_deg, options.last_deg)):
                faults.append(f"sends {channel.first_deg:g} to {last_deg:g} deg only")
        if options.echo != "first" and "DIST2" not in channels:
            faults.append("sends no second echo")
        faults.append(CONTAMINATIONS.get(self._memory.contamination or 0, ""))
        faults.append(HOT if self._memory.temperature_ok is False else "")
        faults.append(describe_status(telegram.status) if any(telegram.status) else "")
        told = ", ".join(fault for fault in faults if fault)
        return f"the scanner {told}" if told else ""
