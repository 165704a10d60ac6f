"""Fake Xsens MTi on its serial line: wake-up, settings, and MTData or MTData2, as its model speaks.

It takes its settings in Config state only, keeps them over a loss of power, samples at exact
periods of its own clock, and its bytes take their time on the line. In Measurement state it
ignores what the sheet does not allow there. What its model has not gets Error 04, or nothing.

Source: MTi sheet, whole.
"""

import math
import struct
from collections.abc import Callable
from enum import Enum

from fakes.mti import frames as mt
from fakes.mti.faults import Faults
from fakes.mti.line import SerialLine
from fakes.mti.memory import BAD_PARAMETER, NOT_IMPLEMENTED, REGISTERS, Memory, maybe_outputs
from fakes.mti.models import FOURTH, HARDWARE, MODELS
from fakes.mti.sensor import Motion, Sensor
from fakes.mti.stream import Stream
from fakes.wires.timing import Quartz

ANSWER_S, SELF_TEST_S = 0.001, 1.0
WAKE_S = 0.5  # for the host's WakeUpAck
BOOT_S = 0.005  # from power to WakeUp
RESTART_S = 0.05  # from a Reset's answer to WakeUp
EMTS_BYTES = 1320
RESTORE_BYTE, RESTORE_CODE, RESTORE_BAUD = 0xDE, 2, 115200
WAKE_UP, WAKE_UP_ACK, ERROR, CONFIGURATION, EMTS = 0x3E, 0x3F, 0x42, 0x0D, 0x91
GO_TO_MEASUREMENT, GO_TO_CONFIG, REQ_DATA, RESET = 0x10, 0x30, 0x34, 0x40
NO_ROTATION, SELF_TEST, SCENARIO, RESET_ORIENTATION, OUTPUTS = 0x22, 0x24, 0x64, 0xA4, 0xC0
WHILE_MEASURING = (NO_ROTATION, GO_TO_CONFIG, RESET, RESET_ORIENTATION)

Answer = bytes | int  # the data, or the code of an Error


class State(Enum):
    """What the device is at."""

    BOOTING = "booting"
    WAKING = "waking"
    CONFIG = "config"
    MEASURING = "measuring"


