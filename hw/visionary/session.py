"""Starts a Visionary camera and keeps it delivering.

| state      | what it does                                   | what ends it                |
|------------|------------------------------------------------|-----------------------------|
| FINDING    | opens a session, asks what it is               | the camera's type           |
| SETTING_UP | stops it, sets its period, opens the stream    | the answer to PLAYSTART     |
| STREAMING  | takes frames; asks for its state each second   | no frame or answer in time  |
| WAITING    | nothing; then wants a fresh connection         | the pause                   |

It is stopped before the stream is opened, so that this does not begin within a frame. It is logged
in to only while something is to be set, for it does not stream meanwhile.
Source: visionary sheet, sections 2 to 4 and 8.
"""

import enum
import math

from hw.device import DeviceStatus, Port, Reopens, Session
from hw.exchange import Exchange, StartAgainError, Steps
from hw.visionary.cola import texts_of
from hw.visionary.conversation import NO_SESSION, UNKNOWN_VARIABLE, Conversation, describe_error
from hw.visionary.frames import FrameMaker
from hw.visionary.options import VisionaryOptions
from hw.visionary.stream import Stream
from hw.visionary.times import FrameTimes

SETTLE_S = 0.1  # from the stop to what comes next
CONNECT_S = 3.0  # for the stream to open
POLL_S = 1.0  # between questions: well below the session's time, and below a port's patience
LOST_PERIODS, LEAST_SILENCE_S = 10, 0.5
PAUSE_S, LONGEST_PAUSE_S = 0.1, 0.5
LOGIN_S = 30.0  # from a log-in that was refused to the next: cameras lock who tries too often
STREAM_PORT, STREAM_PORTS = 2114, range(1025, 65536)
BY_UDP = 1
ASKED = {  # in turn while it streams, and their bytes; what a camera does not know is left out
    "deviceState": 2,
    "SysTemperatureCurrentValue": 2,
    "TmpLvl": 1,
    "OpVoltageStatus": 1,
    "CurPwrMode": 1,
}


class State(enum.Enum):
    """What a session is doing; the table above."""

    FINDING = "looking for it"
    SETTING_UP = "setting it up"
    STREAMING = "streaming"
    WAITING = "waiting before a new attempt"


class Known:
    """What is known of the camera beyond one connection, and what the step tells the session."""

    def __init__(self, stream: Stream, frames: FrameMaker, times: FrameTimes) -> None:
        self.stream, self.frames, self.times = stream, frames, times
        self.good_s = 0.0  # host clock, newest frame that is as it should be
        self.complaint = ""  # why the newest one is not
        self.identity = self.remark = ""  # what it is; what is not as it was set
        self.told: dict[str, int] = {}  # of what it was asked for
        self.refused, self.login_s = "", -math.inf  # why the last log-in was; from when on again


