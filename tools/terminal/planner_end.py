"""A planner's end on a real wire, with a meter; and a pty that is as slow as a serial line.

Used by the live viewer and the demo. No call waits longer than it is told to.
"""

import contextlib
import math
import os
import secrets
import time
import tty
from collections import deque
from dataclasses import dataclass

import numpy as np

from mapod_link.bodies import Pose
from mapod_link.client import Link
from mapod_link.frames import MAP, POSE, Frame
from mapod_link.receiver import Receiver
from mapod_link.wires import StreamWire, Wire

RATE_WINDOW_S = 2.0
ACK_EVERY = 4  # frames: two ticks
BIN_MS, BINS = 0.1, 20_000  # delays up to two seconds
PTY_BURST_S = 0.02  # so much of a line's time may be taken at once after a pause of ours
FASTEST_S = 30.0
SAME_SCAN_MS = 6.0
SAME_CLOCK_MS = (-5.0, 2000.0)  # a first delay within this: sender and viewer share a clock


@dataclass(frozen=True, slots=True)
class Heard:
    """One accepted frame."""

    arrived_s: float
    type: int
    t_ms: int
    size: int  # bytes, before COBS


class WatchingReceiver(Receiver):
    """A receiver that keeps what a meter wants to know of the newest frames."""

    def __init__(self, key: bytes | None = None) -> None:
        super().__init__(secrets.randbelow(2**32 - 1) + 1, key=key, ack_every=ACK_EVERY)
        self.heard: deque[Heard] = deque(maxlen=4096)

    def note(self, now_s: float, frame: Frame) -> None:
        super().note(now_s, frame)
        self.heard.append(Heard(now_s, frame.type, frame.t_ms, frame.size))


class Delays:
    """A histogram of milliseconds: a run of any length takes the same memory."""

    def __init__(self) -> None:
        self._counts = np.zeros(BINS, np.int64)

    def add(self, delay_ms: float) -> None:
        """One delay; what lies outside counts as the nearest that fits."""
        self._counts[min(max(int(delay_ms / BIN_MS), 0), BINS - 1)] += 1

    def quantile_ms(self, part: float) -> float:
        """NaN while empty."""
        total = int(self._counts.sum())
        if total == 0:
            return math.nan
        rank = max(1, math.ceil(part * total))
        return float(np.searchsorted(np.cumsum(self._counts), rank)) * BIN_MS


