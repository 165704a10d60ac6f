"""The data messages of a fake MTi: when each is sampled, what it holds, when it leaves.

Source: MTi sheet, sections 3 to 5, 7 and 10, and its recordings: the first message has no
orientation, the receiver's messages have their headers behind and in reverse.
"""

from dataclasses import replace

from fakes.mti import frames as mt
from fakes.mti.answers import Desk
from fakes.mti.line import SerialLine
from fakes.mti.mtdata import ORIENTATION, Sample, encode
from fakes.mti.nmea import PERIOD_S as NMEA_PERIOD_S
from fakes.mti.nmea import sentences
from fakes.mti.outputs import due, stride
from fakes.mti.packets import FILTERED, HEADERS, LOCATED, TICKS_PER_S, kind_of
from fakes.mti.packets import encode as encode_packets
from fakes.wires.timing import Quartz

PERIOD_TICKS_PER_S = 115200
CALIBRATED_LATENCY_S, LATENCY_S = 0.00031, 0.00255  # from sampling to the first byte
GNSS_S = 0.25  # from one message of the receiver to the next, at full quarters of UTC
GNSS_LATENCY_S, LOCATED_S = 0.0516, 0.064  # from there to its message, and to positions
FULL_LINE_S = 0.1  # a message that would have to wait longer than this is lost
KEPT_S = 0.9  # a device that was not looked at for longer has lost its oldest samples
ON_REQUEST = 0xFFFF  # skip factor
MTDATA, MTDATA2, ERROR = 0x32, 0x36, 0x42
TIMER_OVERFLOW, TELL, STOP = 0x1E, 2, 3  # an Error, and error modes
PRESSURE = 0x3010


