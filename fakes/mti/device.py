"""Fake Xsens MTi on its serial line: wake-up, settings, and MTData or MTData2, as its model speaks.

It takes its settings in Config state only, keeps them over a loss of power, samples at exact
periods of its own clock, and its bytes take their time on the line. In Measurement state it
ignores what the sheet does not allow there. What its model has not gets Error 04, or nothing.

Source: MTi sheet, whole.
"""

import math
from enum import Enum

from fakes.mti import frames as mt
from fakes.mti.answers import SELF_TEST, Answer, Desk
from fakes.mti.line import SerialLine
from fakes.mti.memory import NOT_IMPLEMENTED, Memory, bauds
from fakes.mti.models import MODELS
from fakes.mti.sensor import Motion
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
WHILE_MEASURING = (0x22, GO_TO_CONFIG, REQ_DATA, RESET, 0xA4)


class State(Enum):
    """What the device is at."""

    BOOTING = "booting"
    WAKING = "waking"
    CONFIG = "config"
    MEASURING = "measuring"


class FakeMti(Stream, Desk, SerialLine):
    """One sensor, found in mid-stream as shipped: orientation and counter at 100 Hz.

    Plain attributes, of its bases too, are its faults and properties, to be set at any time.

    Args:
        motion_at: instant (host clock) to R_earth_sensor (3, 3), rate of turn (3,) rad/s, and
            acceleration with gravity (3,) m/s2 in sensor axes; earth is north, west, up.
        model: MTi-28 or MTi-G (legacy), MTi-30, MTi-3, MTi-G-700 or MTi-630.
    """

    def __init__(self, motion_at: Motion, seed: int, model: str = "MTi-28") -> None:
        if model not in MODELS:
            raise ValueError(f"model must be one of {', '.join(MODELS)}, is {model!r}")
        SerialLine.__init__(self, seed)
        Desk.__init__(self, motion_at, seed, MODELS[model])
        self.drift_ppm = 0.0  # of its clock
        self.deaf_acks = 0  # so many answers are swallowed, the requests obeyed
        self.late_data = 0  # so many data messages still come before a GoToConfig's answer
        self.error_next: int | None = None  # code of an Error that it sends unasked, once
        self._emts = self._random.randbytes(EMTS_BYTES)
        self._clock, self._reader = Quartz(), mt.RequestReader()
        self._state = State.MEASURING
        self._begin_s = self._wake_end_s = -math.inf  # of the wake-up
        Stream.__init__(self)
        self.counter = self._random.randrange(2**16)

    @property
    def state(self) -> State:
        """Config, Measurement, or waking up."""
        return self._state

    def power_up(self, now_s: float) -> None:
        """Off and on: WakeUp, and without an answer the stream 500 ms later."""
        now_s = self._clock.follow(now_s, self.drift_ppm)
        self._silence(now_s)
        self._restart(now_s)

    def brown_out(self, now_s: float, *, forgets: bool = False) -> None:
        """A dip of its supply in mid-message; one that forgets is as shipped again."""
        self._silence(now_s)
        self._put_half(now_s)
        if forgets:
            self.memory = Memory(self.memory.model)
        now_s = self._clock.follow(now_s, self.drift_ppm)
        self._restart(now_s)

    def another_host(self, mode: int, settings: int) -> None:
        """Output mode and settings as if another program had set them; MTData from now on."""
        self.memory.mode, self.memory.settings, self.memory.mtdata2 = mode, settings, False

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what the host wrote; give all that the device has sent up to now_s."""
        now_s = self._clock.follow(now_s, self.drift_ppm)
        if self._state in (State.BOOTING, State.WAKING):
            self._wake_on(now_s, received)
        if self._state is State.MEASURING:
            self._measure()
        if self.error_next is not None:
            self._send(now_s, mt.frame(ERROR, bytes([self.error_next & 0xFF])))
            self.error_next = None
        for request in self._reader.feed(now_s, b"" if self.deaf else received):
            self._take(now_s, request)
        return self._taken(now_s)

    # -- states -------------------------------------------------------------------------------

    def _restart(self, at_s: float) -> None:
        """Without power, or reset, until at_s."""
        self._clock.restart()
        self._reader = mt.RequestReader()
        self._state, self._begin_s = State.BOOTING, at_s + BOOT_S
        self._wake_end_s = self._begin_s + WAKE_S
        self.baud = RESTORE_BAUD  # the only one at which DE is heard
        self.counter = 0
        self._forget_resets()

    def _wake_on(self, now_s: float, received: bytes) -> None:
        """WakeUp when it has booted; into Measurement state once the host has had its time."""
        if self._state is State.BOOTING and RESTORE_BYTE in received and not self.deaf:
            self.memory.baud_code = RESTORE_CODE
        if self._state is State.BOOTING and now_s >= self._begin_s:
            self.baud = bauds(self.memory.model)[self.memory.baud_code]
            self._state = State.WAKING
            self._send(self._begin_s, mt.frame(WAKE_UP))
        if self._state is State.WAKING and now_s >= self._wake_end_s:
            self._send(self._wake_end_s, mt.frame(CONFIGURATION, self.memory.configuration()))
            self._send(self._wake_end_s, mt.frame(EMTS, self._emts))
            self._state = State.MEASURING
            self._measure_from(self._clock.device_s - (now_s - self._wake_end_s))

    # -- requests -----------------------------------------------------------------------------

    def _take(self, now_s: float, request: mt.Request) -> None:
        mid = request.mid
        if self._state is State.WAKING and mid == WAKE_UP_ACK:
            self._state = State.CONFIG
        if self._state in (State.BOOTING, State.WAKING) or mid == WAKE_UP_ACK:
            return
        if self._state is State.MEASURING:
            if mid == REQ_DATA:
                self._on_request(now_s, request.data)
            if mid not in WHILE_MEASURING or mid == REQ_DATA:
                return
        if mid == GO_TO_CONFIG and self._state is State.MEASURING and not request.data:
            for _ in range(self.late_data):
                self._message_now(now_s)
        answer = self._obeyed(now_s, mid, request.data)
        if self._is_silent(mid):
            return
        if isinstance(answer, int):
            message = mt.frame(ERROR, bytes([answer]), request.bus_id)
        else:
            message = mt.frame(mid + 1, answer, request.bus_id)
        if self.deaf_acks > 0:
            self.deaf_acks -= 1
        else:
            self._send(now_s + (SELF_TEST_S if mid == SELF_TEST else ANSWER_S), message)
        if mid == RESET and answer == b"":
            self._restart(now_s + RESTART_S)

    def _obeyed(self, now_s: float, mid: int, data: bytes) -> Answer:
        """The answer, after the change of state that was asked for."""
        if mid in (GO_TO_CONFIG, GO_TO_MEASUREMENT, RESET) and data:
            return self._answered(now_s, 0x00, data, True)  # as any message that has none
        if mid == GO_TO_CONFIG:
            self._state = State.CONFIG
            return b""
        if mid == GO_TO_MEASUREMENT:
            code = self._check_fits(self.memory.outputs) if self.memory.mtdata2 else 0
            if code:
                return code
            self._state = State.MEASURING
            self._measure_from(self._clock.device_s)
            return b""
        if mid == RESET:
            return b""
        if mid % 2:
            return NOT_IMPLEMENTED
        return self._answered(now_s, mid, data, self._state is State.CONFIG)

    def _to_config(self) -> None:
        self._state = State.CONFIG

    def _is_measuring(self) -> bool:
        return self._state is State.MEASURING