class Meter:
    """Rates over the last two seconds, delays over the whole run, from the accepted frames.

    Where sender and viewer do not share a clock, delays are those above the fastest of the last
    minute: a longer one would measure how the clocks drift apart.
    """

    def __init__(self) -> None:
        self.link, self.scan = Delays(), Delays()  # tick to arrival; scan to arrival
        self.link_ms = self.scan_ms = math.nan  # newest
        self.frames = self.bytes = 0
        self.first_s = math.nan
        self.same_clock = True
        self._fastest_ms = (math.inf, math.inf)  # of the half-minute before, and of this one
        self._fastest_until_s = -math.inf
        self._recent: deque[Heard] = deque()
        self._pose_t_ms = -1
        self._scans_s: deque[float] = deque()  # when a pose told first of a newer scan
        self._scan_t_ms = 0.0

    def take(self, now_s: float, planner: WatchingReceiver) -> None:
        while planner.heard:
            heard = planner.heard.popleft()
            self.first_s = heard.arrived_s if self.frames == 0 else self.first_s
            self.frames, self.bytes = self.frames + 1, self.bytes + heard.size
            self._recent.append(heard)
            if heard.type == MAP:
                self.link_ms = self._delay_ms(heard.arrived_s, heard.t_ms)
                self.link.add(self.link_ms)
        while self._recent and self._recent[0].arrived_s < now_s - RATE_WINDOW_S:
            self._recent.popleft()
        pose = planner.pose
        if pose is not None and pose.t_ms != self._pose_t_ms:
            self._pose_t_ms = pose.t_ms
            age_ms = pose.age_scan_s * 1000 + self._delay_ms(pose.arrived_s, pose.t_ms)
            if math.isfinite(age_ms):
                self.scan_ms = age_ms
                self.scan.add(age_ms)
                self._count_scan(pose)

    def _count_scan(self, pose: Pose) -> None:
        """A scan's instant is told to 4 ms: what differs by less is the same scan."""
        scan_t_ms = pose.t_ms - pose.age_scan_s * 1000
        if abs(scan_t_ms - self._scan_t_ms) > SAME_SCAN_MS:
            self._scan_t_ms = scan_t_ms
            self._scans_s.append(pose.arrived_s)

    def rates(self, now_s: float) -> tuple[float, float, float]:
        """Maps, however many frames each took, poses and bytes a second."""
        span_s = min(RATE_WINDOW_S, now_s - self.first_s) if self.frames else 0.0
        if span_s <= 0.0:
            return 0.0, 0.0, 0.0
        maps = len({heard.t_ms for heard in self._recent if heard.type == MAP})  # one a tick
        poses = sum(heard.type == POSE for heard in self._recent)
        return maps / span_s, poses / span_s, sum(heard.size for heard in self._recent) / span_s

    def scan_hz(self, now_s: float) -> float:
        """How often a pose has told of a newer scan, over the last two seconds."""
        while self._scans_s and self._scans_s[0] < now_s - RATE_WINDOW_S:
            self._scans_s.popleft()
        span_s = min(RATE_WINDOW_S, now_s - self.first_s) if self.frames else 0.0
        return len(self._scans_s) / span_s if span_s > 0.0 else 0.0

    def recent_ms(self) -> dict[str, float] | None:
        """Median and 99th percentile of the maps' delays of the last two seconds."""
        maps = [heard for heard in self._recent if heard.type == MAP]
        if not maps:
            return None
        delays = sorted(self._delay_ms(heard.arrived_s, heard.t_ms) for heard in maps)
        p50, p99 = (delays[math.ceil(part * len(delays)) - 1] for part in (0.5, 0.99))
        return {"p50": p50, "p99": p99}

    def _delay_ms(self, arrived_s: float, t_ms: int) -> float:
        """The sender's milliseconds wrap at 2^32."""
        arrived_ms = arrived_s * 1000
        whole = math.floor(arrived_ms)
        delay_ms = (whole - t_ms + 2**31) % 2**32 - 2**31 + (arrived_ms - whole)
        if min(self._fastest_ms) == math.inf:
            self.same_clock = SAME_CLOCK_MS[0] <= delay_ms <= SAME_CLOCK_MS[1]
        if arrived_s > self._fastest_until_s:
            self._fastest_ms = self._fastest_ms[1], math.inf
            self._fastest_until_s = arrived_s + FASTEST_S
        before_ms, fastest_ms = self._fastest_ms
        self._fastest_ms = before_ms, min(fastest_ms, delay_ms)
        return delay_ms if self.same_clock else delay_ms - min(self._fastest_ms)


class PtyWire(StreamWire):
    """Our end of a pty whose other end a sender opens as a serial line; as slow as one.

    A pty has no baud rate: bytes are taken only as fast as the line would carry them.
    """

    def __init__(self, baud: int) -> None:
        master, self._slave = os.openpty()  # the slave stays open: no hang-up between users
        tty.setraw(self._slave)
        super().__init__(master)
        self.url = f"serial://{os.ttyname(self._slave)}?baud={baud}"
        self._bytes_per_s = baud / 10
        self._free_s = time.monotonic()  # when the line has carried all that was taken

    def wait(self, timeout_s: float) -> None:
        """Until a byte lies ready, or the time is over; one that is on its way takes its time."""
        super().wait(timeout_s)
        time.sleep(min(0.001, timeout_s))

    def feed(self, receiver: Receiver) -> None:
        """What a line of this rate has carried by now."""
        now_s = time.monotonic()
        self._free_s = max(self._free_s, now_s - PTY_BURST_S)
        room = int((now_s - self._free_s) * self._bytes_per_s)
        with contextlib.suppress(BlockingIOError):
            data = os.read(self._fd, room) if room > 0 else b""
            self._free_s += len(data) / self._bytes_per_s
            receiver.feed_stream(now_s, data)

    def close(self) -> None:
        super().close()
        os.close(self._slave)


class PlannerEnd:
    """A receiver on a wire, with a meter."""

    def __init__(self, wire: Wire, planner: WatchingReceiver) -> None:
        self.wire, self.planner, self.meter = wire, planner, Meter()
        self._link = Link(wire, planner)

    def step(self, wait_s: float) -> float:
        """Wait for bytes, take them, answer; gives the time."""
        now_s = self._link.step(wait_s)
        self.meter.take(now_s, self.planner)
        return now_s
