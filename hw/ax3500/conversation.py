"""One exchange at a time with an AX3500: query, echo, values; and what comes unasked.

Source: AX3500 sheet, sections 1, 2, 10 and 12.
"""

import math
import re
from dataclasses import dataclass, field
from typing import Any

from hw.ax3500.lines import CHARACTER_S, CR, Line, WatchdogStop
from hw.ax3500.motors import Motors
from hw.ax3500.values import ControllerState
from hw.device import DeviceStatus, Tick
from hw.exchange import Exchange, StartAgainError, Steps

CR_EVERY_S, CR_COUNT = 0.04, 20
ECHO_S, EXCHANGE_S = 0.1, 0.2
QUIET_S, QUIET_DOUBLINGS, QUIET_LIMIT_S = 0.05, 2, 1.0  # longer after each failure: late answers
FORGET = 0.98  # of the controller's delay, an exchange
LEARNT_S = 1.0  # for so long it is known what an exchange that was looked at in time has taught
STARVE_S = 1.2  # of silence: the controller's watchdog waits 1 s
RESTART_S = 0.5  # it is longer without power than this before it says that it starts: sheet, 0.7 s
MAX_ANSWER = 16  # characters of a query's lines run together; a longer line is a start-up prompt
NO_ECHO = "no echo: off, not connected, or not in RS-232 mode"
NO_VALUE = "no value after the echo"
NO_LINE = "bytes, but never a clean line: check baud rate, parity E and 7 bits"
is_logging = re.compile(r":[0-9A-F]{16,}\Z").match  # whole, as no damage makes it
# a line that comes only from a controller that starts up, or is in R/C or analog mode
is_start_up = re.compile(rf"OK\Z|:|.{{{MAX_ANSWER + 1}}}", re.DOTALL).match
KNOWN_LINE = re.compile(r"OK|[+-]|[0-9A-Fa-f]{1,8}|:[0-9A-Fa-f]+|[?^!][0-9A-Za-z]{1,3}")


@dataclass(slots=True)
class CounterStream:
    """What the session hears, for the side that measures."""

    readings: list[tuple[int, float, int]] = field(default_factory=list)  # channel, t_s, raw
    zero_lost: bool = False  # the controller has restarted;
    unpowered_s: float = math.inf  # since then it has given the motors no power, inf: nobody knows,
    by_other: bool = False  # but for what a radio or sticks may have asked for meanwhile
    watchdog_stops: int = 0
    identity: int | None = None
    controller: ControllerState = field(default_factory=ControllerState)
    remark: str = ""  # while running

    def lose_zero(self, unpowered_s: float, *, by_other: bool = False) -> None:
        self.zero_lost, self.unpowered_s = True, min(self.unpowered_s, unpowered_s)
        self.by_other |= by_other

    def take_lost_zero(self) -> tuple[float, bool]:
        """`unpowered_s` and `by_other` of what was lost until now."""
        told = self.unpowered_s, self.by_other
        self.zero_lost, self.unpowered_s, self.by_other = False, math.inf, False
        return told


class AnswerTimes:
    """How long exchanges take: the line carries CHARACTER_S each, and the controller thinks.

    Characters that arrive before an answer can be whole are not worth a turn each.
    """

    def __init__(self) -> None:
        self.learnt_s = -math.inf  # host clock, when an answer was last looked at in time
        self._line_s: dict[str, float] = {}  # characters' time, query and its newest answer
        self.delay_s = 0.0  # beyond the characters' own time, as seen

    def whole_s(self, query: str) -> float:
        """From the writing of a query to the last character of its answer, at the soonest."""
        return self._line_s.get(query, (len(query) + 2) * CHARACTER_S) + self.delay_s

    def fit(self, query: str, texts: list[str]) -> float:
        """An exchange that went well: what its characters took, for this is how long they are."""
        # a CR behind each line, and the echo of the last one comes a character behind it
        characters = len(query) + 2 + len("".join(texts)) + len(texts)
        self._line_s[query] = line_s = characters * CHARACTER_S
        return line_s

    def learn(self, now_s: float, beyond_s: float, is_late: bool) -> None:
        """One that was looked at in time. Where it was whole at once, look sooner again.

        Args:
            beyond_s: how long it took beyond its characters' own time.
        """
        delay_s = beyond_s if is_late else FORGET * self.delay_s
        self.delay_s, self.learnt_s = min(max(0.0, delay_s), ECHO_S / 2), now_s


