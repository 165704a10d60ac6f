"""Starts an MTi and keeps it delivering orientation and rate of turn at a fixed rate.

Legacy devices (MTData) are asked for Euler angles and calibrated data with a sample counter; those
that do not know that request are newer ones and get an output configuration (MTData2). What the
device took is read back and compared.

Source: MTi sheet, sections 2, 7, 8 and 9.
"""

import math
import struct
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any

from core.records import Attitude
from hw.device_clock import DeviceClock
from hw.mti import ERRORS, NOT_IMPLEMENTED, Mid, MtFrame, MtParser, encode_frame
from hw.mti_data import MtDataDecoder, MtSample, decode_mtdata2
from hw.session import BadFrame, Device, DeviceStatus, Port, Session, Tick

OUTPUT_MODE = 0x0006  # calibrated data and orientation
OUTPUT_SETTINGS = 0x0000_0005  # sample counter, Euler angles, float32, acc + gyr + mag
TICKS_PER_S = 115200  # of the period
MIN_PERIOD, MAX_PERIOD = 225, 0xFFFF
MTDATA2_COUNTER, MTDATA2_FINE, MTDATA2_QUATERNION, MTDATA2_RATE = 0x1020, 0x1060, 0x2010, 0x8020
ALWAYS = 0xFFFF  # the "rate" of packets that come with every message

CONFIG_RETRY_S = 0.25  # acknowledgements get lost among the data that is still in the pipe
CONFIG_TRIES = 3  # before the cause says so
ANSWER_S, TRIES, OPTIONAL_TRIES = 0.5, 3, 2
NO_ANSWER = -1
SILENCE_S, SILENCE_SAMPLES = 0.5, 3  # the longer
PAUSE_S = 0.2  # before a new attempt

LATENCY_S = 0.00255  # sampling instant to first byte, with orientation (section 7)
FINE_TICK_S = 1e-4
FINE_WRAP, FINE_DAY = 2**32, 864_000_000  # the second on 10 and 100 series
FINE_NEAR = 600_000  # a minute around the wrap
COUNTER_WRAP = 2**16
MAX_GAP_S = 2.0  # beyond the time that passed: a counter that began anew, not lost samples


class StartAgainError(Exception):
    """The conversation cannot go on; says why, in words."""


@dataclass(slots=True)
class MtStream:
    """What the session knows of the running stream, for the side that measures."""

    starts: int = 0
    period_s: float = math.nan
    device_id: str = ""
    product: str = ""
    firmware: str = ""
    samples: list[tuple[int, MtSample]] = field(default_factory=list)  # of this tick: bytes, sample


