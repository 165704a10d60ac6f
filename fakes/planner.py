"""Fake planner: takes the link's frames, keeps the map, acknowledges, asks for what it lacks.

It refuses every frame that section 5 refuses, and such a frame changes nothing but counters.
Source: planner link, sections 4 to 6 and 9.
"""

import math
import random
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fakes.planner_frames import (
    ACK,
    AUTH,
    CRC_SIZE,
    DIGEST,
    DIGEST_BODY,
    DRIVE,
    GEOM,
    HEAD,
    HELLO,
    KEEP,
    MAP,
    MAP_HEAD,
    MAX_FRAME,
    POSE,
    UNKNOWN,
    VERSION,
    Deframer,
    Frame,
    Geometry,
    Pose,
    bytes_from_frame,
    crc32,
    drive_body,
    frame_from_bytes,
    int16,
    maybe_geometry,
    maybe_pose,
    maybe_runs,
    serial_from_frame,
    tag_is_right,
    tag_of,
)

U8 = npt.NDArray[np.uint8]
HELLO_PERIOD_S, ACK_PERIOD_S = 0.25, 0.1
SESSIONS_KEPT = 64  # sessions left behind, which a keyed receiver does not take up again
ALL_SEQ_BITS = 0xFFFFFFFF
POSE_VALID, MAP_VALID, DROP_OFF, ATTITUDE_OUT, OPERATOR_STOP = (
    1 << 4,
    1 << 5,
    1 << 7,
    1 << 9,
    1 << 15,
)


@dataclass(frozen=True, slots=True)
class Heard:
    """One accepted frame, for whoever measures rates and delays."""

    arrived_s: float
    type: int
    t_ms: int
    size: int


@dataclass(frozen=True, slots=True)
class MapUpdate:
    """A MAP frame whose operations have been checked."""

    ox: int
    oy: int
    repaired: int
    runs: list[tuple[int, int, int]]


