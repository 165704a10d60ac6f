"""Questions and answers with an MTi: repeated, timed, matched by message id.

Data still in the pipe is skipped, WakeUp is answered and ends what was going on, an Error is an
answer.
Source: MTi sheet, sections 1, 2 and 9.
"""

from hw.device import DeviceStatus, Tick
from hw.exchange import Exchange, StartAgainError, Steps
from hw.mti.frames import BAUD_CODES, Mid, MtFrame, describe_error, encode_frame

CONFIG_RETRY_S = 0.25  # acknowledgements get lost among the data that is still in the pipe
CONFIG_TRIES = 3  # before the cause says so
ANSWER_S, TRIES, OPTIONAL_TRIES = 0.5, 3, 2
PAUSE_S = 0.2  # before a new attempt
NO_ANSWER = -1
WAKE_UP = int(Mid.WakeUp)  # of each frame it is asked: a name within an enum is slow to find
RESTARTED = "the MTi has restarted: its settings are checked again"

Answer = bytes | int  # data; the code of an Error, or NO_ANSWER


class Conversation:
    """One device on its line."""

    def __init__(self, status: DeviceStatus, baud: int) -> None:
        self.waits = True  # nothing is going on that a WakeUp could end
        self.exchange = Exchange(status, self._hear, pause_s=PAUSE_S, longest_pause_s=PAUSE_S)
        self._baud = baud
        self._refusal = b""  # data of the last Error
        self._has_noise = self._has_frames = False  # since they were told last

    def _hear(self, tick: Tick) -> list[MtFrame]:
        """The frames of a tick; a WakeUp is answered, and ends what is going on."""
        frames, wakes_up = [], False
        for event in tick.events:
            self._has_noise = True
            if isinstance(event, MtFrame):
                frames.append(event)
                self._has_frames, wakes_up = True, wakes_up or event.mid == WAKE_UP
        if not wakes_up:
            return frames
        self.exchange.reply(encode_frame(Mid.WakeUpAck))
        if not self.waits:
            raise StartAgainError(RESTARTED)
        return []

    def try_ask(
        self,
        mid: Mid,
        data: bytes = b"",
        *sizes: int,
        wait_s: float = ANSWER_S,
        tries: int = OPTIONAL_TRIES,
    ) -> Steps[Answer]:
        """A request: the data of its answer, of one of the sizes (none given: empty), or a code."""

        def maybe_match(frame: MtFrame) -> Answer | None:
            if frame.mid == mid + 1 and len(frame.data) in (sizes or (0,)):
                return frame.data
            if frame.mid == Mid.Error and frame.data:
                self._refusal = frame.data
                return frame.data[0]
            return None

        command = encode_frame(mid, data)
        answer = yield from self.exchange.ask(command, maybe_match, wait_s, tries)
        return NO_ANSWER if answer is None else answer

    def ask(self, mid: Mid, data: bytes = b"", *sizes: int) -> Steps[bytes]:
        """The same where nothing goes on without an answer."""
        answer = yield from self.try_ask(mid, data, *sizes, tries=TRIES)
        if isinstance(answer, int):
            raise StartAgainError(self.describe_refusal(mid, answer))
        return answer

    def describe_refusal(self, mid: Mid, code: int) -> str:
        if code == NO_ANSWER:
            return f"the MTi does not answer {mid.name}"
        return f"the MTi refuses {mid.name}: {describe_error(self._refusal)}"

    def read(self, mid: Mid, size: int) -> Steps[int]:
        return int.from_bytes((yield from self.ask(mid, b"", size)), "big")

    def go_to_config(self) -> Steps[str]:
        """Ask until it answers, however much data comes first; gives "" then.

        Gives the reason each time it has been asked for a while: ask again.
        """
        self._has_noise = self._has_frames = False
        exchange = self.exchange
        answer: Answer = NO_ANSWER
        for _ in range(CONFIG_TRIES):
            asked_s = exchange.now_s
            answer = yield from self.try_ask(Mid.GoToConfig, wait_s=CONFIG_RETRY_S, tries=1)
            if isinstance(answer, bytes):
                return ""
            while exchange.now_s - asked_s < CONFIG_RETRY_S:  # it sent an Error
                yield from exchange.turn()
        if isinstance(answer, int) and answer != NO_ANSWER:
            return self.describe_refusal(Mid.GoToConfig, answer)
        if self._has_frames:
            return (
                "the MTi sends data but does not answer GoToConfig: check the line to its receiver"
            )
        if self._has_noise:
            return (
                f"bytes arrive at {self._baud} baud but no MT frame: "
                "check the baud rate, or it is another device"
            )
        return "no answer to GoToConfig: check power, cable and baud rate"

    def describe_bauds(self) -> str:
        others = [str(baud) for baud in sorted(BAUD_CODES) if baud != self._baud]
        return f"asked at {self._baud} baud, an MTi may also be set to {', '.join(others)}"