class FakeMti(Faults):
    """One sensor, found in mid-stream as shipped: orientation and counter at 100 Hz.

    Args:
        motion_at: instant (host clock) to R_earth_sensor (3, 3), rate of turn (3,) rad/s, and
            acceleration with gravity (3,) m/s2 in sensor axes; earth is north, west, up.
        model: MTi-28 or MTi-G (legacy), MTi-30, MTi-3, MTi-G-700 or MTi-630.
    """

    def __init__(self, motion_at: Motion, seed: int, model: str = "MTi-28") -> None:
        if model not in MODELS:
            raise ValueError(f"model must be one of {', '.join(MODELS)}, is {model!r}")
        super().__init__()
        self.memory = Memory(MODELS[model])
        self.sensor = Sensor(self, self.memory, motion_at, seed)
        self._clock, self._reader = Quartz(), mt.RequestReader()
        self._line = SerialLine(self, seed)
        self._emts = self._line.random.randbytes(EMTS_BYTES)
        self._stream = Stream(self, self.memory, self.sensor, self._line, self._clock)
        self.state = State.MEASURING
        self._begin_s = self._wake_end_s = -math.inf  # of the wake-up
        self.counter = self._line.random.randrange(2**16)

    def power_up(self, now_s: float) -> None:
        """Off and on: WakeUp, and without an answer the stream 500 ms later."""
        now_s = self._clock.follow(now_s, self.drift_ppm)
        self._line.break_off(now_s)
        self._restart(now_s)

    def brown_out(self, now_s: float, *, forgets: bool = False) -> None:
        """A dip of its supply in mid-message; one that forgets is as shipped again."""
        self._line.break_off(now_s, self._stream.half_message())
        if forgets:
            self.memory.restore()
        self._restart(self._clock.follow(now_s, self.drift_ppm))

    def another_host(self, mode: int, settings: int) -> None:
        """Output mode and settings as if another program had set them; MTData from now on."""
        self.memory.mode, self.memory.settings, self.memory.mtdata2 = mode, settings, False

    def exchange(self, now_s: float, received: bytes) -> bytes:
        now_s = self._clock.follow(now_s, self.drift_ppm)
        if self.state in (State.BOOTING, State.WAKING):
            self._wake_on(now_s, received)
        if self.state is State.MEASURING:
            self._stream.measure()
            self._stop_if_full()
        if self.error_next is not None:
            self._line.send(now_s, mt.frame(ERROR, bytes([self.error_next & 0xFF])))
            self.error_next = None
        for request in self._reader.feed(now_s, b"" if self.deaf else received):
            self._take(now_s, request)
        return self._line.taken(now_s)

    def _restart(self, at_s: float) -> None:
        """Without power, or reset, until at_s."""
        self._clock.restart()
        self._reader = mt.RequestReader()
        self.state, self._begin_s = State.BOOTING, at_s + BOOT_S
        self._wake_end_s = self._begin_s + WAKE_S
        self.baud = RESTORE_BAUD  # the only one at which DE is heard
        self.counter = 0
        self.sensor.forget_resets()

    def _wake_on(self, now_s: float, received: bytes) -> None:
        """WakeUp when it has booted; into Measurement state once the host has had its time."""
        if self.state is State.BOOTING and RESTORE_BYTE in received and not self.deaf:
            self.memory.baud_code = RESTORE_CODE
        if self.state is State.BOOTING and now_s >= self._begin_s:
            self.baud = self.memory.baud
            self.state = State.WAKING
            self._line.send(self._begin_s, mt.frame(WAKE_UP))
        if self.state is State.WAKING and now_s >= self._wake_end_s:
            configuration = mt.frame(CONFIGURATION, self.memory.configuration())
            self._line.send(self._wake_end_s, configuration)
            self._line.send(self._wake_end_s, mt.frame(EMTS, self._emts))
            self.state = State.MEASURING
            self._stream.begin(self._clock.device_s - (now_s - self._wake_end_s))

    def _stop_if_full(self) -> None:
        if self._stream.stopped:
            self.state = State.CONFIG

    def _take(self, now_s: float, request: mt.Request) -> None:
        mid = request.mid
        if self.state is State.WAKING and mid == WAKE_UP_ACK:
            self.state = State.CONFIG
        if self.state in (State.BOOTING, State.WAKING) or mid == WAKE_UP_ACK:
            return
        if self.state is State.MEASURING:
            if mid == REQ_DATA and not request.data:
                self._stream.answer_request()
                self._stop_if_full()
            if mid not in WHILE_MEASURING:
                return
            if mid == GO_TO_CONFIG and not request.data:
                for _ in range(self.late_data):
                    self._stream.message_now()
        answer = self._answer(now_s, mid, request.data)
        if mid in self.memory.model.silent_mids:
            return
        if isinstance(answer, int):
            message = mt.frame(ERROR, bytes([answer]), request.bus_id)
        else:
            message = mt.frame(mid + 1, answer, request.bus_id)
        if self.deaf_acks > 0:
            self.deaf_acks -= 1
        else:
            self._line.send(now_s + (SELF_TEST_S if mid == SELF_TEST else ANSWER_S), message)
        if mid == RESET and answer == b"":
            self._restart(now_s + RESTART_S)

    def _answer(self, now_s: float, mid: int, data: bytes) -> Answer:
        """The data of the answer, or the code of an Error, after all that was asked for."""
        memory = self.memory
        if mid in (NO_ROTATION, RESET_ORIENTATION):
            if len(data) != 2:
                return BAD_PARAMETER
            value = int.from_bytes(data, "big")
            if mid == RESET_ORIENTATION:
                in_config = self.state is State.CONFIG
                return self.sensor.reset_orientation(now_s, value, in_config)
            self.sensor.still_until_s = now_s + value
            return b""
        if mid == OUTPUTS and not memory.model.legacy:
            return self._outputs(data)
        if mid in REGISTERS and (mid != SCENARIO or data):
            register = REGISTERS[mid]
            if not register.exists(memory):
                return NOT_IMPLEMENTED
            return (register.write(memory, data) or b"") if data else register.read(memory)
        without_data = self._answers_without_data()
        if mid not in without_data:
            return NOT_IMPLEMENTED
        return BAD_PARAMETER if data else without_data[mid]()

    def _answers_without_data(self) -> dict[int, Callable[[], Answer]]:
        memory, model = self.memory, self.memory.model
        answers: dict[int, Callable[[], Answer]] = {
            0x00: lambda: model.device_id,
            0x02: lambda: model.device_id,
            0x0C: memory.configuration,
            0x0E: self._restore,
            GO_TO_MEASUREMENT: self._go_to_measurement,
            0x12: lambda: model.firmware,
            0x1C: lambda: model.product,
            SELF_TEST: lambda: struct.pack(">H", self.self_test),
            GO_TO_CONFIG: self._go_to_config,
            RESET: lambda: b"",
            0x62: model.profiles,
            SCENARIO: lambda: bytes([memory.scenario_version, memory.scenario]),
        }
        if not memory.mtdata2:
            answers[0x0A] = lambda: struct.pack(">H", memory.length())
        if not model.legacy:
            answers[0x1E] = lambda: HARDWARE
        return answers

    def _restore(self) -> Answer:
        self.memory.restore()
        self.sensor.forget_resets()
        return b""

    def _go_to_config(self) -> Answer:
        self.state = State.CONFIG
        return b""

    def _go_to_measurement(self) -> Answer:
        memory = self.memory
        code = memory.check_fits(memory.outputs, self.baud) if memory.mtdata2 else 0
        if code:
            return code
        self.state = State.MEASURING
        self._stream.begin(self._clock.device_s)
        return b""

    def _outputs(self, data: bytes) -> Answer:
        """The output configuration, read or set; the values taken come back."""
        memory = self.memory
        if data == bytes(4) and memory.model.generation == FOURTH:
            memory.mtdata2 = False  # MTData from now on
            return data
        taken = maybe_outputs(data, memory.model) if data else memory.outputs
        if isinstance(taken, int):
            return taken
        code = memory.check_fits(taken, self.baud)
        if code:
            return code
        if data:
            memory.outputs, memory.mtdata2 = taken, True
        elif not memory.mtdata2:
            return bytes(4)
        return b"".join(struct.pack(">HH", *entry) for entry in taken)
