"""Starts a SICK LMS1xx and keeps it delivering scans.

A device is found in any state: still starting, set to the other dialect, measuring as wanted,
measuring for somebody else, left idle after a login. The session asks before it sets, sets only
what differs, and reads back what was taken: settings are shared by all hosts of the device. There
is one command at a time, in the order of section 4 of the sheet; scans may come in between. What a
device does not know or refuses, and can do without, is a remark in the status and no obstacle.

| state       | what it does                                      | what ends it                 |
|-------------|---------------------------------------------------|------------------------------|
| GREETING    | asks harmless questions in each dialect by turns  | any telegram                 |
| READING     | reads the settings; leaves another host in peace  | as wanted, or may now be set |
| SETTING_UP  | login, settings, start, Run; reads back           | it measures, or is silent    |
| SUBSCRIBING | asks for scans                                    | the answer                   |
| MEASURING   | takes scans, asks now and then how the scanner is | a second without a scan      |
| WAITING     | Run, if a login was left open; a growing pause    | the pause is over            |

A new connection begins with GREETING, and so does the attempt after WAITING: it never gives up.
Source: lms111 sheet, sections 3, 4 and 6.
"""

import enum
from collections.abc import Collection
from typing import Any

from core.records import Scan
from hw.device import BadFrame, Device, DeviceStatus, Port, Session, Tick
from hw.exchange import Exchange, StartAgainError, Steps
from hw.lms1xx import commands
from hw.lms1xx.checkup import Checkup
from hw.lms1xx.cola import DialectSetting
from hw.lms1xx.exchange import ColaExchange, Memory, ScanStream
from hw.lms1xx.scan import ScanMaker, ScanSettings
from hw.lms1xx.setup import BUSY, LONGEST_REST_S, REST_S, Setup
from hw.lms1xx.status import TOO_DIRTY, ScannerCondition
from hw.lms1xx.telegrams import Answer, Echo, ScanTelegram, new_parser
from hw.lms1xx.watch import TelegramWatch, condition_of

FIRST_SCAN_S, SILENCE_S = 2.0, 1.0
PAUSE_S, LONGEST_PAUSE_S = 0.2, 2.0  # before a new attempt; doubling until scans are delivered
PEACE_S = 10.0  # of scans, after which no other host is thought to want the scanner otherwise
BYTES_PER_S = 2 * 541 * 50 * 5  # two echoes of 541 beams at 50 Hz, five characters each in CoLa-A


class State(enum.Enum):
    """What a session is doing; the table above."""

    GREETING = "greeting"
    READING = "reading its settings"
    SETTING_UP = "setting it up"
    SUBSCRIBING = "subscribing"
    MEASURING = "measuring"
    WAITING = "waiting before a new attempt"


class Lms111Session:
    """The conversation of section 4, from its beginning as often as needed."""

    def __init__(
        self, status: DeviceStatus, stream: ScanStream, memory: Memory, settings: ScanSettings
    ) -> None:
        self.state = State.GREETING
        self._stream, self._memory = stream, memory
        self._exchange = Exchange(
            status, self._hear, pause_s=PAUSE_S, longest_pause_s=LONGEST_PAUSE_S
        )
        self._cola = ColaExchange(self._exchange, status, stream, memory, settings.dialect)
        self._setup = Setup(self._exchange, self._cola, status, stream, memory, settings)
        self._watch = TelegramWatch(status, stream, settings)

    def _hear(self, tick: Tick) -> list[Any]:
        self._stream.telegrams = []
        return tick.events

    def run(self) -> Session:
        """Yields the bytes to write, is sent a Tick."""
        self._memory.forget_rest()  # whoever wants it otherwise did not cut our connection
        yield from self._exchange.turn()
        while True:
            try:
                yield from self._attempt()
            except StartAgainError as why:
                self.state = State.WAITING
                self._exchange.fail(why)
                if self._memory.owes_run:
                    yield from self._setup.run_at_last()
                yield from self._exchange.back_off()

    def _attempt(self) -> Steps[None]:
        self.state = State.GREETING
        yield from self._cola.greet()
        self.state = State.READING
        survey = yield from self._setup.maybe_change()
        if survey is not None:
            self.state = State.SETTING_UP
            yield from self._setup.set_up(survey)
        self.state = State.SUBSCRIBING
        if not (yield from self._cola.must(commands.subscribe())):
            refusal = self._cola.remarks[-1]
            raise StartAgainError(
                f"the scanner {refusal}: without it there is no scan; is it an LMS1xx?"
            )
        self.state = State.MEASURING
        yield from self._deliver()

    def _deliver(self) -> Steps[None]:
        """As long as telegrams keep coming."""
        exchange, memory = self._exchange, self._memory
        begun_s = heard_s = exchange.now_s
        patience_s, complaint = FIRST_SCAN_S, ""
        checkup = Checkup(self._cola.dialect, begun_s)
        self._watch.begin()
        while exchange.now_s - heard_s <= patience_s:
            for event in (yield from exchange.turn(checkup.out(exchange.now_s))):
                if isinstance(event, BadFrame):
                    complaint = complaint or event.reason
                elif isinstance(event, ScanTelegram):
                    if not event.polled and self._watch.is_new(event):
                        heard_s, patience_s = exchange.now_s, SILENCE_S
                        if self._watch.take(heard_s, event, self._cola.remarks):
                            exchange.succeed()
                elif answer := checkup.maybe_answer(event):
                    self._learn(answer)
            if exchange.now_s - begun_s >= PEACE_S:
                memory.rest_s = REST_S
        self._cola.is_unsure, memory.ran_s = True, heard_s
        memory.rest_s = min(2 * memory.rest_s, LONGEST_REST_S)
        why = f": it {BUSY}" if BUSY in self._cola.remarks else ""
        why = why or (f": {complaint}" if complaint else "")
        raise StartAgainError(f"no scan from the scanner for {patience_s:g} s{why}")

    def _learn(self, answer: Answer) -> None:
        """How the scanner is."""
        if answer.name == commands.READ_CONTAMINATION.name:
            self._stream.contamination = commands.maybe_number(answer)
        elif (state := commands.maybe_state(answer)) is not None and state[1] is not None:
            self._stream.temperature_ok = state[1]


