"""MTi devices written out by hand for the session's tests, a slow encoder, and a bench."""

import struct
from dataclasses import dataclass
from typing import Generic, TypeVar

from core.records import Attitude
from fakes.mti.device import FakeMti
from fakes.wires.wire import MemoryPort, Wire
from hw.mti.session import Mti
from tests.support.mti_frames import configuration, framed, wire

TICK_S, BAUD = 0.005, 115200


@dataclass(frozen=True)
class Truth:
    """What a message is to say; numbers in the order of the wire."""

    temperature: float = 36.5
    accel: tuple[float, ...] = (0.12, -0.34, 9.81)
    rate: tuple[float, ...] = (0.01, -0.02, 0.25)
    magnetic: tuple[float, ...] = (0.45, -0.10, -0.89)
    orientation: tuple[float, ...] = (1.5, -2.25, 90.0)
    analog: tuple[int, int] = (0x0123, 0xFEDC)
    position: tuple[float, ...] = (57.6794, 11.8826, 81.7)
    velocity: tuple[float, ...] = (1.5, -0.25, 0.125)
    status: int = 3
    counter: int = 4660
    raw: bytes = bytes(range(20))
    gps: bytes = bytes(44)
    utc: bytes = bytes.fromhex("00000001 07DA 0102030405 01")


def slow_number(value: float, number_format: int) -> bytes:
    """By the words of section 3, one byte after the other."""
    if number_format == 0:
        return struct.pack(">f", value)
    if number_format == 3:
        return struct.pack(">d", value)
    if number_format == 1:
        return (round(value * 2**20) % 2**32).to_bytes(4, "big")
    b5, b4, b3, b2, b1, b0 = (round(value * 2**32) % 2**48).to_bytes(6, "big")
    return bytes([b3, b2, b1, b0, b5, b4])


