"""Starts a SICK LMS1xx and keeps it delivering scans.

One command at a time, in the order of section 4 of the sheet; scans may come in between. What a
device does not know or refuses, and can do without, is a remark in the status and no obstacle.
Refuses to give up: after any silence or loss the whole conversation begins anew.
Source: lms111 sheet, sections 3, 4 and 6.
"""

import math
from collections.abc import Generator
from typing import Any

from core.records import Scan
from hw.device import BadFrame, Device, DeviceStatus, Port, Session, Tick
from hw.lms1xx import commands
from hw.lms1xx import telegrams as lms111
from hw.lms1xx.checkup import Checkup
from hw.lms1xx.scan import ScanMaker, ScanSettings
from hw.lms1xx.setup import BUSY, LONGEST_REST_S, REST_S, SCAN_WORDS, Setup, covers
from hw.lms1xx.status import (
    TOO_DIRTY,
    ScannerCondition,
    is_dirty,
    is_usable,
    status_in_words,
)
from hw.lms1xx.talk import DialectSetting, Memory, ScanStream, StartAgainError
from hw.lms1xx.telegrams import Answer, Echo, ScanTelegram

FIRST_SCAN_S, SILENCE_S = 2.0, 1.0
PAUSE_S, LONGEST_PAUSE_S = 0.2, 2.0  # before a new attempt; doubling until scans are delivered
UNUSABLE_S = 0.5  # without a scan that may be believed, after which it runs no longer
PEACE_S = 10.0  # of scans, after which no other host is thought to want the scanner otherwise


class Lms111Session(Setup):
    """The conversation of section 4, from its beginning as often as needed."""

    _last: ScanTelegram | None = None
    _checked: tuple[object, ...] = ()  # what the cause was last made of
    _pause_s = PAUSE_S
    _usable_s = -math.inf  # host clock, last telegram that may be believed

    def run(self) -> Session:
        """Yields the bytes to write, is sent a Tick."""
        self._memory.forget_rest()  # whoever wants it otherwise did not cut our connection
        yield from self._turn()
        while True:
            try:
                yield from self._greet()
                yield from self._prepare()
                yield from self._subscribe()
                yield from self._deliver()
            except StartAgainError as why:
                self._failure = str(why)
                self._status.fall_back("starting", self._failure)
                if self._memory.owes_run:
                    yield from self._run_at_last()
                yield from self._pause(self._pause_s)
                self._pause_s = min(2 * self._pause_s, LONGEST_PAUSE_S)

    def _subscribe(self) -> Generator[bytes, Tick, None]:
        if not (yield from self._must(commands.subscribe())):
            raise StartAgainError(
                f"the scanner {self._remarks[-1]}: without it there is no scan; is it an LMS1xx?"
            )

    def _deliver(self) -> Generator[bytes, Tick, None]:
        """As long as telegrams keep coming."""
        begun_s = heard_s = self._now_s
        patience_s = FIRST_SCAN_S
        self._last, self._checked = None, ()
        checkup = Checkup(self._dialect, self._now_s)
        while self._now_s - heard_s <= patience_s:
            for event in (yield from self._turn(checkup.out(self._now_s))):
                if isinstance(event, ScanTelegram):
                    if not event.polled and self._is_new(event):
                        heard_s, patience_s = self._now_s, SILENCE_S
                        self._take(event)
                elif answer := checkup.maybe_answer(event):
                    self._learn(answer)
            if self._now_s - begun_s >= PEACE_S:
                self._memory.rest_s = REST_S
        self._is_unsure, self._memory.ran_s = True, heard_s
        self._memory.rest_s = min(2 * self._memory.rest_s, LONGEST_REST_S)
        why = f": it {BUSY}" if BUSY in self._remarks else ""
        raise StartAgainError(f"no scan from the scanner for {patience_s:g} s{why}")

    def _learn(self, answer: Answer) -> None:
        """How the scanner is."""
        if answer.name == commands.READ_CONTAMINATION.name:
            self._stream.contamination = commands.maybe_number(answer)
        elif (state := commands.maybe_state(answer)) is not None and state[1] is not None:
            self._stream.temperature_ok = state[1]

    def _is_new(self, telegram: ScanTelegram) -> bool:
        """False for a telegram that was there before; counts those that never came."""
        last, self._last = self._last, telegram
        if last is None:
            return True
        if (telegram.telegram_counter, telegram.sent_us) == (last.telegram_counter, last.sent_us):
            self._status.reject(BadFrame("scan telegram repeated", b""))
            return False
        gap = (telegram.scan_counter - last.scan_counter - 1) % 2**16
        passed_s = (telegram.scan_us - last.scan_us) % 2**32 * 1e-6
        if gap <= 1.5 * passed_s * telegram.scan_hz + 1:  # else the counter began anew
            self._status.missed += gap
        return True

    def _take(self, telegram: ScanTelegram) -> None:
        self._stream.newest = telegram
        if not is_usable(telegram.status):
            self._stream.not_ready += 1
            if self._now_s - self._usable_s < UNUSABLE_S:
                return
            words = status_in_words(telegram.status)
            self._status.fall_back("starting", f"the scanner's scans carry device status {words}")
            self._checked = ()
            return
        self._stream.telegrams.append(telegram)
        self._pause_s, self._failure, self._usable_s = PAUSE_S, "", self._now_s
        geometry = [
            value
            for channel in telegram.channels.values()
            for value in (channel.first_deg, channel.step_deg, len(channel.raw))
        ]
        stream = self._stream
        health = (stream.contamination, stream.temperature_ok, telegram.status)
        if self._checked != (checked := (telegram.scan_hz, *health, *geometry)):
            self._checked = checked
            self._status.state, self._status.cause = "running", self._cause(telegram)

    def _cause(self, telegram: ScanTelegram) -> str:
        """What is not as configured, or not well, in one sentence; "" if all is."""
        settings, channels = self._settings, telegram.channels
        faults = list(self._remarks)
        channel = channels.get("DIST1") or channels.get("DIST2")
        if channel is not None:
            is_hz, is_deg = telegram.scan_hz, channel.step_deg
            if (is_hz, is_deg) != (settings.scan_rate_hz, settings.angular_step_deg):
                faults = [fault for fault in faults if SCAN_WORDS not in fault]  # said once
                faults.append(
                    f"scans at {is_hz:g} Hz in steps of {is_deg:g} deg, configured are "
                    f"{settings.scan_rate_hz:g} Hz and {settings.angular_step_deg:g} deg"
                )
            last_deg = channel.first_deg + (len(channel.raw) - 1) * is_deg
            span_deg = (channel.first_deg - is_deg / 2, last_deg + is_deg / 2)
            if not covers(span_deg, (settings.first_deg, settings.last_deg)):
                faults.append(f"sends {channel.first_deg:g} to {last_deg:g} deg only")
        if settings.echo != "first" and "DIST2" not in channels:
            faults.append("sends no second echo")
        if words := condition_of(self._stream).words:
            faults.append(words)
        return f"the scanner {', '.join(faults)}" if faults else ""


