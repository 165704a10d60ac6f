"""A fake MTi and a host that writes frames and looks at what came back; frames of the sheet."""

import math
import struct
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fakes.mti.device import FakeMti
from tests.support.devices.mti_frames import framed, wire

F64 = npt.NDArray[np.float64]
START_S = 200.0
RATE_RADPS, ACCEL_MPS2 = (0.01, -0.02, 0.25), (0.12, -0.34, 9.81)


def split(stream: bytes) -> tuple[list[tuple[int, bytes]], bytes]:
    """(mid, data) of whole messages, and what begins the next one; fails on anything else."""
    found = []
    while len(stream) >= 5:
        assert stream[:2] == b"\xfa\xff"
        head, size = (6, int.from_bytes(stream[4:6], "big")) if stream[3] == 255 else (4, stream[3])
        if len(stream) < head + size + 1:
            break
        found.append((stream[2], stream[head : head + size]))
        assert stream.startswith(framed(*found[-1]))
        stream = stream[head + size + 1 :]
    return found, stream


def frames(stream: bytes) -> list[tuple[int, bytes]]:
    found, rest = split(stream)
    assert not rest
    return found


def numbers(data: bytes, number_format: int) -> list[float]:
    if number_format in (0, 3):
        size = 4 if number_format == 0 else 8
        return list(struct.unpack(f">{len(data) // size}{'fd'[size // 8]}", data))
    if number_format == 1:
        return [n / 2**20 for n in struct.unpack(f">{len(data) // 4}i", data)]
    return [whole + fraction / 2**32 for fraction, whole in struct.iter_unpack(">Ih", data)]


def messages(heard: list[tuple[int, bytes]]) -> list[bytes]:
    return [data for mid, data in heard if mid == 0x32]


def counters(data: list[bytes]) -> list[int]:
    return [int.from_bytes(message[-2:], "big") for message in data]


def turned(roll_deg: float, pitch_deg: float, yaw_deg: float) -> F64:
    """R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = (
        [f(math.radians(angle)) for angle in (roll_deg, pitch_deg, yaw_deg)]
        for f in (math.sin, math.cos)
    )
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(yaw @ pitch @ roll, dtype=np.float64)


def rotated(q: Sequence[float]) -> F64:
    """The matrix of a quaternion, by turning each axis."""
    w, v = q[0], np.array(q[1:])
    axes = [a + 2 * w * np.cross(v, a) + 2 * np.cross(v, np.cross(v, a)) for a in np.eye(3)]
    return np.array(axes).T


class Bench:
    """A noiseless fake in a constant pose, turning at a constant rate all the same."""

    def __init__(self, *angles_deg: float, model: str = "MTi-28") -> None:
        self.R = turned(*(angles_deg or (1.5, -2.25, 90.0)))
        self.sampled_s: list[float] = []
        self.fake = FakeMti(self.motion_at, seed=5, model=model)
        self.fake.angle_noise_rad = self.fake.rate_noise_radps = 0.0
        self.fake.accel_noise_mps2 = self.fake.magnetic_noise = 0.0
        self.fake.earth_field = self.R @ np.array([0.45, -0.10, -0.89])
        self.now_s = START_S
        self.fake.exchange(self.now_s, b"")

    def motion_at(self, t_s: float) -> tuple[F64, F64, F64]:
        self.sampled_s.append(t_s)
        return self.R, np.array(RATE_RADPS), np.array(ACCEL_MPS2)

    def write(self, request: bytes, wait_s: float = 0.05) -> bytes:
        """What comes within wait_s of a request."""
        sent = self.fake.exchange(self.now_s, request)
        self.now_s += wait_s
        return sent + self.fake.exchange(self.now_s, b"")

    def listen(self, seconds: float, step_s: float = 0.005) -> list[tuple[int, bytes]]:
        """What comes, as (mid, data); a message on the way at the end is waited for."""
        stream = b"".join(data for _, data in self.pieces(seconds, step_s))
        while split(stream)[1]:
            self.now_s += 0.0001
            stream += self.fake.exchange(self.now_s, b"")
        return frames(stream)

    def pieces(self, seconds: float, step_s: float) -> list[tuple[float, bytes]]:
        found = []
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            found.append((self.now_s, self.fake.exchange(self.now_s, b"")))
        return [(when_s, data) for when_s, data in found if data]

    def configure(self, *requests: bytes) -> None:
        """Into Config state, settings, and measuring again."""
        self.write(wire("GoToConfig"))
        for request in requests:
            assert frames(self.write(request))[0][0] == request[2] + 1
        assert self.write(wire("GoToMeasurement"), 0.002) == wire("GoToMeasurementAck")