class Conversation:
    """Exchanges with one controller, and what they say about it."""

    def __init__(self, status: DeviceStatus, stream: CounterStream, motors: Motors) -> None:
        self.exchange = Exchange(status, self._hear, pause_s=0.0, longest_pause_s=0.0)
        self.expects_restart = True  # lines of a controller that starts up are no surprise now
        self.fault = ""  # of the last exchange
        self.failures = 0  # exchanges in a row
        self.took_s = 0.0  # the last good exchange, without what its answer lay in the line
        self.entered = False  # RS-232 mode by our CRs: that switches the watchdog on
        self._stream, self._motors = stream, motors
        self._times = AnswerTimes()
        self._heard_line = False  # that this controller may send, since the conversation began
        self.is_noise = False  # whether something arrives, and never such a line

    def _hear(self, tick: Tick) -> list[Any]:
        if self._stream.readings:
            self._stream.readings = []
        if self._motors.enabled:
            self._motors.look(tick.now_s)
        events, maybe_restart = list[Any](), None
        for event in tick.events:
            if isinstance(event, WatchdogStop):
                self._stream.watchdog_stops += 1
                self._motors.doubt("the controller's watchdog stopped them")
                continue
            events.append(event)
            if not isinstance(event, Line):
                self.is_noise = not self._heard_line
                continue
            if not self._heard_line:
                self._heard_line = KNOWN_LINE.fullmatch(event.text) is not None
                self.is_noise = not self._heard_line
            if maybe_restart is None and not self.expects_restart and is_start_up(event.text):
                maybe_restart = event
        if maybe_restart is not None:
            self.have_restarted(maybe_restart)
            raise StartAgainError(f"the controller has restarted: it sent {maybe_restart.text!r}")
        return events

    def have_restarted(self, line: Line) -> None:
        """Its counters begin at zero, in the mode that its flash says and this line shows."""
        self.entered = False
        if not line.text.startswith(":"):
            # its end: what came last before the restart may be its beginning
            self._stream.lose_zero(self.exchange.now_s - RESTART_S)
        elif is_logging(line.text):  # in R/C mode, in which nobody but a radio moves anything
            self._stream.lose_zero(line.began_s, by_other=True)
        else:
            self._stream.lose_zero(math.inf, by_other=True)

    def enter(self) -> Steps[None]:
        """RS-232 mode by ten CR in a row; more, in case it was still starting up."""

        def maybe_ok(event: Any) -> bool | None:  # a logging line may stand in front of it
            return True if isinstance(event, Line) and event.text.endswith("OK") else None

        before, self.expects_restart = self.expects_restart, True
        if (yield from self.exchange.ask(CR, maybe_ok, CR_EVERY_S, CR_COUNT)):
            # only a restart can have brought R/C mode, in which its radio drives
            self._stream.lose_zero(self.exchange.now_s, by_other=True)
            self.entered = True
            yield from self.exchange.turn(self.stop_motors())
        self.expects_restart = before

    def maybe_answer(
        self,
        query: str,
        out: bytes,
        legal: re.Pattern[str],
        lines: int = 1,
        look_by_s: float = -math.inf,
    ) -> Steps[tuple[float, list[str]] | None]:
        """One exchange: when the controller took its values, and these (or "-"); or None.

        A value counts only after the echo of its own query: prompts look like values.

        Args:
            look_by_s: until then the answer may lie in the line, for a step that comes by itself.
                Its time follows then from how long exchanges take, which those teach that are
                looked at in time.
        """
        times, written_s = self._times, self.exchange.now_s
        until_s, whole_s = written_s + ECHO_S, written_s + times.whole_s(query)
        is_patient = look_by_s > whole_s and written_s - times.learnt_s < LEARNT_S
        look_s = look_by_s if is_patient else whole_s
        echoed, fault, texts, began_s, is_late = False, None, list[str](), 0.0, False
        while fault is None and self.exchange.now_s < until_s:
            is_late = self.exchange.now_s >= whole_s  # we have looked, and it was not whole
            due_s, hears_s = (until_s, whole_s) if is_late else (min(look_s, until_s), look_s)
            events = yield from self.exchange.turn(out, due_s, hears_s, self._motors.enabled)
            out = b""
            for event in events:
                if not echoed:
                    echoed = isinstance(event, Line) and event.text.upper() == query.upper()
                    until_s = written_s + EXCHANGE_S if echoed else until_s
                    continue
                if not isinstance(event, Line) or event.began_s - written_s > EXCHANGE_S:
                    fault = "damaged or late value"
                elif event.text != "-" and not legal.fullmatch(event.text):
                    fault = f"damaged value {event.text!r}"
                else:
                    began_s = began_s if texts else event.began_s
                    texts.append(event.text)
                    fault = "" if len(texts) == lines or event.text == "-" else None
                if fault is not None:
                    break
        if fault == "":
            maybe_late = is_late if is_late or not is_patient else None
            taken_s = self._have_answer(query, texts, written_s, began_s, maybe_late)
            return taken_s, ["-"] if "-" in texts else texts
        silence = NO_LINE if self.is_noise else NO_VALUE if echoed else NO_ECHO
        self.fault = fault or silence
        yield from self._fail()
        return None

    def _have_answer(
        self,
        query: str,
        texts: list[str],
        written_s: float,
        began_s: float,
        maybe_late: bool | None,
    ) -> float:
        """When the controller took the values of an exchange that went well.

        Args:
            maybe_late: whether it was not whole at the first look; None: nobody looked in time.
        """
        times, passed_s = self._times, self.exchange.now_s - written_s
        line_s = times.fit(query, texts)
        self.failures, self.fault, self.took_s = 0, "refused", passed_s
        if maybe_late is not None:
            times.learn(self.exchange.now_s, passed_s - line_s, maybe_late)
        else:
            # the first character of the answer comes behind a CR, the echo and itself
            sent_s = (len(query) + 3) * CHARACTER_S + times.delay_s
            began_s = min(began_s, written_s + sent_s)
            self.took_s = min(passed_s, line_s + times.delay_s)
        return (written_s + (len(query) + 1) * CHARACTER_S + began_s) / 2

    def _fail(self) -> Steps[None]:
        """Let late answers pass by until it is quiet, so that none is taken for the next one's.

        Motors that still have not acknowledged a zero are starved: for the watchdog, say nothing.
        """
        quiet_s = QUIET_S * 2 ** min(self.failures, QUIET_DOUBLINGS)
        self.failures += 1
        starve_s = STARVE_S if self._motors.is_overdue else 0.0
        out = self.stop_motors()
        yield from self.exchange.until_quiet(quiet_s, QUIET_LIMIT_S, least_s=starve_s, out=out)
        if starve_s:
            self._motors.have_starved()

    def stop_motors(self) -> bytes:
        """Zero for motors that may be moving, sent blindly; what is known of them is void."""
        out = self._motors.stop_bytes() if self._motors.may_move else b""
        self._motors.doubt()
        return out
