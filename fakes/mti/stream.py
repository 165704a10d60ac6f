"""The data messages of a fake MTi: when each is sampled, what it holds, when it leaves.

Source: MTi sheet, sections 3 to 5, 7 and 10, and its recordings: the first message has no
orientation.
"""

from fakes.mti import frames as mt
from fakes.mti.answers import Desk
from fakes.mti.line import SerialLine
from fakes.mti.mtdata import ORIENTATION, encode
from fakes.mti.outputs import due, stride
from fakes.mti.packets import HEADERS, ORIENTED, TICKS_PER_S, kind_of
from fakes.mti.packets import encode as encode_packets
from fakes.wires.timing import Quartz

PERIOD_TICKS_PER_S = 115200
CALIBRATED_LATENCY_S, LATENCY_S = 0.00031, 0.00255  # from sampling to the first byte
FULL_LINE_S = 0.1  # a message that would have to wait longer than this is lost
KEPT_S = 0.9  # a device that was not looked at for longer has lost its oldest samples
ON_REQUEST = 0xFFFF  # skip factor
MTDATA, MTDATA2, ERROR = 0x32, 0x36, 0x42
TIMER_OVERFLOW, TELL, STOP = 0x1E, 2, 3  # an Error, and error modes


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
            self._send_packets(self._clock.device_s, due(self.memory.outputs, 0, self.memory.model.base_hz))
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
            sample = self._sample(t_s, self._fine(device_s))
            self._last = (MTDATA, encode(sample, memory.mode, memory.settings))
            self.counter = (self.counter + 1) % 2**16
        oriented = memory.mode & ORIENTATION
        self._leave(t_s + (LATENCY_S if oriented else CALIBRATED_LATENCY_S))

    def _packets(self, device_s: float) -> None:
        """MTData2 of what is due at an instant of the device's clock."""
        memory = self.memory
        identifiers = due(memory.outputs, self._tick, memory.model.base_hz)
        self._tick += self._stride
        if self._first:
            identifiers = [i for i in identifiers if kind_of(i) not in ORIENTED]
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
            self._last = (MTDATA2, encode_packets(sample, identifiers))
            self.counter = (self.counter + 1) % 2**16
        self._leave(t_s + LATENCY_S)

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
