"""Starts an MTi and keeps it delivering orientation and rate of turn at a fixed rate.

What the device sends is watched for signs that it is not what was set up: a WakeUp, an unasked
Configuration, data of another kind or length. Then all is read, set and compared anew.

Source: MTi sheet, sections 2, 7, 8 and 9.
"""

import math
from typing import Any

from core.records import Attitude
from hw.device import BadFrame, Device, DeviceStatus, Port, Session
from hw.mti.conversation import (
    ANSWER_S,
    BAUDS_SAID_AFTER_S,
    TRIES,
    Conversation,
    StartAgainError,
    Talk,
)
from hw.mti.frames import Mid, MtFrame, MtParser, encode_frame, error_in_words
from hw.mti.mtdata2 import Received, SampleMerger, decode_mtdata2
from hw.mti.sample import MtSample
from hw.mti.setup import MtStream, identify, set_up
from hw.mti.times import COUNTER_WRAP, RateWatch, SampleTimes

SILENCE_S, SILENCE_SAMPLES = 0.5, 3  # the longer
PAUSE_S = 0.2  # before a new attempt
MAX_GAP_S = 2.0  # beyond the time that passed: a counter that began anew, not lost samples
MAX_FOREIGN = 3  # data messages in a row that are of another kind or length than set up
SAID_S = 5.0  # for so long an Error in the stream is told while running
DATA_MIDS = (Mid.MTData, Mid.MTData2)


class MtiSession:
    """The conversation of section 8, from its beginning as often as needed."""

    def __init__(self, status: DeviceStatus, stream: MtStream, rate_hz: float, baud: int) -> None:
        self._status, self._stream = status, stream
        self._rate_hz, self._baud = rate_hz, baud
        self._talk = Conversation(baud)
        self._failure = ""  # why the last attempt ended, until one succeeds
        self._complaint = ""  # the last thing that was wrong with a data message
        self._error, self._error_s = "", -math.inf  # the last Error in the stream, and when
        self._merger = SampleMerger(0.0)
        self._newest: MtSample | None = None
        self._newest_s = math.nan  # arrival of it; NaN: in a stream before this one
        self._foreign = 0
        self._watch = RateWatch(math.nan)

    def run(self) -> Session:
        """Yields the bytes to write, is sent a Tick."""
        yield from self._talk.turn(b"", waking=False)
        while True:
            try:
                self._stream.samples, self._stream.remark, self._complaint = [], "", ""
                yield from self._start()
                yield from self._deliver()
            except StartAgainError as why:
                self._stream.samples = []
                self._failure = str(why)
                self._status.fall_back("starting", self._failure)
                resume_s = self._talk.now_s + PAUSE_S
                while self._talk.now_s < resume_s:
                    yield from self._talk.turn(b"", waking=False)

    def _start(self) -> Talk[None]:
        began_s = self._talk.now_s
        while reason := (yield from self._talk.go_to_config()):
            if self._talk.now_s - began_s >= BAUDS_SAID_AFTER_S and "baud rate" in reason:
                reason += f" ({self._talk.bauds_in_words()})"
            self._status.fall_back("starting", reason)
        self._status.fall_back("starting", self._failure or "the MTi is being set up")
        yield from identify(self._talk, self._stream)
        yield from set_up(self._talk, self._stream, self._rate_hz, self._baud)
        yield from self._go_to_measurement()

    def _go_to_measurement(self) -> Talk[None]:
        """Data proves it as well as the acknowledgement that data may have hidden."""
        proofs = (Mid.GoToMeasurement + 1, *DATA_MIDS)
        for _ in range(TRIES):
            until_s, out = self._talk.now_s + ANSWER_S, encode_frame(Mid.GoToMeasurement)
            while self._talk.now_s < until_s:
                for frame in (yield from self._talk.turn(out)):
                    if frame.mid in proofs:
                        return
                    if frame.mid == Mid.Error:
                        raise StartAgainError(
                            f"the MTi refuses GoToMeasurement: {error_in_words(frame.data)}"
                        )
                out = b""
        raise StartAgainError("the MTi does not answer GoToMeasurement")

    def _deliver(self) -> Talk[None]:
        """As long as samples with an orientation keep coming."""
        stream, talk = self._stream, self._talk
        stream.starts += 1
        joins = stream.legacy is None and stream.with_rate
        self._merger = SampleMerger(stream.period_s, joins=joins)
        self._newest_s, self._foreign, self._error_s = math.nan, 0, -math.inf
        self._watch = RateWatch(stream.period_s)
        heard_s = talk.now_s
        silence_s = max(SILENCE_S, SILENCE_SAMPLES * stream.period_s)
        while talk.now_s - heard_s <= silence_s:
            samples: list[Received] = []
            for frame in (yield from talk.turn(b"")):
                samples += self._received(frame)
            stream.samples = samples + self._merger.flush(talk.now_s)
            if any(received.sample.q_earth_sensor for received in stream.samples):
                heard_s = talk.now_s
                self._status.state, self._status.cause = "running", self._remark()
                self._failure = ""
        reason = f": {self._complaint}" if self._complaint else ""
        raise StartAgainError(f"no orientation from the MTi for {silence_s:.1f} s{reason}")

    def _remark(self) -> str:
        """What a person should know while it runs; "" if all is as configured."""
        if self._talk.now_s - self._error_s < SAID_S:
            return self._error
        return self._stream.remark or self._watch.remark

    def _received(self, frame: MtFrame) -> list[Received]:
        """The samples that a frame completes."""
        if frame.mid == Mid.Configuration:
            raise StartAgainError("the MTi has restarted: its settings are checked again")
        if frame.mid == Mid.Error:
            self._error = self._complaint = f"the MTi reports {error_in_words(frame.data)}"
            self._error_s = frame.arrived_s
        if frame.mid not in DATA_MIDS:
            return []
        sample = self._checked(frame)
        if isinstance(sample, BadFrame):
            self._status.reject(sample)
            self._complaint = sample.reason
            if self._foreign >= MAX_FOREIGN:
                raise StartAgainError(f"the MTi does not send what was set: {sample.reason}")
            return []
        return self._merger.take(Received(sample, frame.wire_bytes, frame.arrived_s))

    def _checked(self, frame: MtFrame) -> MtSample | BadFrame:
        """The sample of a data message, if it is of the stream that was set up, and a new one."""
        legacy = self._stream.legacy
        if (frame.mid == Mid.MTData) is (legacy is None):
            self._foreign += 1
            name = Mid(frame.mid).name
            return BadFrame(f"{name}, which was not asked for", frame.data)
        if legacy is None:
            sample = decode_mtdata2(frame.data)
        else:
            self._foreign = self._foreign + 1 if len(frame.data) != legacy.size else 0
            sample = legacy.decode(frame.data)
        if isinstance(sample, MtSample) and not self._is_next(sample, frame.arrived_s):
            return BadFrame("sample counter stands still", frame.data)
        return sample

    def _is_next(self, sample: MtSample, arrived_s: float) -> bool:
        """False for a sample that was there before; counts those that never came."""
        newest, passed_s = self._newest, arrived_s - self._newest_s
        self._newest, self._newest_s = sample, arrived_s
        if newest is None or self._merger.continues(sample):
            return True
        ticks_moved = None not in (newest.fine_ticks, sample.fine_ticks) and (
            newest.fine_ticks != sample.fine_ticks
        )
        if newest.counter is None or sample.counter is None:
            return ticks_moved or sample.fine_ticks is None
        step = (sample.counter - newest.counter) % COUNTER_WRAP
        follows = step * self._stream.period_s <= passed_s + MAX_GAP_S  # else it began anew
        self._status.missed += max(0, step - 1) if follows else 0
        if self._stream.legacy is not None:  # a newer device's messages may be split
            self._watch.count(step if follows else 0, arrived_s)
        return step > 0 or ticks_moved or sample.q_earth_sensor is None  # a third part of one


