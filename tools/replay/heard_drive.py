"""An AX3500 that somebody else asks: its counters and state, by what it answered to whom it heard.

An app without the map of before drives otherwise than the one that was recorded, and so asks and
commands the controller at other instants and for other things. The answers in the recording are
those to the recorded app. Each line is told by the echo of the query before it, and a counter's
instant by when that query was written.
"""

from collections import deque

from core.config import Config
from hw.ax3500.conversation import NO_ECHO, CounterStream, is_start_up
from hw.ax3500.lines import (
    CHARACTER_S,
    READ_COUNTER,
    READ_IDENTITY,
    Line,
    maybe_byte,
    maybe_counter,
)
from hw.ax3500.session import LOST_S, Ax3500, Ax3500Options
from hw.ax3500.values import VALUES, state_after_answer
from hw.device import BadFrame, DeviceStatus, Session
from tools.replay.ports import PlayedPort
from wiring import full_counts_per_s

LINES = dict.fromkeys((*READ_COUNTER, READ_IDENTITY), 1) | VALUES  # of each answer


def heard_ax3500(port: PlayedPort, options: Ax3500Options, config: Config) -> Ax3500:
    """It commands no motors: why these did not obey is known as far as the controller says it."""

    def listen(status: DeviceStatus, stream: CounterStream) -> Session:
        return Listening(status, stream, port.asked).run()

    speed = full_counts_per_s(config)
    return Ax3500(port, options, max_counts_per_s=speed, enable_motors=False, listen=listen)


class Listening:
    """One connection's conversation, overheard.

    Args:
        asked: what was written to the controller and when, as far as nobody has answered it.
    """

    def __init__(
        self, status: DeviceStatus, stream: CounterStream, asked: deque[tuple[float, bytes]]
    ) -> None:
        self._status, self._stream, self._asked = status, stream, asked
        self._query, self._texts = "", list[str]()  # the newest echo, and what followed it
        self._written_s: float | None = None  # that query; None: it is not known
        self._began_s = 0.0  # the first line of the answer
        self._good_s: dict[int, float] = {}  # each counter's newest answer

    def run(self) -> Session:
        while True:
            tick = yield b""
            self._stream.readings = []
            for event in tick.events:
                if isinstance(event, Line):
                    self._hear(event, tick.now_s)
                else:  # damaged, or the watchdog's word
                    self._stream.watchdog_stops += not isinstance(event, BadFrame)
                    self._query = ""
            self._judge(tick.now_s)

    def _hear(self, line: Line, now_s: float) -> None:
        text = line.text
        if is_start_up(text):
            self._query, self._stream.zero_lost = "", True
            self._good_s.clear()
            self._status.fall_back("starting", f"the controller has restarted: it sent {text!r}")
        elif text[0] in "?^!":
            self._query, self._texts = text.upper(), []
            self._written_s = self._maybe_written_s(self._query)
        elif self._query in LINES:
            self._began_s = self._began_s if self._texts else line.began_s
            self._texts.append(text)
            if text == "-" or len(self._texts) == LINES[self._query]:
                self._take(now_s)
                self._query = ""

    def _maybe_written_s(self, query: str) -> float | None:
        """When it was; what was asked before it is not answered any more."""
        for k, (t_s, data) in enumerate(self._asked):
            if query in data.decode("ascii", "replace").upper().split("\r"):
                for _ in range(k + 1):
                    self._asked.popleft()
                return t_s
        return None

    def _take(self, now_s: float) -> None:
        """An answer is complete."""
        query, texts, stream = self._query, self._texts, self._stream
        if query in READ_COUNTER:
            self._count(READ_COUNTER.index(query), now_s)
        elif query == READ_IDENTITY:
            stream.identity = maybe_byte(texts[0])
        else:
            before, identity = stream.controller, stream.identity
            state = state_after_answer(before, query, texts, self._began_s, identity)
            stream.controller = state or before

    def _count(self, channel: int, now_s: float) -> None:
        raw = maybe_counter(self._texts[0])
        if raw is None:
            reason = f"{self._query}: damaged value {self._texts[0]!r}"
            self._status.reject(BadFrame(reason, b""))
        elif self._written_s is not None:
            written_s = self._written_s + (len(self._query) + 1) * CHARACTER_S
            taken_s = (written_s + self._began_s) / 2
            self._stream.readings.append((channel, taken_s, raw))
            self._good_s[channel] = now_s

    def _judge(self, now_s: float) -> None:
        if len(self._good_s) < len(READ_COUNTER):
            return
        if now_s - min(self._good_s.values()) > LOST_S:
            self._good_s.clear()
            self._status.fall_back("starting", f"no counters for {LOST_S:.0f} s: {NO_ECHO}")
        else:
            self._status.state, self._status.cause = "running", self._stream.controller.trouble