class FakePlanner:
    """The receiver of sections 4 to 6. Time comes with each call; nothing here raises on bytes.

    Args:
        key: 32 bytes: frames without a valid tag are dropped, ACKs are signed. None: no tags.
        ack_every: accepted frames per ACK; 0 sends none (a link without a return path).
    """

    def __init__(
        self,
        seed: int = 0,
        key: bytes | None = None,
        ack_every: int = 16,
        max_cells: int = 401 * 401,
    ) -> None:
        self.mute, self.deaf, self.loss_rate = False, False, 0.0  # faults, for tests to set
        self.need_geom = self.need_full = False  # set: asked for with the next ACK
        self.stopped = False  # PLANNER_STOPPED
        self.ack_every, self.max_cells = ack_every, max_cells
        self._key, self._random = key, random.Random(seed)
        self.nonce = self._random.randint(1, 2**32 - 1) if ack_every else 0
        self._deframer = Deframer()
        self.accepted: Counter[int] = Counter()  # by frame type
        self.rejected: Counter[str] = Counter()  # by reason
        self.ignored_types = self.ignored_maps = self.repeated = self.gaps = self.missing = 0
        self.heard: deque[Heard] = deque(maxlen=4096)
        self.geom: Geometry | None = None
        self.pose: Pose | None = None
        self.origin: tuple[int, int] | None = None  # window's lowest column and row, unwrapped
        self.gap: int | None = None  # newest frame that may have changed cells unseen
        self.digest_ok = self.auth_failed = False
        self._cells: U8 = np.zeros((0, 0), np.uint8)
        self._map_s = self._newest_s = -math.inf
        self._last = self._mask = self._newest_t_ms = 0
        self._any = False  # a frame has been accepted: _last means something
        self._left_sessions: deque[int] = deque(maxlen=SESSIONS_KEPT)
        self._sent, self._unacked = 0, 0
        self._hello_due_s = self._acked_s = -math.inf
        self._outbox: list[bytes] = []

    # What a planner may know

    def cell(self, col: int, row: int) -> int:
        """Of the window: 0 unknown, 1 free, 2 obstacle; what lies outside is unknown."""
        height, width = self._cells.shape
        return int(self._cells[row, col]) if 0 <= row < height and 0 <= col < width else UNKNOWN

    def window(self) -> U8:
        """(height, width) copy of all cells, row-major from the window's origin."""
        return self._cells.copy()

    @property
    def suspect(self) -> bool:
        """Some cell may be outdated."""
        return self.gap is not None

    @property
    def blank(self) -> bool:
        """There is no map yet."""
        return self.origin is None

    def stale(self, now_s: float) -> bool:
        """Poses or maps do not arrive in time."""
        if self.geom is None or self.pose is None:
            return True
        return now_s - min(self.pose.arrived_s, self._map_s) > self.geom.stale_s

    def advice(self, now_s: float) -> tuple[str, str]:
        """("go" | "slow" | "stop", why): what section 5 makes the planner do."""
        if self.blank or self.pose is None:
            return "stop", "no map yet"
        health = self.pose.health
        reasons = {
            "link stale": self.stale(now_s),
            f"mode {self.pose.mode}": self.pose.mode not in (1, 2),
            "pose not valid": not health & POSE_VALID,
            "map not valid": not health & MAP_VALID,
            "attitude out of range": bool(health & ATTITUDE_OUT),
            "drop-off ahead": bool(health & DROP_OFF),
            "operator stop": bool(health & OPERATOR_STOP),
        }
        for why, holds in reasons.items():
            if holds:
                return "stop", why
        return ("slow", "a frame is missing") if self.suspect else ("go", "")

    def digest(self) -> int:
        """CRC-32 of the window, four cells a byte."""
        flat = np.zeros(-(-self._cells.size // 4) * 4, np.uint8)
        flat[: self._cells.size] = self._cells.ravel()
        quads = flat.reshape(-1, 4) << np.array([0, 2, 4, 6], np.uint8)
        return crc32(np.bitwise_or.reduce(quads, axis=1).tobytes())

    # Bytes in, bytes out

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """The planner on a serial line: what came, and what it sends until now_s."""
        self.feed_stream(now_s, received)
        return b"".join(serial_from_frame(frame) for frame in self.poll(now_s))

    def feed_stream(self, now_s: float, data: bytes) -> None:
        """Bytes from a serial line, cut anywhere."""
        for frame in self._deframer.feed(data):
            if frame is None:
                self.rejected["cobs"] += 1
            else:
                self.feed_datagram(now_s, frame)

    def feed_datagram(self, now_s: float, data: bytes) -> None:
        """One frame."""
        if self.deaf or (self.loss_rate and self._random.random() < self.loss_rate):
            return
        frame = frame_from_bytes(data)
        if isinstance(frame, str):
            self.rejected[frame] += 1
            return
        reason = self._take(now_s, frame)
        if reason:
            self.rejected[reason] += 1

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send back, not framed for a serial line."""
        if self.geom is None and now_s >= self._hello_due_s:
            self._hello_due_s = now_s + HELLO_PERIOD_S
            body = self.nonce.to_bytes(4, "little") + self.max_cells.to_bytes(4, "little")
            self._send(now_s, HELLO, body + MAX_FRAME.to_bytes(2, "little") + bytes(2))
        asking = self.need_geom or self.need_full
        if self._any and now_s - self._acked_s >= (ACK_PERIOD_S / 2 if asking else ACK_PERIOD_S):
            self._acknowledge(now_s)
        frames, self._outbox = self._outbox, []
        return [] if self.mute or not self.ack_every else frames

    def drive(self, now_s: float, v_mps: float, w_radps: float, valid_s: float) -> bool:
        """Ask the robot to move; False while the run of the sender is not known.

        Valid for 0 s means: stop now. It goes out with the next `poll`.
        """
        if self.geom is None or not self.ack_every:
            return False
        self._send(now_s, DRIVE, drive_body(self.geom.session, self.nonce, v_mps, w_radps, valid_s))
        return True

    def ack(self, now_s: float) -> bytes:
        """The body of an ACK as of now."""
        bits = (
            self.need_geom or self.geom is None,
            self.need_full,
            self.stale(now_s),
            self.suspect,
            self.stopped,
            self.digest_ok,
            self.auth_failed,
        )
        status = sum(bit << i for i, bit in enumerate(bits))
        hold = round(min(max(now_s - self._newest_s, 0.0), 6.5535) * 10_000)
        return (
            self._last.to_bytes(2, "little")
            + self._mask.to_bytes(4, "little")
            + self._newest_t_ms.to_bytes(4, "little")
            + hold.to_bytes(2, "little")
            + (sum(self.rejected.values()) % 0x10000).to_bytes(2, "little")
            + bytes([status, self.geom.geom_id if self.geom else 0])
        )

    def _acknowledge(self, now_s: float) -> None:
        self._acked_s, self._unacked = now_s, 0
        self._send(now_s, ACK, self.ack(now_s))

    def _send(self, now_s: float, frame_type: int, body: bytes) -> None:
        self._sent += 1
        t_ms = math.floor(now_s * 1000 + 1e-6)
        if self._key is None or self.geom is None or frame_type == HELLO:
            self._outbox.append(bytes_from_frame(frame_type, self._sent, t_ms, body))
            return
        signed = HEAD.pack(VERSION << 4 | frame_type, AUTH, self._sent % 0x10000, t_ms % 2**32)
        tag = tag_of(signed + body, self._key, self.geom.session, self.nonce)
        self._outbox.append(bytes_from_frame(frame_type, self._sent, t_ms, body, AUTH, tag))

    # Section 5: which frames count

    def _take(self, now_s: float, frame: Frame) -> str:
        """Checks a frame, then lets it act; gives the reason if it is rejected."""
        geom = maybe_geometry(frame.body) if frame.type == GEOM else None
        if frame.type == GEOM and (geom is None or geom.width * geom.height > self.max_cells):
            return "body"
        begins = geom is not None and (self.geom is None or geom.session != self.geom.session)
        if self._key is not None and not self._tag_is_right(self._key, frame, geom):
            self.auth_failed = True
            return "tag"
        self.auth_failed = False
        if not begins and not self._is_newer(frame):
            self.repeated += 1
            return ""
        pose = maybe_pose(frame.body, frame.t_ms, now_s) if frame.type == POSE else None
        update = self._maybe_update(frame.body) if frame.type == MAP else None
        bad_digest = frame.type == DIGEST and len(frame.body) != DIGEST_BODY.size
        if (frame.type == POSE and pose is None) or update == "body" or bad_digest:
            return "body"
        if update == "geometry":
            self.ignored_maps += 1
            self.need_geom = True
            return ""
        self._count(now_s, frame, begins)
        if geom is not None:
            self._adopt(geom, begins)
        elif pose is not None:
            self.pose = pose
        elif isinstance(update, MapUpdate):
            self._map_s = now_s
            self._apply(update)
        elif frame.type == DIGEST:
            self._compare(*DIGEST_BODY.unpack(frame.body))
        else:
            self.ignored_types += 1
        if self._unacked >= self.ack_every > 0:
            self._acknowledge(now_s)
        return ""

    def _tag_is_right(self, key: bytes, frame: Frame, geom: Geometry | None) -> bool:
        """A GEOM names its own session; one that was left may not come back."""
        known = geom or self.geom
        if known is None or not frame.flags & AUTH or known.session in self._left_sessions:
            return False
        return tag_is_right(frame, key, known.session, self.nonce)

    def _is_newer(self, frame: Frame) -> bool:
        back_ms = (self._newest_t_ms - frame.t_ms) % 2**32
        if self._key is not None and self._any and 0 < back_ms < 2**31:
            return False
        return not self._any or int16(frame.seq - self._last) > 0

    def _maybe_update(self, body: bytes) -> MapUpdate | str:
        if len(body) < MAP_HEAD.size:
            return "body"
        ox, oy, repaired, geom_id, start = MAP_HEAD.unpack_from(body)
        if self.geom is None or geom_id != self.geom.geom_id:
            return "geometry"
        runs = maybe_runs(body[MAP_HEAD.size :], int.from_bytes(start, "little"), self._cells.size)
        return "body" if runs is None else MapUpdate(ox, oy, repaired, runs)

    def _count(self, now_s: float, frame: Frame, begins: bool) -> None:
        """The books of an accepted frame: numbers, gap, mask."""
        step = int16(frame.seq - self._last)
        if begins or not self._any:
            self._mask = 0
        else:
            if step > 1:
                self.gap = frame.seq - 1
                self.gaps, self.missing = self.gaps + 1, self.missing + step - 1
            self._mask = (self._mask << step | 1 << (step - 1)) & ALL_SEQ_BITS
        self._any, self._last, self._newest_t_ms = True, frame.seq, frame.t_ms
        self._newest_s = now_s
        self.accepted[frame.type] += 1
        size = len(frame.signed) + len(frame.tag) + CRC_SIZE
        self.heard.append(Heard(now_s, frame.type, frame.t_ms, size))
        self._unacked += 1

    # Section 4: the map

    def _adopt(self, geom: Geometry, begins: bool) -> None:
        old, self.geom, self.need_geom = self.geom, geom, False
        if begins:
            self.pose, self._map_s = None, -math.inf  # of another run of the sender
            if old is not None:
                self._left_sessions.append(old.session)
        layout = (geom.geom_id, geom.width, geom.height, geom.cell_m)
        if begins or old is None or layout != (old.geom_id, old.width, old.height, old.cell_m):
            self.origin, self.need_full, self.digest_ok = None, False, False
            self._cells = np.zeros((geom.height, geom.width), np.uint8)
            self.gap = None

    def _apply(self, update: MapUpdate) -> None:
        height, width = self._cells.shape
        ox, oy = self.origin or (0, 0)
        dx, dy = int16(update.ox - ox), int16(update.oy - oy)
        if self.origin is None or abs(dx) >= width or abs(dy) >= height:
            self._cells[:] = UNKNOWN
            self.gap = None
        elif dx or dy:
            kept = self._cells[max(dy, 0) : height + min(dy, 0), max(dx, 0) : width + min(dx, 0)]
            moved = np.zeros_like(self._cells)
            moved[max(-dy, 0) : height - max(dy, 0), max(-dx, 0) : width - max(dx, 0)] = kept
            self._cells = moved
        self.origin = ox + dx, oy + dy
        if self.gap is not None and int16(update.repaired - self.gap) >= 0:
            self.gap = None
        flat = self._cells.ravel()
        for state, first, end in update.runs:
            if state != KEEP:
                flat[first:end] = state

    def _compare(self, geom_id: int, expected: int) -> None:
        """A difference that no gap explains can only be repaired by a new epoch."""
        if self.geom is None or geom_id != self.geom.geom_id:
            return
        self.digest_ok = self.digest() == expected
        self.need_full |= not self.digest_ok and not self.suspect
