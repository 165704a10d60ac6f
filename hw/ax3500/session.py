"""Finds an AX3500 in whatever mode it is, polls its two encoder counters, commands its motors.

The controller says nothing by itself in RS-232 mode: each value is an exchange of its own, query,
echo, value, never two at a time. In R/C mode it belongs to its radio and only logs; ten CR in a row
take it over, which also switches its watchdog on. So the session first listens: a logging line
means R/C mode, `OK` the end of a start-up. It changes nothing in the controller; it takes the
vehicle from its radio only where the settings allow it, and moves motors only where they do.

| state       | what it does                                        | what ends it              |
|-------------|-----------------------------------------------------|---------------------------|
| LISTENING   | reads; writes a zero for motors that may be moving  | `OK`, R/C mode, or 0.3 s  |
|             |                                                     | of silence                |
| ENTERING    | sends a CR each 40 ms                               | `OK`, or twenty CR        |
| IDENTIFYING | asks for the identity and, with motors, for modes   | answers, or 3 tries each  |
| POLLING     | motor commands, counters, slow values, by turns     | no counter for 2 s        |

A line of a start-up while IDENTIFYING or POLLING, and a controller without encoders, lead back to
LISTENING; five failed exchanges in a row to ENTERING, where that is allowed.
Source: AX3500 sheet, sections 1, 3, 10 and 12.
"""

import enum
import math
import re
from collections.abc import Callable
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from core.records import WheelCounts
from hw.ax3500.conversation import NO_ECHO, NO_LINE, Conversation, CounterStream, is_start_up
from hw.ax3500.counters import Pair, WheelCounters
from hw.ax3500.lines import (
    BYTE,
    COUNTER,
    ENCODER_BIT,
    READ_COUNTER,
    READ_IDENTITY,
    Line,
    LineParser,
    encode_query,
    maybe_byte,
    maybe_counter,
)
from hw.ax3500.motors import Motors
from hw.ax3500.schedule import REFRESH_S, Schedule
from hw.ax3500.values import READ_INPUTS, READ_STATUS, VALUES, state_after_answer
from hw.device import BadFrame, Device, DeviceStatus, Port, Session
from hw.exchange import StartAgainError, Steps

LISTEN_S, BOOT_S, LISTEN_LIMIT_S = 0.3, 1.0, 3.0  # silence at first, after unknown lines; in all
FAILURES_TO_ENTER, LOST_S = 5, 2.0
READ_TRIES = 3
READ_INPUT_MODE, READ_MOTOR_MODE = "^00", "^01"
PLUS = re.compile(r"\+")
CONDITION_S = 3.0  # status and emergency stop older than this are not known
OUTAGE_S, OUTAGE_PAIRS = 0.5, 2.5  # the longer: a controller that restarts is away longer

NO_STATUS = "the controller does not tell its status"
IN_RC_MODE = "in R/C mode: set [drive] enter_rs232 = true to let mapod take it over"


class State(enum.Enum):
    """What a session is doing; the table above."""

    LISTENING = "listening"
    ENTERING = "taking the controller from its radio"
    IDENTIFYING = "asking for identity and modes"
    POLLING = "polling"


class Ax3500Options(Struct, frozen=True):
    """The keys of [drive] that its driver alone knows: how it is read and wired."""

    poll_hz: Annotated[float, Meta(ge=5, le=30)]
    left_channel: Literal[1, 2]
    right_channel: Literal[1, 2]
    invert: list[Literal[1, 2]]
    enter_rs232: bool
    radio: bool

    def __post_init__(self) -> None:
        if self.left_channel == self.right_channel:
            raise ValueError(
                f"right_channel: must differ from left_channel = {self.left_channel}, "
                f"is {self.right_channel}"
            )

    def describe(self) -> str:
        return f"{self.poll_hz:g} pairs/s"


