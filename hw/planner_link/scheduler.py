"""Frames on their way to one planner: their numbers, their sizes, and what the line carries.

A tick's frames go out together or not at all. The budget grows with time by what the line carries;
what is left over is kept for a few ticks, a share of it for the refresh.
Source: planner link, sections 2 and 7.
"""

import math
from array import array
from dataclasses import dataclass

from hw.device import Port
from hw.planner_link.frames import (
    CRC,
    HEAD,
    MAX_FRAME,
    MORE,
    TAG_BYTES,
    Secret,
    encode_frame,
    encode_serial,
    serial_bytes,
)

UDP_BAUD = 4_000_000  # a datagram link is used as if it were a line of this rate
LINE_SHARE = 0.85  # of what the line carries
REFRESH_SHARE = 0.2  # of the budget, saved up
LONGEST_BURST = 1.85  # ticks of the whole line that one tick may fill: the next finds most done
SAVED_TICKS = LONGEST_BURST / LINE_SHARE  # budget that may be saved up
UNTIMED = 1024  # newest frames, of which an ACK that tells no time is believed
IDLE_S = 0.020  # after such a pause a zero ends what noise has begun in the receiver


@dataclass(slots=True)
class Budget:
    """Bytes that may be sent."""

    tick_bytes: float  # what the line carries in one tick
    credit: float = 0.0  # saved up so far
    saved: float = 0.0  # of that, the refresh's share
    most_saved: float = 0.0
    kept: float = 0.0  # of the share, what this tick's changes leave: all, once it fills a slice
    line_left: float = 0.0  # that the line carries until the next tick, beside the queued


class FrameScheduler:
    """Numbers, paces and writes the frames of one planner."""

    def __init__(
        self,
        port: Port,
        line_baud: int | None,
        tick_s: float,
        secret: Secret | None,
        slice_body: int,
        first_seq: int,
    ) -> None:
        self.port = port
        self.secret = secret  # what frames are signed with: it may change, but not from or to None
        self._bare_bytes = HEAD.size + CRC.size + (TAG_BYTES if secret else 0)  # of a frame
        sizes = range(self._bare_bytes, MAX_FRAME + 1)
        # wire bytes of a frame, at most, by the bytes of its body
        self.costs = list(sizes if port.datagrams else map(serial_bytes, sizes))
        self._bytes_per_s = (line_baud or UDP_BAUD) / 10 * LINE_SHARE
        self.budget = Budget(self._bytes_per_s * tick_s)
        self._longest_s = SAVED_TICKS * tick_s  # for which budget is earned
        self._most_credit = self.budget.tick_bytes * SAVED_TICKS
        self._line_bytes = self.budget.tick_bytes / LINE_SHARE  # in one tick, used to the full
        self._burst_bytes = LONGEST_BURST * self._line_bytes
        self._first_seq, self.seq = first_seq, first_seq - 1  # `seq`: newest frame, unwrapped
        self.most_body = MAX_FRAME - self._bare_bytes  # bytes that the planner takes
        self._slice_cost = self.costs[slice_body]  # that the refresh's share is saved up for
        self.is_full = False  # the wire is more than a tick behind, or the budget overdrawn
        self._earned_s = self._written_s = -math.inf
        self._queued: list[tuple[int, int, bytes]] = []  # this tick: kind, flags, body
        self._t_ms = array("I", bytes(4 * 2**16))  # of the newest of a number
        self.frames_sent = 0

    def limit(self, max_frame: int) -> None:
        """The planner takes frames of so many bytes."""
        self.most_body = max_frame - self._bare_bytes

    def earn(self, now_s: float) -> float:
        """Budget for the time since the last tick, which is returned (s, bounded).

        What the wire still holds of earlier ticks is part of what this one may fill.
        """
        dt_s = max(0.0, min(now_s - self._earned_s, self._longest_s))
        self._earned_s = now_s
        budget, line_bytes, backlog = self.budget, self._line_bytes, self.port.backlog
        earned, waiting = self._bytes_per_s * dt_s, min(backlog, line_bytes)
        longest = self._burst_bytes - waiting
        budget.credit = min(budget.credit + earned, self._most_credit, longest)
        share = REFRESH_SHARE * earned
        budget.most_saved = max(REFRESH_SHARE * self._most_credit, self._slice_cost + share)
        budget.saved = min(budget.saved + share, budget.most_saved)
        budget.kept = budget.saved if budget.saved >= self._slice_cost else 0.0
        budget.line_left = line_bytes - waiting
        self.is_full = backlog > line_bytes or budget.credit < 0.0
        return dt_s

    def room(self, budget: float, head_bytes: int) -> int:
        """Bytes that a body may have behind its head under a budget; may be negative."""
        left = math.floor(budget) - self.costs[head_bytes] - 2
        return min(self.most_body - head_bytes, left)

    def queue(self, kind: int, body: bytes, flags: int = 0) -> None:
        """One more frame of this tick; left out if the planner can't take one so long."""
        if len(body) <= self.most_body:
            self.seq += 1
            self._queued.append((kind, flags, body))
            budget, cost = self.budget, self.costs[len(body)]
            budget.credit -= cost
            budget.line_left -= cost

    def write(self, now_s: float) -> None:
        if not self._queued:
            return
        port, t_ms, seq = self.port, round(now_s * 1000) % 2**32, self.seq - len(self._queued)
        lead = b"" if now_s - self._written_s <= IDLE_S or port.datagrams else b"\0"
        self.budget.credit -= len(lead)
        for kind, flags, body in self._queued:
            seq += 1
            more = MORE if seq < self.seq else 0
            frame = encode_frame(kind, flags | more, seq, t_ms, body, self.secret)
            port.write(frame if port.datagrams else lead + encode_serial(frame))
            lead = b""
            self._t_ms[seq % 2**16] = t_ms
        self.frames_sent += len(self._queued)
        self._queued.clear()
        self._written_s = now_s

    def maybe_sent(self, last_seq: int, t_ms: int) -> int | None:
        """The unwrapped number of the newest frame of that number, if `t_ms` was its time.

        Who tells 0 keeps no times: believed of the newest frames alone.
        """
        newest = self.seq - (self.seq - last_seq) % 2**16
        is_recent = t_ms == 0 and self.seq - newest < UNTIMED
        is_its_time = self._t_ms[last_seq] == t_ms or is_recent
        return newest if newest >= self._first_seq and is_its_time else None
