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
from typing import Any

from core.records import Scan
from hw.device import Device, DeviceStatus, Port, Session
from hw.exchange import StartAgainError, Steps, silent
from hw.urg04lx import sensor as says
from hw.urg04lx.conversation import Conversation
from hw.urg04lx.delivery import Delivery
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.scan import ScanMaker, Window
from hw.urg04lx.scip import ScipError, ScipParser, encode_request, number_in

SYNC_SAMPLES, SYNC_S = 10, 0.1


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

    def run(self) -> Session:
        yield from self._exchange.turn()
        while True:
            try:
                self._status.session = State.FINDING
                yield from self._talk.find()
                self._status.session = State.SETTING_UP
                window = yield from self._set_up()
                self._status.session = State.MEASURING
                delivery = Delivery(self._talk, self._status, self._maker, self._options)
                yield from delivery.run(window, self.scans)
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
        """Its time, if it can tell that; else a remark says so."""
        started = yield from self._talk.ask("TM0")
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
        self._session = silent()
        next(self._session)

    @property
    def identity(self) -> str:
        return self._session_now.identity

    @property
    def clock_uncertainty_s(self) -> float:
        return self._maker.clock.uncertainty_s

    def measured(self) -> dict[str, float]:
        told = {f"beams: {kind}": float(n) for kind, n in self._maker.sight.invalid().items()}
        return {"clock_uncertainty_s": round(self.clock_uncertainty_s, 6), **told}

    @property
    def doubt(self) -> str:
        return self._maker.sight.doubt

    def _measure(self, now_s: float, events: list[Any]) -> list[Scan]:
        scans = self._session_now.scans[:]
        self._session_now.scans.clear()
        self.clock_locked, self.is_impaired = self._maker.clock.locked, bool(self.doubt)
        return scans