class Ax3500Session:
    """The conversation with a controller, from its beginning as often as needed."""

    def __init__(
        self,
        status: DeviceStatus,
        stream: CounterStream,
        motors: Motors,
        poll_hz: float,
        enter_rs232: bool,
    ) -> None:
        self._status, self._stream, self._motors = status, stream, motors
        self._talk = Conversation(status, stream, motors)
        self._exchange = self._talk.exchange
        self._schedule, self._may_enter = Schedule(poll_hz), enter_rs232
        self._good_s, self._heard = [0.0, 0.0], set[int]()
        self._counter_faults = ["", ""]  # of each counter's last failed exchange
        self._polling_s = 0.0  # host clock, when polling began
        self._commands = 0  # not zero, since the last pair

    def run(self) -> Session:
        out = self._begin_anew("the connection is new")
        yield from self._exchange.turn()
        while True:
            try:
                yield from self._listen(out)
                yield from self._identify()
                yield from self._read_modes()
                yield from self._poll()
            except StartAgainError as why:
                self._exchange.fail(why)
                self._stream.remark = ""
                out = self._begin_anew(str(why))

    def _begin_anew(self, trouble: str) -> bytes:
        """Nothing is known of the motors any more; zero for those that may be moving."""
        self._status.session, self._talk.expects_restart = State.LISTENING, True
        out = self._talk.stop_motors()
        self._motors.forget_modes(trouble)
        return out

    # --- before polling

    def _listen(self, out: bytes) -> Steps[None]:
        """Until it is clear, or quiet. A logging line means R/C or analog mode."""
        x = self._exchange
        quiet_s, limit_s, began_s = x.now_s, LISTEN_S, x.now_s
        while x.now_s - quiet_s < limit_s and x.now_s - began_s < LISTEN_LIMIT_S:
            events = yield from x.turn(out)
            out = b""
            for event in events:
                quiet_s, limit_s = x.now_s, BOOT_S
                if not isinstance(event, Line) or not is_start_up(event.text):
                    continue
                self._talk.have_restarted(event)
                if event.text == "OK":
                    return
                if event.text.startswith(":") and self._may_enter:
                    yield from self._enter()
                    return
                if event.text.startswith(":"):
                    self._status.fall_back("starting", IN_RC_MODE)
                    began_s = x.now_s
        if x.now_s - began_s >= LISTEN_LIMIT_S and self._talk.is_noise:
            self._status.fall_back("starting", NO_LINE)

    def _enter(self) -> Steps[None]:
        before, self._status.session = self._status.session, State.ENTERING
        yield from self._talk.enter()
        self._status.session = before

    def _identify(self) -> Steps[None]:
        """Insists on the encoder module where the controller tells; polling judges silence."""
        self._status.session, self._talk.expects_restart = State.IDENTIFYING, False
        for last_try in (False, True):
            for _ in range(READ_TRIES):
                answer = yield from self._maybe_read(READ_IDENTITY)
                if answer is not None:
                    self._check_identity(answer)
                    return
            if last_try or not self._may_enter:
                return
            yield from self._enter()

    def _check_identity(self, answer: str) -> None:
        identity = maybe_byte(answer)
        if identity is None:  # "-"
            return
        self._stream.identity = identity
        if not identity & ENCODER_BIT:
            raise StartAgainError(
                f"the controller has no encoder module: {READ_IDENTITY} says {identity:02X}"
            )

    def _maybe_read(self, parameter: str) -> Steps[str | None]:
        """A parameter's value or "-"; the session works both with a `+` after it and without."""
        answer = yield from self._talk.maybe_answer(parameter, encode_query(parameter), BYTE)
        return answer[1][0] if answer else None

    def _read_modes(self) -> Steps[None]:
        """Only where motors may be commanded: whether they may, and what a command means."""
        if not self._motors.enabled:
            return
        modes: list[int | None] = []
        for parameter in (READ_INPUT_MODE, READ_MOTOR_MODE):
            answer = None
            for _ in range(READ_TRIES):
                answer = yield from self._maybe_read(parameter)
                if answer is not None and answer != "-":
                    break
            modes.append(maybe_byte(answer or ""))
        self._motors.adopt_modes(modes[0], modes[1], self._talk.entered)

    # --- polling

    def _poll(self) -> Steps[None]:
        """Motor commands, counters, slow values: one exchange after the other.

        A zero goes before everything. Other commands take turns with the queries that are due: on
        a slow line a wish that changes all the time would leave none to them.
        """
        self._status.session, x = State.POLLING, self._exchange
        self._good_s, self._heard = [x.now_s, x.now_s], set()
        self._polling_s = x.now_s
        self._schedule.begin(x.now_s)
        while True:
            blocked = self._find_remark()
            command = self._motors.maybe_command(blocked) if self._motors.enabled else None
            query = None
            if command is None or (command[1] != 0 and self._commands >= len(READ_COUNTER)):
                query = self._schedule.maybe_next(x.now_s)
            if query is None and command is not None:
                yield from self._command(*command)
                continue
            if query is None:
                yield from x.turn(due_s=self._schedule.due_s, each_step=True)
            elif query in READ_COUNTER:
                yield from self._ask_counter(READ_COUNTER.index(query))
            else:
                yield from self._ask_value(query)
            if x.now_s - min(self._good_s) > LOST_S:
                raise StartAgainError(self._why_no_counters())

    def _why_no_counters(self) -> str:
        now_s = self._exchange.now_s
        fault = self._counter_faults[self._good_s.index(min(self._good_s))]
        late = [k for k in (0, 1) if now_s - self._good_s[k] > LOST_S / 2]
        queries = " and ".join(READ_COUNTER[k] for k in late) + ": "
        reason = fault if fault in (NO_ECHO, NO_LINE) else queries + (fault or "not asked in time")
        return f"no counters for {LOST_S:.0f} s: {reason}"

    def _command(self, channel: int, power: int) -> Steps[None]:
        self._commands += power != 0
        out = self._motors.sent(channel, power)
        text = out.decode("ascii").rstrip("\r")
        answer = yield from self._talk.maybe_answer(text, out, PLUS)
        if answer is not None and answer[1] == ["+"]:
            self._motors.acknowledged(channel, power)

    def _ask_counter(self, channel: int) -> Steps[None]:
        query, talk = READ_COUNTER[channel], self._talk
        if channel == 0:  # ends a pair
            self._commands = 0
        look_by_s = -math.inf if self._motors.enabled else self._schedule.look_by_s
        answer = yield from talk.maybe_answer(
            query, encode_query(query), COUNTER, look_by_s=look_by_s
        )
        raw = maybe_counter(answer[1][0]) if answer else None
        if answer is None or raw is None:
            self._counter_faults[channel] = talk.fault
            self._status.reject(BadFrame(f"{query}: {talk.fault}", b""))
            if talk.failures == FAILURES_TO_ENTER and self._may_enter:
                yield from self._enter()
            return
        now_s = self._exchange.now_s
        self._schedule.counter_took(talk.took_s)
        self._stream.readings.append((channel, answer[0], raw))
        self._good_s[channel] = now_s
        self._heard.add(channel)
        if len(self._heard) == 2:
            self._status.state, self._status.cause = "running", self._stream.remark

    def _ask_value(self, query: str) -> Steps[None]:
        lines = VALUES[query]
        answer = yield from self._talk.maybe_answer(query, encode_query(query), BYTE, lines)
        if answer is None:
            self._status.reject(BadFrame(f"{query}: {self._talk.fault}", b""))
            return
        stream, (taken_s, texts) = self._stream, answer
        state = state_after_answer(stream.controller, query, texts, taken_s, stream.identity)
        stream.controller = state or stream.controller
        if texts == ["-"] and query not in (READ_STATUS, READ_INPUTS):
            self._schedule.refused(query, self._exchange.now_s)

    def _find_remark(self) -> str:
        """What keeps the motors from their wish, and the line from its pace.

        Gives why motors get zero only; what is not known is a reason too, where they are enabled.
        """
        now_s, motors, schedule = self._exchange.now_s, self._motors, self._schedule
        blocked = why = self._stream.controller.trouble
        motors_hz = 0.0
        if motors.enabled:
            blocked = blocked or self._what_is_not_told()
            why = motors.refusal or blocked or (motors.why_off if motors.turns_wish_down else "")
            motors_hz = 1.0 / REFRESH_S if motors.usable else 0.0
        if now_s >= schedule.judge_s:
            schedule.judge(now_s, motors_hz)
        remark = f"{why}; {schedule.remark}" if why and schedule.remark else why or schedule.remark
        self._stream.remark = remark
        if self._status.state == "running":
            self._status.cause = remark
        return blocked

    def _what_is_not_told(self) -> str:
        state, since_s = self._stream.controller, self._exchange.now_s - CONDITION_S
        since_s = max(self._polling_s, since_s)
        if state.status is None or state.taken_s[READ_STATUS] < since_s:
            return NO_STATUS
        if state.emergency_stop is None or state.taken_s[READ_INPUTS] < since_s:
            return NO_STATUS
        return ""


