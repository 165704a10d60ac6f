"""Fake Hokuyo URG-04LX, and sisters: SCIP 2.0 on a serial line, USB or TCP, one host at a time.

The classic model powers up in SCIP 1.1, of which it knows only to say E. It does not notice that a
host has gone, and streams on; a sister on TCP does.

Source: urg04lx sheet.
"""

import contextlib
from collections import deque
from collections.abc import Callable

from fakes.urg04lx.faults import Faults
from fakes.urg04lx.head import Head, Truth
from fakes.urg04lx.line import Line
from fakes.urg04lx.measuring import CHECKING, TROUBLE, Measuring
from fakes.urg04lx.models import KNOWN_RATES, MODELS, OPTIONAL, RATES
from fakes.urg04lx.scip import (
    BUFFER,
    MOST_REQUEST,
    OK,
    SWITCH,
    UNDEFINED,
    UPDATING,
    Carried,
    Request,
    RequestReader,
    StatusError,
    check_form,
    message,
    number,
    request,
    summed,
    told,
)

ANSWER_S = 0.001
IN_TIME_MODE = (b"TM", b"%ST")
IN_UPDATE_MODE = (b"VV", b"II", b"RS")
EXTENSIONS = (b"ME", b"GE", b"ND", b"NE", b"HD", b"HE", b"RB", b"RT", b"%ST", b"%SL")
SLOWEST, DEFAULT_SPEED = 10, 99  # of CR: so many hundredths slower, at most [U]
STANDBY, ADJUSTING, SINGLE, STREAMING, BROKEN = b"000", b"002", b"003", b"004", b"900"  # %ST [U]


