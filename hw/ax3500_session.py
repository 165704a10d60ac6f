"""Finds an AX3500 in whatever mode it is, and polls its two encoder counters, one query at a time.

It sends nothing that moves a motor, and nothing that changes the controller; entering RS-232 mode
takes the vehicle from its radio and happens only where the settings allow it.

Source: AX3500 sheet, sections 1, 10 and 12.
"""

import re
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any

from core.records import WheelCounts
from hw.ax3500 import (
    BYTE,
    CHARACTER_S,
    COUNTER,
    CR,
    ENCODER_BIT,
    READ_COUNTER,
    READ_IDENTITY,
    Line,
    LineParser,
    WatchdogStop,
    encode_query,
    maybe_byte,
    maybe_counter,
)
from hw.session import BadFrame, Device, DeviceStatus, Port, Session, Tick
from hw.wheel_counters import Pair, WheelCounters

LISTEN_S, BOOT_S, LISTEN_LIMIT_S = 0.3, 1.0, 3.0  # silence at first, after unknown lines; in all
CR_EVERY_S, CR_COUNT = 0.04, 20
ECHO_S, EXCHANGE_S = 0.1, 0.2
QUIET_S, QUIET_DOUBLINGS, QUIET_LIMIT_S = 0.05, 2, 1.0  # longer after each failure: late answers
FAILURES_TO_ENTER, LOST_S = 5, 2.0
IDENTITY_TRIES = 3
MAX_ANSWER = 16  # characters of a query's lines run together; a longer line is a start-up prompt
OUTAGE_S, OUTAGE_PAIRS = 0.5, 2.5  # the longer: a controller that restarts is away longer

IN_RC_MODE = "in R/C mode: set [drive] enter_rs232 = true to let mapod take it over"


class StartAgainError(Exception):
    """The conversation cannot go on; says why, in words."""


@dataclass(slots=True)
class CounterStream:
    """What the session hears, for the side that measures."""

    readings: list[tuple[int, float, int]] = field(default_factory=list)  # channel, t_s, raw
    zero_lost: bool = False  # the controller has restarted
    watchdog_stops: int = 0
    identity: int | None = None