class Stream(Desk, SerialLine):
    """The streaming side; plain attributes are faults, settable any time."""

    _clock: Quartz

    def __init__(self) -> None:
        self.frozen = False  # the same data again and again
        self.lost_rate = 0.0  # of data messages, which are then missing in the counter
        self.gap = 0  # samples that the next message's counter jumps over; then 0 again
        self.length_off = 0  # data messages carry so many bytes more, or fewer, than they should
        self.fine_next: int | None = None  # SampleTimeFine of the next message; it runs on from it
        self._fine_offset = 0
        self._last = (MTDATA, b"")
        self._next_device_s = self._random.uniform(0.0, self._period_s)  # of the next sample
        self._tick = 0  # base ticks of MTData2 since measuring began
        self._skipped = 0  # samples since the last message
        self._first = True  # the filter has given nothing yet
        self._located_from_s = self._gnss_due_s = self._next_device_s
        self._nmea_due_s = 0.0

    @property
    def _period_s(self) -> float:
        """From one sample to the next."""
        if not self.memory.mtdata2:
            return self.memory.period / PERIOD_TICKS_PER_S
        base_hz = self.memory.model.base_hz
        return (stride(self.memory.outputs, base_hz) or base_hz) / base_hz

    def _to_config(self) -> None:
        """Leave Measurement state."""
        raise NotImplementedError

    def _put_half(self, now_s: float) -> None:
        """Half a data message, at once."""
        message = mt.frame(*self._last)
        self._queue.append((now_s, 0.0, message[: len(self._last[1]) // 2]))

    # -- when ---------------------------------------------------------------------------------

    def _measure_from(self, device_s: float) -> None:
        self._skipped = self._tick = 0
        self._first = True
        self._next_device_s = device_s + self._period_s
        begin_s = self._clock.host_s(device_s)
        self._gnss_due_s = self._epoch_after(begin_s - GNSS_LATENCY_S) + GNSS_LATENCY_S
        self._located_from_s = self._epoch_after(begin_s) + LOCATED_S
        self._nmea_due_s = begin_s + NMEA_PERIOD_S

    def _epoch_after(self, t_s: float) -> float:
        """The receiver's next instant after a host instant."""
        utc_s = self.utc_at_zero_s + t_s
        return t_s + GNSS_S - utc_s % GNSS_S

    def _measure(self) -> None:
        """Take the samples that have become due."""
        if self._next_device_s > self._clock.device_s:
            return
        period_s = self._period_s
        lost = int((self._clock.device_s - KEPT_S - self._next_device_s) / period_s)
        if lost > 0:
            self._next_device_s += lost * period_s
            self._tick += lost * self._stride
            skip = 0 if self.memory.mtdata2 else self.memory.skip
            self.counter = (self.counter + lost // (skip + 1)) % 2**16
        while self._next_device_s <= self._clock.device_s and self._is_measuring():
            device_s = self._next_device_s
            self._next_device_s += period_s
            if self.memory.mtdata2:
                self._packets(device_s)
            else:
                self._skipped += 1
                if self.memory.skip != ON_REQUEST and self._skipped > self.memory.skip:
                    self._message(device_s)

    def _is_measuring(self) -> bool:
        raise NotImplementedError

    @property
    def _stride(self) -> int:
        return stride(self.memory.outputs, self.memory.model.base_hz)

    def _on_request(self, now_s: float, data: bytes) -> None:
        """One message for a ReqData."""
        if self.memory.skip == ON_REQUEST and not data and not self.memory.mtdata2:
            self._message(self._clock.device_s)

    def _message_now(self, now_s: float) -> None:
        """One message more than the period asks for."""
        if self.memory.mtdata2:
            self._send_packets(self._clock.device_s, due(self.memory.outputs, 0, 1))
        else:
            self._message(self._clock.device_s)

    # -- what ---------------------------------------------------------------------------------

    def _fine(self, device_s: float) -> int:
        """SampleTimeFine of an instant of the device's clock."""
        ticks, wrap = round(device_s * TICKS_PER_S), self.memory.model.fine_ticks
        if self.fine_next is not None:
            self._fine_offset, self.fine_next = self.fine_next - ticks, None
        return (ticks + self._fine_offset) % wrap

    def _count(self) -> None:
        """The counter of the message that comes."""
        self.counter = (self.counter + self.gap) % 2**16
        self.gap = 0

    def _message(self, device_s: float) -> None:
        """MTData of a sample at an instant of the device's clock."""
        t_s = self._clock.host_s(device_s)
        self._skipped = 0
        memory = self.memory
        if not self.frozen or not self._last[1]:
            self._count()
            age = int((t_s + self.utc_at_zero_s) % GNSS_S / self._period_s)
            sample = self._sample(t_s, self._fine(device_s), min(age, 255))
            self._last = (MTDATA, encode(sample, memory.mode, memory.settings))
            self.counter = (self.counter + 1) % 2**16
        oriented = memory.mode & ORIENTATION
        self._leave(t_s + (LATENCY_S if oriented else CALIBRATED_LATENCY_S))

    def _packets(self, device_s: float) -> None:
        """MTData2 of what is due at an instant of the device's clock."""
        memory, t_s = self.memory, self._clock.host_s(device_s)
        base_hz = memory.model.base_hz
        self._receiver(t_s)
        self._text(t_s, device_s)
        pressure = [entry for entry in memory.outputs if entry[0] == PRESSURE]
        if self._first and pressure:  # it is sampled on its own, and ready before all others
            alone = [i for i, _ in memory.outputs if i == PRESSURE or kind_of(i) in HEADERS]
            early_s = self._period_s / 2
            self._send_packets(device_s - early_s, alone)
        identifiers = due(memory.outputs, self._tick, base_hz)
        self._tick += self._stride
        if self._first:
            identifiers = [i for i in identifiers if kind_of(i) not in FILTERED]
        if t_s < self._located_from_s or not self.gps_fix:
            identifiers = [i for i in identifiers if kind_of(i) not in LOCATED]
        self._first = False
        if any(kind_of(i) not in HEADERS for i in identifiers) or not self._rated():
            self._send_packets(device_s, identifiers)

    def _rated(self) -> bool:
        return any(kind_of(i) not in HEADERS for i, _ in self.memory.outputs)

    def _send_packets(self, device_s: float, identifiers: list[int]) -> None:
        if not identifiers:
            return
        t_s = self._clock.host_s(device_s)
        if not self.frozen or not self._last[1]:
            self._count()
            sample = self._sample(t_s, self._fine(device_s))
            periods_s = {i: 1 / hz for i, hz in self.memory.outputs if hz}
            self._last = (MTDATA2, encode_packets(sample, identifiers, periods_s))
            self.counter = (self.counter + 1) % 2**16
        self._leave(t_s + LATENCY_S)

    def _receiver(self, t_s: float) -> None:
        """The receiver's own messages: what it told, then the headers in reverse."""
        if t_s < self._gnss_due_s:
            return
        epoch_s = self._gnss_due_s - GNSS_LATENCY_S
        self._gnss_due_s += GNSS_S
        identifiers = [i for i, _ in self.memory.outputs]
        headers = [i for i in identifiers if kind_of(i) in HEADERS and kind_of(i) < 0xE000]
        headers = sorted(headers, reverse=True, key=identifiers.index)
        device_s = self._clock.device_s - (self._clock.host_s(self._clock.device_s) - epoch_s)
        for told in (0x7020, 0x7010):
            if told in identifiers:
                self._gnss_message(epoch_s, device_s, [told, *headers])

    def _gnss_message(self, epoch_s: float, device_s: float, identifiers: list[int]) -> None:
        place = self._place(epoch_s)
        sample: Sample = replace(
            self._sample(epoch_s, self._fine(device_s)), place=place, preamble=False
        )
        self._last = (MTDATA2, encode_packets(sample, identifiers, {}))
        self.counter = (self.counter + 1) % 2**16
        self._leave(epoch_s + GNSS_LATENCY_S)

    def _text(self, t_s: float, device_s: float) -> None:
        """NMEA sentences, if they were asked for."""
        if not self.memory.string_output or t_s < self._nmea_due_s:
            return
        self._nmea_due_s = t_s + NMEA_PERIOD_S
        R = self._told(self._motion_at(t_s)[0])
        self._send(t_s + LATENCY_S, sentences(R, self.memory.string_output))

    def _leave(self, ready_s: float) -> None:
        """Send the last message's data, unless it is lost."""
        mid, data = self._last
        data = data + bytes(self.length_off) if self.length_off >= 0 else data[: self.length_off]
        if self._hit(self.lost_rate):
            return
        if self._line_free_s < ready_s + FULL_LINE_S:
            self._send(ready_s, mt.frame(mid, data))
        else:
            self._fail(ready_s)

    def _fail(self, ready_s: float) -> None:
        """A message did not fit the line: what the error mode says."""
        mode = self.memory.error_mode
        if mode == 0:  # as if it had not been sampled
            self.counter = (self.counter - 1) % 2**16
        if mode >= TELL and self._line_free_s < ready_s + 2 * FULL_LINE_S:
            self._send(ready_s, mt.frame(ERROR, bytes([TIMER_OVERFLOW])))
        if mode == STOP:
            self._to_config()
