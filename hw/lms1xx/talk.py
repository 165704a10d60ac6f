"""One command at a time to a SICK LMS1xx, in the dialect that it speaks, and what it answers.

A refusal (sFA) does not name its command. So after a command that was given up, a read whose answer
names itself is asked first: what comes before that answer is of the past.
Source: lms111 sheet, sections 1, 2 and 6.
"""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any, Literal

from hw.device import DeviceStatus, Tick
from hw.lms1xx import commands
from hw.lms1xx.cola import Dialect
from hw.lms1xx.commands import Command
from hw.lms1xx.telegrams import Answer, Refusal, ScanTelegram

DialectSetting = Literal["auto", "binary", "ascii"]
Result = Answer | Refusal | None  # None: no answer

PROBE_S = 0.2  # from one greeting to the next
START_UP_S = 120.0  # the longest that a device was seen to be silent after power on (section 6)
OTHER_DIALECT_S = 35.0  # after so much silence (30 s are usual), the dialect is to be doubted
ANSWER_S, OPTIONAL_S, TRIES = 2.5, 1.0, 2
RESYNC_S, QUIET_S = 0.5, 0.1

GREETINGS = (commands.READ_DEVICE_STATE, commands.READ_STATE, commands.READ_FIRMWARE)
COLA = {"binary": "CoLa-B (EIHstCola 1)", "ascii": "CoLa-A (EIHstCola 0)"}
BOOTING = "waiting for the scanner to answer, which takes up to 120 s after power on"


class StartAgainError(Exception):
    """The conversation can't go on; says why, in words."""


@dataclass(slots=True)
class Memory:
    """What is known of the device from one connection to the next."""

    dialect: Dialect | None = None  # in which it answered
    owes_run: bool = False  # somebody must still send Run: a login ended measuring
    set_up_s: float = float("-inf")  # host clock, when it was last set up
    ran_s: float = float("-inf")  # host clock, when its scans ceased
    rest_s: float = 3.0  # until it is set up again: another host may want it otherwise
    settled: tuple[object, ...] = ()  # what it read back then

    def forget_rest(self) -> None:
        """A new connection: it may be set up at once."""
        self.set_up_s = self.ran_s = float("-inf")


@dataclass(slots=True)
class ScanStream:
    """What the session hands to the side that measures."""

    telegrams: list[ScanTelegram] = field(default_factory=list)  # of this tick, to be used
    not_ready: int = 0  # telegrams whose device status says that they are not to be used
    newest: ScanTelegram | None = None  # usable or not
    contamination: int | None = None  # as asked for, and the next two as well
    temperature_ok: bool | None = None
    firmware: str = ""


