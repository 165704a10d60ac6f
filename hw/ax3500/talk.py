"""One exchange at a time with an AX3500: query, echo, values; and what comes unasked.

Source: AX3500 sheet, sections 1, 2, 10 and 12.
"""

import re
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any

from hw.ax3500.lines import CHARACTER_S, CR, Line, WatchdogStop
from hw.ax3500.motors import Motors
from hw.ax3500.values import ControllerState, maybe_state_after_log_line
from hw.device import DeviceStatus, Tick

CR_EVERY_S, CR_COUNT = 0.04, 20
ECHO_S, EXCHANGE_S = 0.1, 0.2
QUIET_S, QUIET_DOUBLINGS, QUIET_LIMIT_S = 0.05, 2, 1.0  # longer after each failure: late answers
STARVE_S = 1.2  # of silence: the controller's watchdog waits 1 s
MAX_ANSWER = 16  # characters of a query's lines run together; a longer line is a start-up prompt
KNOWN_LINE = re.compile(r"OK|[+-]|[0-9A-Fa-f]{1,8}|:[0-9A-Fa-f]+|[?^!][0-9A-Za-z]{1,3}")
NO_ECHO = "no echo: off, not connected, or not in RS-232 mode"
NO_LINE = "bytes, but never a clean line: check baud rate, parity E and 7 bits"


class StartAgainError(Exception):
    """The conversation cannot go on; says why, in words."""


@dataclass(slots=True)
class CounterStream:
    """What the session hears, for the side that measures."""

    readings: list[tuple[int, float, int]] = field(default_factory=list)  # channel, t_s, raw
    zero_lost: bool = False  # the controller has restarted
    watchdog_stops: int = 0
    identity: int | None = None
    controller: ControllerState = field(default_factory=ControllerState)
    remark: str = ""  # while running, in words


class Talk:
    """The conversation's primitives; a session says what is talked about."""

    def __init__(self, status: DeviceStatus, stream: CounterStream, motors: Motors) -> None:
        self._status, self._stream, self._motors = status, stream, motors
        self._now_s = 0.0
        self._fault = ""  # of the last exchange, in words
        self._failures = 0  # exchanges in a row
        self._trouble_s = float("-inf")  # host clock, of the last failed exchange
        self._clean_lines = self._unclean_lines = 0  # since the conversation began
        self._entered = False  # RS-232 mode by our CRs: that switches the watchdog on

    @property
    def is_noise(self) -> bool:
        """Whether something arrives, and never a line that this controller may send."""
        return self._unclean_lines > 0 and not self._clean_lines

    def _turn(self, out: bytes) -> Generator[bytes, Tick, list[Any]]:
        """Write; the lines and bad frames of the next tick."""
        tick = yield out
        self._now_s = tick.now_s
        if self._stream.readings:
            self._stream.readings = []
        self._motors.look(tick.now_s)
        if not tick.events:
            return tick.events
        stops = sum(isinstance(event, WatchdogStop) for event in tick.events)
        if stops:
            self._stream.watchdog_stops += stops
            self._motors.doubt("the controller's watchdog stopped them")
        events = [event for event in tick.events if not isinstance(event, WatchdogStop)]
        for event in events:
            clean = isinstance(event, Line) and KNOWN_LINE.fullmatch(event.text) is not None
            self._clean_lines += clean
            self._unclean_lines += not clean
            if isinstance(event, Line) and event.text.startswith(":"):
                self._take_log_line(event)
        return events

    def _take_log_line(self, line: Line) -> None:
        state = maybe_state_after_log_line(
            self._stream.controller, line.text, line.began_s, self._stream.identity
        )
        self._stream.controller = state or self._stream.controller

    def _enter(self) -> Generator[bytes, Tick, None]:
        """RS-232 mode by ten CR in a row; more, in case it was still starting up."""
        for _ in range(CR_COUNT):
            sent_s, out = self._now_s, CR
            while self._now_s - sent_s < CR_EVERY_S:
                for event in (yield from self._turn(out)):
                    # a logging line that broke off may stand in front of it
                    if isinstance(event, Line) and event.text.endswith("OK"):
                        self._stream.zero_lost = True  # only a restart can have brought R/C mode
                        self._entered = True
                        yield from self._turn(self._stop_motors())
                        return
                out = b""

    def _maybe_answer(
        self, query: str, out: bytes, legal: re.Pattern[str], lines: int = 1
    ) -> Generator[bytes, Tick, tuple[float, list[str]] | None]:
        """One exchange: when the controller took its values, and these (or "-"); or None.

        A value counts only after the echo of its own query: prompts look like values.
        """
        written_s, echoed = self._now_s, False
        first_s, texts = 0.0, list[str]()
        self._fault = NO_ECHO
        while self._now_s - written_s <= (EXCHANGE_S if echoed else ECHO_S):
            events = yield from self._turn(out)
            out = b""
            self._check_restart(events)
            for event in events:
                if not echoed:
                    echoed = isinstance(event, Line) and event.text.upper() == query.upper()
                    self._fault = "no value after the echo" if echoed else self._fault
                    continue
                if not isinstance(event, Line) or event.began_s - written_s > EXCHANGE_S:
                    self._fault = "damaged or late value"
                elif event.text == "-" or legal.fullmatch(event.text):
                    first_s = first_s if texts else event.began_s
                    texts.append(event.text)
                    if len(texts) < lines and event.text != "-":
                        continue
                    self._failures, self._fault = 0, "refused"
                    taken_s = (written_s + (len(query) + 1) * CHARACTER_S + first_s) / 2
                    return taken_s, ["-"] if "-" in texts else texts
                else:
                    self._fault = f"damaged value {event.text!r}"
                yield from self._fail()
                return None
        if self.is_noise:
            self._fault = NO_LINE
        yield from self._fail()
        return None

    def _fail(self) -> Generator[bytes, Tick, None]:
        """Let late answers pass by until it is quiet, so that none is taken for the next one's.

        Motors that still have not acknowledged a zero are starved: for the watchdog, say nothing.
        """
        quiet_for_s = QUIET_S * 2 ** min(self._failures, QUIET_DOUBLINGS)
        self._failures += 1
        began_s = quiet_s = self._trouble_s = self._now_s
        starve_s = STARVE_S if self._motors.is_overdue else 0.0
        out = self._stop_motors()
        while self._now_s - began_s < starve_s or (
            self._now_s - quiet_s < quiet_for_s and self._now_s - began_s < QUIET_LIMIT_S
        ):
            events = yield from self._turn(out)
            out = b""
            self._check_restart(events)
            if events:
                quiet_s = self._now_s
        if starve_s:
            self._motors.have_starved()

    def _check_restart(self, events: list[Any]) -> None:
        """Lines that nobody asked for: the controller starts up, or is back in R/C mode."""
        for event in events:
            if isinstance(event, Line) and tells_restart(event):
                self._stream.zero_lost, self._entered = True, False
                raise StartAgainError(f"the controller has restarted: it sent {event.text!r}")

    def _stop_motors(self) -> bytes:
        """Zero for motors that may be moving, sent blindly; what is known of them is void."""
        out = self._motors.stop_bytes() if self._motors.may_move else b""
        self._motors.doubt()
        return out


def tells_restart(line: Line) -> bool:
    """A line that comes only from a controller that starts up, or is in R/C or analog mode."""
    return line.text == "OK" or line.text.startswith(":") or len(line.text) > MAX_ANSWER
