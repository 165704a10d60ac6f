"""Sets a SICK LMS1xx up in the order of section 4, unless it already measures as wanted.

Logging in ends measuring, for all hosts: so what the device has is read first, without login, and
a second host with the same settings disturbs nobody. Run, which ends a login, is never forgotten.
It refuses to store settings: that wears the device's memory out. What the device took is read back.
Source: lms111 sheet, sections 3, 4 and 6.
"""

import math
from typing import NamedTuple

from hw.exchange import StartAgainError, Steps
from hw.lms1xx import commands
from hw.lms1xx.commands import Command, ScanConfig
from hw.lms1xx.exchange import ANSWER_S, OPTIONAL_S, START_UP_S, ColaExchange
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.scan import FIRST_DEG, LAST_DEG
from hw.lms1xx.status import CONFIG_FAULTS, CONFIGURING, IDLE, READY, STATES
from hw.lms1xx.telegrams import Answer, Refusal

POLL_S = 0.1
BUSY_S = 2.0  # without `STlms`, a device may say "busy" for ever though it would scan
STOPPED_S = 3.0  # after Run it may be idle for so long; longer means that somebody logged in
REST_S, LONGEST_REST_S = 3.0, 6.0  # between two set-ups
ANSWER_LOGIN_S = 2.0
STOPPED = (CONFIGURING, IDLE)  # it measures only after somebody has sent Run
SLACK_DEG = 0.01  # output ranges are off the grid by 0.0003 deg
ANOTHER_HOST = "another host may be configuring it"
BUSY = "says that it is busy"


class Survey(NamedTuple):
    """What the device says about its settings; None where it does not."""

    scan: ScanConfig | None
    content: tuple[int, ...] | None
    span_deg: tuple[float, float] | None


