"""A fake MTi that answers some requests as a test tells it, and a bench with mapod's session."""

import math

import numpy as np
import numpy.typing as npt

from core.records import Attitude
from fakes.mti.device import FakeMti
from fakes.mti.models import BAUDS
from fakes.wires.wire import MemoryPort, Wire
from hw.mti.session import Mti
from tests.support.devices.mti_frames import framed, wire

F64 = npt.NDArray[np.float64]
TICK_S, BAUD, YAW_RADPS = 0.005, 115200, 0.5
GREETING = [wire(name) for name in ("GoToConfig", "ReqDID", "ReqProductCode", "ReqFWRev")]
CONVERSATION = [  # section 8: what differs from the wish is set, and read back
    *GREETING,
    *map(wire, ("ReqConfiguration", "ReqOutputMode", "ReqPeriod")),
    *map(wire, ("ReqOutputMode", "SetOutputMode", "ReqOutputMode")),
    *map(wire, ("ReqOutputSettings", "SetOutputSettings", "ReqOutputSettings")),
    framed(0xD4),
    *map(wire, ("ReqConfiguration", "GoToMeasurement")),
]
NEW_OUTPUTS = bytes.fromhex("1020 FFFF 1060 FFFF 2010 0064 8020 0064 C020 0064")
NEW_REQUEST, NEW_READ = framed(0xC0, NEW_OUTPUTS), framed(0xC0)
NEW_CONVERSATION = [
    *(*GREETING, framed(0x1E), wire("ReqConfiguration")),
    *(NEW_READ, NEW_REQUEST, NEW_READ, wire("GoToMeasurement")),
]


def rotation(axis: int, angle_rad: float) -> F64:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    R = np.eye(3)
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


def motion_at(t_s: float) -> tuple[F64, F64, F64]:
    """Turning left on a slope, nose 4 degrees down, right side 2 degrees down."""
    R = rotation(2, YAW_RADPS * t_s) @ rotation(1, math.radians(4)) @ rotation(0, math.radians(2))
    return R, R.T @ np.array([0.0, 0.0, YAW_RADPS]), R.T @ np.array([0.0, 0.0, 9.81])


class Scripted(FakeMti):
    """A noiseless sensor, which takes no notice itself of the requests that are in `answers`."""

    def __init__(self, model: str = "MTi-28") -> None:
        super().__init__(motion_at, seed=1, model=model)
        self.angle_noise_rad = self.rate_noise_radps = 0.0
        self.answers: dict[bytes, bytes | None] = {}
        self.unasked = b""  # what it says next of its own accord
        self.heard: list[bytes] = []

    def settings_heard(self) -> list[bytes]:
        return [request for request in self.heard if len(request) > 5]

    def exchange(self, now_s: float, received: bytes) -> bytes:
        said, self.unasked, passed = self.unasked, b"", b""
        while received:
            request, received = received[: received[3] + 5], received[received[3] + 5 :]
            self.heard.append(request)
            if request in self.answers:
                said += self.answers[request] or b""
            else:
                passed += request
        if said:
            self._line.send(now_s, said)
        return super().exchange(now_s, passed)


class Bench:
    """One device, one wire, one clock."""

    def __init__(self, device: Scripted, rate_hz: float = 100, baud: int = BAUD) -> None:
        self.device, self.port, self.now_s = device, MemoryPort(), 0.0
        device.baud = baud
        device.memory.baud_code = next(code for code, rate in BAUDS.items() if rate == baud)
        self.wire = Wire(device, self.port, seed=1)
        self.mti = Mti(self.port, rate_hz=rate_hz, baud=baud)

    def state(self) -> str:
        return self.mti.status.state

    def cause(self) -> str:
        return self.mti.status.cause

    def run(self, seconds: float) -> list[Attitude]:
        measured = []
        for _ in range(round(seconds / TICK_S)):
            self.wire.step(self.now_s)
            measured += self.mti.step(self.now_s)
            self.now_s += TICK_S
        return measured

    def run_until(self, state: str, at_most_s: float) -> bool:
        until_s = self.now_s + at_most_s
        while self.state() != state and self.now_s < until_s:
            self.run(TICK_S)
        return self.state() == state

    def reconnect(self) -> None:
        """The wire is cut for so long that the session starts anew."""
        self.wire.cut = True
        self.run(0.1)
        self.wire.cut = False
