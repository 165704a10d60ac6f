"""The data messages of one MTi, checked against what was set up: new, in order, of the right kind.

Source: MTi sheet, sections 4, 5 and 9.
"""

import math
from dataclasses import dataclass

from msgspec import Struct
from msgspec.structs import replace

from core.records import Attitude
from hw.device import BadFrame, DeviceStatus
from hw.exchange import StartAgainError
from hw.mti.conversation import RESTARTED
from hw.mti.frames import Mid, MtFrame, describe_error
from hw.mti.mtdata import MtDataDecoder, decode_mtdata2
from hw.mti.sample import MtSample
from hw.mti.times import COUNTER_WRAP, RateWatch, SampleTimes

MAX_GAP_S = 2.0  # beyond the time that passed: a counter that began anew, not lost samples
MAX_FOREIGN = 3  # data messages in a row that are of another kind or length than set up
ERROR_SHOWN_S = 5.0  # for so long an Error in the stream is told while running
MTDATA = int(Mid.MTData)  # of each frame it is asked: a name within an enum is slow to find
DATA_MIDS = (MTDATA, int(Mid.MTData2))
STAMPS = ("counter", "fine_ticks", "status")  # in every message


class Received(Struct, frozen=True):
    """A sample, and the frame by which its time is found."""

    sample: MtSample
    frame: MtFrame


@dataclass(slots=True)
class MtStream:
    """What the session knows of the device and its stream, for the side that measures."""

    period_s: float = math.nan
    device_id: str = ""  # hexadecimal
    product: str = ""
    firmware: str = ""
    hardware: str = ""  # newer devices only
    legacy: MtDataDecoder | None = None  # None: the stream is MTData2
    with_rate: bool = True  # of turn
    remark: str = ""  # what is not as configured

    def note(self, remark: str) -> None:
        """The first thing said stays: what follows is mostly its consequence."""
        self.remark = self.remark or remark