class Setup:
    """From the first answer to a device that measures."""

    def __init__(self, cola: ColaExchange, options: Lms1xxOptions) -> None:
        self._cola, self._options = cola, options
        self._exchange, self._status, self._memory = cola.exchange, cola.status, cola.memory
        self._config = ScanConfig(
            round(options.scan_rate_hz * 100), round(options.angular_step_deg * 10_000)
        )
        self._content = commands.content(options.echo)
        self._unreadable: set[str] = set()  # names that are not asked for again in this attempt
        self._state: int | None = None  # code of STlms; None also where it says that it is busy

    # --- what it has

    def maybe_change(self) -> Steps[Survey | None]:
        """What it has, where that must be changed; None where it measures, as wanted.

        Another host may want it otherwise: it is left in peace for a while after each set-up.
        """
        self._cola.remarks.clear()
        self._unreadable.clear()
        if self._memory.owes_run:
            yield from self.run_at_last()
        while True:
            survey = yield from self._survey()
            self._state = yield from self._maybe_state()
            if (yield from self._measures_as_wanted(survey)):
                self._remark_contents(survey)
                return None
            is_stopped = self._state in STOPPED
            begun_s = max(self._memory.set_up_s, self._memory.ran_s if is_stopped else -math.inf)
            rest_s = begun_s + self._memory.rest_s - self._exchange.now_s
            if rest_s <= 0:
                return survey
            what = "is busy" if self._is_wanted(survey) else "was set otherwise"
            what = f"is {STATES[self._state or 0]}" if is_stopped else what
            self._status.fall_back("starting", f"the scanner {what}: {ANOTHER_HOST}")
            yield from self._exchange.pause(min(rest_s, 0.5))

    def _measures_as_wanted(self, survey: Survey) -> Steps[bool]:
        """Whether nothing is to be done but to wait until it is ready.

        Where it does not tell, and we have set it up, a login would only make it begin anew.
        """
        if not self._is_wanted(survey) or self._state in STOPPED:
            return False
        if self._state is None:
            if self._exchange.now_s - self._memory.set_up_s >= START_UP_S:
                return False
            self._cola.remark(BUSY)
        elif self._state != READY:
            yield from self._wait_until_ready()
        return True

    def _survey(self) -> Steps[Survey]:
        scan = yield from self._maybe_read(commands.READ_SCAN_CONFIG)
        content = yield from self._maybe_read(commands.READ_CONTENT)
        span = yield from self._maybe_read(commands.READ_OUTPUT_RANGE)
        return Survey(
            commands.maybe_scan_config(scan) if scan else None,
            commands.maybe_content(content) if content else None,
            commands.maybe_output_range_deg(span) if span else None,
        )

    def _maybe_read(self, command: Command) -> Steps[Answer | None]:
        if command.name in self._unreadable:
            return None
        wait_s = OPTIONAL_S if self._unreadable else ANSWER_S  # one that is slow, or many missing
        answer = yield from self._cola.ask_optional(command, tries=1, wait_s=wait_s)
        if answer is None:
            self._unreadable.add(command.name)
        return answer

    def _is_wanted(self, survey: Survey) -> bool:
        """Whether nothing is to be set; or nothing more than what was refused before."""
        if None in survey:
            return False
        is_as_wanted = (survey.scan, survey.content) == (self._config, self._content)
        return (is_as_wanted and _is_whole(survey)) or survey == self._memory.settled

    def _remark_contents(self, survey: Survey) -> None:
        """Where they are others than told; all else that it took, the scans themselves tell."""
        if survey.content is not None and survey.content != self._content:
            says, told = (" ".join(map(str, values)) for values in (survey.content, self._content))
            self._cola.remark(f"has LMDscandatacfg {says}, not {told} as it was told")

    def _maybe_state(self) -> Steps[int | None]:
        """The code of `STlms`, or its like by the older `SCdevicestate`; None: not known, busy."""
        answer = yield from self._maybe_read(commands.READ_STATE)
        if answer is not None and (state := commands.maybe_state(answer)) is not None:
            if state[1] is not None:
                self._memory.temperature_ok = state[1]
            return state[0]
        answer = yield from self._maybe_read(commands.READ_DEVICE_STATE)
        number = None if answer is None else commands.maybe_number(answer)
        if number == 2:
            raise StartAgainError(
                "the scanner reports an error (SCdevicestate 2): its LEDs tell more; power it off"
            )
        return READY if number == 1 else None

    # --- what it shall have

    def set_up(self, survey: Survey) -> Steps[None]:
        """Log in, set what differs, start, Run, and read back what it took."""
        self._status.fall_back("starting", self._exchange.failure or "the scanner is being set up")
        if not (yield from self._log_in(self._state == READY)):
            self._remark_contents(survey)
            return
        if survey.scan != self._config:  # else the mirror may stay as it is
            yield from self._set_scan_config()
        yield from self._cola.ask_optional(commands.set_content(self._options.echo))
        if not _is_whole(survey):
            # Firmware that refuses the whole field of view (1.23 does) keeps its own.
            yield from self._cola.ask_optional(commands.set_output_range(self._config.step))
        yield from self._cola.must(commands.START_MEASURING)
        self._memory.owes_run = not (yield from self._cola.must(commands.RUN))
        self._memory.set_up_s = self._exchange.now_s
        yield from self._wait_until_ready()
        survey = self._memory.settled = yield from self._survey()
        self._remark_contents(survey)

    def _log_in(self, is_measuring: bool) -> Steps[bool]:
        """False where it is refused, and the device measures all the same."""
        self._memory.owes_run = True  # from here on: its answer may get lost
        before_s, self._memory.set_up_s = self._memory.set_up_s, self._exchange.now_s
        result = yield from self._cola.ask(commands.LOGIN, ANSWER_LOGIN_S)
        if result is None:
            raise StartAgainError(f"the scanner does not answer {commands.LOGIN.name}")
        if isinstance(result, Answer) and commands.is_good(result):
            return True
        self._memory.owes_run, self._memory.set_up_s = False, before_s  # nothing has changed
        why = result.reason if isinstance(result, Refusal) else "was its password changed?"
        if not is_measuring:
            raise StartAgainError(
                f"the scanner refuses the login: {why}; it must take the password of level 3"
            )
        self._cola.remark(f"refuses the login ({why})")
        return False

    def run_at_last(self) -> Steps[None]:
        """Run after a set-up that failed: else the device stays busy, for other hosts too."""
        result = yield from self._cola.ask(commands.RUN, ANSWER_LOGIN_S, tries=1)
        if isinstance(result, Answer) and commands.is_good(result):
            self._memory.owes_run = False

    def _set_scan_config(self) -> Steps[None]:
        answer = yield from self._cola.ask_optional(commands.set_scan_config(self._config))
        if answer is not None and (status := commands.maybe_number(answer)):
            fault = CONFIG_FAULTS.get(status, f"status {status}")
            self._cola.remark(f"did not take the scan rate and step: {fault}")

    def _wait_until_ready(self) -> Steps[None]:
        begun_s = self._exchange.now_s
        while (state := (yield from self._maybe_state())) != READY:
            waited_s = self._exchange.now_s - begun_s
            if state is None and waited_s >= BUSY_S:
                self._cola.remark(BUSY)
                return
            what = "busy" if state is None else STATES.get(state, f"in state {state}")
            if state in STOPPED and waited_s >= STOPPED_S:
                raise StartAgainError(f"the scanner is {what}: {ANOTHER_HOST}")
            if waited_s >= START_UP_S:
                raise StartAgainError(f"the scanner does not get ready: {what}")
            self._status.fall_back("starting", f"the scanner is not ready yet: {what}")
            yield from self._exchange.pause(POLL_S)


def covers(span_deg: tuple[float, float], wanted_deg: tuple[float, float]) -> bool:
    """Whether one field of view has all of the other."""
    return span_deg[0] <= wanted_deg[0] + SLACK_DEG and span_deg[1] >= wanted_deg[1] - SLACK_DEG


def _is_whole(survey: Survey) -> bool:
    return survey.span_deg is not None and covers(survey.span_deg, (FIRST_DEG, LAST_DEG))
