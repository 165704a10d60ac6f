"""The sender of the planner link: map, pose and health to the planner under a byte budget.

Every cell operation is absolute, so a lost frame spoils nothing that comes later; what it told is
told again, when an ACK shows the gap or when the rolling refresh passes by. While an input is not
to be trusted, free cells are told as unknown. A tick's frames go out together or not at all: there
is never a queue of outdated frames.
Source: planner link, sections 2 to 8 (docs/planner-link.md).
"""

import math
from collections import deque
from dataclasses import dataclass

from core.records import ExternalPose, ObstacleWindow, PoseReport
from hw import map_sender
from hw.map_sender import MapSender
from hw.planner_commanders import Commanders
from hw.planner_frames import (
    DRIVE,
    EXTERNAL_POSE,
    GEOM,
    HEAD,
    MAP,
    MAP_HEAD,
    MAX_FRAME,
    MORE,
    NEED_FULL,
    NEED_GEOM,
    PLANNER_STOPPED,
    POSE,
    REFRESH,
    TAG_BYTES,
    Ack,
    Deframer,
    Drive,
    External,
    Hello,
    Secret,
    decode_answer,
    encode_frame,
    encode_geom,
    encode_map,
    encode_pose,
    encode_serial,
    is_kind,
    serial_bytes,
)
from hw.planner_poses import ExternalPoses
from hw.planner_requests import Requests
from hw.session import BadFrame, Port

UDP_BAUD = 4_000_000  # a datagram link is used as if it were a line of this rate
LINE_SHARE = 0.85  # of what the line carries
REFRESH_SHARE = 0.2  # of the budget, saved up
SLICE_OPS = 120  # bytes of operations that a refresh slice is saved up for
PASS_S = 0.35  # one refresh pass, where bandwidth allows
SAVED_TICKS = 3.0  # budget that may be saved up
LEAST_SLICE_OPS = 32  # the MAP frame that every tick has
MOST_PER_CELL = 5  # bytes of operations: its run, and a KEEP up to it
GEOM_EVERY_S = 1.0
ACK_WINDOW = 33  # frames that an ACK speaks of
REMEMBERED = 512  # MAP frames without an ACK


@dataclass(frozen=True, slots=True)
class SentMap:
    """A MAP frame on its way: what to tell again if it gets lost."""

    seq: int  # unwrapped
    start: int
    ops: bytes
    origin: tuple[int, int]


