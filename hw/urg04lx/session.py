"""Starts a Hokuyo scanner and keeps it delivering.

| state      | what it does                                        | what ends it               |
|------------|-----------------------------------------------------|----------------------------|
| FINDING    | QT at each rate; ends a stream, SCIP 1.1, time mode | QT is answered with 00     |
| SETTING_UP | reads what it is, and its time                      | the last answer            |
| MEASURING  | MD or MS, or GD or GS for each scan                 | silence, or a refusal      |
| WAITING    | nothing                                             | a pause, longer each time  |

It asks for nothing that an URG-04LX does not know: some stop answering then, for good.
Source: urg04lx sheet, sections 2, 5, 7 and 8.
"""

import enum
import math
from typing import Any

from core.records import Scan
from hw.device import BadFrame, Device, DeviceStatus, Port, Session
from hw.exchange import StartAgainError, Steps
from hw.urg04lx import sensor as says
from hw.urg04lx.conversation import Conversation
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.scan import ScanMaker, Window
from hw.urg04lx.scip import Reply, ScipError, ScipParser, encode_request, number_in

SYNC_SAMPLES, SYNC_S = 10, 0.1
SILENCE_PERIODS, LEAST_SILENCE_S = 8, 0.5
MISSED_SHARE, SCANS_SHARE = 0.3, 0.1  # of scans, so many missed are told; weight of the newest
FIRST_SCAN_S = 2.0  # the laser and its mirror start


class State(enum.Enum):
    """What a session is doing; the table above."""

    FINDING = "looking for it"
    SETTING_UP = "setting it up"
    MEASURING = "measuring"
    WAITING = "waiting before a new attempt"


