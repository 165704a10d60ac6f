"""One run of the planner link on a simulated line: mapod's sender, the drive, a receiver.

Source: planner link, sections 5, 6 and 11.
"""

import math
import random
import time
from collections import deque
from dataclasses import dataclass

import numpy as np

from core.records import F64, ObstacleMap, PoseReport, StopZoneReport
from hw.planner_link.receivers import one_link
from hw.planner_link.sender import PlannerLink
from mapod_link.frames import MORE, frame_from_bytes
from mapod_link.receiver import Receiver
from mapod_link.serial_line import maybe_bytes_from_cobs, serial_from_frame
from tools.bench.drive import CELL_M, Playback, RandomMap, drive
from tools.bench.link_meter import Meter, View

BITS = 10  # of a byte on the line
TTY_BYTES = 4096  # that a driver takes before it says that it is full
DRIVE_S = 40.0
START_S, SETTLE_S = 1000.0, 1.0  # of the simulated clock; before anything counts
DELAY_S, LOSS = 0.010, 0.01
NEVER = 10**9  # frames
NONE = float("nan")
ZONE = StopZoneReport(2.0, 2.5, 1.0, 1.5, 3.0, 0.8, 0.3, 0.9, 0.5, (2.5,) * 8, state=2, causes=1)


@dataclass(frozen=True, slots=True)
class Arrival:
    """One frame at the far end, or the instant at which it should have been there."""

    at_s: float
    frame: bytes  # without COBS
    is_lost: bool


class Lane:
    """One direction of the line."""

    def __init__(self, baud: int | None, delay_s: float, loss: float, seed: int) -> None:
        self.baud, self.delay_s, self.loss = baud, delay_s, loss
        self.bytes_sent = 0
        self._random = random.Random(seed)
        self._free_s = -math.inf  # when the line has sent what it was given
        self._way: deque[Arrival] = deque()

    def send(self, now_s: float, data: bytes) -> None:
        if self.baud is None:
            self._carry(now_s, data, len(data))
            return
        for piece in data.split(b"\0")[:-1]:
            frame = maybe_bytes_from_cobs(piece)
            assert frame is not None, "what the sender writes is COBS"
            self._carry(now_s, frame, len(piece) + 1)

    def _carry(self, now_s: float, frame: bytes, wire_bytes: int) -> None:
        self.bytes_sent += wire_bytes
        busy_s = 0.0 if self.baud is None else wire_bytes * BITS / self.baud
        self._free_s = max(now_s, self._free_s) + busy_s
        if frame:
            is_lost = self._random.random() < self.loss
            self._way.append(Arrival(self._free_s + self.delay_s, frame, is_lost))

    def waiting_s(self, now_s: float) -> float:
        return max(0.0, self._free_s - now_s)

    def arrivals(self, until_s: float) -> list[Arrival]:
        """What has come, or got lost, since the last call; in order."""
        come = []
        while self._way and self._way[0].at_s <= until_s:
            come.append(self._way.popleft())
        return come


class LinePort:
    """The sender's port on a simulated line (`hw.device.Port`); its owner sets `now_s`."""

    def __init__(self, to_receiver: Lane, to_sender: Lane, buffer_bytes: int = TTY_BYTES) -> None:
        self.datagrams = to_receiver.baud is None
        self.cause, self.opened, self.now_s = "", 1, 0.0
        self._out, self._in, self._buffer_bytes = to_receiver, to_sender, buffer_bytes

    @property
    def backlog(self) -> int:
        """Bytes that the driver's buffer has no room for."""
        if self._out.baud is None:
            return 0
        waiting = math.ceil(self._out.waiting_s(self.now_s) * self._out.baud / BITS - 1e-6)
        return max(0, waiting - self._buffer_bytes)

    @backlog.setter
    def backlog(self, waiting: int) -> None:
        """The line alone decides."""

    def fileno(self) -> int:
        return -1

    def poll(self, now_s: float) -> bool:
        return True

    def read(self) -> list[bytes]:
        come = [arrival.frame for arrival in self._in.arrivals(self.now_s) if not arrival.is_lost]
        return come if self.datagrams else [serial_from_frame(frame) for frame in come]

    def write(self, data: bytes) -> None:
        self._out.send(self.now_s, data)

    def close(self) -> None:
        """Nothing to let go of."""


@dataclass(frozen=True, slots=True)
class Case:
    """One line, one rate, one window."""

    baud: int | None  # None: UDP
    rate_hz: int
    ack: str  # "tick", "10 Hz" or "none"
    size: int = 201
    drives: bool = True  # False: a map that changes at random, and fills a slow line
    loss: float = LOSS
    seconds: float = DRIVE_S
    seed: int = 1  # which frames get lost

    @property
    def line(self) -> str:
        return f"{self.baud // 100 / 10:g} k" if self.baud else "UDP"


@dataclass(frozen=True, slots=True)
class Figures:
    """What came out of a case; times in milliseconds: p50, p99, worst."""

    told_ms: tuple[float, float, float]  # new obstacle, from its tick to the tick that told it
    held_ms: tuple[float, float, float]  # new obstacle, until it had arrived: line and delay
    recovery_ms: tuple[float, float, float]
    pass_s: float  # one refresh pass; NaN: none ended
    suspect: float  # share of time
    bytes_per_s: float
    worst_wait_ticks: float  # of line time not yet sent when a tick begins
    ticks_held: int  # in which nothing could be sent
    new_obstacles: int
    recovered: int  # cells that a loss had hit
    unsafe: int  # FREE at the receiver where it was told of an OBSTACLE, suspect clear


