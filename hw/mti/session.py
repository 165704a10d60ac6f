"""Starts an MTi and keeps it delivering orientation and rate of turn at a fixed rate.

The device takes settings in Config state only, keeps them over a loss of power, and streams in
Measurement state. It may be found in either, in mid-stream, waking up, or set up by another host.
So each attempt first asks for Config state, by time and however much data comes in between; then
all is read, what differs is set, and read back. What it sends afterwards is watched for signs that
it is not what was set up (a WakeUp, an unasked Configuration, data of another kind or length): then
the next attempt begins.

| state      | what it does                                    | what ends it                    |
|------------|-------------------------------------------------|---------------------------------|
| WAITING    | answers a WakeUp, and nothing else              | 0.2 s                           |
| FINDING    | asks for Config state each 0.25 s, without end  | the answer                      |
| SETTING_UP | reads who it is, sets and reads back the output | the last answer                 |
| STARTING   | asks for Measurement state, three times         | the answer, or data             |
| DELIVERING | checks and joins samples                        | silence, or a sign of a restart |

A refusal, three unanswered requests or a WakeUp lead back to WAITING.
Source: MTi sheet, sections 2, 7, 8 and 9.
"""

import enum
import math
from typing import Annotated, Any

from msgspec import Meta, Struct

from core.records import Attitude
from hw.device import Device, DeviceStatus, Gathers, Port, Session
from hw.exchange import StartAgainError, Steps
from hw.mti.conversation import ANSWER_S, TRIES, Conversation
from hw.mti.frames import Mid, MtFrame, MtParser, describe_error, encode_frame
from hw.mti.setup import identify, set_up
from hw.mti.stream import DATA_MIDS, MtStream, StreamReader

EARLY_S = 0.002  # before a sample is due: adapters and drivers jitter by a millisecond
STAMPED_S = 0.05  # between two samples read as they arrive, at least: the clock needs some
MOST_GATHERED = 255  # bytes, of VMIN
GATHER_AGAIN_S = 1.0
SILENCE_S, SILENCE_SAMPLES = 0.5, 3  # the longer
BAUDS_TOLD_AFTER_S = 3.0


class State(enum.Enum):
    """What a session is doing; the table above."""

    WAITING = "waiting before a new attempt"
    FINDING = "asking for Config state"
    SETTING_UP = "reading, and setting what differs"
    STARTING = "asking for Measurement state"
    DELIVERING = "delivering samples"


class MtiOptions(Struct, frozen=True):
    """The keys of [ahrs] that its driver alone knows."""

    rate_hz: Annotated[float, Meta(ge=10, le=120)]

    def describe(self) -> str:
        return f"{self.rate_hz:g} samples/s"


class MtiSession:
    """The conversation of section 8, from its beginning as often as needed."""

    def __init__(self, status: DeviceStatus, stream: MtStream, rate_hz: float, baud: int) -> None:
        self.attitudes: list[Attitude] = []  # of this tick
        self.reader = StreamReader(status, stream, 10 / baud)
        self._status, self._stream = status, stream
        self._rate_hz, self._baud = rate_hz, baud
        self._talk = Conversation(status, baud)
        self._exchange = self._talk.exchange

    def run(self) -> Session:
        yield from self._exchange.turn()
        while True:
            try:
                self._talk.waits, self._stream.remark = False, ""
                yield from self._find()
                yield from self._set_up()
                yield from self._start()
                yield from self._deliver()
            except StartAgainError as why:
                self._status.session = State.WAITING
                self._talk.waits, self.attitudes = True, []
                self._exchange.fail(why)
                yield from self._exchange.back_off()

    def _find(self) -> Steps[None]:
        self._status.session, began_s = State.FINDING, self._exchange.now_s
        while reason := (yield from self._talk.go_to_config()):
            if self._exchange.now_s - began_s >= BAUDS_TOLD_AFTER_S and "baud rate" in reason:
                reason += f" ({self._talk.describe_bauds()})"
            self._status.fall_back("starting", reason)

    def _set_up(self) -> Steps[None]:
        self._status.session = State.SETTING_UP
        self._status.fall_back("starting", self._exchange.failure or "the MTi is being set up")
        yield from identify(self._talk, self._stream)
        yield from set_up(self._talk, self._stream, self._rate_hz, self._baud)

    def _start(self) -> Steps[None]:
        """Data proves Measurement state as well as the acknowledgement that it may have hidden."""
        self._status.session = State.STARTING
        proofs = (Mid.GoToMeasurement + 1, *DATA_MIDS, Mid.Error)
        frame: MtFrame | None = yield from self._exchange.ask(
            encode_frame(Mid.GoToMeasurement),
            lambda frame: frame if frame.mid in proofs else None,
            ANSWER_S,
            TRIES,
        )
        if frame is None:
            raise StartAgainError("the MTi does not answer GoToMeasurement")
        if frame.mid == Mid.Error:
            refusal = describe_error(frame.data)
            raise StartAgainError(f"the MTi refuses GoToMeasurement: {refusal}")

    def _deliver(self) -> Steps[None]:
        self._status.session = State.DELIVERING
        stream, exchange = self._stream, self._exchange
        newest = self.reader.newest
        self.reader = reader = StreamReader(self._status, stream, 10 / self._baud, newest)
        heard_s = exchange.now_s
        silence_s = max(SILENCE_S, SILENCE_SAMPLES * stream.period_s)
        while exchange.now_s - heard_s <= silence_s:
            frames = yield from exchange.turn(due_s=heard_s + silence_s)
            self.attitudes = reader.take(frames, exchange.now_s)
            if self.attitudes:
                heard_s = exchange.now_s
                if self._status.state != "running":
                    self._status.state = "running"
                    exchange.succeed()
                self._status.cause = reader.remark
        reason = f": {reader.complaint}" if reader.complaint else ""
        raise StartAgainError(f"no orientation from the MTi for {silence_s:.1f} s{reason}")


