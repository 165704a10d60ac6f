"""A planner's end on a real wire: sockets and ttys around the fake planner, and a meter.

Used by the live viewer and the demo. No call waits longer than it is told to.
"""

import contextlib
import errno
import math
import os
import select
import socket
import struct
import termios
import time
import tty
from collections import deque
from typing import Protocol
from urllib.parse import parse_qs, urlsplit

import numpy as np

from fakes.planner import FakePlanner, Heard
from fakes.planner_frames import MAP, POSE, serial_from_frame

SO_TIMESTAMPNS = 35  # Linux: the kernel stamps each datagram, so that drawing delays no stamp
RATE_WINDOW_S = 2.0
BIN_MS, BINS = 0.1, 20_000  # delays up to two seconds
PTY_BURST_S = 0.02  # so much of a line's time may be taken at once after a pause of ours
SAME_CLOCK_MS = (-5.0, 2000.0)  # a first delay within this: sender and viewer share a clock


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

    Where sender and viewer do not share a clock, delays are those above the fastest first seen.
    """

    def __init__(self) -> None:
        self.link, self.scan = Delays(), Delays()  # tick to arrival; scan to arrival
        self.link_ms = self.scan_ms = math.nan  # newest
        self.frames = self.bytes = 0
        self.first_s = math.nan
        self.same_clock = True
        self._fastest_ms: float | None = None
        self._recent: deque[Heard] = deque()
        self._pose_t_ms = -1

    def take(self, now_s: float, planner: FakePlanner) -> None:
        """Count what the planner has heard since the last call."""
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

    def rates(self, now_s: float) -> tuple[float, float, float]:
        """MAP frames, POSE frames and bytes per second."""
        span_s = min(RATE_WINDOW_S, now_s - self.first_s) if self.frames else 0.0
        if span_s <= 0.0:
            return 0.0, 0.0, 0.0
        maps = sum(heard.type == MAP for heard in self._recent)
        poses = sum(heard.type == POSE for heard in self._recent)
        return maps / span_s, poses / span_s, sum(heard.size for heard in self._recent) / span_s

    def _delay_ms(self, arrived_s: float, t_ms: int) -> float:
        """The sender's milliseconds wrap at 2^32."""
        arrived_ms = arrived_s * 1000
        whole = math.floor(arrived_ms)
        delay_ms = (whole - t_ms + 2**31) % 2**32 - 2**31 + (arrived_ms - whole)
        if self._fastest_ms is None:
            self.same_clock = SAME_CLOCK_MS[0] <= delay_ms <= SAME_CLOCK_MS[1]
            self._fastest_ms = delay_ms
        self._fastest_ms = min(self._fastest_ms, delay_ms)
        return delay_ms if self.same_clock else delay_ms - self._fastest_ms


class Wire(Protocol):
    """Where frames come from and answers go to."""

    def wait(self, timeout_s: float) -> None:
        """Until something has arrived, or the time is over."""

    def feed(self, planner: FakePlanner) -> None:
        """Hand the planner what has arrived."""

    def write(self, frame: bytes) -> None:
        """Answer; dropped where nobody can take it."""

    def close(self) -> None:
        """Let go of it."""


