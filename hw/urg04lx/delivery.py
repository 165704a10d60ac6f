"""Scans from a Hokuyo scanner that is set up: streamed, or asked for one by one.

It goes on until they cease, or the scanner says that it can't: then it ends with StartAgainError.
Source: urg04lx sheet, sections 3, 5 and 7.
"""

import math

from core.records import Scan
from hw.device import BadFrame, DeviceStatus
from hw.exchange import StartAgainError, Steps
from hw.urg04lx import sensor as says
from hw.urg04lx.conversation import ANSWER_S, Conversation
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.scan import ScanMaker, Window
from hw.urg04lx.scip import Reply

SILENCE_PERIODS, LEAST_SILENCE_S = 8, 0.5  # without a scan that can be used,
MUTE_PERIODS, LEAST_MUTE_S = 3, 0.4  # and without a word: a stream that has ended
MISSED_SHARE, SCANS_SHARE = 0.3, 0.1  # of scans, so many missed are told; weight of the newest
FIRST_SCAN_S = 2.0  # the laser and its mirror start
NAMED = 16  # characters of a request that is quoted
NO_TIME = (
    "the scanner does not tell its time: its scans are taken for later than they are, "
    "by what they take to come"
)


class Delivery:
    """One stretch of scans of one window."""

    def __init__(
        self, talk: Conversation, status: DeviceStatus, maker: ScanMaker, options: Urg04lxOptions
    ) -> None:
        self._talk, self._exchange, self._status = talk, talk.exchange, status
        self._maker, self._options = maker, options
        self._missed_share, self._complaint = 0.0, ""
        self._heard_s, self._patience_s = talk.exchange.now_s, FIRST_SCAN_S
        self._said_s, self._mute_s = talk.exchange.now_s, FIRST_SCAN_S

    def run(self, window: Window, scans: list[Scan]) -> Steps[None]:
        """Until they cease.

        Args:
            scans: takes each one.
        """
        options = self._options
        kind = "D" if options.characters == 3 else "S"
        if options.stream:
            command = f"M{kind}{window.text}{options.skip_scans}00"
            yield from self._talk.must(command, says.OK, says.DATA)
            yield from self._stream(command, window, scans)
        else:
            yield from self._talk.must("BM", says.OK, "02")
            yield from self._poll(f"G{kind}{window.text}", window, scans)
        why = f": {self._complaint}" if self._complaint else ""
        silent_s = self._exchange.now_s - self._heard_s
        raise StartAgainError(f"no scan from the scanner for {silent_s:.1f} s{why}")

    @property
    def _is_silent(self) -> bool:
        return self._exchange.now_s - self._heard_s > self._patience_s

    def _stream(self, command: str, window: Window, scans: list[Scan]) -> Steps[None]:
        while not self._is_silent and self._exchange.now_s - self._said_s <= self._mute_s:
            due_s = min(self._heard_s + self._patience_s, self._said_s + self._mute_s)
            for event in (yield from self._exchange.turn(due_s=due_s)):
                self._said_s = self._exchange.now_s
                if isinstance(event, BadFrame):
                    self._complaint = event.reason
                elif event.command == command:
                    self._take(event, window, scans)
                else:  # what it echoes has no sum
                    self._reject(f"reply to {event.command[:NAMED]}, which was not asked")

    def _poll(self, command: str, window: Window, scans: list[Scan]) -> Steps[None]:
        """The next scan is asked for when the last one is there: else questions would pile up.

        It waits in the device until then, so that its coming tells no time: that is asked, too.
        """
        wait_s = ANSWER_S + self._talk.line_s(window.beams * (self._options.characters + 1))
        yield from self._ask_time()
        while not self._is_silent:
            next_s = self._exchange.now_s + self._options.period_s
            reply = yield from self._talk.ask(command, wait_s, tries=1)
            if reply is not None:
                self._take(reply, window, scans)
            yield from self._ask_time()
            while self._exchange.now_s < next_s:
                yield from self._exchange.turn(due_s=next_s)

    def _ask_time(self) -> Steps[None]:
        asked_s = self._exchange.now_s
        reply = yield from self._talk.ask("II", tries=1)
        ticks = None if reply is None else says.maybe_ticks(reply)
        if reply is None or ticks is None:
            self._complaint = "it does not tell its time"
            return
        line_s = min(self._talk.line_s(reply.size), reply.arrived_s - asked_s)
        self._maker.hear_time(ticks, reply.arrived_s - line_s)

    def _take(self, reply: Reply, window: Window, scans: list[Scan]) -> None:
        """Hand it on, if it is a scan."""
        status, good = reply.status, says.DATA if self._options.stream else says.OK
        if status != good:
            why = f"the scanner: {says.describe_status(status, reply.command)}"
            if status.isdigit() and int(status) in says.SUSPENDED:
                self._status.fall_back("starting", why)
                self._said_s = math.inf  # it goes on by itself, and says so
            elif status not in (says.OK, says.RESUMED):
                raise StartAgainError(why)
            return
        found = self._maker.scan(reply, window)
        if found is None:
            return
        if isinstance(found, BadFrame):
            self._reject(found.reason)
            return
        scan, missed = found
        scans.append(scan)
        took_s, self._heard_s = self._exchange.now_s - self._heard_s, self._exchange.now_s
        period_s = window.sensor.turn_s * (1 + self._options.skip_scans)
        self._patience_s = max(LEAST_SILENCE_S, SILENCE_PERIODS * period_s, 3 * took_s)
        self._mute_s = max(LEAST_MUTE_S, MUTE_PERIODS * max(period_s, took_s))
        self._status.missed += missed
        self._missed_share += SCANS_SHARE * (missed / (1 + missed) - self._missed_share)
        self._status.state, self._status.cause = "running", self._remark(window)
        self._exchange.succeed()
        self._complaint = ""

    def _reject(self, reason: str) -> None:
        self._complaint = reason
        self._status.reject(BadFrame(reason, b""))

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
        return self._talk.remark or ("" if self._maker.knows_delay else NO_TIME)
