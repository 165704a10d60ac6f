"""Fake Xsens MTi of the legacy kind on its serial line: wake-up, settings, and MTData.

It takes its settings in Config state only, keeps them over a loss of power, samples at exact
periods of its own clock, and its bytes take their time on the line. In Measurement state it
ignores what the sheet does not allow there. MTi-G's messages and all newer ones get Error 04.

Source: MTi sheet, sections 1 to 4, 6, 7 and 10.
"""

import math
import random
import struct
from collections.abc import Callable
from enum import Enum

import numpy as np

from fakes import mt
from fakes.mti_data import F64, ORIENTATION, Sample, encode, rotation, rotation_z
from fakes.mti_memory import (
    BAD_PARAMETER,
    BAUDS,
    DEVICE_ID,
    FIRMWARE,
    NOT_IMPLEMENTED,
    REGISTERS,
    SCENARIO_VERSION,
    Memory,
    scenarios,
)
from fakes.timing import Outbox, Quartz

Motion = Callable[[float], tuple[F64, F64, F64]]

TICKS_PER_S = 115200  # of the period
PRODUCT = b"MTi-28A53G35".ljust(20)
ANSWER_S, SELF_TEST_S = 0.001, 1.0
WAKE_S = 0.5  # for the host's WakeUpAck
RESTART_S = 0.05  # from a Reset's answer to WakeUp
EMTS_BYTES = 1320
CALIBRATED_LATENCY_S, LATENCY_S = 0.00031, 0.00255  # from sampling to the first byte
FULL_LINE_S = 0.1  # a message that would have to wait longer than this is lost
KEPT_S = 0.9  # a device that was not looked at for longer has lost its oldest samples
ON_REQUEST = 0xFFFF  # skip factor
MTDATA, WAKE_UP, WAKE_UP_ACK, ERROR, CONFIGURATION, EMTS = 0x32, 0x3E, 0x3F, 0x42, 0x0D, 0x91
SELF_TEST, SCENARIO = 0x24, 0x64
WHILE_MEASURING = (0x22, 0x30, 0x34, 0x40, 0xA4)


class State(Enum):
    """What the device is at."""

    WAKING = "waking"
    CONFIG = "config"
    MEASURING = "measuring"