class Mti(Device[Attitude]):
    """An MTi or MTx on a serial line."""

    def __init__(self, port: Port, *, rate_hz: float, baud: int) -> None:
        self.stream = MtStream()
        self.clock_locked = False  # as of the newest step
        status = DeviceStatus("mti")

        def new_session() -> Session:
            self.session = MtiSession(status, self.stream, rate_hz, baud)
            return self.session.run()

        def new_parser() -> MtParser:
            self._parser = MtParser(baud)
            return self._parser

        self._maybe_gathers = port if isinstance(port, Gathers) else None
        self._gathered, self._gathered_s = (0, 0), -math.inf  # bytes, of which connection; when
        self._gives_frames = False  # the line is readable when a whole sample has come, not before
        self._hears_s, self._stamped_s = -math.inf, 0.0  # listened to from then; read as it arrived
        super().__init__(status, port, new_parser, new_session)

    def step(self, now_s: float) -> list[Attitude]:
        attitudes = super().step(now_s)
        self._gather(now_s)
        is_running = self.status.state == "running"
        self.clock_locked = is_running and self.session.reader.times.locked
        if self._gives_frames:  # all that had come is read: the next one is read as it arrives
            passed_s, period_s = now_s - self._stamped_s, self.stream.period_s
            next_s = self._stamped_s + math.ceil(passed_s / period_s) * period_s
            self._hears_s = next_s - EARLY_S if passed_s >= STAMPED_S else math.inf
        self.status.hears_s = self._hears_s
        return attitudes

    def hear(self, now_s: float) -> None:
        super().hear(now_s)
        self._gather(now_s)
        self._listen_later(now_s)

    def keep(self, now_s: float) -> None:
        super().keep(now_s)
        self._listen_later(now_s)

    def _listen_later(self, now_s: float) -> None:
        """A sample is read; when the next one is worth a turn of its own.

        Samples that steps read are stamped late. The clock, which goes by the least delayed, needs
        some whose stamps are true. While it starts, nobody knows how often they will come.
        """
        self._hears_s = self._stamped_s = now_s
        if self.status.state == "running":
            next_s = math.inf if self._gives_frames else now_s + self.stream.period_s
            self._hears_s = next_s - EARLY_S
        self.status.hears_s = self._hears_s

    def _gather(self, now_s: float) -> None:
        """Let the line wake us for whole frames, where we stand between two of them.

        A change costs the driver of a real adapter milliseconds: seldom done, undone at once.
        """
        if self._maybe_gathers is None:
            return
        is_between = self.status.state == "running" and not self._parser.kept
        size = self.session.reader.frame_bytes if is_between else 0
        wanted = (size if 0 < size <= MOST_GATHERED else 1, self.port.opened)
        if wanted == self._gathered:
            return
        if wanted[0] == 1 or now_s - self._gathered_s >= GATHER_AGAIN_S:
            self._maybe_gathers.gather(wanted[0])
            self._gathered, self._gathered_s = wanted, now_s
            self._gives_frames = wanted[0] > 1

    @property
    def clock_uncertainty_s(self) -> float:
        return self.session.reader.times.uncertainty_s

    def measured(self) -> dict[str, float]:
        return {"clock_uncertainty_s": round(self.clock_uncertainty_s, 6)}

    @property
    def identity(self) -> str:
        stream = self.stream
        firmware = f"firmware {stream.firmware}" if stream.firmware else ""
        hardware = f"hardware {stream.hardware}" if stream.hardware else ""
        parts = (stream.product, firmware, hardware, stream.device_id)
        return ", ".join(part for part in parts if part)

    def _measure(self, now_s: float, events: list[Any]) -> list[Attitude]:
        attitudes, self.session.attitudes = self.session.attitudes, []
        return attitudes