class FarEnd:
    """The receiver on its end of the line."""

    def __init__(self, ack: str, nonce: int) -> None:
        self._ack = ack
        has_way_back = ack != "none"
        self.receiver = Receiver(nonce * has_way_back, ack_every=NEVER * has_way_back)

    def take(self, at_s: float, data: bytes, is_last_of_tick: bool) -> list[bytes]:
        self.receiver.feed_datagram(at_s, data)
        if self._ack == "tick" and is_last_of_tick:
            self.receiver.acknowledge(at_s)
        return self.receiver.poll(at_s)

    def view(self) -> View:
        return View(self.receiver.cells, self.receiver.origin, self.receiver.suspect)


def new_link(port: LinePort, baud: int | None, size: int, rate_hz: float) -> PlannerLink:
    return one_link(
        port,
        size=size,
        cell_mm=round(CELL_M * 1000),
        session=77,
        tick_s=1 / rate_hz,
        line_baud=baud,
        key=None,
        stale_ms=max(150, round(3000 / rate_hz)),
        drive_refusal="nobody drives here",
    )


def step(link: PlannerLink, now_s: float, pose: PoseReport, window: ObstacleMap) -> float:
    """One tick of the sender; seconds of computing."""
    begun_s = time.perf_counter()
    link.step(now_s, pose, window, ZONE)
    return time.perf_counter() - begun_s


class Run:
    """One drive of a case on the simulated clock."""

    def __init__(self, case: Case) -> None:
        seed = case.seed
        self.case, self.tick_s = case, 1 / case.rate_hz
        self.down = Lane(case.baud, DELAY_S, case.loss, 2 * seed)
        self.up = Lane(case.baud, DELAY_S, case.loss, 2 * seed + 1)
        self.port = LinePort(self.down, self.up)
        self.link = new_link(self.port, case.baud, case.size, case.rate_hz)
        self.far, self.meter = FarEnd(case.ack, seed), Meter(case.size)
        self._playback = (
            Playback(drive(case.size, case.seconds)) if case.drives else RandomMap(case.size, seed)
        )
        self.waits_s: list[float] = []
        self.bytes_sent = 0  # since things count

    def go(self) -> None:
        settled = round(SETTLE_S * self.case.rate_hz)
        before = 0
        for tick in range(round(self.case.seconds * self.case.rate_hz)):
            if tick == settled:
                self.meter.begin(START_S + tick * self.tick_s)
                before = self.down.bytes_sent
            self._tick(START_S + tick * self.tick_s, tick * self.tick_s)
        self.bytes_sent = self.down.bytes_sent - before
        self.meter.end(START_S + self.case.seconds)

    def _tick(self, now_s: float, drive_s: float) -> None:
        self._carry(now_s)
        self.port.now_s = now_s
        self.waits_s.append(self.down.waiting_s(now_s))
        window = self._playback.until(drive_s)
        self.meter.mean(now_s, window)
        step(self.link, now_s, self._playback.pose, window)

    def _carry(self, until_s: float) -> None:
        for arrival in self.down.arrivals(until_s):
            frame = frame_from_bytes(arrival.frame)
            assert not isinstance(frame, str), "the sender's frames are valid"
            if arrival.is_lost:
                self.meter.lose(arrival.at_s, frame, self.far.view())
                continue
            is_last = not frame.flags & MORE
            for answer in self.far.take(arrival.at_s, arrival.frame, is_last):
                data = answer if self.case.baud is None else serial_from_frame(answer)
                self.up.send(arrival.at_s, data)
            self.meter.take(arrival.at_s, frame.t_ms / 1000, frame, self.far.view())


def measure(case: Case) -> Figures:
    run = Run(case)
    run.go()
    got, watched_s = run.meter.readings, case.seconds - SETTLE_S
    told_s, recovered_s = joined(got.told_s), joined(got.recovered_s)
    return Figures(
        told_ms=_spread_ms(told_s),
        held_ms=_spread_ms(joined(got.held_s)),
        recovery_ms=_spread_ms(recovered_s),
        pass_s=float(np.mean(got.passes_s)) if got.passes_s else NONE,
        suspect=got.suspect_s / watched_s,
        bytes_per_s=run.bytes_sent / watched_s,
        worst_wait_ticks=max(run.waits_s) / run.tick_s,
        ticks_held=run.link.counters.ticks_held,
        new_obstacles=told_s.size,
        recovered=recovered_s.size,
        unsafe=got.unsafe,
    )


def joined(parts: list[F64]) -> F64:
    return np.concatenate([np.zeros(0), *parts])


def _spread_ms(times_s: F64) -> tuple[float, float, float]:
    """Median, p99 and worst; NaN of nothing."""
    if times_s.size == 0:
        return NONE, NONE, NONE
    p50, p99 = np.quantile(times_s, [0.5, 0.99])
    return 1000 * float(p50), 1000 * float(p99), 1000 * float(times_s.max())
