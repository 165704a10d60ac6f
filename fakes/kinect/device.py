"""Fake Kinect on a stream in memory, in the form in which the host reads it; or a data set of one.

The host gets an answer as of a web camera, each frame a part of it: raw values, millimetres, or
images in PNG behind what a camera.toml says.
Source: RFC 2046; W3C, Portable Network Graphics; kinect sheet, section 2.
"""

import math
import random
import struct
import zlib
from collections import deque

import numpy as np

from fakes.kinect.faults import Faults, Form
from fakes.kinect.sensing import E_CM, NO_RAW, P_CM, R_CM, SHIFT, U16, Lens, Picture, Sensor, Sight
from fakes.wires.timing import Outbox

MOST_BEHIND_S = 0.5  # a device that was not looked at for longer has lost its oldest frames
KINDS = {"raw": "depth/raw-11", "mm": "depth/mm", "png": ""}
WILD = 40_000


def mm_of_raw(raw: U16) -> U16:
    """Millimetres of raw values; 0: none."""
    m_cm = ((raw.astype(float) - 4.0 * SHIFT) / 4.0 - 0.375) * P_CM
    with np.errstate(divide="ignore", invalid="ignore"):
        mm = 10.0 * R_CM * E_CM / (E_CM - m_cm)
    is_good = (raw != NO_RAW) & (m_cm < E_CM) & (mm < 10_000.0)
    return np.where(is_good, mm, 0.0).astype(np.uint16)


def chunk(kind: bytes, body: bytes) -> bytes:
    """A piece of a PNG, with its length and checksum."""
    crc = zlib.crc32(kind + body)
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", crc)


def png_of(numbers: U16) -> bytes:
    """Grey, 16 bits a pixel; each row is told by what differs from the one above."""

    rows = numbers.astype(">u2").view(np.uint8).reshape(len(numbers), -1)
    told = np.diff(rows, axis=0, prepend=np.zeros((1, rows.shape[1]), np.uint8))
    filtered = np.concatenate([np.full((len(rows), 1), 2, np.uint8), told], axis=1)
    head = struct.pack(">IIBBBBB", numbers.shape[1], numbers.shape[0], 16, 0, 0, 0, 0)
    packed = zlib.compress(filtered.tobytes(), 1)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    )


def camera_toml(lens: Lens, times: float) -> bytes:
    """What is said of a lens whose focal lengths are told so many times too long."""
    fx, fy = (times * focal for focal in lens.focal_px)
    return (
        f"size_px = {list(lens.size_px)}\nfocal_px = [{fx}, {fy}]\n"
        f"centre_px = {list(lens.centre_px)}\nunits_per_m = 1000.0\n"
        'along = "axis"\nmirrored = false\n'
    ).encode()


def part(data: bytes, kind: str, stamp_s: float | None, number: int | None) -> bytes:
    told = ["--mapod-image", f"Content-Length: {len(data)}"]
    told += [f"Content-Type: {kind}"] if kind else []
    told += [f"X-Timestamp: {stamp_s:.6f}"] if stamp_s is not None else []
    told += [f"X-Number: {number}"] if number is not None else []
    return "".join(f"{line}\r\n" for line in told).encode() + b"\r\n" + data + b"\r\n"


class FakeKinect(Faults):
    """One camera. Its faults and properties are attributes (`Faults`), to be set at any time."""

    def __init__(
        self, sight: Sight, seed: int, form: Form = "raw", lens: Lens | None = None
    ) -> None:
        super().__init__()
        self.sensor = Sensor(self, lens or Lens(), sight, seed)
        self._form, self._chance = form, random.Random(seed)
        self.exposed_s: deque[float] = deque(maxlen=64)  # instants of the newest frames
        self.truth: Picture | None = None  # of the newest
        self.reconnected(-math.inf)

    def reconnected(self, now_s: float) -> None:
        self._outbox, self._next_s, self._number = Outbox(), math.nan, 0

    def exchange(self, now_s: float, received: bytes) -> bytes:
        if math.isnan(self._next_s):  # it begins by itself
            self._next_s = now_s
            self._outbox.put(now_s, self._begin())
        if now_s - self._next_s > MOST_BEHIND_S:
            self._next_s = now_s
        while self._next_s <= now_s:
            self._show(self._next_s)
            self._next_s += self.period_s
        sent = self._outbox.take(now_s)
        return b"" if self.mute else sent

    def _begin(self) -> bytes:
        head = (
            b"HTTP/1.0 200 OK\r\n"
            b"Content-Type: multipart/x-mixed-replace; boundary=mapod-image\r\n\r\n"
        )
        if self._form != "png" or self.no_camera:
            return head
        lens = camera_toml(self.sensor.lens, 10.0 if self.wrong_matrix else 1.0)
        return head + part(lens, "application/toml", None, None)

    def _show(self, exposed_s: float) -> None:
        if not self.frozen or self.truth is None:
            self.truth = self.sensor.picture(exposed_s)
            self.exposed_s.append(exposed_s)
        raw = self.truth.raw
        numbers = raw if self._form == "raw" else mm_of_raw(raw)
        numbers = numbers[::2, ::2] if self.small else numbers
        if self.wild:
            numbers = np.full_like(numbers, WILD)
        data = png_of(numbers) if self._form == "png" else numbers.astype("<u2").tobytes()
        due_s = exposed_s + self.latency_s
        stamp_s = None if self.untimed else due_s - self.stamp_late_s
        number = None if self.unnumbered else self._number
        self._number += 1
        self._outbox.put(due_s, self._damaged(part(data, KINDS[self._form], stamp_s, number)))

    def _damaged(self, piece: bytes) -> bytes:
        if self._chance.random() < self.cut_rate:
            return piece[: len(piece) // 2]
        if self._chance.random() < self.damaged_rate:
            bent = bytearray(piece)
            for _ in range(20):
                bent[self._chance.randrange(len(bent))] ^= 1 << self._chance.randrange(8)
            return bytes(bent)
        return piece