class Urg04lxSession:
    """The conversation, from its beginning as often as needed."""

    def __init__(
        self, talk: Conversation, status: DeviceStatus, maker: ScanMaker, options: Urg04lxOptions
    ) -> None:
        self.scans: list[Scan] = []  # of this tick
        self.identity = ""
        self._talk, self._exchange, self._status = talk, talk.exchange, status
        self._maker, self._options = maker, options
        self._missed_share = 0.0

    def run(self) -> Session:
        yield from self._exchange.turn()
        while True:
            try:
                self._status.session = State.FINDING
                yield from self._talk.find()
                self._status.session = State.SETTING_UP
                window = yield from self._set_up()
                self._status.session = State.MEASURING
                yield from self._deliver(window)
            except StartAgainError as why:
                self._status.session = State.WAITING
                self._exchange.fail(why)
                yield from self._exchange.back_off()

    def _set_up(self) -> Steps[Window]:
        options = self._options
        sensor = says.maybe_sensor((yield from self._talk.must("PP")))
        if sensor is None:
            raise StartAgainError("the scanner tells parameters that can't be true")
        version = yield from self._talk.ask("VV", tries=1)  # of some, its lines are damaged
        texts = says.texts_of(version) if version is not None else {}
        told = (("firmware", texts.get("FIRM")), ("serial number", texts.get("SERI")))
        self.identity = ", ".join(
            [sensor.model, *(f"{what} {text}" for what, text in told if text)]
        )
        window, most = Window.of(sensor, options), options.spec.max_beams
        if not 1 <= window.beams <= most:
            raise StartAgainError(
                f"the scanner has {window.beams} steps in the used field of view, "
                f"a {options.model} has up to {most}: is scanner.model right? "
                f"It says that it is {sensor.model!r}"
            )
        if self._maker.begin(f"{window.text} {self._talk.baud}") and options.stream:
            yield from self._synchronise()
        return window

    def _synchronise(self) -> Steps[None]:
        """Its time, if it can tell that."""
        started = yield from self._talk.ask("TM0", tries=1)
        if started is None or started.status not in (says.OK, "02"):
            return
        for _ in range(SYNC_SAMPLES):
            reply = yield from self._talk.ask("TM1", tries=1)
            if reply is not None and reply.status == says.OK and reply.lines:
                try:
                    ticks = number_in(reply.lines[0])
                except ScipError:
                    continue
                self._maker.synchronise(ticks, reply.arrived_s - self._talk.line_s(reply.size))
            yield from self._exchange.pause(SYNC_S)
        yield from self._talk.must("TM2", says.OK, "03")

    def _deliver(self, window: Window) -> Steps[None]:
        """Until they cease."""
        options = self._options
        kind = "D" if options.characters == 3 else "S"
        period_s = window.sensor.turn_s * (1 + options.skip_scans)
        if options.stream:
            command = f"M{kind}{window.text}{options.skip_scans}00"
            yield from self._talk.must(command, says.OK, says.DATA)
        else:
            command = f"G{kind}{window.text}"
            yield from self._talk.must("BM", says.OK, "02")
        heard_s, patience_s = self._exchange.now_s, FIRST_SCAN_S
        ask_s = math.inf if options.stream else heard_s  # when to ask for the next one
        while self._exchange.now_s - heard_s <= patience_s:
            out, now_s = b"", self._exchange.now_s
            if now_s >= ask_s:
                out, ask_s = encode_request(command), now_s + period_s
            for event in (yield from self._exchange.turn(out, min(heard_s + patience_s, ask_s))):
                if not (isinstance(event, Reply) and event.command == command):
                    continue
                if self._take(event, window):
                    took_s, heard_s = self._exchange.now_s - heard_s, self._exchange.now_s
                    patience_s = max(LEAST_SILENCE_S, SILENCE_PERIODS * period_s, 3 * took_s)
                if not options.stream:  # the scan waited there until it was asked for
                    yield from self._ask_time()
        raise StartAgainError(f"no scan from the scanner for {patience_s:g} s")

    def _ask_time(self) -> Steps[None]:
        asked_s = self._exchange.now_s
        reply = yield from self._talk.ask("II", tries=1)
        ticks = None if reply is None else says.maybe_ticks(reply)
        if reply is not None and ticks is not None:
            line_s = min(self._talk.line_s(reply.size), reply.arrived_s - asked_s)
            self._maker.hear_time(ticks, reply.arrived_s - line_s)

    def _take(self, reply: Reply, window: Window) -> bool:
        """Whether it is a scan, which is handed on then."""
        status, good = reply.status, says.DATA if self._options.stream else says.OK
        if status != good:
            if status.isdigit() and int(status) in says.SUSPENDED:
                self._status.fall_back("starting", f"the scanner: {says.describe_status(status)}")
            elif status not in (says.OK, says.RESUMED):
                raise StartAgainError(f"the scanner: {says.describe_status(status)}")
            return False
        found = self._maker.scan(reply, window)
        if isinstance(found, BadFrame):
            self._status.reject(found)
        if found is None or isinstance(found, BadFrame):
            return False
        scan, missed = found
        self.scans.append(scan)
        self._status.missed += missed
        self._missed_share += SCANS_SHARE * (missed / (1 + missed) - self._missed_share)
        self._status.state, self._status.cause = "running", self._remark(window)
        self._exchange.succeed()
        return True

    def _remark(self, window: Window) -> str:
        """What is not as it should be, though it runs."""
        if self._missed_share > MISSED_SHARE:
            return (
                f"{self._missed_share:.0%} of the scanner's scans do not come: a higher rate, "
                "scanner.characters = 2 or a cluster make its line faster"
            )
        turn_s, period_s = window.sensor.turn_s, self._options.period_s
        if abs(turn_s * (1 + self._options.skip_scans) - period_s) > 0.01:
            return f"the scanner turns {1 / turn_s:g} times a second"
        return ""


class Urg04lx(Device[Scan]):
    """A Hokuyo scanner on its serial line or TCP port."""

    def __init__(self, port: Port, options: Urg04lxOptions, baud: int | None = None) -> None:
        """baud: of the port, as set; None: it has no rate."""
        self._maker = ScanMaker(options)
        self.clock_locked = self.is_impaired = False
        status = DeviceStatus("urg04lx")

        def begin() -> Session:
            talk = Conversation(status, port, baud)
            self._session_now = Urg04lxSession(talk, status, self._maker, options)
            return self._session_now.run()

        super().__init__(status, port, ScipParser, begin)

    def stop(self) -> None:
        """Before the program ends: it would go on streaming for nobody."""
        self.port.write(encode_request("QT"))

    @property
    def identity(self) -> str:
        return self._session_now.identity

    @property
    def clock_uncertainty_s(self) -> float:
        return self._maker.clock.uncertainty_s

    def measured(self) -> dict[str, float]:
        told = {f"beams: {kind}": float(n) for kind, n in self._maker.invalid().items()}
        return {"clock_uncertainty_s": round(self.clock_uncertainty_s, 6), **told}

    @property
    def doubt(self) -> str:
        return ""

    def _measure(self, now_s: float, events: list[Any]) -> list[Scan]:
        scans, self._session_now.scans = self._session_now.scans, []
        self.clock_locked = self._maker.clock.locked
        return scans
