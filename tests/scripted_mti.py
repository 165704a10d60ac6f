"""An MTi written out by hand for the session's tests, and a bench to put it on."""

import struct
from pathlib import Path

from core.records import Attitude
from fakes.wire import MemoryPort, Wire
from hw.mti_session import Mti

TICK_S, BAUD = 0.005, 115200
ROWS = [
    line.split("\t")
    for line in (Path(__file__).parent / "vectors/mti_frames.tsv").read_text().splitlines()
    if not line.startswith("#")
]


def wire(name: str, which: int = 0) -> bytes:
    """A frame of the sheet by name."""
    return [bytes.fromhex(row[2]) for row in ROWS if row[1] == name][which]


def framed(mid: int, data: bytes) -> bytes:
    body = bytes([0xFF, mid, len(data)]) + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


def configuration(tail_102: str) -> bytes:
    """The Configuration frame of section 8; bytes 102..109 are given."""
    data = bytes.fromhex("00300D2A 04800000") + bytes(88) + bytes.fromhex("0001 00300D2A")
    return framed(0x0D, data + bytes.fromhex(tail_102 + "0003 020601 330208"))


BEFORE, AFTER = configuration("0012 0004 00000001"), configuration("0032 0006 00000005")
CONVERSATION = [  # section 8
    (wire("GoToConfig"), wire("GoToConfigAck")),
    (wire("ReqDID"), wire("DeviceID")),
    (wire("ReqProductCode"), wire("ProductCode")),
    (wire("ReqFWRev"), wire("FirmwareRev")),
    (wire("ReqConfiguration"), BEFORE),
    (wire("SetOutputMode"), wire("SetOutputModeAck")),
    (wire("SetOutputSettings"), wire("SetOutputSettingsAck")),
    (wire("SetPeriod"), wire("SetPeriodAck")),
    (wire("SetOutputSkipFactor"), wire("SetOutputSkipFactorAck")),
    (wire("ReqOutputMode"), wire("OutputMode")),
    (wire("ReqOutputSettings"), wire("OutputSettings")),
    (wire("ReqPeriod"), wire("Period")),
    (wire("ReqConfiguration"), AFTER),
    (wire("GoToMeasurement"), wire("GoToMeasurementAck")),
]
NEW_REQUEST = framed(0xC0, bytes.fromhex("1020 FFFF 1060 FFFF 2010 0064 8020 0064"))
NEW_ANSWER = framed(0xC1, bytes.fromhex("1020 FFFF 1060 FFFF 2010 0064 8020 0064"))
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
    """Streams samples each 10 ms, stops for GoToConfig, answers from a table."""

    def __init__(self) -> None:
        self.answers: dict[bytes, bytes | None] = dict(CONVERSATION)
        self.heard: list[bytes] = []
        self.measuring, self.mute, self.deaf = True, False, False
        self.counter, self.first_s = 65530, 0.0
        self.burst_s = 0.0  # bytes are held back to multiples of it
        self.unasked = b""
        self._due_s, self._held = 0.0, b""
        self._released_s = 0.0

    def message(self) -> bytes:
        """A sample at roll 1.5, pitch -2.25, yaw 90 degrees."""
        data = wire("MTData 0006 00000005")[4:-3] + struct.pack(">H", self.counter)
        return framed(0x32, data)

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
            answer = self.answers.get(frame, NOT_IMPLEMENTED)
            if frame == wire("GoToConfig"):
                self.measuring = False
            if frame == wire("GoToMeasurement") and answer:
                self.measuring = True
            if frame == wire("WakeUpAck"):
                answer = None
            if frame == wire("ReqConfiguration") and wire("SetOutputMode") in self.heard:
                answer = AFTER
            sent += answer or b""
        self._held += b"" if self.mute else sent
        if self.burst_s and now_s - self._released_s < self.burst_s:
            return b""
        released, self._held, self._released_s = self._held, b"", now_s
        return released


class ScriptedNew(Scripted):
    """Knows no output mode; MTData2 with counter and time stamp."""

    def __init__(self) -> None:
        super().__init__()
        self.answers = {
            wire("GoToConfig"): wire("GoToConfigAck"),
            wire("ReqDID"): framed(0x01, bytes.fromhex("0368248C")),
            wire("ReqFWRev"): wire("FirmwareRev", 1),
            NEW_REQUEST: NEW_ANSWER,
            wire("GoToMeasurement"): wire("GoToMeasurementAck"),
        }
        self.ticks = 864_000_000 - 5000

    def message(self) -> bytes:
        self.ticks = (self.ticks + 100) % 864_000_000
        half = 0.5**0.5
        return framed(
            0x36,
            struct.pack(">HBH HBI", 0x1020, 2, self.counter, 0x1060, 4, self.ticks)
            + struct.pack(">HB4f", 0x2010, 16, half, 0.0, 0.0, half)
            + struct.pack(">HB3f", 0x8020, 12, 0.01, -0.02, 0.25),
        )


class Bench:
    """One device, one wire, one clock."""

    def __init__(self, device: Scripted) -> None:
        self.device, self.port, self.now_s = device, MemoryPort(), 0.0
        self.wire = Wire(device, self.port, seed=1)
        self.mti = Mti(self.port, rate_hz=100, baud=BAUD)
        self.attitudes: list[Attitude] = []
        self.arrivals_s: list[float] = []

    def state(self) -> str:
        return self.mti.status.state

    def run(self, seconds: float) -> list[Attitude]:
        """What was measured in that time."""
        begin = len(self.attitudes)
        for _ in range(round(seconds / TICK_S)):
            self.wire.step(self.now_s)
            new = self.mti.step(self.now_s)
            self.attitudes += new
            self.arrivals_s += [self.now_s] * len(new)
            self.now_s += TICK_S
        return self.attitudes[begin:]
