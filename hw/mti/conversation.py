"""Questions and answers with an MTi: repeated, timed, matched by message id.

Parts of a session (generators: they yield bytes to write and are sent a Tick). Data still in the
pipe is skipped, WakeUp is answered and ends what was going on, an Error is an answer.

Source: MTi sheet, sections 1, 2 and 9.
"""

from collections.abc import Generator
from typing import TypeVar

from hw.device import Tick
from hw.mti.frames import Mid, MtFrame, encode_frame, error_in_words
from hw.mti.service import BAUD_CODES

CONFIG_RETRY_S = 0.25  # acknowledgements get lost among the data that is still in the pipe
CONFIG_TRIES = 3  # before the cause says so
BAUDS_SAID_AFTER_S = 3.0
ANSWER_S, TRIES, OPTIONAL_TRIES = 0.5, 3, 2
NO_ANSWER = -1

Result = TypeVar("Result")
Talk = Generator[bytes, Tick, Result]


class StartAgainError(Exception):
    """The conversation cannot go on; says why, in words."""


class Conversation:
    """One device on its line."""

    def __init__(self, baud: int) -> None:
        self.now_s = 0.0
        self.refusal = b""  # data of the last Error
        self._baud = baud
        self._noise = self._frames = False  # what was heard since the last words about it

    def turn(self, out: bytes, *, waking: bool = True) -> Talk[list[MtFrame]]:
        """Write; the frames of the next tick.

        Args:
            waking: a WakeUp ends what is going on; False: nothing is, so it is only answered.
        """
        tick = yield out
        self.now_s = tick.now_s
        frames = [event for event in tick.events if isinstance(event, MtFrame)]
        if not tick.events:
            return frames
        self._noise = True
        self._frames = self._frames or bool(frames)
        if any(frame.mid == Mid.WakeUp for frame in frames):
            tick = yield encode_frame(Mid.WakeUpAck)
            self.now_s = tick.now_s
            if waking:
                raise StartAgainError("the MTi has restarted: its settings are checked again")
            return []
        return frames

    def maybe_answer(
        self, mid: Mid, data: bytes, sizes: tuple[int, ...], wait_s: float
    ) -> Talk[bytes | int | None]:
        """One request: the data of its answer, the code of an Error, or None after wait_s."""
        until_s = self.now_s + wait_s
        out = encode_frame(mid, data)
        while True:
            for frame in (yield from self.turn(out)):
                if frame.mid == mid + 1 and len(frame.data) in sizes:
                    return frame.data
                if frame.mid == Mid.Error and frame.data:
                    self.refusal = frame.data
                    return frame.data[0]
            if self.now_s >= until_s:
                return None
            out = b""

    def ask(
        self,
        mid: Mid,
        data: bytes = b"",
        *sizes: int,
        optional: bool = False,
        tries: int | None = None,
    ) -> Talk[bytes | int]:
        """A request, repeated: the data of its answer, of one of the sizes (none given: empty).

        An optional one may be refused: the code of the Error then, or NO_ANSWER.
        """
        answer: bytes | int | None = None
        for _ in range(tries or (OPTIONAL_TRIES if optional else TRIES)):
            answer = yield from self.maybe_answer(mid, data, sizes or (0,), ANSWER_S)
            if answer is not None:
                break
        if answer is None:
            answer = NO_ANSWER
        if isinstance(answer, bytes) or optional:
            return answer
        raise StartAgainError(self.refused(mid, answer))

    def refused(self, mid: Mid, answer: int) -> str:
        """In words, what became of a request that brought a code."""
        if answer == NO_ANSWER:
            return f"the MTi does not answer {mid.name}"
        return f"the MTi refuses {mid.name}: {error_in_words(self.refusal)}"

    def read(self, mid: Mid, size: int) -> Talk[int]:
        """A setting as the device holds it."""
        answer = yield from self.ask(mid, b"", size)
        assert isinstance(answer, bytes)  # only optional requests give codes
        return int.from_bytes(answer, "big")

    def go_to_config(self) -> Talk[str]:
        """Ask until it answers, however much data comes first; gives "" then.

        Gives the reason in words each time it has been asked for a while: ask again.
        """
        self._noise = self._frames = False
        answer: bytes | int | None = None
        for _ in range(CONFIG_TRIES):
            asked_s = self.now_s
            answer = yield from self.maybe_answer(Mid.GoToConfig, b"", (0,), CONFIG_RETRY_S)
            if answer == b"":
                return ""
            while self.now_s - asked_s < CONFIG_RETRY_S:  # it sent an Error
                yield from self.turn(b"")
        if isinstance(answer, int):
            return self.refused(Mid.GoToConfig, answer)
        return self._silence_in_words()

    def _silence_in_words(self) -> str:
        if self._frames:
            return (
                "the MTi sends data but does not answer GoToConfig: check the line to its receiver"
            )
        if self._noise:
            return (
                f"bytes arrive at {self._baud} baud but no MT frame: "
                "check the baud rate, or it is another device"
            )
        return "no answer to GoToConfig: check power, cable and baud rate"

    def bauds_in_words(self) -> str:
        """For a person who has to find out which one it is."""
        others = [str(baud) for baud in sorted(BAUD_CODES) if baud != self._baud]
        return f"asked at {self._baud} baud, an MTi may also be set to {', '.join(others)}"
