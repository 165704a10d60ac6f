"""One command at a time to a SICK LMS1xx, in the dialect that it speaks, and what it answers.

A refusal (sFA) does not name its command. So after a command that was given up, a read whose answer
names itself is asked first: what comes before that answer is of the past.
Source: lms111 sheet, sections 1, 2 and 6.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from hw.device import DeviceStatus
from hw.exchange import Exchange, StartAgainError, Steps
from hw.lms1xx import commands
from hw.lms1xx.cola import Dialect, DialectSetting
from hw.lms1xx.commands import Command
from hw.lms1xx.telegrams import Answer, Refusal, ScanTelegram

Heard = Answer | Refusal | ScanTelegram
Result = Answer | Refusal | None  # None: no answer

PROBE_S = 0.2  # from one greeting to the next
START_UP_S = 120.0  # the longest that a device was seen to be silent after power on (section 6)
OTHER_DIALECT_S = 35.0  # after so much silence (30 s are usual), the dialect is to be doubted
ANSWER_S, OPTIONAL_S, TRIES = 2.5, 1.0, 2
RESYNC_S, QUIET_S = 0.5, 0.1

GREETINGS = (commands.READ_DEVICE_STATE, commands.READ_STATE, commands.READ_FIRMWARE)
COLA = {"binary": "CoLa-B (EIHstCola 1)", "ascii": "CoLa-A (EIHstCola 0)"}
BOOTING = "waiting for the scanner to answer, which takes up to 120 s after power on"


@dataclass(slots=True)
class Memory:
    """What is known of the device from one connection to the next, and its newest telegrams."""

    dialect: Dialect | None = None  # in which it answered
    owes_run: bool = False  # somebody must still send Run: a login ended measuring
    set_up_s: float = -math.inf  # host clock, when it was last set up
    ran_s: float = -math.inf  # host clock, when its scans ceased
    rest_s: float = 3.0  # until it is set up again: another host may want it otherwise
    settled: tuple[object, ...] | None = None  # what it read back then
    firmware: str = ""
    serial_number: int | None = None
    contamination: int | None = None
    temperature_ok: bool | None = None
    telegrams: list[ScanTelegram] = field(default_factory=list)  # of this tick, to be used


class ColaExchange:
    """Greeting, commands, answers, and remarks on what is not as it should be."""

    def __init__(
        self, exchange: Exchange, status: DeviceStatus, memory: Memory, dialect: DialectSetting
    ) -> None:
        self.exchange, self.status, self.memory = exchange, status, memory
        first: Dialect = (memory.dialect or "binary") if dialect == "auto" else dialect
        other: Dialect = "ascii" if first == "binary" else "binary"
        self._dialects: tuple[Dialect, ...] = (first, other) if dialect == "auto" else (first,)
        self.dialect: Dialect = first
        self.is_unsure = False  # an answer to a command that was given up may still come
        self.remarks: list[str] = []  # with which it goes on all the same

    def remark(self, text: str) -> None:
        """To be told while the scanner runs; said once."""
        if text not in self.remarks:
            self.remarks.append(text)

    def greet(self) -> Steps[None]:
        """Ask harmless questions in each dialect by turns until anything is answered.

        A device that starts takes connections before it answers; set to one dialect, it is silent
        to the other.
        """
        begun_s, asked = self.exchange.now_s, 0
        while True:
            rounds, turn = divmod(asked, len(self._dialects))
            greeting = GREETINGS[rounds % len(GREETINGS)].encode(self._dialects[turn])
            heard: Heard | None = yield from self.exchange.ask(greeting, _maybe_telegram, PROBE_S)
            if heard is not None:
                self.dialect = self.memory.dialect = heard.dialect
                self.is_unsure = True  # other greetings may be answered yet
                return
            asked += 1
            if asked > 1:
                silence = self._describe_silence(self.exchange.now_s - begun_s)
                self.status.fall_back("starting", silence)

    def _describe_silence(self, silent_s: float) -> str:
        if len(self._dialects) > 1:
            return BOOTING if silent_s < START_UP_S else "the scanner answers in neither dialect"
        is_set, other = self.dialect, "ascii" if self.dialect == "binary" else "binary"
        doubt = f"set to {COLA[other]} instead of {COLA[is_set]} on this port"
        if silent_s < OTHER_DIALECT_S:
            return BOOTING
        if silent_s < START_UP_S:
            return f"{BOOTING}, or it may be {doubt}"
        return f"the scanner does not answer: it may be {doubt}"

    def ask(self, command: Command, wait_s: float, tries: int = TRIES) -> Steps[Result]:
        for _ in range(tries):
            if self.is_unsure:
                yield from self._resync()
            out = command.encode(self.dialect)
            result: Result = yield from self.exchange.ask(out, _result_of(command), wait_s)
            if result is not None:
                return result
            self.is_unsure = True
        return None

    def _resync(self) -> Steps[None]:
        """Until the answers to earlier commands are there or lost; reads the firmware's version."""
        read = commands.READ_FIRMWARE
        out, matches = read.encode(self.dialect), _result_of(read)
        heard: Result = yield from self.exchange.ask(out, matches, RESYNC_S)
        while isinstance(heard, Refusal):  # an earlier command's, or of this read: soon quiet
            self.is_unsure = False
            heard = yield from self.exchange.wait_for(matches, QUIET_S)
        if heard is not None:
            self.memory.firmware = (commands.maybe_texts(heard) or (self.memory.firmware,))[0]
            self.is_unsure = False
        elif not self.memory.firmware:  # it never told it: it is not waited for every time
            self.is_unsure = False

    def ask_optional(
        self, command: Command, tries: int = TRIES, wait_s: float = OPTIONAL_S
    ) -> Steps[Answer | None]:
        """A command that we can do without; a remark says why there is no answer."""
        result = yield from self.ask(command, wait_s, tries)
        if isinstance(result, Answer):
            return result
        self.remark(_describe_refusal(command, result))
        return None

    def must(self, command: Command) -> Steps[bool]:
        """A command that has to be answered; whether the answer is good: a remark if not."""
        result = yield from self.ask(command, ANSWER_S)
        if result is None:
            raise StartAgainError(f"the scanner does not answer {command.name}")
        if isinstance(result, Refusal):
            self.remark(_describe_refusal(command, result))
            return False
        if not commands.is_good(result):
            number = commands.maybe_number(result)
            said = "nothing" if number is None else str(number)
            self.remark(f"answers {command.name} with {said}, which is no")
            return False
        return True


def _maybe_telegram(event: Any) -> Heard | None:
    return event if isinstance(event, Heard) else None


def _result_of(command: Command) -> Callable[[Any], Result]:
    def maybe_result(event: Any) -> Result:
        is_result = isinstance(event, Refusal) or command.is_answered_by(event)
        return event if is_result else None

    return maybe_result


def _describe_refusal(command: Command, result: Result) -> str:
    if isinstance(result, Refusal):
        return f"refuses {command.name} ({result.reason})"
    return f"does not answer {command.name}"
