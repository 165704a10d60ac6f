"""Fake SICK Visionary camera: a T Mini, an S or an old T, on two TCP ports or streams in memory.

`control` and `stream` are its ports, each for a wire of its own; faults and properties are its own
attributes (`Faults`), to be set at any time. It exposes at its own pace while it plays. A session
of CoLa-2 outlives its connection until it is idle for too long.

Source: visionary sheet.
"""

import math
import random
from collections import deque

from fakes.visionary.access import Challenges
from fakes.visionary.control import Desk, Host, Memory
from fakes.visionary.faults import Faults
from fakes.visionary.frames import binary, damaged, description, message
from fakes.visionary.lens import Lens, lens_of
from fakes.visionary.models import KINDS, Model
from fakes.visionary.picture import Camera, Maps, Sight
from fakes.wires.timing import Outbox, Quartz

CLOCK_S = 1.79e9  # what its calendar shows, seconds since 1970, when it is switched on
MOST_BEHIND = 2  # frames: a device that was not looked at for longer has lost its oldest ones
BOOT_S = 2.0


class Guest:
    """One connection to one of the two ports."""

    def __init__(self, device: "FakeVisionary", maybe_host: Host | None) -> None:
        self._device, self._maybe_host = device, maybe_host
        self._outbox, self.gone = Outbox(), False

    def begin(self, now_s: float) -> None:
        self._outbox.clear()
        self.gone = False
        if self._maybe_host is not None:
            self._maybe_host.begin(now_s)

    def left(self, now_s: float) -> None:
        if self._maybe_host is not None:
            self._maybe_host.end()
        self._device.leave(self)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        device = self._device
        device.advance(now_s)
        if device.is_off(now_s):
            self.gone = True
            self._outbox.clear()
            return b""
        if self._maybe_host is not None:
            sent = self._maybe_host.heard(now_s, received)
            return b"" if device.mute or device.mute_control else sent
        sent = self._outbox.take(now_s)
        return b"" if device.mute or device.mute_stream else sent

    def show(self, due_s: float, piece: bytes) -> None:
        self._outbox.put(due_s, piece)


class Door:
    """One of its ports, as wires want it: several guests, or one in memory."""

    def __init__(self, device: "FakeVisionary", is_control: bool) -> None:
        self._device, self._is_control = device, is_control
        self.max_clients = 4
        self.backlog = 16 << 20  # bytes that it keeps for a host that is slow
        self.only = self._new()

    def _new(self) -> Guest:
        desk = self._device.desk
        return Guest(self._device, Host(desk) if self._is_control else None)

    def connect(self, now_s: float) -> Guest:
        guest = self._new()
        guest.begin(now_s)
        self._device.enter(guest, self._is_control)
        return guest

    def reconnected(self, now_s: float) -> None:
        self.only.begin(now_s)
        self._device.enter(self.only, self._is_control)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        return self.only.exchange(now_s, received)


class FakeVisionary(Faults):
    """One camera.

    Args:
        sight: what rays from it meet.
    """

    def __init__(self, model: Model, sight: Sight, seed: int) -> None:
        super().__init__(model)
        self.clock_ahead_s = 0.0  # by which its calendar was set: it jumps
        self._kind = KINDS[model]
        self.camera = Camera(self, self._kind, sight, seed)
        self._chance, self._quartz = random.Random(seed), Quartz()
        self.memory = Memory(self._kind, self)
        self.desk = Desk(self._kind, self, self.memory, self, self._new_challenges)
        self._watchers: list[Guest] = []
        self._next_s, self._is_playing, self._booted_s = -math.inf, False, -math.inf
        self._number, self._change, self._due_s = 0, 0, -math.inf
        self._xml = b""
        self._maps_of: tuple[Lens, Maps] | None = None  # the newest picture
        self.exposed_s: deque[float] = deque(maxlen=64)  # instants of the newest pictures
        self.truth: Maps | None = None  # of the newest
        self.control, self.stream = Door(self, True), Door(self, False)

    def warm(self) -> None:
        """Compile the kernels of a picture, so that no frame is late by that."""
        self.camera.maps(0.0, lens_of(self._kind, self.memory.halvings))

    def _new_challenges(self) -> Challenges:
        return Challenges(self._chance)

    def enter(self, guest: Guest, is_control: bool) -> None:
        if not is_control and guest not in self._watchers:
            self._watchers.append(guest)

    def leave(self, guest: Guest) -> None:
        if guest in self._watchers:
            self._watchers.remove(guest)

    def reboot(self, now_s: float) -> None:
        """It begins anew: numbers, sessions, what it was told; settings stay."""
        self._booted_s, self._number, self._change = now_s + BOOT_S, 0, 0
        self._is_playing, self._xml = False, b""
        self.desk.sessions.clear()

    def skip(self, frames: int) -> None:
        """So many of what it captures are never sent."""
        self._number += frames

    def is_off(self, now_s: float) -> bool:
        return self.gone or now_s < self._booted_s

    @property
    def is_playing(self) -> bool:
        return self._is_playing

    def play(self, now_s: float) -> None:
        """A host starts it."""
        if not self._is_playing:
            self._next_s = now_s
        self._is_playing = True

    def halt(self) -> None:
        """A host stops it."""
        self._is_playing = False

    def play_one(self, now_s: float) -> None:
        """A host asks for one frame: nothing, if that is sooner than a period after the last."""
        if not self._is_playing and now_s >= self._next_s:
            self._next_s = now_s + self.memory.period_s
            self._show(now_s)

    def advance(self, now_s: float) -> float:
        """Expose all frames that are due by an instant, which it gives back."""
        self._quartz.follow(now_s, self.drift_ppm)
        if not self._is_playing or self.is_off(now_s) or self.desk.is_occupied:
            return now_s
        period_s = self.memory.period_s
        behind = math.floor((now_s - self._next_s) / period_s) - MOST_BEHIND
        if behind > 0:
            self._next_s += behind * period_s
            self.skip(behind)
        while self._next_s <= now_s:
            exposed_s, self._next_s = self._next_s, self._next_s + period_s
            self._show(exposed_s)
        return now_s

    def _show(self, exposed_s: float) -> None:
        number = self._number
        self._number += 0 if self.same_number else 1
        if not self._watchers:
            return
        lens = lens_of(self._kind, self.memory.halvings)
        if not self.frozen or self._maps_of is None or self._maps_of[0] != lens:
            self._maps_of = lens, self.camera.maps(exposed_s, lens)
            self.exposed_s.append(exposed_s)
        maps = self.truth = self._maps_of[1]
        xml = description(self._kind, lens, self)
        if xml != self._xml:
            self._change += 0 if self.changes_silently and self._change else 1
            self._xml = xml
        shown_s = self._quartz.device_s + (exposed_s - self._quartz.host_s(self._quartz.device_s))
        calendar_s = CLOCK_S + shown_s + self.clock_ahead_s
        depths = binary(maps, self._kind, self, calendar_s, number)
        piece = damaged(message(xml, self._change, depths, int(self.segments)), self, self._chance)
        late_s = self.latency_s + self._chance.expovariate(1.0) * self.jitter_s
        due_s = self._due_s = max(self._due_s, exposed_s + late_s)  # frames stay in order
        for guest in self._watchers:
            guest.show(due_s, piece)