class Talk:
    """A conversation: greeting, questions, answers, remarks."""

    def __init__(
        self, status: DeviceStatus, stream: ScanStream, memory: Memory, dialect: DialectSetting
    ) -> None:
        self._status, self._stream, self._memory = status, stream, memory
        first: Dialect = (memory.dialect or "binary") if dialect == "auto" else dialect
        other: Dialect = "ascii" if first == "binary" else "binary"
        self._dialects: tuple[Dialect, ...] = (first, other) if dialect == "auto" else (first,)
        self._dialect: Dialect = first
        self._now_s = 0.0
        self._is_unsure = False  # an answer to a command that was given up may still come
        self._remarks: list[str] = []  # what is not as it should be, though it goes on

    def _turn(self, out: bytes = b"") -> Generator[bytes, Tick, list[Any]]:
        """Write; the events of the next tick."""
        tick = yield out
        self._stream.telegrams = []
        self._now_s = tick.now_s
        return tick.events

    def _pause(self, seconds: float) -> Generator[bytes, Tick, None]:
        resume_s = self._now_s + seconds
        while self._now_s < resume_s:
            yield from self._turn()

    def _greet(self) -> Generator[bytes, Tick, None]:
        """Ask harmless questions in each dialect by turns until anything is answered.

        A device that starts takes connections before it answers; set to one dialect, it is silent
        to the other.
        """
        begun_s, asked = self._now_s, 0
        while True:
            rounds, turn = divmod(asked, len(self._dialects))
            greeting = GREETINGS[rounds % len(GREETINGS)]
            out, asked = greeting.encode(self._dialects[turn]), asked + 1
            until_s = self._now_s + PROBE_S
            while self._now_s < until_s:
                for event in (yield from self._turn(out)):
                    if isinstance(event, Answer | Refusal | ScanTelegram):
                        self._dialect = self._memory.dialect = event.dialect
                        self._is_unsure = True  # other greetings may be answered yet
                        return
                out = b""
            if asked > 1:
                words = self._silence_in_words(self._now_s - begun_s)
                self._status.fall_back("starting", words)

    def _silence_in_words(self, silent_s: float) -> str:
        if len(self._dialects) > 1:
            return BOOTING if silent_s < START_UP_S else "the scanner answers in neither dialect"
        is_set, other = self._dialect, "ascii" if self._dialect == "binary" else "binary"
        doubt = f"set to {COLA[other]} instead of {COLA[is_set]} on this port"
        if silent_s < OTHER_DIALECT_S:
            return BOOTING
        if silent_s < START_UP_S:
            return f"{BOOTING}, or it may be {doubt}"
        return f"the scanner does not answer: it may be {doubt}"

    def _maybe_answer(self, command: Command, wait_s: float) -> Generator[bytes, Tick, Result]:
        """Its answer, a refusal, or None after wait_s."""
        if self._is_unsure:
            yield from self._resync()
        until_s, out = self._now_s + wait_s, command.encode(self._dialect)
        while True:
            for event in (yield from self._turn(out)):
                if isinstance(event, Answer) and f"{event.kind} {event.name}" == command.answer:
                    return event
                if isinstance(event, Refusal):
                    return event
            if self._now_s >= until_s:
                self._is_unsure = True
                return None
            out = b""

    def _resync(self) -> Generator[bytes, Tick, None]:
        """Until the answers to earlier commands are there or lost; reads the firmware's version."""
        out, until_s = commands.READ_FIRMWARE.encode(self._dialect), self._now_s + RESYNC_S
        while self._now_s < until_s:
            for event in (yield from self._turn(out)):
                if isinstance(event, Answer) and event.name == commands.READ_FIRMWARE.name:
                    if texts := commands.maybe_texts(event):
                        self._stream.firmware = texts[0]
                    self._is_unsure = False
                    return
                if isinstance(event, Refusal):  # an earlier command's, or of this read: soon quiet
                    until_s = self._now_s + QUIET_S
                    self._is_unsure = False
            out = b""
        if not self._stream.firmware:  # it never answered that: it is not waited for every time
            self._is_unsure = False

    def _ask(
        self, command: Command, wait_s: float, tries: int = TRIES
    ) -> Generator[bytes, Tick, Result]:
        """The same, asked again if there was no answer."""
        result: Result = None
        for _ in range(tries):
            result = yield from self._maybe_answer(command, wait_s)
            if result is not None:
                break
        return result

    def _try(
        self, command: Command, tries: int = TRIES, wait_s: float = OPTIONAL_S
    ) -> Generator[bytes, Tick, Answer | None]:
        """A command that we can do without; a remark says why there is no answer."""
        result = yield from self._ask(command, wait_s, tries)
        if isinstance(result, Answer):
            return result
        self._remark(_refusal_in_words(command, result))
        return None

    def _must(self, command: Command) -> Generator[bytes, Tick, bool]:
        """A command that has to be answered; whether the answer is good: a remark if not.

        Raises:
            StartAgainError: no answer.
        """
        result = yield from self._ask(command, ANSWER_S)
        if result is None:
            raise StartAgainError(f"the scanner does not answer {command.name}")
        if isinstance(result, Refusal):
            self._remark(_refusal_in_words(command, result))
            return False
        if not commands.is_good(result):
            number = commands.maybe_number(result)
            said = "nothing" if number is None else str(number)
            self._remark(f"answers {command.name} with {said}, which is no")
            return False
        return True

    def _remark(self, text: str) -> None:
        if text not in self._remarks:
            self._remarks.append(text)


def _refusal_in_words(command: Command, result: Result) -> str:
    if isinstance(result, Refusal):
        return f"refuses {command.name} ({result.reason})"
    return f"does not answer {command.name}"