class SampleMerger:
    """Joins messages of one instant: orientation in one, rate of turn in the next.

    A sample that lacks one of the two is held until a message of another instant comes, or a period
    has passed; then it goes on as it is. Whatever is put in comes out, in order.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._held: Received | None = None

    def continues(self, sample: MtSample) -> bool:
        """Whether it belongs to the held sample: the same instant, and nothing said twice."""
        if self._held is None:
            return False
        held = self._held.sample
        if held.fine_ticks is not None and sample.fine_ticks is not None:
            if held.fine_ticks != sample.fine_ticks:
                return False
        elif held.counter is None or held.counter != sample.counter:
            return False
        return not (_said(held) & _said(sample))

    def take(self, received: Received) -> list[Received]:
        held, sample = self._held, received.sample
        if held is not None and self.continues(sample):
            received, held = _joined(held, received), None
            sample = received.sample
        given = [] if held is None else [held]
        is_half = (sample.q_earth_sensor is None) != (sample.rate_radps is None)
        self._held = received if is_half else None
        return given if is_half else [*given, received]

    def flush(self, now_s: float) -> list[Received]:
        """The held sample, once it has waited for a period."""
        held = self._held
        if held is not None and now_s - held.frame.arrived_s >= self._period_s:
            self._held = None
            return [held]
        return []


def _said(sample: MtSample) -> set[str]:
    names = (name for name in sample.__struct_fields__ if name not in STAMPS)
    return {name for name in names if getattr(sample, name) is not None}


def _joined(first: Received, second: Received) -> Received:
    """Timed by the message with the orientation."""
    values = {
        name: getattr(second.sample, name)
        for name in MtSample.__struct_fields__
        if getattr(first.sample, name) is None
    }
    timed = first if first.sample.q_earth_sensor is not None else second
    return Received(replace(first.sample, **values), timed.frame)


class StreamReader:
    """Frames of one stream in, attitudes out; from each start of the stream a new one.

    Args:
        byte_s: of one byte on the wire.
        newest: the sample before this stream, so that a frozen one is known again.
    """

    def __init__(
        self, status: DeviceStatus, stream: MtStream, byte_s: float, newest: MtSample | None = None
    ) -> None:
        self.times = SampleTimes(stream.period_s, byte_s)
        self.frame_bytes = 0  # of each data message; 0 while they differ
        self._newest_size = -1  # of its data
        self.complaint = ""  # the last thing that was wrong with a data message
        self.remark = ""  # what a person should know while it runs; "" if all is as configured
        self.newest = newest
        self._status, self._stream = status, stream
        joins = stream.legacy is None and stream.with_rate  # else nothing waits for its rate
        self._maybe_merger = SampleMerger(stream.period_s) if joins else None
        self._watch = RateWatch(stream.period_s)
        self._newest_s = math.nan  # arrival of it; NaN: in a stream before this one
        self._foreign = 0
        self._error, self._error_s = "", -math.inf  # the last Error, and when

    def take(self, frames: list[MtFrame], now_s: float) -> list[Attitude]:
        complete, merger = list[Received](), self._maybe_merger
        for frame in frames:
            if self._newest_size != len(frame.data):
                self._newest_size, self.frame_bytes = len(frame.data), 0
            elif not self.frame_bytes:
                self.frame_bytes = frame.wire_bytes
            if frame.mid not in DATA_MIDS:
                self._note(frame)
                continue
            sample = self._checked(frame)
            if isinstance(sample, BadFrame):
                self._refuse(sample)
            else:
                received = Received(sample, frame)
                complete += [received] if merger is None else merger.take(received)
        if merger is not None:
            complete += merger.flush(now_s)
        attitudes = []
        for received in complete:
            sample, frame = received.sample, received.frame
            if sample.q_earth_sensor is not None:
                t_s = self.times.t_s(sample, frame.arrived_s, frame.wire_bytes)
                rate_radps = sample.rate_radps or (math.nan, math.nan, math.nan)
                field, felt = sample.magnetic, sample.accel_mps2
                attitudes.append(Attitude(t_s, sample.q_earth_sensor, rate_radps, field, felt))
        is_error_new = now_s - self._error_s < ERROR_SHOWN_S
        self.remark = self._error if is_error_new else self._stream.remark or self._watch.remark
        return attitudes

    def _refuse(self, bad: BadFrame) -> None:
        self._status.reject(bad)
        self.complaint = bad.reason
        if self._foreign >= MAX_FOREIGN:
            raise StartAgainError(f"the MTi does not send what was set: {bad.reason}")

    def _note(self, frame: MtFrame) -> None:
        """What it says between its data."""
        if frame.mid == Mid.Configuration:
            raise StartAgainError(RESTARTED)
        if frame.mid == Mid.Error:
            self._error = self.complaint = f"the MTi reports {describe_error(frame.data)}"
            self._error_s = frame.arrived_s

    def _checked(self, frame: MtFrame) -> MtSample | BadFrame:
        """What it says, if it was not there before; counts those that never came."""
        legacy, data, arrived_s = self._stream.legacy, frame.data, frame.arrived_s
        if (frame.mid == MTDATA) is (legacy is None):
            self._foreign += 1
            return BadFrame(f"{Mid(frame.mid).name}, which was not asked for", data)
        if legacy is None:
            self._foreign = 0
            sample = decode_mtdata2(data)
        else:
            self._foreign = self._foreign + 1 if len(data) != legacy.size else 0
            sample = legacy.decode(data)
        if isinstance(sample, BadFrame):
            return sample
        newest, passed_s = self.newest, arrived_s - self._newest_s
        self.newest, self._newest_s = sample, arrived_s
        merger = self._maybe_merger
        if newest is None or (merger is not None and merger.continues(sample)):
            return sample
        before, now = newest.fine_ticks, sample.fine_ticks
        is_next = before is not None and now is not None and before != now
        if newest.counter is None or sample.counter is None:
            is_next = is_next or now is None
        else:
            step = (sample.counter - newest.counter) % COUNTER_WRAP
            follows = step * self._stream.period_s <= passed_s + MAX_GAP_S  # else it began anew
            self._status.missed += max(0, step - 1) if follows else 0
            if legacy is not None:  # a newer device's messages may be split
                self._watch.count(step if follows else 0, arrived_s)
            is_next = is_next or step > 0 or sample.q_earth_sensor is None  # a third part of one
        return sample if is_next else BadFrame("sample counter stands still", data)
