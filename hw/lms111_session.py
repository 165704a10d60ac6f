"""Starts a SICK LMS1xx and keeps it delivering scans.

One command at a time, in the order of section 4 of the sheet; scans may come in between. What a
device does not know or refuses, and can do without, is a remark in the status and no obstacle.
Refuses to give up: after any silence or loss the whole conversation begins anew.
Source: lms111 sheet, sections 3, 4 and 6.
"""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any

from core.records import Scan
from hw import lms111
from hw.lms111 import Answer, Echo, Refusal, ScanConfig, ScanTelegram
from hw.lms111_scan import ScanMaker, ScanSettings
from hw.session import BadFrame, Device, DeviceStatus, Port, Session, Tick

LOGIN_RETRY_S = 3.0
START_UP_S = 120.0  # the longest that a device was seen to be silent after power on (section 6)
ANSWER_S, OPTIONAL_S, TRIES = 2.5, 1.0, 2
BUSY_S = 2.0  # without `STlms`, a device may say "busy" for ever though it would scan
POLL_S = 0.2
FIRST_SCAN_S, SILENCE_S = 5.0, 1.0
PAUSE_S = 1.0  # before a new attempt
SLACK_DEG = 0.01  # output ranges are off the grid by 0.0003 deg

OK_ZERO, OK_ONE = b"\x00", b"\x01"  # commands differ in what they call good
READY = 7
STATES = {
    0: "undefined",
    1: "initialising",
    2: "being configured",
    3: "idle",
    4: "its mirror is speeding up",
    5: "in preparation",
    6: "ready, but not for measurement",
}
CONFIG_FAULTS = {
    1: "bad frequency",
    2: "bad resolution",
    3: "bad frequency and resolution",
    4: "bad area",
}


class StartAgainError(Exception):
    """The conversation can't go on; says why, in words."""


@dataclass(slots=True)
class ScanStream:
    """What the session hands to the side that measures."""

    telegrams: list[ScanTelegram] = field(default_factory=list)  # of this tick, to be used
    not_ready: int = 0  # telegrams whose device status says that they are not to be used