class VisionarySession:
    """The conversation on one connection, from its beginning as often as needed."""

    def __init__(
        self, status: DeviceStatus, port: Port, options: VisionaryOptions, known: Known
    ) -> None:
        self._status, self._port, self._options, self._known = status, port, options, known
        self._exchange = Exchange(status, pause_s=PAUSE_S, longest_pause_s=LONGEST_PAUSE_S)
        self.talk = Conversation(self._exchange, options.control == "cola_2")
        self._asked, self._period_s = dict(ASKED), options.period_s

    def run(self) -> Session:
        known, exchange = self._known, self._exchange
        yield from exchange.turn()
        while True:
            try:
                self._status.session = State.FINDING
                known.stream.drop("the camera is started anew")
                yield from self.talk.open()
                yield from self._identify()
                self._status.session = State.SETTING_UP
                yield from self._set_up()
                self._status.session = State.STREAMING
                yield from self._deliver()
            except StartAgainError as why:
                self._status.session = State.WAITING
                exchange.fail(why)
                known.stream.drop(str(why))
                yield from exchange.turn(self.talk.encode("Cx", "") if self.talk.is_open else b"")
                yield from exchange.back_off()
                if isinstance(self._port, Reopens):
                    self._port.reopen(str(why))

    def succeed(self) -> None:
        """Frames come."""
        if self._exchange.failure:
            self._exchange.succeed()

    def _identify(self) -> Steps[None]:
        texts = texts_of((yield from self.talk.maybe_read("DeviceIdent")) or b"")
        serial = texts_of((yield from self.talk.maybe_read("SerialNumber")) or b"")
        named = ("", "firmware ")
        told = [f"{what}{text}" for what, text in zip(named, texts, strict=False) if text]
        self._known.identity = ", ".join([*told, *(f"serial number {text}" for text in serial[:1])])

    def _set_up(self) -> Steps[None]:
        known, talk = self._known, self.talk
        yield from talk.must("MN", "PLAYSTOP")
        yield from self._exchange.pause(SETTLE_S)
        known.remark, known.told = "", {}
        period_us = yield from self._set_period()
        self._period_s = self._options.period_s if period_us is None else 1e-6 * period_us
        known.times.begin(1000.0 * self._period_s)
        known.frames.begin()
        number = yield from talk.maybe_number("BlobTcpPortAPI", 2)
        known.stream.want(number if number is not None and number in STREAM_PORTS else STREAM_PORT)
        until_s = self._exchange.now_s + CONNECT_S
        while not known.stream.is_open:
            if self._exchange.now_s > until_s:
                raise StartAgainError(f"the camera's stream does not open: {known.stream.cause}")
            yield from self._exchange.turn()
        yield from talk.must("MN", "PLAYSTART")

    def _set_period(self) -> Steps[int | None]:
        """Set what differs from the settings; the period that it has then, if it has one.

        Raises:
            StartAgainError: it goes on sending its stream by UDP.
        """
        talk, options, known = self.talk, self._options, self._known
        period_us = yield from talk.maybe_number("framePeriodUs", 4)
        transport = yield from talk.maybe_number("BlobTransportProtocolAPI", 1)
        wanted: dict[str, bytes] = {}
        if period_us not in (None, options.period_us):
            wanted["framePeriodUs"] = options.period_us.to_bytes(4, "big")
        if transport == BY_UDP:
            wanted["BlobTransportProtocolAPI"] = b"\x00"
        if wanted:
            refused = yield from self._write(wanted)
            if refused and transport == BY_UDP:
                raise StartAgainError(f"the camera streams by UDP, mapod by TCP: {refused}")
            period_us = yield from talk.maybe_number("framePeriodUs", 4)
            if period_us not in (None, options.period_us):
                refused = refused or "it takes another value"
                known.remark = f"the camera keeps {period_us / 1000:g} ms a frame: {refused}"
        return period_us

    def _write(self, wanted: dict[str, bytes]) -> Steps[str]:
        """Log in, write, log out; why something was refused, in words."""
        level, password = self._options.level, self._options.password
        if level == "none":
            return 'level is "none", so nothing is set'
        known = self._known
        if self._exchange.now_s < known.login_s:
            return known.refused
        if refused := (yield from self.talk.log_in(level, password)):
            known.refused, known.login_s = refused, self._exchange.now_s + LOGIN_S
            return refused
        for name, data in wanted.items():
            reply = yield from self.talk.ask("WN", name, data)
            if reply.letters == "FA":
                refused = describe_error(reply.error)
        yield from self.talk.log_out()
        return refused

    def _deliver(self) -> Steps[None]:
        known, exchange = self._known, self._exchange
        known.good_s, known.complaint = exchange.now_s, ""
        patience_s = max(LEAST_SILENCE_S, LOST_PERIODS * self._period_s)
        poll_s = exchange.now_s + POLL_S
        while exchange.now_s - known.good_s <= patience_s:
            yield from exchange.turn(b"", min(known.good_s + patience_s, poll_s))
            if exchange.now_s >= poll_s:
                yield from self._poll()
                poll_s = exchange.now_s + POLL_S
        raise StartAgainError(known.complaint or f"no frame from the camera for {patience_s:g} s")

    def _poll(self) -> Steps[None]:
        """One of what is asked, by turns: it keeps the session, and shows that it is there."""
        name, size = next(iter(self._asked.items()))
        del self._asked[name]
        reply = yield from self.talk.ask("RN", name)
        if reply.letters == "FA" and reply.error == NO_SESSION:
            yield from self.talk.open()
        elif reply.letters != "FA" and len(reply.data) == size:
            self._known.told[name] = int.from_bytes(reply.data, "big")
        if reply.error != UNKNOWN_VARIABLE:
            self._asked[name] = size
        if not self._asked:
            self._asked["deviceState"] = ASKED["deviceState"]


def warnings_of(told: dict[str, int]) -> list[str]:
    """What the camera itself warns of."""
    words = {"TmpLvl": "temperature", "OpVoltageStatus": "supply voltage"}
    grades = {1: "error", 2: "warning"}
    return [f"{words[name]}: {grades[told[name]]}" for name in words if told.get(name, 3) in grades]