class UdpWire:
    """A bound socket; answers go to whoever sent last."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._socket.bind((host, port))
        self._sender: tuple[str, int] | None = None
        self.url = "udp://{}:{}".format(*self._socket.getsockname())

    def wait(self, timeout_s: float) -> None:
        """Until a datagram lies ready, or the time is over."""
        select.select([self._socket], [], [], timeout_s)

    def feed(self, planner: FakePlanner) -> None:
        """Each datagram at the instant at which the kernel took it."""
        ahead_s = time.time() - time.monotonic()
        while True:
            try:
                data, notes, _, self._sender = self._socket.recvmsg(2048, 64)
            except BlockingIOError:
                return
            except ConnectionRefusedError:  # an answer of ours found nobody
                continue
            arrived_s = time.monotonic()
            for level, kind, stamp in notes:
                if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
                    seconds, nanoseconds = struct.unpack("@ll", stamp)
                    arrived_s = seconds + nanoseconds * 1e-9 - ahead_s
            planner.feed_datagram(arrived_s, data)

    def write(self, frame: bytes) -> None:
        """To the last sender."""
        if self._sender is not None:
            try:
                self._socket.sendto(frame, self._sender)
            except OSError as error:  # nobody there, or no room: an ACK may get lost
                if error.errno not in (errno.ECONNREFUSED, errno.EAGAIN, errno.ENETUNREACH):
                    raise

    def close(self) -> None:
        """Free the port."""
        self._socket.close()


class SerialWire:
    """A serial line, 8N1."""

    def __init__(self, path: str, baud: int) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._fd)
        settings = termios.tcgetattr(self._fd)
        settings[4] = settings[5] = getattr(termios, f"B{baud}")
        termios.tcsetattr(self._fd, termios.TCSANOW, settings)

    def wait(self, timeout_s: float) -> None:
        """Until a byte lies ready, or the time is over."""
        select.select([self._fd], [], [], timeout_s)

    def feed(self, planner: FakePlanner) -> None:
        """All that has arrived."""
        with contextlib.suppress(BlockingIOError):
            planner.feed_stream(time.monotonic(), os.read(self._fd, 4096))

    def write(self, frame: bytes) -> None:
        """COBS-encoded; where the line has no room, an ACK may get lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._fd, serial_from_frame(frame))

    def close(self) -> None:
        """Close the line."""
        os.close(self._fd)


class PtyWire(SerialWire):
    """Our end of a pty whose other end a sender opens as a serial line; as slow as one.

    A pty has no baud rate: bytes are taken only as fast as the line would carry them.
    """

    def __init__(self, baud: int) -> None:
        self._fd, self._slave = os.openpty()  # the slave stays open: no hang-up between users
        tty.setraw(self._slave)
        os.set_blocking(self._fd, False)
        self.url = f"serial://{os.ttyname(self._slave)}?baud={baud}"
        self._bytes_per_s = baud / 10
        self._free_s = time.monotonic()  # when the line has carried all that was taken

    def wait(self, timeout_s: float) -> None:
        """Until a byte lies ready, or the time is over; one that is on its way takes its time."""
        super().wait(timeout_s)
        time.sleep(min(0.001, timeout_s))

    def feed(self, planner: FakePlanner) -> None:
        """What a line of this rate has carried by now."""
        now_s = time.monotonic()
        self._free_s = max(self._free_s, now_s - PTY_BURST_S)
        room = int((now_s - self._free_s) * self._bytes_per_s)
        with contextlib.suppress(BlockingIOError):
            data = os.read(self._fd, room) if room > 0 else b""
            self._free_s += len(data) / self._bytes_per_s
            planner.feed_stream(now_s, data)

    def close(self) -> None:
        """Hang up."""
        super().close()
        os.close(self._slave)


def wire_from_url(url: str) -> UdpWire | SerialWire:
    """udp://host:port (bound) or serial:///path?baud=...

    Raises:
        ValueError: not such a URL.
    """
    parts = urlsplit(url)
    if parts.scheme == "udp" and parts.hostname and parts.port is not None:
        return UdpWire(parts.hostname, parts.port)
    if parts.scheme == "serial" and parts.path:
        [baud] = parse_qs(parts.query).get("baud", ["115200"])
        return SerialWire(parts.path, int(baud))
    raise ValueError(f"{url}: must be udp://host:port or serial:///path?baud=115200")


class PlannerEnd:
    """A fake planner on a wire, with a meter."""

    def __init__(self, wire: Wire, planner: FakePlanner) -> None:
        self.wire, self.planner, self.meter = wire, planner, Meter()

    def step(self, wait_s: float) -> float:
        """Wait for bytes, take them, answer; gives the time."""
        self.wire.wait(wait_s)
        self.wire.feed(self.planner)
        now_s = time.monotonic()
        self.meter.take(now_s, self.planner)
        for frame in self.planner.poll(now_s):
            self.wire.write(frame)
        return now_s