class Ax3500Session:
    """Listening, entering, identifying, polling, lost: the states of section 12."""

    def __init__(
        self, status: DeviceStatus, stream: CounterStream, poll_hz: float, enter_rs232: bool
    ) -> None:
        self._status, self._stream = status, stream
        self._period_s, self._may_enter = 1.0 / poll_hz, enter_rs232
        self._now_s = 0.0
        self._fault = ""  # of the last exchange, in words
        self._failures = 0  # exchanges in a row

    def run(self) -> Session:
        """Yields the bytes to write, is sent a Tick."""
        yield from self._turn(b"")
        while True:
            try:
                yield from self._listen()
                yield from self._identify()
                yield from self._poll()
            except StartAgainError as why:
                self._status.fall_back("starting", str(why))

    def _turn(self, out: bytes) -> Generator[bytes, Tick, list[Any]]:
        """Write; the lines and bad frames of the next tick."""
        tick = yield out
        self._now_s = tick.now_s
        self._stream.readings = []
        stops = sum(isinstance(event, WatchdogStop) for event in tick.events)
        self._stream.watchdog_stops += stops
        return [event for event in tick.events if not isinstance(event, WatchdogStop)]

    def _listen(self) -> Generator[bytes, Tick, None]:
        """Until it is clear, or quiet. A logging line means R/C or analog mode."""
        quiet_s, limit_s, began_s = self._now_s, LISTEN_S, self._now_s
        while self._now_s - quiet_s < limit_s and self._now_s - began_s < LISTEN_LIMIT_S:
            for event in (yield from self._turn(b"")):
                quiet_s, limit_s = self._now_s, BOOT_S
                if isinstance(event, Line) and _tells_restart(event):
                    self._stream.zero_lost = True
                    if event.text == "OK":
                        return
                    if event.text.startswith(":") and self._may_enter:
                        yield from self._enter()
                        return
                    if event.text.startswith(":"):
                        self._status.fall_back("starting", IN_RC_MODE)
                        began_s = self._now_s

    def _enter(self) -> Generator[bytes, Tick, None]:
        """RS-232 mode by ten CR in a row; more, in case it was still starting up."""
        for _ in range(CR_COUNT):
            sent_s, out = self._now_s, CR
            while self._now_s - sent_s < CR_EVERY_S:
                for event in (yield from self._turn(out)):
                    if isinstance(event, Line) and event.text == "OK":
                        self._stream.zero_lost = True  # only a restart can have brought R/C mode
                        return
                out = b""

    def _identify(self) -> Generator[bytes, Tick, None]:
        """Insists on the encoder module where the controller tells; polling judges silence."""
        for last_try in (False, True):
            for _ in range(IDENTITY_TRIES):
                answer = yield from self._maybe_answer(READ_IDENTITY, BYTE)
                if answer is not None:
                    self._check_identity(answer)
                    return
            if last_try or not self._may_enter:
                return
            yield from self._enter()

    def _check_identity(self, answer: tuple[float, str]) -> None:
        identity = maybe_byte(answer[1])
        if identity is None:  # "-"
            return
        self._stream.identity = identity
        if not identity & ENCODER_BIT:
            raise StartAgainError(
                f"the controller has no encoder module: {READ_IDENTITY} says {identity:02X}"
            )

    def _poll(self) -> Generator[bytes, Tick, None]:
        """Both counters by turns. Channel 2 comes first in a pair: channel 1 then completes it."""
        channel, heard = 0, set[int]()
        good_s, due_s = [self._now_s, self._now_s], self._now_s
        while True:
            answer = yield from self._maybe_answer(READ_COUNTER[channel], COUNTER)
            raw = maybe_counter(answer[1]) if answer else None
            if answer is not None and raw is not None:
                self._stream.readings.append((channel, answer[0], raw))
                good_s[channel] = self._now_s
                heard.add(channel)
                if len(heard) == 2:
                    self._status.state, self._status.cause = "running", ""
            else:
                self._status.reject(BadFrame(f"{READ_COUNTER[channel]}: {self._fault}", b""))
                if self._now_s - min(good_s) > LOST_S:
                    raise StartAgainError(f"no counters for {LOST_S:.0f} s: {self._fault}")
                if self._failures == FAILURES_TO_ENTER and self._may_enter:
                    yield from self._enter()
            channel = 1 - channel
            if channel == 1:
                due_s = max(due_s + self._period_s, self._now_s - self._period_s)
                while self._now_s < due_s:
                    self._check_restart((yield from self._turn(b"")))

    def _maybe_answer(
        self, query: str, legal: re.Pattern[str]
    ) -> Generator[bytes, Tick, tuple[float, str] | None]:
        """One exchange: when the controller took its value, and the value (or "-"); or None.

        A value counts only after the echo of its own query: prompts look like values.
        """
        written_s, out, echoed = self._now_s, encode_query(query), False
        self._fault = "no echo: off, not connected, or not in RS-232 mode"
        while self._now_s - written_s <= (EXCHANGE_S if echoed else ECHO_S):
            events = yield from self._turn(out)
            out = b""
            self._check_restart(events)
            for event in events:
                if not echoed:
                    echoed = isinstance(event, Line) and event.text.upper() == query
                    self._fault = "no value after the echo" if echoed else self._fault
                    continue
                if not isinstance(event, Line) or event.began_s - written_s > EXCHANGE_S:
                    self._fault = "damaged or late value"
                elif event.text == "-" or legal.fullmatch(event.text):
                    self._failures, self._fault = 0, "refused"
                    taken_s = (written_s + (len(query) + 1) * CHARACTER_S + event.began_s) / 2
                    return taken_s, event.text
                else:
                    self._fault = f"damaged value {event.text!r}"
                yield from self._fail()
                return None
        yield from self._fail()
        return None

    def _fail(self) -> Generator[bytes, Tick, None]:
        """Let late answers pass by until it is quiet, so that none is taken for the next one's."""
        quiet_for_s = QUIET_S * 2 ** min(self._failures, QUIET_DOUBLINGS)
        self._failures += 1
        began_s = quiet_s = self._now_s
        while self._now_s - quiet_s < quiet_for_s and self._now_s - began_s < QUIET_LIMIT_S:
            events = yield from self._turn(b"")
            self._check_restart(events)
            if events:
                quiet_s = self._now_s

    def _check_restart(self, events: list[Any]) -> None:
        """Lines that nobody asked for: the controller starts up, or is back in R/C mode."""
        for event in events:
            if isinstance(event, Line) and _tells_restart(event):
                self._stream.zero_lost = True
                raise StartAgainError(f"the controller has restarted: it sent {event.text!r}")


def _tells_restart(line: Line) -> bool:
    return line.text == "OK" or line.text.startswith(":") or len(line.text) > MAX_ANSWER


class Ax3500(Device[WheelCounts]):
    """The two wheel encoders behind an AX3500."""

    def __init__(
        self,
        port: Port,
        *,
        poll_hz: float,
        left_channel: int,
        right_channel: int,
        inverted_channels: tuple[int, ...],
        enter_rs232: bool,
        max_counts_per_s: float,
    ) -> None:
        self.stream = CounterStream()
        self._left, self._right = left_channel - 1, right_channel - 1
        self._signs = [-1.0 if channel in inverted_channels else 1.0 for channel in (1, 2)]
        self._counters = WheelCounters(max_counts_per_s, max(OUTAGE_S, OUTAGE_PAIRS / poll_hz))
        status = DeviceStatus("ax3500")
        super().__init__(
            status,
            port,
            LineParser,
            lambda: Ax3500Session(status, self.stream, poll_hz, enter_rs232).run(),
        )

    def _measure(self, now_s: float, events: list[Any]) -> list[WheelCounts]:
        if self.stream.zero_lost:
            self._counters.forget_zero()
            self.stream.zero_lost = False
        measured = []
        for reading in self.stream.readings:
            match self._counters.take(*reading):
                case Pair(t_s, one, two):
                    counts = (self._signs[0] * one, self._signs[1] * two)
                    measured.append(
                        WheelCounts(
                            t_s, counts[self._left], counts[self._right], self._counters.restarts
                        )
                    )
                case BadFrame() as refused:
                    self.status.reject(refused)
        self.stream.readings = []
        return measured