def slow_mtdata(mode: int, settings: int, truth: Truth) -> bytes:
    """By the table of section 4, one row after the other."""
    numbers: list[float] = []
    data = truth.raw if mode & 0x4000 else b""
    data += truth.gps if mode & 0x1000 else b""
    processed = not mode & 0x4000
    if mode & 0x0001 and processed:
        numbers += [truth.temperature]
    if mode & 0x0002 and processed:
        numbers += [] if settings & 0x10 else truth.accel
        numbers += [] if settings & 0x20 else truth.rate
        numbers += [] if settings & 0x40 else truth.magnetic
    if mode & 0x0004 and processed:
        numbers += truth.orientation
    data += b"".join(slow_number(number, settings // 256 % 4) for number in numbers)
    if mode & 0x0008 and processed:
        data += b"" if settings & 0x400 else struct.pack(">H", truth.analog[0])
        data += b"" if settings & 0x800 else struct.pack(">H", truth.analog[1])
    numbers = []
    numbers += truth.position if mode & 0x0010 and processed else ()
    numbers += truth.velocity if mode & 0x0020 and processed else ()
    data += b"".join(slow_number(number, settings // 256 % 4) for number in numbers)
    data += bytes([truth.status]) if mode & 0x0800 else b""
    data += struct.pack(">H", truth.counter) if settings & 1 else b""
    return data + (truth.utc if settings & 2 else b"")


BEFORE, AFTER = configuration("0012 0004 00000001"), configuration("0032 0006 00000005")
IDENTITY = [  # section 8
    (wire("GoToConfig"), wire("GoToConfigAck")),
    (wire("ReqDID"), wire("DeviceID")),
    (wire("ReqProductCode"), wire("ProductCode")),
    (wire("ReqFWRev"), wire("FirmwareRev")),
]
CONVERSATION = [  # what differs from the wish is set, and read back
    *[request for request, _ in IDENTITY],
    wire("ReqConfiguration"),
    wire("ReqOutputMode"),
    wire("ReqPeriod"),
    wire("ReqOutputMode"),
    wire("SetOutputMode"),
    wire("ReqOutputMode"),
    wire("ReqOutputSettings"),
    wire("SetOutputSettings"),
    wire("ReqOutputSettings"),
    framed(0xD4),
    wire("ReqConfiguration"),
    wire("GoToMeasurement"),
]
NEW_OUTPUTS = bytes.fromhex("1020 FFFF 1060 FFFF 2010 0064 8020 0064 C020 0064")
NEW_REQUEST, NEW_READ = framed(0xC0, NEW_OUTPUTS), framed(0xC0)
NOT_IMPLEMENTED = wire("Error", 1)


def split(stream: bytes) -> list[bytes]:
    """Whole frames, as the host writes them."""
    frames = []
    while stream:
        size = stream[3] + 5
        frames.append(stream[:size])
        stream = stream[size:]
    return frames


class Scripted:
    """A legacy device. Streams samples each 10 ms, stops for GoToConfig, keeps registers."""

    def __init__(self) -> None:
        self.registers = {0xD0: "0004", 0xD2: "00000001", 0x04: "0480", 0xD4: "0000"}
        self.stubborn: dict[int, str] = {}  # what registers become whatever is written
        self.answers: dict[bytes, bytes | None] = dict(IDENTITY)  # before all else
        self.answers[wire("GoToMeasurement")] = wire("GoToMeasurementAck")
        self.heard: list[bytes] = []
        self.measuring, self.mute, self.deaf = True, False, False
        self.counter, self.first_s = 65530, 0.0
        self.unasked = b""
        self.truth = Truth()
        self._due_s = 0.0

    def message(self) -> bytes:
        """A sample at roll 1.5, pitch -2.25, yaw 90 degrees."""
        mode, settings = (int(self.registers[mid], 16) for mid in (0xD0, 0xD2))
        half = 0.5**0.5
        euler = settings >> 2 & 3 == 1
        truth = Truth(
            counter=self.counter, orientation=(1.5, -2.25, 90.0) if euler else (half, 0, 0, half)
        )
        return framed(0x32, slow_mtdata(mode, settings, truth))

    def answer(self, frame: bytes) -> bytes | None:
        """By the tables; Error 04 to what is not in them."""
        mid, data = frame[2], frame[4:-1]
        if frame in self.answers:
            return self.answers[frame]
        if mid == 0x0C:
            mode, settings = (int(self.registers[register], 16) for register in (0xD0, 0xD2))
            size = len(slow_mtdata(mode, settings, self.truth))
            return configuration(f"{size:04X}" + self.registers[0xD0] + self.registers[0xD2])
        if mid in self.registers and data:
            self.registers[mid] = self.stubborn.get(mid, data.hex())
            return framed(mid + 1)
        if mid in self.registers:
            return framed(mid + 1, bytes.fromhex(self.registers[mid]))
        return NOT_IMPLEMENTED

    def exchange(self, now_s: float, received: bytes) -> bytes:
        sent = self.unasked
        self.unasked = b""
        while self._due_s + 0.0073 <= now_s:  # 2.55 ms and 55 bytes after the sampling instant
            if self.measuring:
                sent += self.message()
                self.counter = (self.counter + 1) % 65536
            self._due_s += 0.01
        for frame in [] if self.deaf else split(received):
            self.heard.append(frame)
            if frame == wire("WakeUpAck"):
                self.measuring = False
                continue
            answer = self.answer(frame)
            if frame == wire("GoToConfig"):
                self.measuring = False
            if frame == wire("GoToMeasurement") and answer and answer[2:3] != b"\x42":
                self.measuring = True
            sent += answer or b""
        return b"" if self.mute else sent


class ScriptedNew(Scripted):
    """Knows no output mode; MTData2 with counter and time stamp."""

    device_id = "0368248C"

    def __init__(self) -> None:
        super().__init__()
        self.registers = {0xC0: ""}
        self.most_hz = 400  # by which the rates of a list are cut
        self.answers = {
            wire("GoToConfig"): wire("GoToConfigAck"),
            wire("ReqDID"): framed(0x01, bytes.fromhex(self.device_id)),
            wire("ReqFWRev"): wire("FirmwareRev", 1),
            wire("GoToMeasurement"): wire("GoToMeasurementAck"),
        }
        self.ticks = 864_000_000 - 5000

    def answer(self, frame: bytes) -> bytes | None:
        if frame[2] == 0x0C and frame not in self.answers:
            return configuration("0000 0000 00000000", self.device_id[-8:], "00000000")
        answer = super().answer(frame)
        if frame[2] == 0xC0 and len(frame) > 5 and answer == framed(0xC1):
            pairs = [struct.unpack(">HH", frame[i : i + 4]) for i in range(4, len(frame) - 1, 4)]
            taken = [
                (key, rate if key < 0x1100 else min(rate, self.most_hz)) for key, rate in pairs
            ]
            self.registers[0xC0] = b"".join(struct.pack(">HH", *pair) for pair in taken).hex()
            return framed(0xC1, bytes.fromhex(self.registers[0xC0]))
        return answer

    def message(self) -> bytes:
        self.ticks = (self.ticks + 100) % 864_000_000
        half = 0.5**0.5
        return framed(
            0x36,
            struct.pack(">HBH HBI", 0x1020, 2, self.counter, 0x1060, 4, self.ticks)
            + struct.pack(">HB4f", 0x2010, 16, half, 0.0, 0.0, half)
            + struct.pack(">HB3f", 0x8020, 12, 0.01, -0.02, 0.25),
        )


Device = TypeVar("Device", bound=Scripted | FakeMti)


class Bench(Generic[Device]):
    """One device, one wire, one clock."""

    def __init__(self, device: Device, rate_hz: float = 100, baud: int = BAUD) -> None:
        self.device, self.port, self.now_s = device, MemoryPort(), 0.0
        self.wire = Wire(device, self.port, seed=1)
        self.mti = Mti(self.port, rate_hz=rate_hz, baud=baud)

    def state(self) -> str:
        return self.mti.status.state

    def cause(self) -> str:
        return self.mti.status.cause

    def run(self, seconds: float) -> list[Attitude]:
        """What was measured in that time."""
        measured = []
        for _ in range(round(seconds / TICK_S)):
            self.wire.step(self.now_s)
            measured += self.mti.step(self.now_s)
            self.now_s += TICK_S
        return measured

    def run_until(self, state: str, at_most_s: float) -> bool:
        """Let time pass until the device is in that state."""
        for _ in range(round(at_most_s / TICK_S)):
            self.run(TICK_S)
            if self.state() == state:
                return True
        return False