class FakeUrg04lx(Faults):
    """One scanner. Its faults and properties are attributes (`Faults`), to be set at any time.

    Args:
        ranges_m_at: what its beams meet (`Head`).
    """

    def __init__(self, ranges_m_at: Truth, seed: int, model: str = "URG-04LX") -> None:
        if model not in MODELS:
            raise ValueError(f"model: must be one of {', '.join(MODELS)}, is {model!r}")
        super().__init__()
        self._model = MODELS[model]
        self.head = Head(self, self._model, ranges_m_at, seed)
        self._line = Line(self, seed)
        self._power_up()

    def _power_up(self) -> None:
        self.head.power_up()
        self._line.clear()
        self._reader, self._asked = RequestReader(), deque[bytes]()
        self._measuring = Measuring(self, self._model, self.head, self._line)
        self._is_scip2 = self._model.starts_in_scip2
        self._is_timing = self._is_hung = self._is_sensitive = False
        self._slower = 0
        self._next_baud: int | None = None  # once the reply is out
        self._reboots, self._before = False, b""  # once the reply is out; the command before
        self.baud = RATES[0] if self._model.wire == "serial" else None

    def restart(self, now_s: float) -> None:
        """Power fails and comes back: power-on state, default rate."""
        self.head.clock.follow(now_s, self.drift_ppm)
        self._power_up()

    def switch_laser_off(self, now_s: float) -> None:
        """By itself: a stream ends without a word, and GD gets 10."""
        self._measuring.stop()

    def leave_streaming(self, now_s: float) -> None:
        """As a host has left it that died: in SCIP 2.0, with a stream of full scans."""
        self.head.clock.follow(now_s, self.drift_ppm)
        self._is_scip2, self._is_timing = True, False
        every = request(b"MD%04d%04d01000" % (self._model.amin, self._model.amax))
        self._measuring.stop()
        with contextlib.suppress(StatusError):  # in trouble it does not
            self._measuring.stream(every)

    def reconnected(self, now_s: float) -> None:
        """A new host: a serial line does not tell, a sister on TCP begins anew with it."""
        if self._model.wire == "tcp":
            self._line.clear()
            self._reader, self._asked = RequestReader(), deque()
            self._measuring.stop()

    def exchange(self, now_s: float, received: bytes) -> bytes:
        now_s = self.head.clock.follow(now_s, self.drift_ppm)
        if self._next_baud is not None and self._line.is_empty:
            self.baud, self._next_baud = self._next_baud, None
        if self._reboots and self._line.is_empty:
            self._power_up()
        is_up = self.head.clock.device_s >= self.start_silent_s
        if is_up and not self.deaf and not self._is_hung:
            self._asked.extend(self._reader.feed(received))
        self._measuring.send_scans(now_s)
        while self._asked and not self._must_wait(self._asked[0]):
            self._answer(now_s, self._asked.popleft())
        return self._line.taken(now_s)

    def _must_wait(self, line: bytes) -> bool:
        """For the first scan after the laser went on."""
        is_scan = self._is_scip2 and line[:2] in (b"GD", b"GS")
        return is_scan and self._measuring.is_on_its_way

    def _answer(self, now_s: float, line: bytes) -> None:
        one = request(line)
        if self._is_scip2:
            try:
                status, lines = self._carry_out(one)
            except StatusError as refused:
                status, lines = refused.status, []
            self._before, reply = one.command, message(line, status, lines)
        else:
            self._is_scip2 = line == SWITCH
            reply = line + (b"\n0\n\n" if self._is_scip2 else b"\nE\n\n")
        if self.hangs_at_extensions and one.command in EXTENSIONS:
            self._is_hung = True
        elif self.answers_lost > 0:
            self.answers_lost -= 1
        else:
            self._line.send(now_s + ANSWER_S + self.slow_answer_s, reply)

    def _carry_out(self, one: Request) -> Carried:
        """Do what a request says: status and lines of its reply.

        Raises:
            StatusError: it is not done.
        """
        if len(one.whole) > MOST_REQUEST:
            raise StatusError(BUFFER)
        commands: dict[bytes, Callable[[Request], Carried]] = {
            b"VV": lambda _: (OK, self._version()),
            b"PP": lambda _: (OK, [told(text) for text in self._model.parameters()]),
            b"II": lambda _: (OK, [told(text) for text in self._state()]),
            b"BM": lambda _: self._measuring.light(),
            b"QT": lambda _: self._measuring.stop(),
            b"RS": lambda _: self._reset(),
            **dict.fromkeys((b"GD", b"GS"), self._measuring.scan),
            **dict.fromkeys((b"MD", b"MS"), self._measuring.stream),
            b"SS": self._set_rate,
            b"TM": self._time,
            b"CR": self._turn,
            b"HS": self._sense,
            b"DB": self._simulate,
            b"RB": lambda _: self._reboot(),
            b"%ST": lambda _: (OK, [summed(self._state_code())]),
        }
        if one.command not in commands or one.command in OPTIONAL - self._model.extras:
            raise StatusError(UNDEFINED)
        if self._is_timing and one.command not in IN_TIME_MODE:
            raise StatusError(UNDEFINED)
        if self.updates_firmware and one.command not in IN_UPDATE_MODE:
            raise StatusError(UPDATING)
        check_form(one)
        if (refused := self.refuse.get(one.command.decode("latin-1"))) is not None:
            raise StatusError(refused.encode("ascii", "replace"))
        return commands[one.command](one)

    def _version(self) -> list[bytes]:
        lines = [told(text) for text in self._model.version()]
        if self.splits_serial:
            lines[-1] = lines[-1][:8] + b"\n" + lines[-1][8:-1] + b"0"
        return lines

    def _state(self) -> list[str]:
        rpm, rate = round(60.0 / self.head.period_s), self.baud or RATES[0]
        default = "<-Default setting by user"
        return [
            self._model.parameters()[0],
            f"LASR:{'ON' if self.head.is_lit else 'OFF'}",
            f"SCSP:Initial({rpm}[rpm]){'' if self._slower else default}",
            f"MESM:{'Measuring' if self._measuring.is_streaming else 'IDLE'}",
            f"SBPS:{rate}[bps]{default if rate == RATES[0] else ''}",
            f"TIME:{self.head.timer_ms():06X}",
            f"STAT:Sensor {f'trouble {self.trouble}' if self.trouble else 'works well'}.",
        ]

    def _state_code(self) -> bytes:
        if self._measuring.is_broken:
            return BROKEN
        if self._is_timing:
            return ADJUSTING
        if self._measuring.is_streaming:
            return STREAMING
        return SINGLE if self.head.is_lit else STANDBY

    def _reset(self) -> Carried:
        self._measuring.stop()
        self.head.reset()
        self._slower, self._is_sensitive = 0, False
        self._next_baud = RATES[0] if self._model.wire == "serial" else None
        return OK, []

    def _reboot(self) -> Carried:
        """Two in a row do it [U: as a client for Ethernet models asks for it]."""
        self._reboots = self._before == b"RB"
        return OK if self._reboots else b"01", []

    def _set_rate(self, one: Request) -> Carried:
        if self._model.wire == "tcp":
            raise StatusError(UNDEFINED)
        if not one.parameters.isdigit():
            return b"01", []
        rate = int(one.parameters)
        if rate not in RATES:
            return b"04" if rate in KNOWN_RATES else b"02", []
        if rate == (self.baud or RATES[0]):
            return b"03", []
        self._next_baud = rate if self._model.wire == "serial" else None
        return OK, []

    def _time(self, one: Request) -> Carried:
        match one.parameters:
            case b"0" if self._is_timing:
                return b"02", []
            case b"0":
                self._measuring.stop()
                self._is_timing = True
            case b"1" if not self._is_timing:
                return b"04", []
            case b"1":
                return OK, [summed(number(self.head.timer_ms(), 4))]
            case b"2" if not self._is_timing:
                return b"03", []
            case b"2":
                self._is_timing = False
            case _:
                return b"01", []
        return OK, []

    def _turn(self, one: Request) -> Carried:
        if not one.parameters.isdigit():
            return b"01", []
        slower = int(one.parameters)
        slower = 0 if slower == DEFAULT_SPEED else slower
        if slower > SLOWEST:
            return b"02", []
        if slower == self._slower:
            return b"03", []
        self._slower = slower
        self._measuring.turn(slower / 100)
        return OK, []

    def _sense(self, one: Request) -> Carried:
        if one.parameters not in (b"0", b"1"):
            return b"01", []
        before, self._is_sensitive = self._is_sensitive, one.parameters == b"1"
        return b"02" if before == self._is_sensitive else OK, []

    def _simulate(self, one: Request) -> Carried:
        """Hardware trouble of the number that it says, until 00."""
        if not one.parameters.isdigit() or int(one.parameters) not in (0, *CHECKING, *TROUBLE):
            return b"01", []
        self.trouble = int(one.parameters)
        return OK, []