class MtiSession:
    """The conversation of section 8, from its beginning as often as needed."""

    def __init__(self, status: DeviceStatus, stream: MtStream, rate_hz: float) -> None:
        self._status, self._stream = status, stream
        self._period = min(MAX_PERIOD, max(MIN_PERIOD, round(TICKS_PER_S / rate_hz)))
        self._rate_hz = round(rate_hz)
        self._now_s = 0.0
        self._legacy: MtDataDecoder | None = None
        self._failure = ""  # why the last attempt ended, until one succeeds
        self._remark = ""  # what is not as asked for, while running all the same
        self._complaint = ""  # the last thing that was wrong with a data message
        self._noise = self._frames = False  # what was heard since the last start
        self._counter: int | None = None  # of the last sample
        self._counter_s = math.nan

    def run(self) -> Session:
        """Yields the bytes to write, is sent a Tick."""
        yield from self._turn(b"", waking=False)
        while True:
            try:
                self._stream.samples, self._remark, self._complaint = [], "", ""
                yield from self._start()
                yield from self._deliver()
            except StartAgainError as why:
                self._stream.samples = []
                self._failure = str(why)
                self._status.fall_back("starting", self._failure)
                resume_s = self._now_s + PAUSE_S
                while self._now_s < resume_s:
                    yield from self._turn(b"", waking=False)

    def _turn(self, out: bytes, *, waking: bool = True) -> Generator[bytes, Tick, list[MtFrame]]:
        """Write; the frames of the next tick. A WakeUp is answered and ends the attempt."""
        tick = yield out
        self._now_s = tick.now_s
        frames = [event for event in tick.events if isinstance(event, MtFrame)]
        self._noise = self._noise or bool(tick.events)
        self._frames = self._frames or bool(frames)
        if any(frame.mid == Mid.WakeUp for frame in frames):
            self._stream.samples = []
            tick = yield encode_frame(Mid.WakeUpAck)
            self._now_s = tick.now_s
            if waking:
                raise StartAgainError("the MTi has restarted: its settings are set again")
            return []
        return frames

    def _maybe_answer(
        self, mid: Mid, data: bytes, sizes: tuple[int, ...], wait_s: float
    ) -> Generator[bytes, Tick, bytes | int | None]:
        """One request: the data of its answer, the code of an Error, or None after wait_s."""
        until_s = self._now_s + wait_s
        out = encode_frame(mid, data)
        while True:
            for frame in (yield from self._turn(out)):
                if frame.mid == mid + 1 and len(frame.data) in sizes:
                    return frame.data
                if frame.mid == Mid.Error and frame.data:
                    return frame.data[0]
            if self._now_s >= until_s:
                return None
            out = b""

    def _ask(
        self, mid: Mid, data: bytes = b"", *sizes: int, optional: bool = False
    ) -> Generator[bytes, Tick, bytes | int]:
        """A request, repeated: the data of its answer, of one of the sizes (none given: empty).

        An optional one may be refused: the code of the Error then, or NO_ANSWER.
        """
        answer: bytes | int | None = None
        for _ in range(OPTIONAL_TRIES if optional else TRIES):
            answer = yield from self._maybe_answer(mid, data, sizes or (0,), ANSWER_S)
            if answer is not None:
                break
        if answer is None:
            answer = NO_ANSWER
        if isinstance(answer, bytes) or optional:
            return answer
        if answer == NO_ANSWER:
            raise StartAgainError(f"the MTi does not answer {mid.name}")
        raise StartAgainError(f"the MTi refuses {mid.name}: {error_in_words(answer)}")

    def _read(self, mid: Mid, size: int) -> Generator[bytes, Tick, int]:
        """A setting as the device holds it."""
        answer = yield from self._ask(mid, b"", size)
        assert isinstance(answer, bytes)  # only optional requests give codes
        return int.from_bytes(answer, "big")

    def _start(self) -> Generator[bytes, Tick, None]:
        yield from self._go_to_config()
        self._status.fall_back("starting", self._failure or "the MTi is being set up")
        yield from self._identify()
        mode = OUTPUT_MODE.to_bytes(2, "big")
        answer = yield from self._ask(Mid.SetOutputMode, mode, optional=True)
        if isinstance(answer, bytes):
            yield from self._set_up_legacy()
        elif answer in (NOT_IMPLEMENTED, NO_ANSWER):
            yield from self._set_up_new()
        else:
            raise StartAgainError(f"the MTi refuses SetOutputMode: {error_in_words(answer)}")
        yield from self._go_to_measurement()

    def _go_to_config(self) -> Generator[bytes, Tick, None]:
        """Until it answers, however much data comes first."""
        tries = 0
        self._noise = self._frames = False
        while True:
            asked_s = self._now_s
            answer = yield from self._maybe_answer(Mid.GoToConfig, b"", (0,), CONFIG_RETRY_S)
            if answer == b"":
                return
            while self._now_s - asked_s < CONFIG_RETRY_S:  # it sent an Error
                yield from self._turn(b"")
            tries += 1
            if tries % CONFIG_TRIES == 0:
                self._status.fall_back("starting", self._silence_in_words())
                self._noise = self._frames = False

    def _silence_in_words(self) -> str:
        if self._frames:
            return (
                "the MTi sends data but does not answer GoToConfig: check the line to its receiver"
            )
        if self._noise:
            return "bytes arrive but no MT frame: check the baud rate, or it is another device"
        return "no answer to GoToConfig: check power, cable and baud rate"

    def _identify(self) -> Generator[bytes, Tick, None]:
        """Who it is; only the id is insisted on."""
        answer = yield from self._ask(Mid.ReqDID, b"", 4, 8)
        self._stream.device_id = answer.hex() if isinstance(answer, bytes) else ""
        answer = yield from self._ask(Mid.ReqProductCode, b"", *range(1, 21), optional=True)
        if isinstance(answer, bytes):
            self._stream.product = answer.decode("ascii", "replace").strip()
        answer = yield from self._ask(Mid.ReqFWRev, b"", 3, 11, optional=True)
        if isinstance(answer, bytes):
            self._stream.firmware = ".".join(str(part) for part in answer[:3])
        yield from self._ask(Mid.ReqConfiguration, b"", 118, optional=True)

    def _set_up_legacy(self) -> Generator[bytes, Tick, None]:
        """Output settings and period; all of it read back and compared."""
        yield from self._ask(Mid.SetOutputSettings, OUTPUT_SETTINGS.to_bytes(4, "big"))
        yield from self._ask(Mid.SetPeriod, self._period.to_bytes(2, "big"))
        yield from self._ask(Mid.SetOutputSkipFactor, b"\0\0", optional=True)
        mode = yield from self._read(Mid.SetOutputMode, 2)
        settings = yield from self._read(Mid.SetOutputSettings, 4)
        period = yield from self._read(Mid.SetPeriod, 2)
        if (mode, settings) != (OUTPUT_MODE, OUTPUT_SETTINGS):
            raise StartAgainError(
                f"the MTi has output mode {mode:04X} and settings {settings:08X}, "
                f"not {OUTPUT_MODE:04X} and {OUTPUT_SETTINGS:08X} as it was told"
            )
        if period != self._period:
            self._remark = (
                f"the MTi has period {period}, not {self._period} as it was told: "
                f"{TICKS_PER_S / max(period, 1):.1f} samples a second"
            )
        configuration = yield from self._ask(Mid.ReqConfiguration, b"", 118, optional=True)
        if isinstance(configuration, bytes):
            reported = struct.unpack_from(">HI", configuration, 104)
            if reported != (mode, settings):
                self._remark = "the MTi's configuration block contradicts its settings"
        self._legacy = MtDataDecoder(mode, settings)
        self._stream.period_s = max(period, 1) / TICKS_PER_S

    def _set_up_new(self) -> Generator[bytes, Tick, None]:
        """An output configuration; the answer carries what the device made of it."""
        wanted = {
            MTDATA2_COUNTER: ALWAYS,
            MTDATA2_FINE: ALWAYS,
            MTDATA2_QUATERNION: self._rate_hz,
            MTDATA2_RATE: self._rate_hz,
        }
        data = b"".join(struct.pack(">HH", *pair) for pair in wanted.items())
        answer = yield from self._ask(Mid.SetOutputConfiguration, data, *range(0, 129, 4))
        assert isinstance(answer, bytes)
        taken = dict(struct.iter_unpack(">HH", answer))
        for identifier, rate_hz in wanted.items():
            if identifier not in taken:
                raise StartAgainError(f"the MTi does not offer output {identifier:04X}")
            given_hz = taken[identifier]
            if rate_hz not in (ALWAYS, given_hz):
                self._remark = (
                    f"the MTi gives output {identifier:04X} at {given_hz} Hz, not {rate_hz}"
                )
        self._legacy = None
        self._stream.period_s = 1.0 / max(taken[MTDATA2_QUATERNION], 1)

    def _go_to_measurement(self) -> Generator[bytes, Tick, None]:
        """Data proves it as well as the acknowledgement that data may have hidden."""
        proofs = (Mid.GoToMeasurement + 1, Mid.MTData, Mid.MTData2)
        for _ in range(TRIES):
            until_s, out = self._now_s + ANSWER_S, encode_frame(Mid.GoToMeasurement)
            while self._now_s < until_s:
                frames = yield from self._turn(out)
                if any(frame.mid in proofs for frame in frames):
                    return
                out = b""
        raise StartAgainError("the MTi does not answer GoToMeasurement")

    def _deliver(self) -> Generator[bytes, Tick, None]:
        """As long as samples with an orientation keep coming."""
        self._stream.starts += 1
        heard_s, self._counter_s = self._now_s, math.nan  # what came before is not missed
        silence_s = max(SILENCE_S, SILENCE_SAMPLES * self._stream.period_s)
        while self._now_s - heard_s <= silence_s:
            self._stream.samples = self._decoded((yield from self._turn(b"")))
            if any(sample.q_earth_sensor for _, sample in self._stream.samples):
                heard_s = self._now_s
                self._status.state, self._status.cause = "running", self._remark
                self._failure = ""
        reason = f": {self._complaint}" if self._complaint else ""
        raise StartAgainError(f"no orientation from the MTi for {silence_s:.1f} s{reason}")

    def _decoded(self, frames: list[MtFrame]) -> list[tuple[int, MtSample]]:
        samples = []
        for frame in frames:
            if frame.mid == Mid.MTData and self._legacy is not None:
                sample = self._legacy.decode(frame.data)
            elif frame.mid == Mid.MTData2:
                sample = decode_mtdata2(frame.data)
            else:
                if frame.mid == Mid.Error and frame.data:
                    self._complaint = f"it reports {error_in_words(frame.data[0])}"
                continue
            if isinstance(sample, MtSample) and not self._is_next(sample.counter):
                sample = BadFrame("sample counter stands still", frame.data)
            if isinstance(sample, BadFrame):
                self._status.reject(sample)
                self._complaint = sample.reason
            else:
                samples.append((frame.wire_bytes, sample))
        return samples

    def _is_next(self, counter: int | None) -> bool:
        """False for a sample that was there before; counts those that never came."""
        if counter is None or self._counter is None:
            self._counter, self._counter_s = counter, self._now_s
            return True
        step = (counter - self._counter) % COUNTER_WRAP
        passed_s = self._now_s - self._counter_s
        if step * self._stream.period_s <= passed_s + MAX_GAP_S:  # else it began anew
            self._status.missed += max(0, step - 1)
        self._counter, self._counter_s = counter, self._now_s
        return step > 0