class Ax3500(Device[WheelCounts]):
    """The two wheel encoders and, where enabled, the two motors behind an AX3500."""

    def __init__(
        self,
        port: Port,
        options: Ax3500Options,
        *,
        max_counts_per_s: float,
        enable_motors: bool,
        listen: Callable[[DeviceStatus, CounterStream], Session] | None = None,
    ) -> None:
        """`listen`: a session in place of its own, where somebody else asks the controller."""
        self.stream = CounterStream()
        self.emergency_stop = False  # it is pressed
        left, right, poll_hz = options.left_channel, options.right_channel, options.poll_hz
        self._has_radio = options.radio
        self.motors = Motors(enable_motors, left, right, options.invert)
        signs = [-1.0 if channel in options.invert else 1.0 for channel in (1, 2)]
        self._left, self._right = ((k - 1, signs[k - 1]) for k in (left, right))
        self._counters = WheelCounters(max_counts_per_s, max(OUTAGE_S, OUTAGE_PAIRS / poll_hz))
        status = DeviceStatus("ax3500", each_step=listen is not None)

        def new_session() -> Session:
            if listen is not None:
                return listen(status, self.stream)
            parts = status, self.stream, self.motors, poll_hz, options.enter_rs232
            return Ax3500Session(*parts).run()

        super().__init__(status, port, LineParser, new_session)

    @property
    def trouble(self) -> str:
        off = self.motors.why_off
        if self.motors.enabled and self.status.state == "closed":
            off = self.status.cause
        return "; ".join(reason for reason in (self.stream.controller.trouble, off) if reason)

    @property
    def identity(self) -> str:
        identity = self.stream.identity
        return "" if identity is None else f"{READ_IDENTITY} {identity:02X}"

    def measured(self) -> dict[str, float]:
        return self.stream.controller.measured() | {"watchdog_stops": self.stream.watchdog_stops}

    def drive(self, left: float, right: float) -> None:
        """Wheel power wanted from the next step on, -1..1 of full; call it at every tick.

        Not called for 0.1 s, or NaN, means zero: it goes out after the exchange under way, at most
        0.2 s (hw/ax3500/motors.py says what if that fails). After trouble zero must be asked for
        once before anything else counts; `trouble` tells what the trouble was. Nothing is sent
        unless motors are enabled.
        """
        self.motors.wish(left, right)

    def stop(self) -> None:
        """Writes zero for both motors to the port at once; step until `settled` before closing."""
        self.port.write(self.motors.stop_bytes())
        self.motors.doubt("mapod stopped them")

    @property
    def settled(self) -> bool:
        """Whether no zero is owed: both are acknowledged, or there is nobody to send them to."""
        return not self.motors.may_move or self.status.state == "closed"

    def _measure(self, now_s: float, events: list[Any]) -> list[WheelCounts]:
        if self.stream.zero_lost:
            unpowered_s, by_other = self.stream.take_lost_zero()
            self._counters.forget_zero(unpowered_s, by_other=by_other and self._has_radio)
        self.emergency_stop = bool(self.stream.controller.emergency_stop)
        if not self.stream.readings:
            return []
        measured, of = list[WheelCounts](), self._counters
        for reading in self.stream.readings:
            taken, cut_off = of.take(*reading), self.stream.controller.cuts_off
            if isinstance(taken, Pair):
                travel = (taken.one, taken.two)
                (left, left_sign), (right, right_sign) = self._left, self._right
                ways = left_sign * travel[left], right_sign * travel[right]
                counts = WheelCounts(taken.t_s, *ways, of.restarts, of.unpowered_s, cut_off)
                measured.append(counts)
            elif taken is not None:
                self.status.reject(taken)
        self.stream.readings = []
        return measured