def condition_of(stream: ScanStream) -> ScannerCondition:
    """What is known of the scanner, without its beams."""
    newest = stream.newest
    return ScannerCondition(
        contamination=stream.contamination,
        temperature_ok=stream.temperature_ok,
        device_status=newest.status if newest else (0, 0),
        firmware=stream.firmware,
        serial_number=newest.serial_number if newest else None,
    )


class Lms111(Device[Scan]):
    """A SICK LMS1xx on its TCP port. Angles are the device's: 90 deg is straight ahead.

    "auto" finds its dialect out; "binary" and "ascii" (CoLa-B and CoLa-A) never try the other.
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
    ) -> None:
        settings = ScanSettings(
            scan_rate_hz=scan_rate_hz,
            angular_step_deg=angular_step_deg,
            first_deg=first_deg,
            last_deg=last_deg,
            echo=echo,
        )
        self.stream = ScanStream()
        self._maker = ScanMaker(settings)
        self._memory = Memory()
        status = DeviceStatus("lms111")
        super().__init__(
            status,
            port,
            lambda: lms111.new_parser(dialect),
            lambda: Lms111Session(status, self.stream, self._memory, settings, dialect).run(),
        )

    def stop(self) -> None:
        """Before the program ends: a login that is under way must not leave the device busy."""
        if self._memory.owes_run and self._memory.dialect is not None:
            self.port.write(commands.RUN.encode(self._memory.dialect))

    @property
    def clock_locked(self) -> bool:
        """True once the scanner's clock is known well enough."""
        return self._maker.clock.locked

    @property
    def clock_uncertainty_s(self) -> float:
        """Typical error of the scans' times."""
        return self._maker.clock.uncertainty_s

    @property
    def not_ready(self) -> int:
        """Telegrams that were not delivered, for their device status says not to use them."""
        return self.stream.not_ready

    @property
    def is_impaired(self) -> bool:
        """Whether its window is contaminated, be it as a warning."""
        stream, newest = self.stream, self.stream.newest
        return is_dirty(stream.contamination, newest.status if newest else (0, 0))

    @property
    def doubt(self) -> str:
        """Why its "nothing there" is not to be believed, in words; "" if it is."""
        too_dirty = (self.stream.contamination or 0) >= TOO_DIRTY
        return "the scanner's window is too dirty" if too_dirty else ""

    @property
    def condition(self) -> ScannerCondition:
        """What the scanner has said about itself, and its newest scan's beams by cause of loss."""
        condition, newest = condition_of(self.stream), self.stream.newest
        return condition if newest is None else self._maker.with_beams(condition, newest)

    def _measure(self, now_s: float, events: list[Any]) -> list[Scan]:
        scans: list[Scan] = []
        if not self.stream.telegrams:
            return scans
        for telegram in self.stream.telegrams:
            scan = self._maker.scan(telegram)
            if isinstance(scan, Scan):
                scans.append(scan)
            else:
                self.status.reject(scan)
        self.stream.telegrams = []
        return scans