class Mti(Device[Attitude]):
    """An MTi or MTx on a serial line."""

    def __init__(self, port: Port, *, rate_hz: float, baud: int) -> None:
        self.stream = MtStream()
        self._byte_s = 10 / baud
        self._times: SampleTimes | None = None
        self._starts = 0  # of the stream, that the times are for
        status = DeviceStatus("mti")
        super().__init__(
            status,
            port,
            lambda: MtParser(baud),
            lambda: MtiSession(status, self.stream, rate_hz, baud).run(),
        )

    @property
    def clock_locked(self) -> bool:
        """True while the sensor runs and its clock is known well enough."""
        running = self.status.state == "running"
        return running and self._times is not None and self._times.locked

    @property
    def clock_uncertainty_s(self) -> float:
        """Typical error of a sample's time, beyond a constant delay; inf before the first one."""
        return math.inf if self._times is None else self._times.uncertainty_s

    def _measure(self, now_s: float, events: list[Any]) -> list[Attitude]:
        if self._times is None or self._starts != self.stream.starts:
            self._starts = self.stream.starts
            self._times = SampleTimes(self.stream.period_s, self._byte_s)
        attitudes = []
        for received in self.stream.samples:
            sample = received.sample
            if sample.q_earth_sensor is not None:
                t_s = self._times.t_s(sample, received.arrived_s, received.wire_bytes)
                rate_radps = sample.rate_radps or (math.nan, math.nan, math.nan)
                attitudes.append(Attitude(t_s, sample.q_earth_sensor, rate_radps, sample.magnetic))
        self.stream.samples = []
        return attitudes