class Lms111(Device[Scan]):
    """A SICK LMS1xx on its TCP port. Angles are the device's: 90 deg is straight ahead.

    "auto" finds its dialect out; "binary" and "ascii" (CoLa-B and CoLa-A) never try the other.

    Args:
        accepted_status: values of the device status, beside 0, whose scans are used.
    """

    def __init__(
        self,
        port: Port,
        *,
        dialect: DialectSetting = "auto",
        scan_rate_hz: float,
        angular_step_deg: float,
        first_deg: float,
        last_deg: float,
        echo: Echo,
        accepted_status: Collection[int] = (),
    ) -> None:
        self._settings = ScanSettings(
            scan_rate_hz=scan_rate_hz,
            angular_step_deg=angular_step_deg,
            first_deg=first_deg,
            last_deg=last_deg,
            echo=echo,
            dialect=dialect,
            accepted_status=accepted_status,
        )
        self.stream, self._memory = ScanStream(), Memory()
        self._maker = ScanMaker(self._settings)
        super().__init__(
            DeviceStatus("lms111"),
            port,
            lambda: new_parser(dialect),
            self._started_session,
            BYTES_PER_S,
        )

    def _started_session(self) -> Session:
        self.session = Lms111Session(self.status, self.stream, self._memory, self._settings)
        return self.session.run()

    def stop(self) -> None:
        """Before the program ends: a login that is under way must not leave the device busy."""
        if self._memory.owes_run and self._memory.dialect is not None:
            self.port.write(commands.RUN.encode(self._memory.dialect))

    @property
    def clock_locked(self) -> bool:
        """True once the scanner's clock is known well enough."""
        return self._maker.clock.locked

    @property
    def not_ready(self) -> int:
        """Telegrams that were not delivered, for they are not to be believed."""
        return self.stream.not_ready

    @property
    def is_impaired(self) -> bool:
        """Whether its window is contaminated, be it as a warning."""
        return bool(self.stream.contamination)

    @property
    def doubt(self) -> str:
        """Why its "nothing there" is not to be believed; "" if it is."""
        too_dirty = (self.stream.contamination or 0) >= TOO_DIRTY
        return "the scanner's window is too dirty" if too_dirty else ""

    @property
    def condition(self) -> ScannerCondition:
        """What the scanner has said about itself, and its newest scan's beams by cause of loss."""
        condition, newest = condition_of(self.stream), self.stream.newest
        return condition if newest is None else self._maker.with_beams(condition, newest)

    def _measure(self, now_s: float, events: list[Any]) -> list[Scan]:
        scans: list[Scan] = []
        for telegram in self.stream.telegrams:
            scan = self._maker.scan(telegram)
            if isinstance(scan, Scan):
                scans.append(scan)
            else:
                self.status.reject(scan)
        self.stream.telegrams = []
        return scans
