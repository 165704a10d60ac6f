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
import math
from typing import Any

from core.records import Scan
from hw.device import BadFrame, Device, DeviceStatus, Port, Session
from hw.exchange import Exchange, StartAgainError, Steps
from hw.lms1xx import commands
from hw.lms1xx.exchange import ColaExchange, Memory
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.scan import ScanMaker
from hw.lms1xx.setup import BUSY, LONGEST_REST_S, REST_S, Setup
from hw.lms1xx.status import TOO_DIRTY
from hw.lms1xx.telegrams import ScanTelegram, new_parser
from hw.lms1xx.watch import Checkup, TelegramWatch

FIRST_SCAN_S, SILENCE_S = 2.0, 1.0
PAUSE_S, LONGEST_PAUSE_S = 0.2, 2.0  # before a new attempt; doubling until scans are delivered
PEACE_S = 10.0  # of scans, after which no other host is thought to want the scanner otherwise
BYTES_PER_S = 2 * 541 * 50 * 5  # two echoes of 541 beams at 50 Hz, five characters each in CoLa-A
PIECE = 2560  # one echo of 1081 beams in CoLa-B, or two of 541: a telegram parsed at once


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

    def __init__(self, status: DeviceStatus, memory: Memory, options: Lms1xxOptions) -> None:
        self._status, self._memory, self._options = status, memory, options
        self._exchange = Exchange(status, pause_s=PAUSE_S, longest_pause_s=LONGEST_PAUSE_S)
        self._cola = ColaExchange(self._exchange, status, memory, options.dialect)
        self._setup = Setup(self._cola, options)

    def run(self) -> Session:
        # Whoever wants it otherwise did not cut our connection: it may be set up at once.
        self._memory.set_up_s = self._memory.ran_s = -math.inf
        yield from self._exchange.turn()
        while True:
            try:
                yield from self._begin()
                yield from self._deliver()
            except StartAgainError as why:
                self._status.session = State.WAITING
                self._exchange.fail(why)
                if self._memory.owes_run:
                    yield from self._setup.run_at_last()
                yield from self._exchange.back_off()

    def _begin(self) -> Steps[None]:
        status = self._status
        status.session = State.GREETING
        yield from self._cola.greet()
        status.session = State.READING
        survey = yield from self._setup.maybe_change()
        if survey is not None:
            status.session = State.SETTING_UP
            yield from self._setup.set_up(survey)
        status.session = State.SUBSCRIBING
        if not (yield from self._cola.must(commands.subscribe())):
            refusal = self._cola.remarks[-1]
            raise StartAgainError(
                f"the scanner {refusal}: without it there is no scan; is it an LMS1xx?"
            )

    def _deliver(self) -> Steps[None]:
        self._status.session = State.MEASURING
        exchange, memory = self._exchange, self._memory
        begun_s = heard_s = exchange.now_s
        patience_s, complaint = FIRST_SCAN_S, ""
        checkup, watch = Checkup(self._cola), TelegramWatch(self._cola, self._options)
        while exchange.now_s - heard_s <= patience_s:
            out, check_s = b"", checkup.due_s
            if exchange.now_s >= check_s:
                out, check_s = checkup.out(exchange.now_s), checkup.due_s
            for event in (yield from exchange.turn(out, min(heard_s + patience_s, check_s))):
                if isinstance(event, BadFrame):
                    complaint = complaint or event.reason
                elif not isinstance(event, ScanTelegram):
                    checkup.hear(event)
                elif not event.polled and watch.take(exchange.now_s, event):
                    heard_s, patience_s = exchange.now_s, SILENCE_S
            if exchange.now_s - begun_s >= PEACE_S:
                memory.rest_s = REST_S
        self._cola.is_unsure, memory.ran_s = True, heard_s
        memory.rest_s = min(2 * memory.rest_s, LONGEST_REST_S)
        why = f": it {BUSY}" if BUSY in self._cola.remarks else ""
        why = why or (f": {complaint}" if complaint else "")
        raise StartAgainError(f"no scan from the scanner for {patience_s:g} s{why}")


class Lms111(Device[Scan]):
    """A SICK LMS1xx on its TCP port."""

    def __init__(self, port: Port, options: Lms1xxOptions) -> None:
        self._memory = Memory()
        self._maker = ScanMaker(options)
        self.clock_locked = False
        self.is_impaired = False  # its window is contaminated, be it as a warning
        super().__init__(
            DeviceStatus("lms111"),
            port,
            lambda: new_parser(options.dialect),
            lambda: Lms111Session(self.status, self._memory, options).run(),
            BYTES_PER_S,
            PIECE,
        )

    def stop(self) -> None:
        """Before the program ends: a login that is under way must not leave the device busy."""
        if self._memory.owes_run and self._memory.dialect is not None:
            self.port.write(commands.RUN.encode(self._memory.dialect))

    @property
    def identity(self) -> str:
        firmware, number = self._memory.firmware, self._memory.serial_number
        told = [f"firmware {firmware}"] if firmware else []
        told += [f"serial number {number}"] if number else []
        return ", ".join(told)

    @property
    def clock_uncertainty_s(self) -> float:
        return self._maker.clock.uncertainty_s

    def measured(self) -> dict[str, float]:
        return {"clock_uncertainty_s": round(self.clock_uncertainty_s, 6)}

    @property
    def doubt(self) -> str:
        too_dirty = (self._memory.contamination or 0) >= TOO_DIRTY
        return "the scanner's window is too dirty" if too_dirty else ""

    def _measure(self, now_s: float, events: list[Any]) -> list[Scan]:
        telegrams, self._memory.telegrams = self._memory.telegrams, []
        scans: list[Scan] = []
        for telegram in telegrams:
            scan = self._maker.scan(telegram)
            if isinstance(scan, Scan):
                scans.append(scan)
            else:
                self.status.reject(scan)
        self.clock_locked = self._maker.clock.locked
        self.is_impaired = bool(self._memory.contamination)
        return scans
