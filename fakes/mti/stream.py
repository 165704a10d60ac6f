"""The data messages of a fake MTi: when each is sampled, what it holds, when it leaves.

Source: MTi sheet, sections 3 to 5, 7 and 10, and its recordings: the first message has no
orientation.
"""

from fakes.mti.faults import Faults
from fakes.mti.frames import frame
from fakes.mti.line import SerialLine
from fakes.mti.memory import Memory, is_rated, stride
from fakes.mti.messages import ORIENTATION, ORIENTED, kind_of, mtdata, mtdata2
from fakes.mti.sensor import Sensor
from fakes.wires.timing import Quartz

PERIOD_TICKS_PER_S, FINE_TICKS_PER_S = 115200, 10_000
CALIBRATED_LATENCY_S, LATENCY_S = 0.00031, 0.00255  # from sampling to the first byte
FULL_LINE_S = 0.1  # a message that would have to wait longer than this is lost
KEPT_S = 0.9  # a device that was not looked at for longer has lost its oldest samples
ON_REQUEST = 0xFFFF  # skip factor
MTDATA, MTDATA2, ERROR = 0x32, 0x36, 0x42
TIMER_OVERFLOW, TELL, STOP = 0x1E, 2, 3  # an Error, and error modes


class Stream:
    """The streaming side of a fake, of which it takes faults and settings."""

    def __init__(
        self, faults: Faults, memory: Memory, sensor: Sensor, line: SerialLine, clock: Quartz
    ) -> None:
        self.stopped = False  # by a full line, as the error mode wants it
        self._faults, self._memory = faults, memory
        self._sensor, self._line, self._clock = sensor, line, clock
        self._last = (MTDATA, b"")
        self._fine_offset = 0
        self._next_device_s = line.random.uniform(0.0, self._period_s)  # of the next sample
        self._tick = 0  # base ticks of MTData2 since measuring began
        self._skipped = 0  # samples since the last message
        self._first = True  # the filter has given nothing yet

    @property
    def _period_s(self) -> float:
        if not self._memory.mtdata2:
            return self._memory.period / PERIOD_TICKS_PER_S
        base_hz = self._memory.model.base_hz
        return (self._stride or base_hz) / base_hz

    @property
    def _stride(self) -> int:
        return stride(self._memory.outputs, self._memory.model.base_hz)

    def half_message(self) -> bytes:
        """What gets out of a data message when the power goes."""
        return frame(*self._last)[: len(self._last[1]) // 2]

    def begin(self, device_s: float) -> None:
        """Measurement state from an instant of the device's clock."""
        self._skipped = self._tick = 0
        self._first, self.stopped = True, False
        self._next_device_s = device_s + self._period_s

    def measure(self) -> None:
        memory = self._memory
        if self._next_device_s > self._clock.device_s:
            return
        period_s = self._period_s
        lost = int((self._clock.device_s - KEPT_S - self._next_device_s) / period_s)
        if lost > 0:
            self._next_device_s += lost * period_s
            self._tick += lost * self._stride
            self._count(lost if memory.mtdata2 else lost // (memory.skip + 1))
        while self._next_device_s <= self._clock.device_s and not self.stopped:
            device_s = self._next_device_s
            self._next_device_s += period_s
            if memory.mtdata2:
                self._packets(device_s)
            else:
                self._skipped += 1
                if memory.skip != ON_REQUEST and self._skipped > memory.skip:
                    self._message(device_s)

    def answer_request(self) -> None:
        """One message for a ReqData."""
        if self._memory.skip == ON_REQUEST and not self._memory.mtdata2:
            self._message(self._clock.device_s)

    def message_now(self) -> None:
        """One message more than the period asks for."""
        identifiers = self._due(0) if self._memory.mtdata2 else None
        self._message(self._clock.device_s, identifiers)

    def _packets(self, device_s: float) -> None:
        identifiers = self._due(self._tick)
        self._tick += self._stride
        if self._first:
            identifiers = [i for i in identifiers if kind_of(i) not in ORIENTED]
        self._first = False
        if self._headers_alone or any(is_rated(i) for i in identifiers):
            self._message(device_s, identifiers)

    @property
    def _headers_alone(self) -> bool:
        return not any(is_rated(identifier) for identifier, _ in self._memory.outputs)

    def _due(self, tick: int) -> list[int]:
        """The packets, in the order set, whose time is a base tick; headers if any is."""
        outputs, base_hz = self._memory.outputs, self._memory.model.base_hz
        rated = {i for i, hz in outputs if is_rated(i) and tick % (base_hz // hz) == 0}
        if not rated and not self._headers_alone:
            return []
        return [i for i, _ in outputs if i in rated or not is_rated(i)]

    def _message(self, device_s: float, identifiers: list[int] | None = None) -> None:
        """Of a sample at an instant of the device's clock: MTData, or MTData2 of these packets."""
        memory = self._memory
        if identifiers == []:
            return
        t_s = self._clock.host_s(device_s)
        self._skipped = 0
        if not self._faults.frozen or not self._last[1]:
            self._count(self._faults.gap)
            self._faults.gap = 0
            sample = self._sensor.sample(t_s, self._fine(device_s))
            if identifiers is None:
                self._last = (MTDATA, mtdata(sample, memory.mode, memory.settings))
            else:
                self._last = (MTDATA2, mtdata2(sample, identifiers))
            self._count(1)
        is_calibrated = identifiers is None and not memory.mode & ORIENTATION
        self._leave(t_s + (CALIBRATED_LATENCY_S if is_calibrated else LATENCY_S))

    def _fine(self, device_s: float) -> int:
        """SampleTimeFine of an instant of the device's clock."""
        ticks, faults = round(device_s * FINE_TICKS_PER_S), self._faults
        if faults.fine_next is not None:
            self._fine_offset, faults.fine_next = faults.fine_next - ticks, None
        return (ticks + self._fine_offset) % self._memory.model.fine_ticks

    def _count(self, steps: int) -> None:
        self._faults.counter = (self._faults.counter + steps) % 2**16

    def _leave(self, ready_s: float) -> None:
        """Send the last message's data, unless it is lost."""
        mid, data = self._last
        off = self._faults.length_off
        data = data + bytes(off) if off >= 0 else data[:off]
        if self._line.hits(self._faults.lost_rate):
            return
        if self._line.free_s < ready_s + FULL_LINE_S:
            self._line.send(ready_s, frame(mid, data))
        else:
            self._fail(ready_s)

    def _fail(self, ready_s: float) -> None:
        """A message did not fit the line: what the error mode says."""
        mode = self._memory.error_mode
        if mode == 0:  # as if it had not been sampled
            self._count(-1)
        if mode >= TELL and self._line.free_s < ready_s + 2 * FULL_LINE_S:
            self._line.send(ready_s, frame(ERROR, bytes([TIMER_OVERFLOW])))
        self.stopped = mode == STOP