class PlannerLink:
    """One planner on one port."""

    def __init__(
        self,
        port: Port,
        *,
        size: int,
        cell_mm: int,
        session: int,
        tick_s: float,
        line_baud: int | None,
        key: bytes | None,
        stale_ms: int,
        drive_refusal: str,
        pose_refusal: str = "no external poses are taken here",
    ) -> None:
        self.port = port
        self._size, self._cell_mm = size, cell_mm
        self._session, self._tick_s, self._stale_ms = session, tick_s, stale_ms
        self._bytes_per_s = (line_baud or UDP_BAUD) / 10 * LINE_SHARE
        self._key = key
        self._nonce: int | None = None  # of the planner's newest HELLO
        self._map = MapSender(size)
        self._deframer = Deframer()
        self._max_frame = MAX_FRAME
        self.refusal = ""  # why no map is announced, in words
        self._seq = 0  # of the newest frame, unwrapped
        self._geom_id, self._epoch = session % 256, -1  # after a restart hardly the same number
        self._epoch_seq = 1  # first frame of this geometry
        self._geom_due, self._geom_s = True, -math.inf
        self._credit = self._saved = 0.0  # bytes: of the line, and of the refresh's share
        self._due_cells = 0.0  # of the refresh, by its pace
        self._stepped_s = -math.inf
        self._repaired = self._covered = 0
        self._sent: deque[SentMap] = deque()
        self._pass_cell, self._pass_seq = 0, 1
        self._in_step = True  # ACKs, if any come, tell of every MAP frame of this geometry
        self._origin: tuple[int, int] | None = None  # of the newest MAP frame
        self._out: list[tuple[int, int, bytes]] = []  # this tick: kind, flags, body
        self.frames_sent = self.bytes_sent = self.frames_lost = 0
        self.acks = self.answers_rejected = self.ticks_held = 0
        self.planner_status = 0  # of the newest ACK
        commanders = Commanders(session)
        self.requests = Requests(session, drive_refusal, commanders)
        self.external_poses = ExternalPoses(pose_refusal, commanders)
        self.round_trip_s = math.nan
        self._t_ms = 0

    # What the planner says

    def poll(self, now_s: float) -> bool:
        """Move the port on, and take what the planner says; True while the port is open."""
        is_open = self.port.poll(now_s)
        for piece in self.port.read():
            frames = [piece] if self.port.datagrams else self._deframer.feed(piece)
            for frame in frames:
                if isinstance(frame, BadFrame):
                    self.answers_rejected += 1
                    continue
                match decode_answer(frame, self._secret()):
                    case Ack() as ack:
                        self._take_ack(now_s, ack)
                    case Hello() as hello:
                        self._take_hello(hello)
                    case Drive() as drive:
                        self.requests.take(now_s, drive)
                    case External() as external:
                        self.external_poses.take(now_s, external)
                    case BadFrame(reason, data):
                        self.answers_rejected += 1
                        if is_kind(data, DRIVE):
                            self.requests.refuse(reason)
                        elif is_kind(data, EXTERNAL_POSE):
                            self.external_poses.refuse(reason)
        return is_open

    def take_external_poses(self) -> list[ExternalPose]:
        """Those that counted since the last call, each with its instant on the host's clock."""
        return self.external_poses.take_all()

    @property
    def doubt(self) -> str:
        """Why no request of the planner's should be obeyed, in words."""
        stopped = self.planner_status & PLANNER_STOPPED
        return self.port.cause or ("the planner says it stopped" if stopped else "")

    def _secret(self) -> Secret | None:
        return Secret(self._key, self._session, self._nonce or 0) if self._key else None

    def _take_hello(self, hello: Hello) -> None:
        """A planner has started: it holds nothing, and wants to know the geometry."""
        self._max_frame = max(64, min(MAX_FRAME, hello.max_frame))
        self.refusal = ""
        if hello.max_cells < self._size**2:
            self.refusal = (
                f"the planner can hold {hello.max_cells} cells, the window has {self._size**2}: "
                "lower obstacle.window_cells"
            )
        if hello.nonce != self._nonce:
            self._nonce = hello.nonce
            self._begin_epoch()
        self._geom_due = True

    def _take_ack(self, now_s: float, ack: Ack) -> None:
        self.acks += 1
        self.planner_status = ack.status
        newest = self._seq - (self._seq - ack.last_seq) % 2**16  # unwrapped
        if newest < self._epoch_seq:
            return  # of another run or geometry: it says nothing of what is on its way now
        round_trip_s = ((round(now_s * 1000) - ack.echo_t_ms) % 2**32) / 1000 - ack.hold_s
        self.round_trip_s = round_trip_s if round_trip_s < 60 else math.nan
        if ack.status & NEED_FULL and ack.geom_id == self._geom_id:
            self._begin_epoch()
            return
        if ack.geom_id != self._geom_id or ack.status & NEED_GEOM:
            self._geom_due, self._in_step = True, False
            return
        if not self._in_step:
            # It ignored what came before the geometry, or was silent for long: all of it again
            self._in_step = True
            self._map.retell()
            self._sent.clear()
        self._settle_frames(newest, ack.mask)
        self._covered = max(self._covered, newest)

    def _settle_frames(self, newest: int, mask: int) -> None:
        """Which frames up to `newest` arrived, and what of the others is to be told again."""
        seen: tuple[int, int] | None = None
        while self._sent and self._sent[0].seq <= newest:
            sent = self._sent.popleft()
            age = newest - sent.seq
            if age == 0 or (age < ACK_WINDOW and mask >> (age - 1) & 1):
                seen = sent.origin
                continue
            self.frames_lost += 1
            self._map.mark_lost(sent.start, sent.ops, sent.origin)
        if seen is not None:
            self._map.note_seen(seen, [sent.origin for sent in self._sent])

    def _begin_epoch(self) -> None:
        """New geometry number: both ends start from unknown."""
        self._geom_id = (self._geom_id + 1) % 256
        self._geom_due = True
        self._map.forget()
        self._sent.clear()
        self._repaired = self._covered = self._seq
        self._epoch_seq = self._seq + 1
        self._pass_cell, self._pass_seq = 0, self._seq + 1
        self._in_step = True

    # What the planner is told

    def step(self, now_s: float, pose: PoseReport, window: ObstacleWindow) -> None:
        """One tick: take answers, then write the frames that the line has room for."""
        is_open = self.poll(now_s)
        if window.epoch != self._epoch:
            self._epoch = window.epoch
            self._begin_epoch()
        careful = self._in_step or self._map.corner != self._origin
        moved_from = self._map.update(window, careful)
        if moved_from is not None:
            self._follow(moved_from)
        self._earn(now_s)
        if not is_open or self.port.backlog > 0:
            self.ticks_held += 1
            return
        self._t_ms = round(now_s * 1000)
        if not self.refusal and (self._geom_due or now_s - self._geom_s >= GEOM_EVERY_S):
            self._geom_due, self._geom_s = False, now_s
            geom = (self._geom_id, self._size, self._cell_mm, self._session)
            self._queue(GEOM, 0, encode_geom(*geom, self._tick_s, self._stale_ms))
        self._queue(POSE, 0, encode_pose(pose))
        if not self.refusal:
            self._tell_changes()
            self._refresh()
        self._repair()
        self._send()

    def _earn(self, now_s: float) -> None:
        """Budget for the time since the last tick."""
        dt_s = max(0.0, min(now_s - self._stepped_s, SAVED_TICKS * self._tick_s))
        self._stepped_s = now_s
        earned = self._bytes_per_s * dt_s
        most = self._bytes_per_s * self._tick_s * SAVED_TICKS
        self._credit = min(self._credit + earned, most)
        most_saved = max(REFRESH_SHARE * most, self._cost(SLICE_OPS) + REFRESH_SHARE * earned)
        self._saved = min(self._saved + REFRESH_SHARE * earned, most_saved)
        cells = self._size**2
        self._due_cells = min(self._due_cells + cells * dt_s / PASS_S, cells)

    def _follow(self, moved_from: tuple[int, int]) -> None:
        """The window moved: rows that the refresh has not passed yet stay ahead of it."""
        assert self._map.corner is not None
        next_row = moved_from[1] + self._pass_cell // self._size - self._map.corner[1]
        self._pass_cell = max(0, min(self._size - 1, next_row)) * self._size

    def _cost(self, ops_bytes: int) -> int:
        """Wire bytes of a MAP frame with so many bytes of operations."""
        frame = HEAD.size + MAP_HEAD.size + ops_bytes + 4 + (TAG_BYTES if self._key else 0)
        return frame if self.port.datagrams else serial_bytes(frame)

    def _ops_room(self, budget: float) -> int:
        """Bytes of operations that a MAP frame may have under a budget; may be negative."""
        tag = TAG_BYTES if self._key else 0
        most = self._max_frame - HEAD.size - MAP_HEAD.size - 4 - tag
        return min(most, math.floor(budget) - self._cost(0) - 2)

    def _queue(self, kind: int, flags: int, body: bytes) -> None:
        self._seq += 1
        self._out.append((kind, flags, body))
        frame = HEAD.size + len(body) + 4 + (TAG_BYTES if self._key else 0)
        self._credit -= frame if self.port.datagrams else serial_bytes(frame)

    def _tell_changes(self) -> None:
        """All marked cells in one raster pass if they fit; else obstacles near the robot first."""
        if self._map.marked == 0:
            return
        budget = self._credit - self._saved
        if self._map.marked * MOST_PER_CELL + 2 * self._cost(0) < min(budget, self._max_frame):
            self._tell(map_sender.ALL, budget)
            return
        before = self._map.snapshot(), self._seq, self._credit, len(self._out), len(self._sent)
        if self._tell(map_sender.ALL, budget):
            return
        snapshot, self._seq, self._credit, queued, sent = before
        self._map.restore(snapshot)
        del self._out[queued:]
        while len(self._sent) > sent:
            self._sent.pop()
        for kind in map_sender.IN_ORDER:
            if not self._tell(kind, self._credit - self._saved):
                return

    def _tell(self, kind: int, budget: float) -> bool:
        """MAP frames with the cells of one kind; True if all of them fitted."""
        floor, cell, end = self._credit - budget, 0, self._size**2
        while cell < end:
            room = self._ops_room(self._credit - floor)
            if room < 2 * map_sender.OP_ROOM:
                return False
            start, ops, cell = self._map.encode(kind, cell, end, room)
            if start >= 0:
                self._queue_map(0, start, ops)
        return True

    def _refresh(self) -> None:
        """Slices of the rolling refresh, by its pace, of its share and what else the line has left.

        One tick's budget stays for a burst of changes. A short slice at least goes out if no other
        MAP frame does.
        """
        has_map = any(kind == MAP for kind, _, _ in self._out)
        least, slice_cost = self._cost(LEAST_SLICE_OPS) + 2, self._cost(SLICE_OPS)
        while True:
            left = self._credit - self._bytes_per_s * self._tick_s
            left = max(left, min(self._saved, self._credit))
            if has_map and (self._due_cells < 1 or left < slice_cost):
                return
            room = self._ops_room(max(least, left))
            due = max(1, math.floor(self._due_cells))
            end = min(self._size**2, self._pass_cell + due)
            begun, before, first_seq = self._pass_cell, self._credit, self._seq + 1
            start, ops, self._pass_cell = self._map.encode(map_sender.REFRESH, begun, end, room)
            self._queue_map(REFRESH, start, ops)
            has_map = True
            self._due_cells = max(0.0, self._due_cells - (self._pass_cell - begun))
            self._saved = max(0.0, self._saved - (before - self._credit))
            if begun == 0:
                self._pass_seq = first_seq
            if self._pass_cell >= self._size**2:
                self._pass_cell = 0
                self._repaired = max(self._repaired, self._pass_seq - 1)

    def _queue_map(self, flags: int, start: int, ops: bytes) -> None:
        assert self._map.corner is not None
        self._origin = origin = self._map.corner
        self._queue(MAP, flags, encode_map(origin, self._repaired, self._geom_id, start, ops))
        self._sent.append(SentMap(self._seq, start, ops, origin))
        if len(self._sent) > REMEMBERED:
            self._sent.clear()
            self._in_step = False

    def _repair(self) -> None:
        """How far every change has arrived or has been told again, by ACKs."""
        if self._map.lost == 0 and self._in_step:
            self._repaired = max(self._repaired, self._covered)

    def _send(self) -> None:
        first = self._seq - len(self._out) + 1
        secret = self._secret()
        for k, (kind, flags, body) in enumerate(self._out):
            more = MORE if k + 1 < len(self._out) else 0
            frame = encode_frame(kind, flags | more, first + k, self._t_ms, body, secret)
            data = frame if self.port.datagrams else encode_serial(frame)
            self.port.write(data)
            self.frames_sent += 1
            self.bytes_sent += len(data)
        self._out.clear()