class Lms111Session:
    """The conversation of section 4, from its beginning as often as needed."""

    def __init__(self, status: DeviceStatus, stream: ScanStream, settings: ScanSettings) -> None:
        self._status, self._stream, self._settings = status, stream, settings
        self._config = ScanConfig(
            round(settings.scan_rate_hz * 100), round(settings.angular_step_deg * 10_000)
        )
        self._now_s = 0.0
        self._remarks: list[str] = []  # what is not as it should be, though it goes on
        self._last: ScanTelegram | None = None
        self._checked: tuple[float, ...] = ()  # what the cause was last made of

    def run(self) -> Session:
        """Yields the bytes to write, is sent a Tick."""
        yield from self._turn()
        while True:
            self._remarks = []
            try:
                yield from self._log_in()
                self._status.fall_back("starting", "the scanner is being set up")
                yield from self._configure()
                yield from self._must(lms111.START_MEASURING, "sAN LMCstartmeas", OK_ZERO)
                yield from self._must(lms111.RUN, "sAN Run", OK_ONE)
                yield from self._wait_until_ready()
                yield from self._subscribe()
                yield from self._deliver()
            except StartAgainError as why:
                self._status.fall_back("starting", str(why))
                yield from self._pause(PAUSE_S)

    # --- talking

    def _turn(self, out: bytes = b"") -> Generator[bytes, Tick, list[Any]]:
        """Write; the events of the next tick."""
        tick = yield out
        self._stream.telegrams = []
        self._now_s = tick.now_s
        return tick.events

    def _pause(self, seconds: float) -> Generator[bytes, Tick, None]:
        resume_s = self._now_s + seconds
        while self._now_s < resume_s:
            yield from self._turn()

    def _maybe_answer(
        self, command: bytes, answer: str, wait_s: float
    ) -> Generator[bytes, Tick, bytes | Refusal | None]:
        """The values of the answer of that type and name, a refusal, or None after wait_s.

        A refusal does not name its command: one that comes too late hits the next command.
        """
        until_s, out = self._now_s + wait_s, command
        while True:
            for event in (yield from self._turn(out)):
                if isinstance(event, Answer) and f"{event.kind} {event.name}" == answer:
                    return event.values
                if isinstance(event, Refusal):
                    return event
            if self._now_s >= until_s:
                return None
            out = b""

    def _ask(
        self, command: bytes, answer: str, wait_s: float
    ) -> Generator[bytes, Tick, bytes | Refusal | None]:
        """The same, asked a second time if there was none."""
        result: bytes | Refusal | None = None
        for _ in range(TRIES):
            result = yield from self._maybe_answer(command, answer, wait_s)
            if result is not None:
                break
        return result

    def _try(self, command: bytes, answer: str) -> Generator[bytes, Tick, bytes | None]:
        """A command that we can do without; a remark says why there is no answer."""
        result = yield from self._ask(command, answer, OPTIONAL_S)
        if isinstance(result, bytes):
            return result
        name = answer.partition(" ")[2]
        self._remark(f"refuses {name} ({result.reason})" if result else f"does not answer {name}")
        return None

    def _must(self, command: bytes, answer: str, good: bytes) -> Generator[bytes, Tick, bool]:
        """A command that has to be answered; whether the answer is good: a remark if not."""
        result = yield from self._ask(command, answer, ANSWER_S)
        name = answer.partition(" ")[2]
        if result is None:
            raise StartAgainError(f"the scanner does not answer {name}")
        if isinstance(result, Refusal):
            self._remark(f"refuses {name} ({result.reason})")
            return False
        if result[: len(good)] != good:
            self._remark(f"answers {name} with {result.hex() or 'nothing'}")
            return False
        return True

    def _remark(self, text: str) -> None:
        if text not in self._remarks:
            self._remarks.append(text)

    # --- starting

    def _log_in(self) -> Generator[bytes, Tick, None]:
        """Again and again: a device that starts takes connections before it answers."""
        begun_s = self._now_s
        while True:
            result = yield from self._maybe_answer(lms111.LOGIN, "sAN SetAccessMode", LOGIN_RETRY_S)
            if isinstance(result, Refusal):
                raise StartAgainError(f"the scanner refuses the login: {result.reason}")
            if result == OK_ONE:
                return
            if result is not None:
                raise StartAgainError("the scanner refuses the login: was its password changed?")
            self._status.fall_back(
                "starting",
                "waiting for the scanner to answer, which takes up to 120 s after power on"
                if self._now_s - begun_s < START_UP_S
                else "the scanner does not answer: is it set to CoLa-B on this port?",
            )

    def _configure(self) -> Generator[bytes, Tick, None]:
        values = yield from self._try(lms111.READ_SCAN_CONFIG, "sRA LMPscancfg")
        if values is None or lms111.maybe_scan_config(values) != self._config:
            yield from self._set_scan_config()
        content = lms111.encode_scan_data_config(self._settings.echo)
        yield from self._must(content, "sWA LMDscandatacfg", b"")
        values = yield from self._try(lms111.READ_OUTPUT_RANGE, "sRA LMPoutputRange")
        span_deg = lms111.maybe_output_range_deg(values) if values is not None else None
        if span_deg is not None and not self._covers(*span_deg):
            command = lms111.encode_output_range(self._config.step)
            yield from self._try(command, "sWA LMPoutputRange")

    def _set_scan_config(self) -> Generator[bytes, Tick, None]:
        command = lms111.encode_set_scan_config(self._config)
        values = yield from self._try(command, "sAN mLMPsetscancfg")
        if not values:
            return
        taken = lms111.maybe_scan_config(values[1:])
        if values[0]:
            fault = CONFIG_FAULTS.get(values[0], f"status {values[0]}")
            self._remark(f"did not take the scan rate and step: {fault}")
        elif taken is not None and taken != self._config:
            self._remark(
                f"took {taken.centihertz / 100:g} Hz and steps of {taken.step / 10_000:g} deg"
            )

    def _covers(self, first_deg: float, last_deg: float) -> bool:
        """Whether a field of view has all of the used one."""
        settings = self._settings
        return (
            first_deg <= settings.first_deg + SLACK_DEG
            and last_deg >= settings.last_deg - SLACK_DEG
        )

    def _wait_until_ready(self) -> Generator[bytes, Tick, None]:
        begun_s = self._now_s
        while (values := (yield from self._try(lms111.READ_STATE, "sRA STlms"))) is not None:
            state = lms111.maybe_state(values)
            if state == READY:
                return
            words = STATES.get(-1 if state is None else state, "in a state that is not listed")
            if self._now_s - begun_s >= START_UP_S:
                raise StartAgainError(f"the scanner does not get ready: {words}")
            self._status.fall_back("starting", f"the scanner is not ready yet: {words}")
            yield from self._pause(POLL_S)
        yield from self._wait_while_busy()

    def _wait_while_busy(self) -> Generator[bytes, Tick, None]:
        """The older way to ask; its "busy" is believed for a while only."""
        begun_s = self._now_s
        while self._now_s - begun_s < BUSY_S:
            values = yield from self._try(lms111.READ_DEVICE_STATE, "sRA SCdevicestate")
            if values is None or values[:1] == b"\x01":
                return
            if values[:1] == b"\x02":
                raise StartAgainError("the scanner reports an error (SCdevicestate 2)")
            self._status.fall_back("starting", "the scanner says that it is busy")
            yield from self._pause(POLL_S)
        self._remark("says that it is busy")

    def _subscribe(self) -> Generator[bytes, Tick, None]:
        if not (yield from self._must(lms111.SUBSCRIBE, "sEA LMDscandata", OK_ONE)):
            raise StartAgainError(f"the scanner {self._remarks[-1]}")

    # --- running

    def _deliver(self) -> Generator[bytes, Tick, None]:
        """As long as telegrams keep coming."""
        heard_s, patience_s = self._now_s, FIRST_SCAN_S
        self._last, self._checked = None, ()
        while self._now_s - heard_s <= patience_s:
            for event in (yield from self._turn()):
                if isinstance(event, ScanTelegram) and not event.polled and self._is_new(event):
                    heard_s, patience_s = self._now_s, SILENCE_S
                    self._take(event)
        raise StartAgainError(f"no scan from the scanner for {patience_s:g} s")

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
        if telegram.status != (0, 0):
            self._stream.not_ready += 1
            one, two = telegram.status
            self._status.fall_back(
                "starting", f"the scanner's scans carry device status {one} {two}"
            )
            self._checked = ()
            return
        self._stream.telegrams.append(telegram)
        geometry = [
            value
            for channel in telegram.channels.values()
            for value in (channel.first_deg, channel.step_deg, len(channel.raw))
        ]
        if self._checked != (checked := (telegram.scan_hz, *geometry)):
            self._checked = checked
            self._status.state, self._status.cause = "running", self._cause(telegram)

    def _cause(self, telegram: ScanTelegram) -> str:
        """What is not as configured, in one sentence; "" if all is."""
        settings, channels = self._settings, telegram.channels
        faults = list(self._remarks)
        channel = channels.get("DIST1") or channels.get("DIST2")
        if channel is not None:
            is_hz, is_deg = telegram.scan_hz, channel.step_deg
            if (is_hz, is_deg) != (settings.scan_rate_hz, settings.angular_step_deg):
                faults.append(
                    f"scans at {is_hz:g} Hz in steps of {is_deg:g} deg, configured are "
                    f"{settings.scan_rate_hz:g} Hz and {settings.angular_step_deg:g} deg"
                )
            last_deg = channel.first_deg + (len(channel.raw) - 1) * is_deg
            if not self._covers(channel.first_deg - is_deg / 2, last_deg + is_deg / 2):
                faults.append(f"sends {channel.first_deg:g} to {last_deg:g} deg only")
        if settings.echo != "first" and "DIST2" not in channels:
            faults.append("sends no second echo")
        return f"the scanner {', '.join(faults)}" if faults else ""


class Lms111(Device[Scan]):
    """A SICK LMS1xx on its TCP port, CoLa-B. Angles are the device's: 90 deg is straight ahead."""

    def __init__(
        self,
        port: Port,
        *,
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
        status = DeviceStatus("lms111")
        super().__init__(
            status,
            port,
            lms111.new_parser,
            lambda: Lms111Session(status, self.stream, settings).run(),
        )

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

    def _measure(self, now_s: float, events: list[Any]) -> list[Scan]:
        scans = []
        for telegram in self.stream.telegrams:
            scan = self._maker.scan(telegram)
            if isinstance(scan, Scan):
                scans.append(scan)
            else:
                self.status.reject(scan)
        self.stream.telegrams = []
        return scans
