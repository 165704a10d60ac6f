"""Sets a SICK LMS1xx up in the order of section 4, unless it already measures as wanted.

Logging in ends measuring, for all hosts: so what the device has is read first, without login, and
a second host with the same settings disturbs nobody. Run, which ends a login, is never forgotten.
Refuses to store settings: that wears the device's memory out. What the device took is read back.
Source: lms111 sheet, sections 3, 4 and 6.
"""

import math
from collections.abc import Generator
from dataclasses import dataclass

from hw.device import DeviceStatus, Tick
from hw.lms1xx import commands
from hw.lms1xx.commands import Command, ScanConfig
from hw.lms1xx.scan import FIRST_DEG, LAST_DEG, ScanSettings
from hw.lms1xx.status import CONFIG_FAULTS, CONFIGURING, IDLE, READY, STATES
from hw.lms1xx.talk import (
    ANSWER_S,
    OPTIONAL_S,
    START_UP_S,
    DialectSetting,
    Memory,
    ScanStream,
    StartAgainError,
    Talk,
)
from hw.lms1xx.telegrams import Answer, Refusal

POLL_S = 0.1
BUSY_S = 2.0  # without `STlms`, a device may say "busy" for ever though it would scan
STOPPED_S = 3.0  # after Run it may be idle for so long; longer means that somebody logged in
REST_S, LONGEST_REST_S = 3.0, 6.0  # between two set-ups
ANSWER_LOGIN_S = 2.0
SLACK_DEG = 0.01  # output ranges are off the grid by 0.0003 deg
ANOTHER_HOST = "another host may be configuring it"
SCAN_WORDS = "Hz in steps of"  # in every remark on rate and step
BUSY = "says that it is busy"
CONTENT_FIELDS = (  # of `LMDscandatacfg`, up to the interval
    *("echoes", "echoes (high byte)", "remission", "16 bit remission", "remission unit"),
    *("encoders", "encoders (high byte)", "position", "name", "comment", "time"),
)


@dataclass(frozen=True, slots=True)
class Survey:
    """What the device says about its settings; None where it does not."""

    scan: ScanConfig | None
    content: tuple[int, ...] | None
    span_deg: tuple[float, float] | None

    def values(self) -> tuple[object, ...]:
        """To be compared."""
        return (self.scan, self.content, self.span_deg)


