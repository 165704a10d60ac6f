"""Asks a SICK LMS1xx that is measuring, now and then, how it is. No I/O, no clock.

One question at a time; one that was refused or not answered twice is not asked again.
Scans go on meanwhile.
Source: lms111 sheet, section 3.
"""

from typing import Any

from hw.lms1xx import commands
from hw.lms1xx.cola import Dialect
from hw.lms1xx.commands import Command
from hw.lms1xx.telegrams import Answer, Refusal

EVERY_S = 2.5  # by turns: each question every 5 s
ANSWER_S = 2.0
GIVE_UP = 2


class Checkup:
    """The questions of one connection: contamination, and temperature with the state."""

    def __init__(self, dialect: Dialect, now_s: float) -> None:
        self._dialect = dialect
        self._topics = [commands.READ_CONTAMINATION, commands.READ_STATE]
        self._unanswered = dict.fromkeys([topic.name for topic in self._topics], 0)
        self._due_s, self._asked_s = now_s + 0.5, now_s
        self._asked: Command | None = None

    def out(self, now_s: float) -> bytes:
        """The bytes of the next question, if it is due."""
        if self._asked is not None and now_s - self._asked_s >= ANSWER_S:
            self._fail(self._asked)
        if self._asked is not None or now_s < self._due_s or not self._topics:
            return b""
        self._asked, self._asked_s, self._due_s = self._topics.pop(0), now_s, now_s + EVERY_S
        return self._asked.encode(self._dialect)

    def maybe_answer(self, event: Any) -> Answer | None:
        """The event, if it answers what was asked."""
        asked = self._asked
        if asked is None:
            return None
        if isinstance(event, Refusal):
            self._fail(asked)
        elif isinstance(event, Answer) and f"{event.kind} {event.name}" == asked.answer:
            self._unanswered[asked.name] = 0
            self._topics.append(asked)
            self._asked = None
            return event
        return None

    def _fail(self, asked: Command) -> None:
        """No answer: ask once more when its turn comes."""
        self._unanswered[asked.name] += 1
        if self._unanswered[asked.name] < GIVE_UP:
            self._topics.append(asked)
        self._asked = None