class FakeMti:
    """One sensor, found in mid-stream as shipped: quaternion and counter at 100 Hz.

    Plain attributes are its faults and properties, to be set at any time.

    Args:
        motion_at: instant (host clock) to R_earth_sensor (3, 3), rate of turn (3,) rad/s, and
            acceleration with gravity (3,) m/s2 in sensor axes; earth is north, west, up.
    """

    def __init__(self, motion_at: Motion, seed: int) -> None:
        self.mute = False  # its bytes are lost, it hears
        self.frozen = False  # the same data again and again
        self.burst_s = 0.0  # bytes come together, so far apart: 0.016 is a USB adapter as shipped
        self.wrong_checksum_rate = 0.0  # of all messages
        self.lost_rate = 0.0  # of data messages, which are then missing in the counter
        self.gap = 0  # samples that the next message's counter jumps over; then 0 again
        self.nan = False  # all numbers
        self.yaw_jump_rad = 0.0
        self.deaf_acks = 0  # so many answers are swallowed, the requests obeyed
        self.drift_ppm = 0.0
        self.baud = 115200  # until the next power-up, which sets what the memory says
        self.counter = 0  # of the next message
        self.angle_noise_rad = math.radians(0.05)
        self.rate_noise_radps = math.radians(0.3)
        self.accel_noise_mps2 = 0.02
        self.magnetic_noise = 0.002
        self.rate_bias_radps: F64 = np.zeros(3)
        self.accel_bias_mps2: F64 = np.zeros(3)
        self.earth_field: F64 = np.array([0.4, 0.0, -0.9])  # north, west, up
        self.temperature_deg = 35.0
        self.memory = Memory()
        self._motion_at = motion_at
        self._random, self._noise = random.Random(seed), np.random.default_rng(seed)
        self._emts = self._random.randbytes(EMTS_BYTES)
        self._clock, self._outbox, self._reader = Quartz(), Outbox(), mt.RequestReader()
        self._state = State.MEASURING
        self._wake_end_s = self._line_free_s = self._still_until_s = -math.inf
        self._next_device_s = self._random.uniform(0.0, self._period_s)  # of the next sample
        self._skipped = 0  # samples since the last message
        self._G, self._A = self.memory.G_reset, self.memory.A_reset  # as now; see Memory
        self._last_data = b""
        self.counter = self._random.randrange(2**16)

    @property
    def state(self) -> State:
        """Config, Measurement, or waking up."""
        return self._state

    @property
    def _period_s(self) -> float:
        return self.memory.period / TICKS_PER_S

    def power_up(self, now_s: float) -> None:
        """Off and on: WakeUp, and without an answer the stream 500 ms later."""
        now_s = self._clock.follow(now_s, self.drift_ppm)
        self._outbox.clear()
        self._line_free_s = now_s
        self._wake(now_s)

    def brown_out(self, now_s: float, *, forgets: bool = False) -> None:
        """A dip of its supply in mid-message; one that forgets is as shipped again."""
        self._outbox.clear()
        self._outbox.put(now_s, mt.frame(MTDATA, self._last_data)[: len(self._last_data) // 2])
        self._line_free_s = now_s
        if forgets:
            self.memory = Memory()
        self._clock.follow(now_s, self.drift_ppm)
        self._wake(now_s)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what the host wrote; give all that the device has sent up to now_s."""
        now_s = self._clock.follow(now_s, self.drift_ppm)
        self._wake_on(now_s)
        self._measure()
        for request in self._reader.feed(now_s, received):
            self._take(now_s, request)
        until_s = math.floor(now_s / self.burst_s) * self.burst_s if self.burst_s > 0 else now_s
        sent = self._outbox.take(until_s)
        return b"" if self.mute else sent

    # -- states -------------------------------------------------------------------------------

    def _wake(self, at_s: float) -> None:
        self._clock.restart()
        self._reader = mt.RequestReader()
        self._state, self._wake_end_s = State.WAKING, at_s + WAKE_S
        self.baud = BAUDS[self.memory.baud_code]
        self.counter = 0
        self._G, self._A = self.memory.G_reset, self.memory.A_reset
        self._send(at_s, mt.frame(WAKE_UP))

    def _wake_on(self, now_s: float) -> None:
        """Into Measurement state once the host has had its time."""
        if self._state is State.WAKING and now_s >= self._wake_end_s:
            self._send(self._wake_end_s, mt.frame(CONFIGURATION, self.memory.configuration()))
            self._send(self._wake_end_s, mt.frame(EMTS, self._emts))
            self._measure_from(self._clock.device_s - (now_s - self._wake_end_s))

    def _measure_from(self, device_s: float) -> None:
        self._state, self._skipped = State.MEASURING, 0
        self._next_device_s = device_s + self._period_s

    def _send(self, ready_s: float, message: bytes) -> None:
        """Onto the line, behind what is still on it."""
        if self._hit(self.wrong_checksum_rate):
            message = message[:-1] + bytes([message[-1] ^ 0xFF])
        self._line_free_s = max(ready_s, self._line_free_s) + 10 * len(message) / self.baud
        self._outbox.put(self._line_free_s, message)

    def _hit(self, rate: float) -> bool:
        return rate > 0 and self._random.random() < rate

    # -- requests -----------------------------------------------------------------------------

    def _take(self, now_s: float, request: mt.Request) -> None:
        if self._state is State.WAKING:
            if request.mid == WAKE_UP_ACK and now_s >= self._wake_end_s - WAKE_S:
                self._state = State.CONFIG
            return
        if self._state is State.MEASURING and request.mid not in WHILE_MEASURING:
            return
        if request.mid == WAKE_UP_ACK:
            return
        if request.mid == 0x34 and self._state is State.MEASURING:
            if self.memory.skip == ON_REQUEST and not request.data:
                self._message(now_s)
            return
        answer = self._answered(now_s, request.mid, request.data)
        if isinstance(answer, int):
            message = mt.frame(ERROR, bytes([answer]), request.bus_id)
        else:
            message = mt.frame(request.mid + 1, answer, request.bus_id)
        if self.deaf_acks > 0:
            self.deaf_acks -= 1
        else:
            self._send(now_s + (SELF_TEST_S if request.mid == SELF_TEST else ANSWER_S), message)
        if request.mid == 0x40 and answer == b"":
            self._wake(now_s + RESTART_S)

    def _answered(self, now_s: float, mid: int, data: bytes) -> bytes | int:
        """The data of the answer, or the code of an Error."""
        if mid in REGISTERS and (mid != SCENARIO or data):
            if not data:
                return REGISTERS[mid].read(self.memory)
            return REGISTERS[mid].write(self.memory, data) or b""
        without_data: dict[int, Callable[[], bytes]] = {
            0x00: lambda: DEVICE_ID.to_bytes(4, "big"),
            0x02: lambda: DEVICE_ID.to_bytes(4, "big"),
            0x0A: lambda: self.memory.configuration()[102:104],
            0x0C: self.memory.configuration,
            0x0E: self._restore,
            0x10: self._go_to_measurement,
            0x12: lambda: FIRMWARE,
            0x1C: lambda: PRODUCT,
            SELF_TEST: lambda: b"\x01\xff",
            0x30: self._go_to_config,
            0x40: lambda: b"",
            0x62: scenarios,
            SCENARIO: lambda: bytes([SCENARIO_VERSION, self.memory.scenario]),
        }
        if mid in without_data:
            return BAD_PARAMETER if data else without_data[mid]()
        if mid in (0x22, 0xA4):
            if len(data) != 2:
                return BAD_PARAMETER
            (value,) = struct.unpack(">H", data)
            return self._no_rotation(now_s, value) if mid == 0x22 else self._reset(now_s, value)
        return NOT_IMPLEMENTED

    def _restore(self) -> bytes:
        self.memory = Memory()
        self._G, self._A = self.memory.G_reset, self.memory.A_reset
        return b""

    def _go_to_config(self) -> bytes:
        self._state = State.CONFIG
        return b""

    def _go_to_measurement(self) -> bytes:
        self._measure_from(self._clock.device_s)
        return b""

    def _no_rotation(self, now_s: float, seconds: int) -> bytes:
        self._still_until_s = now_s + seconds
        return b""

    def _reset(self, now_s: float, code: int) -> bytes | int:
        """Orientation reset: 1 heading, 2 global, 3 object, 4 both 3 and 1; 0 stores it."""
        if (code == 0) is not (self._state is State.CONFIG) or code > 4:
            return BAD_PARAMETER
        if code == 0:
            self.memory.G_reset, self.memory.A_reset = self._G, self._A
            return b""
        alignment = np.array(self.memory.alignment).reshape(3, 3)
        R = self._told(self._motion_at(now_s)[0])
        turn = rotation_z(math.atan2(R[1, 0], R[0, 0]))
        if code in (3, 4):
            self._A = alignment.T @ turn.T @ R @ alignment @ self._A
        if code in (1, 4):
            self._G = turn.T @ self._G
        if code == 2:
            offset = rotation_z(self._yaw_offset_rad)
            self._G = offset.T @ R.T @ offset @ self._G
        return b""

    # -- data ---------------------------------------------------------------------------------

    @property
    def _yaw_offset_rad(self) -> float:
        return self.memory.heading_rad - self.memory.declination_rad

    def _told(self, R_earth_sensor: F64) -> F64:
        """The orientation in the frames that settings and resets have made."""
        A = np.array(self.memory.alignment).reshape(3, 3) @ self._A
        return np.asarray(rotation_z(self._yaw_offset_rad) @ self._G @ R_earth_sensor @ A.T)

    def _measure(self) -> None:
        """Take the samples that have become due."""
        if self._state is not State.MEASURING:
            return
        lost = int((self._clock.device_s - KEPT_S - self._next_device_s) / self._period_s)
        if lost > 0:
            self._next_device_s += lost * self._period_s
            self.counter = (self.counter + lost // (self.memory.skip + 1)) % 2**16
        while self._next_device_s <= self._clock.device_s:
            t_s = self._clock.host_s(self._next_device_s)
            self._next_device_s += self._period_s
            self._skipped += 1
            if self.memory.skip != ON_REQUEST and self._skipped > self.memory.skip:
                self._message(t_s)

    def _message(self, t_s: float) -> None:
        """Sample at t_s and send it."""
        self._skipped = 0
        if not self.frozen or not self._last_data:
            self.counter = (self.counter + self.gap) % 2**16
            self.gap = 0
            self._last_data = encode(self._sample(t_s), self.memory.mode, self.memory.settings)
            self.counter = (self.counter + 1) % 2**16
        oriented = self.memory.mode & ORIENTATION
        ready_s = t_s + (LATENCY_S if oriented else CALIBRATED_LATENCY_S)
        if not self._hit(self.lost_rate) and self._line_free_s < ready_s + FULL_LINE_S:
            self._send(ready_s, mt.frame(MTDATA, self._last_data))

    def _sample(self, t_s: float) -> Sample:
        R_true, rate_radps, accel_mps2 = self._motion_at(t_s)
        noise = self._noise.standard_normal((4, 3))
        R = self._told(R_true @ rotation(self.angle_noise_rad * noise[0]))
        A = np.array(self.memory.alignment).reshape(3, 3) @ self._A
        rate = rate_radps + self.rate_bias_radps + self.rate_noise_radps * noise[1]
        accel = accel_mps2 + self.accel_bias_mps2 + self.accel_noise_mps2 * noise[2]
        magnetic = R_true.T @ self.earth_field + self.magnetic_noise * noise[3]
        bad = math.nan if self.nan else 0.0
        return Sample(
            R_earth_sensor=rotation_z(self.yaw_jump_rad) @ R + bad,
            rate_radps=A @ rate + bad,
            accel_mps2=A @ accel + bad,
            magnetic=A @ magnetic + bad,
            temperature_deg=self.temperature_deg + bad,
            analog=(0, 0),
            status=0x03 | (0x18 if t_s < self._still_until_s else 0),
            counter=self.counter,
        )