class Setup(Talk):
    """From the first answer to a device that measures."""

    def __init__(
        self,
        status: DeviceStatus,
        stream: ScanStream,
        memory: Memory,
        settings: ScanSettings,
        dialect: DialectSetting,
    ) -> None:
        super().__init__(status, stream, memory, dialect)
        self._settings = settings
        self._config = ScanConfig(
            round(settings.scan_rate_hz * 100), round(settings.angular_step_deg * 10_000)
        )
        self._unreadable: set[str] = set()  # names that are not asked for again in this attempt
        self._failure = ""  # why the last attempt ended, until scans are delivered

    def _prepare(self) -> Generator[bytes, Tick, None]:
        """Until the device measures, as wanted or as near to it as it will."""
        self._remarks, self._unreadable = [], set()
        if self._memory.owes_run:
            yield from self._run_at_last()
        while True:
            survey = yield from self._survey()
            state = yield from self._maybe_state()
            is_wanted = self._is_wanted(survey)
            if is_wanted and state not in (None, CONFIGURING, IDLE):
                if state != READY:
                    yield from self._wait_until_ready()
                self._remark_differences(survey)
                return
            if is_wanted and state is None and self._now_s - self._memory.set_up_s < START_UP_S:
                self._remark(BUSY)  # we set it up: a login now would only make it begin anew
                self._remark_differences(survey)
                return
            is_stopped = state in (CONFIGURING, IDLE)
            begun_s = max(self._memory.set_up_s, self._memory.ran_s if is_stopped else -math.inf)
            rest_s = begun_s + self._memory.rest_s - self._now_s
            if rest_s <= 0:
                break
            words = "is busy" if is_wanted else "was set otherwise"
            words = f"is {STATES[state or 0]}" if is_stopped else words
            self._status.fall_back("starting", f"the scanner {words}: {ANOTHER_HOST}")
            yield from self._pause(min(rest_s, 0.5))
        yield from self._set_up(survey, is_measuring=state == READY)

    # --- what it has

    def _survey(self) -> Generator[bytes, Tick, Survey]:
        scan = yield from self._maybe_read(commands.READ_SCAN_CONFIG)
        content = yield from self._maybe_read(commands.READ_CONTENT)
        span = yield from self._maybe_read(commands.READ_OUTPUT_RANGE)
        return Survey(
            commands.maybe_scan_config(scan) if scan else None,
            commands.maybe_content(content) if content else None,
            commands.maybe_output_range_deg(span) if span else None,
        )

    def _maybe_read(self, command: Command) -> Generator[bytes, Tick, Answer | None]:
        """A read that is not repeated where it was refused or not answered before."""
        if command.name in self._unreadable:
            return None
        wait_s = OPTIONAL_S if self._unreadable else ANSWER_S  # one that is slow, or many missing
        answer = yield from self._try(command, tries=1, wait_s=wait_s)
        if answer is None:
            self._unreadable.add(command.name)
        return answer

    def _is_wanted(self, survey: Survey) -> bool:
        """Whether nothing is to be set; or nothing more than what was refused before."""
        if None in survey.values():
            return False
        wanted = (self._config, commands.content(self._settings.echo))
        is_whole = survey.span_deg is not None and covers(survey.span_deg, (FIRST_DEG, LAST_DEG))
        is_as_wanted = (survey.scan, survey.content) == wanted and is_whole
        return is_as_wanted or survey.values() == self._memory.settled

    def _remark_differences(self, survey: Survey) -> None:
        """Asked, and got, where that differs; step and rate of the scans themselves count."""
        if survey.scan is not None and survey.scan != self._config:
            asked, got = _scan_in_words(self._config), _scan_in_words(survey.scan)
            self._remark(f"was asked for {asked} and says {got}")
        wanted = commands.content(self._settings.echo)
        if survey.content is not None and survey.content != wanted:
            if survey.content[-1] != wanted[-1]:
                self._remark(f"sends one scan in {survey.content[-1]} only")
            for field, told, says in zip(CONTENT_FIELDS, wanted, survey.content, strict=False):
                if told != says:
                    self._remark(f"has {field} {says} in its scans, not {told} as it was told")
        settings, span_deg = self._settings, survey.span_deg
        if span_deg and not covers(span_deg, (settings.first_deg, settings.last_deg)):
            asked, got = f"{FIRST_DEG:g} to {LAST_DEG:g} deg", f"{span_deg[0]:g} to {span_deg[1]:g}"
            self._remark(f"was asked for {asked} and says {got} deg")

    def _maybe_state(self) -> Generator[bytes, Tick, int | None]:
        """The code of `STlms`, or its like by the older `SCdevicestate`; None: not known, or busy.

        Raises:
            StartAgainError: it reports an error.
        """
        answer = yield from self._maybe_read(commands.READ_STATE)
        if answer is not None and (state := commands.maybe_state(answer)) is not None:
            if state[1] is not None:
                self._stream.temperature_ok = state[1]
            return state[0]
        answer = yield from self._maybe_read(commands.READ_DEVICE_STATE)
        number = None if answer is None else commands.maybe_number(answer)
        if number == 2:
            raise StartAgainError(
                "the scanner reports an error (SCdevicestate 2): its LEDs tell more; power it off"
            )
        return READY if number == 1 else None

    # --- what it shall have

    def _set_up(self, survey: Survey, is_measuring: bool) -> Generator[bytes, Tick, None]:
        self._status.fall_back("starting", self._failure or "the scanner is being set up")
        if not (yield from self._log_in(is_measuring)):
            self._remark_differences(survey)
            return
        if survey.scan != self._config:  # else the mirror may stay as it is
            yield from self._set_scan_config()
        yield from self._try(commands.set_content(self._settings.echo))
        if survey.span_deg is None or not covers(survey.span_deg, (FIRST_DEG, LAST_DEG)):
            # Firmware that refuses the whole field of view (1.23 does) keeps its own.
            yield from self._try(commands.set_output_range(self._config.step))
        yield from self._must(commands.START_MEASURING)
        self._memory.owes_run = not (yield from self._must(commands.RUN))
        self._memory.set_up_s = self._now_s
        yield from self._wait_until_ready()
        survey = yield from self._survey()
        self._memory.settled = survey.values()
        self._remark_differences(survey)

    def _log_in(self, is_measuring: bool) -> Generator[bytes, Tick, bool]:
        """False where it is refused, and the device measures all the same."""
        self._memory.owes_run = True  # from here on: its answer may get lost
        before_s, self._memory.set_up_s = self._memory.set_up_s, self._now_s
        login = commands.login()
        result = yield from self._ask(login, ANSWER_LOGIN_S)
        if result is None:
            raise StartAgainError(f"the scanner does not answer {login.name}")
        if isinstance(result, Answer) and commands.is_good(result):
            return True
        self._memory.owes_run, self._memory.set_up_s = False, before_s  # nothing has changed
        why = result.reason if isinstance(result, Refusal) else "was its password changed?"
        if not is_measuring:
            raise StartAgainError(
                f"the scanner refuses the login: {why}; it must take the password of level 3"
            )
        self._remark(f"refuses the login ({why})")
        return False

    def _run_at_last(self) -> Generator[bytes, Tick, None]:
        """Run after a set-up that failed: else the device stays busy, for other hosts too."""
        result = yield from self._ask(commands.RUN, ANSWER_LOGIN_S, tries=1)
        if isinstance(result, Answer) and commands.is_good(result):
            self._memory.owes_run = False

    def _set_scan_config(self) -> Generator[bytes, Tick, None]:
        answer = yield from self._try(commands.set_scan_config(self._config))
        taken = commands.maybe_taken_config(answer) if answer is not None else None
        if taken is None:
            return
        status, config = taken
        if status:
            fault = CONFIG_FAULTS.get(status, f"status {status}")
            self._remark(f"did not take {_scan_in_words(self._config)}: {fault}")
        elif config is not None and config != self._config:
            self._remark(f"took {_scan_in_words(config)} instead of {_scan_in_words(self._config)}")

    def _wait_until_ready(self) -> Generator[bytes, Tick, None]:
        begun_s = self._now_s
        while (state := (yield from self._maybe_state())) != READY:
            waited_s = self._now_s - begun_s
            if state is None and waited_s >= BUSY_S:
                self._remark(BUSY)
                return
            words = "busy" if state is None else STATES.get(state, f"in state {state}")
            if state in (CONFIGURING, IDLE) and waited_s >= STOPPED_S:
                raise StartAgainError(f"the scanner is {words}: {ANOTHER_HOST}")
            if waited_s >= START_UP_S:
                raise StartAgainError(f"the scanner does not get ready: {words}")
            self._status.fall_back("starting", f"the scanner is not ready yet: {words}")
            yield from self._pause(POLL_S)


def covers(span_deg: tuple[float, float], wanted_deg: tuple[float, float]) -> bool:
    """Whether one field of view has all of the other."""
    return span_deg[0] <= wanted_deg[0] + SLACK_DEG and span_deg[1] >= wanted_deg[1] - SLACK_DEG


def _scan_in_words(config: ScanConfig) -> str:
    return f"{config.centihertz / 100:g} {SCAN_WORDS} {config.step / 10_000:g} deg"