def error_in_words(code: int) -> str:
    """The meaning of an Error message (section 3)."""
    return f"error {code:02X}, {ERRORS.get(code, 'not listed')}"


class Mti(Device[Attitude]):
    """An MTi or MTx on a serial line."""

    def __init__(self, port: Port, *, rate_hz: float, baud: int) -> None:
        self.stream = MtStream()
        self._byte_s = 10 / baud
        self._times: _SampleTimes | None = None
        self._starts = 0  # of the stream, that the times are for
        status = DeviceStatus("mti")
        super().__init__(
            status,
            port,
            lambda: MtParser(baud),
            lambda: MtiSession(status, self.stream, rate_hz).run(),
        )

    @property
    def clock_locked(self) -> bool:
        """True once the sensor's clock is known well enough."""
        return self._times is not None and self._times.locked

    def _measure(self, now_s: float, events: list[Any]) -> list[Attitude]:
        if self._times is None or self._starts != self.stream.starts:
            self._starts, self._times = self.stream.starts, _SampleTimes(self.stream.period_s)
        attitudes = []
        for wire_bytes, sample in self.stream.samples:
            if sample.q_earth_sensor is not None:
                sent_s = now_s - LATENCY_S - wire_bytes * self._byte_s
                rate_radps = sample.rate_radps or (math.nan, math.nan, math.nan)
                t_s = self._times.t_s(sample, sent_s)
                attitudes.append(Attitude(t_s, sample.q_earth_sensor, rate_radps))
        self.stream.samples = []
        return attitudes


class _SampleTimes:
    """Sampling instants on the host's clock, from the device's time stamp or its sample counter."""

    def __init__(self, period_s: float) -> None:
        self._by_counter = DeviceClock(period_s, COUNTER_WRAP)
        self._by_stamp = DeviceClock(FINE_TICK_S, FINE_WRAP)
        self._days, self._last_ticks = 0, 0

    @property
    def locked(self) -> bool:
        """True once one of the device's clocks is known well enough."""
        return self._by_counter.locked or self._by_stamp.locked

    def t_s(self, sample: MtSample, sent_s: float) -> float:
        """When it was taken; sent_s is that instant as far as its arrival tells."""
        if sample.fine_ticks is not None:
            return self._by_stamp.host_s(self._without_day_wrap(sample.fine_ticks), sent_s)
        if sample.counter is not None:
            return self._by_counter.host_s(sample.counter, sent_s)
        return sent_s

    def _without_day_wrap(self, ticks: int) -> int:
        """Some devices count up to a day, others to 2^32: made one."""
        if FINE_DAY - FINE_NEAR <= self._last_ticks < FINE_DAY and ticks < FINE_NEAR:
            self._days += 1
        self._last_ticks = ticks
        return (self._days * FINE_DAY + ticks) % FINE_WRAP
