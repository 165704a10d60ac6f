"""Fake web camera beside a laser: MJPEG over HTTP on TCP, or on any stream in memory.

It exposes at its own pace whether anybody looks or not, and serves several hosts. A connection gets
one answer: images until one side goes, or a refusal.

Source: RFC 9112; RFC 2046. Its pace and its X-Timestamp are like mjpg-streamer's.
"""

import math
import random
from collections import deque

from fakes.stripe.camera import Camera, Sight
from fakes.stripe.faults import Faults
from fakes.stripe.http import MOST_REQUEST, head, part, refusal, status_of
from fakes.stripe.jpeg import damaged, jpeg_from_image
from fakes.wires.timing import Outbox

CLOCK_S = 1.7e9  # what the camera's clock shows when the host's shows 0
MOST_BEHIND_S = 0.9  # a device that was not looked at for longer has lost its oldest images


class Client:
    """One host's connection."""

    def __init__(self, device: "FakeStripe") -> None:
        self._device = device
        self.begin()

    def begin(self) -> None:
        self.is_watching = self.gone = self._has_ended = False
        self._received, self._outbox = b"", Outbox()
        self._is_answered = False

    def left(self, now_s: float) -> None:
        self._device.leave(self)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        device = self._device
        device.advance(now_s)
        self.gone = self._has_ended
        if not self._is_answered:
            self._received += received
            if b"\r\n\r\n" in self._received or len(self._received) > MOST_REQUEST:
                self._answer(now_s)
        if self.is_watching and device.gone:
            self._end()
        sent = self._outbox.take(now_s - device.late_s)
        return b"" if device.mute else sent

    def show(self, due_s: float, piece: bytes) -> None:
        self._outbox.put(due_s, piece)

    def _answer(self, now_s: float) -> None:
        device, self._is_answered = self._device, True
        status = device.refuse or (503 if device.gone else status_of(self._received, device.path))
        self._received = b""
        if status == 200:
            self.is_watching = True
            self._outbox.put(now_s, head())
        else:
            self._outbox.put(now_s, refusal(status))
            self._end()

    def _end(self) -> None:
        """Nothing more comes; the wire closes once what was said is out."""
        self.is_watching, self._has_ended = False, True


class FakeStripe(Faults):
    """One camera. Its faults and properties are attributes (`Faults`), to be set at any time.

    Args:
        sight: what rays from it meet.
    """

    max_clients = 4

    def __init__(self, sight: Sight, seed: int) -> None:
        super().__init__()
        self.camera = Camera(self, sight, seed)
        self._chance = random.Random(seed)
        self._only = Client(self)  # on a stream in memory
        self._clients = [self._only]
        self._next_s = -math.inf  # exposure
        self._jpegs: deque[bytes] = deque()  # newest last, whole: to be repeated
        self.exposed_s: deque[float] = deque(maxlen=64)  # instants of the newest images

    def connect(self, now_s: float) -> Client:
        client = Client(self)
        self._clients.append(client)
        return client

    def leave(self, client: Client) -> None:
        if client in self._clients:
            self._clients.remove(client)

    def reconnected(self, now_s: float) -> None:
        self._only.begin()

    def exchange(self, now_s: float, received: bytes) -> bytes:
        return self._only.exchange(now_s, received)

    def advance(self, now_s: float) -> float:
        """Expose all images that are due by an instant, which it gives back."""
        if now_s - self._next_s > MOST_BEHIND_S:
            self._next_s = now_s
        while self._next_s <= now_s:
            exposed_s = self._next_s
            self._next_s += 1.0 / self.rate_hz
            watching = [client for client in self._clients if client.is_watching]
            if watching and not self.gone:
                self._show(exposed_s, watching)
        return now_s

    def _show(self, exposed_s: float, watching: list[Client]) -> None:
        jpeg = self._next_jpeg(exposed_s)
        exposed_us = round((CLOCK_S + exposed_s) * 1e6) if self.tells_time else None
        piece = part(damaged(jpeg, self, self._chance), exposed_us, self.tells_length)
        delay_s = self.latency_s + self._chance.expovariate(1.0) * self.jitter_s
        for client in watching:
            client.show(exposed_s + delay_s, piece)

    def _next_jpeg(self, exposed_s: float) -> bytes:
        jpegs = self._jpegs
        if self.frozen and jpegs:
            return jpegs[-1]
        if self.repeated and len(jpegs) >= self.repeated:
            jpegs.rotate(-1)
            return jpegs[-1]
        jpegs.append(jpeg_from_image(self.camera.image(exposed_s), self))
        while len(jpegs) > max(1, self.repeated):
            jpegs.popleft()
        self.exposed_s.append(exposed_s)
        return jpegs[-1]
