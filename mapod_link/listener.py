"""The listening half of a receiver: bytes in, map, pose and stop zone out.

It refuses every frame that section 5 refuses, and such a frame changes nothing but counters. It
opens nothing and reads no clock: time comes with each call, in seconds of any clock that never goes
back.
Source: planner link, sections 3 to 5 and 9.
"""

import math
from collections import Counter, deque

from mapod_link.advice import Advice, advice_for, allowed_mps
from mapod_link.bodies import (
    Digest,
    Geometry,
    MapUpdate,
    Pose,
    StopZone,
    maybe_digest,
    maybe_geometry,
    maybe_map_geometry,
    maybe_map_update,
    maybe_pose,
    maybe_stop_zone,
)
from mapod_link.cell_map import U8, CellMap
from mapod_link.counting import Numbers
from mapod_link.frames import (
    ACK,
    AUTH,
    DIGEST,
    EXTERNAL_POSE,
    GEOM,
    KEY_SIZE,
    MAP,
    POSE,
    STOP_ZONE,
    TILE,
    Frame,
    frame_from_bytes,
    tag_is_right,
)
from mapod_link.serial_line import Deframer
from mapod_link.tiles import TilePiece, Tiles, maybe_tile_piece

SESSIONS_KEPT = 4096  # sessions left behind, which a keyed receiver does not take up again
MEANT = (GEOM, POSE, MAP, DIGEST, STOP_ZONE, TILE)  # types whose bodies must be right
Body = Geometry | Pose | StopZone | MapUpdate | Digest | TilePiece | None


class Listener:
    """What a planner knows of the robot. Nothing raises on bytes.

    Attributes:
        geom: newest geometry; None until one has arrived that this receiver can hold.
        pose, stop_zone: newest; None until one has arrived in this run of the sender.
        accepted: frames taken, by type. rejected: frames refused, by reason.
        repeated, ignored_types, ignored_maps: frames left alone: older or twice, of no type for a
            receiver, of another geometry.
        numbers: which frames have arrived.
        too_many_cells: of a window that this receiver cannot hold; 0: none was announced.
        need_geom, need_full: to be asked for, with the next ACK.
        differs: the newest DIGEST that could be compared proves the map wrong.
    """

    def __init__(self, nonce: int, key: bytes | None, max_cells: int, poll_only: bool) -> None:
        if key is not None and len(key) != KEY_SIZE:
            raise ValueError(f"a key has {KEY_SIZE} bytes, not {len(key)}")
        self.nonce, self.max_cells, self.poll_only, self._key = nonce, max_cells, poll_only, key
        self._deframer = Deframer()
        self.accepted: Counter[int] = Counter()
        self.rejected: Counter[str] = Counter()
        self.ignored_types = self.ignored_maps = self.repeated = 0
        self.geom: Geometry | None = None
        self.pose: Pose | None = None
        self.stop_zone: StopZone | None = None
        self.numbers, self.tiles, self._map = Numbers(), Tiles(), CellMap(0, 0)
        self.need_geom = self.need_full = self.differs = False
        self.digest_ok = self.auth_failed = False
        self.too_many_cells = 0
        self._map_s = -math.inf  # when a MAP frame was applied last
        self._left_sessions: deque[int] = deque(maxlen=SESSIONS_KEPT)

    # What is known

    @property
    def cells(self) -> U8:
        """(height, width) read-only view, row-major from `origin`: 0 unknown, 1 free, 2 obstacle.

        Later frames change what it shows; `window()` gives a copy. A new geometry has another one.
        """
        return self._map.cells

    def window(self) -> U8:
        """(height, width) copy of all cells."""
        return self._map.cells.copy()

    def cell(self, col: int, row: int) -> int:
        """Of the window: 0 unknown, 1 free, 2 obstacle; what lies outside is unknown."""
        return self._map.cell(col, row)

    def cell_at(self, x_m: float, y_m: float) -> int:
        """The cell at a place in the map frame; what lies outside of the window is unknown."""
        if self.geom is None or self.origin is None:
            return 0
        i, j = (math.floor(part_m / self.geom.cell_m) for part_m in (x_m, y_m))
        return self._map.cell(i - self.origin[0], j - self.origin[1])

    @property
    def origin(self) -> tuple[int, int] | None:
        """World cell (column, row) of cells[0, 0], near the robot's pose; None while blank.

        World cell (i, j) reaches from (i, j) * cell_m to (i + 1, j + 1) * cell_m in the map frame.
        """
        return self._map.origin

    def digest(self) -> int:
        """CRC-32 of the window, as a DIGEST frame tells it."""
        return self._map.digest()

    @property
    def suspect(self) -> bool:
        """A frame is missing that may have changed cells: some cell may be outdated."""
        return self.numbers.gap is not None

    @property
    def gaps(self) -> int:
        """How often frames were missing."""
        return self.numbers.gaps

    @property
    def missing(self) -> int:
        """How many frames were missing; on UDP some may have come too late."""
        return self.numbers.missing

    @property
    def newest_seq(self) -> int:
        """Number of the newest frame that was taken, modulo 65 536; 0 before the first."""
        return self.numbers.last

    @property
    def blank(self) -> bool:
        """There is no map yet."""
        return self.origin is None

    def stale(self, now_s: float) -> bool:
        """Poses or maps do not arrive in time: nothing that is known may be used."""
        if self.geom is None or self.pose is None:
            return True
        return now_s - min(self.pose.arrived_s, self._map_s) > self.geom.stale_s

    def advice(self, now_s: float) -> Advice:
        """("go" | "slow" | "stop", why): what section 5 makes a planner do, whatever its way."""
        if self.poll_only:
            return "stop", "a receiver that only asks keeps no map"
        if self.too_many_cells:
            return "stop", f"the window has {self.too_many_cells} cells, too many for this receiver"
        if self.differs:
            return "stop", "the map is not the sender's"
        return advice_for(self.pose, self.blank, self.stale(now_s), self.suspect)

    def allowed_mps(self, now_s: float) -> tuple[float, float]:
        """How fast the robot may go straight ahead and back, besides what `advice` says.

        From the newest stop zone, which speaks of both: a robot before a wall can back off.
        """
        return allowed_mps(self.stop_zone, now_s)

    # Bytes in

    def begin_stream(self) -> None:
        """A new connection: what was begun on the one before has no end."""
        self._deframer = Deframer()

    def feed_stream(self, now_s: float, data: bytes) -> None:
        """Bytes from a serial line, cut anywhere; now_s: when they arrived."""
        for frame in self._deframer.feed(data):
            if frame is None:
                self.rejected["cobs"] += 1
            else:
                self.feed_datagram(now_s, frame)

    def feed_datagram(self, now_s: float, data: bytes) -> bool:
        """One frame, without COBS; now_s: when it arrived. Whether it was taken."""
        frame = frame_from_bytes(data)
        if isinstance(frame, str):
            self.rejected[frame] += 1
            return False
        before, reason = self.numbers.taken, self._take(now_s, frame)
        if reason:
            self.rejected[reason] += 1
        return self.numbers.taken > before

    def note(self, now_s: float, frame: Frame) -> None:
        """Called with each frame that is taken; for those who measure."""

    # Section 5: which frames count

    def _take(self, now_s: float, frame: Frame) -> str:
        """Checks a frame, then lets it act; gives the reason if it is rejected."""
        if ACK <= frame.type <= EXTERNAL_POSE:  # goes to the sender: an echo, also of our own
            self.ignored_types += 1
            return ""
        geom = maybe_geometry(frame.body) if frame.type == GEOM else None
        if self._key is not None and not self._is_genuine(self._key, frame, geom):
            self.auth_failed = True
            return "tag"
        self.auth_failed = False
        begins = geom is not None and (self.geom is None or geom.session != self.geom.session)
        anew = self.numbers.is_after_silence(frame)
        if not begins and not self.numbers.is_newer(frame, keyed=self._key is not None):
            self.repeated += 1
            return ""
        foreign = frame.type == MAP and self._is_foreign(frame.body)
        body = geom or (None if foreign else self._maybe_body(now_s, frame))
        if body is None and not foreign and frame.type in MEANT:
            return "body"
        if anew and not begins:
            self._map.forget()
            self.numbers.gap = None
        self.numbers.count(now_s, frame, begins or anew)
        self.accepted[frame.type] += 1
        if foreign:
            self.ignored_maps += 1
            self.need_geom = True
        else:
            self._act(now_s, frame, body, begins)
        self.note(now_s, frame)
        return ""

    def _is_genuine(self, key: bytes, frame: Frame, geom: Geometry | None) -> bool:
        """A GEOM names its own session; one that was left may not come back."""
        known = geom or self.geom
        if known is None or not frame.flags & AUTH or known.session in self._left_sessions:
            return False
        return tag_is_right(frame, key, known.session, self.nonce)

    def _is_foreign(self, body: bytes) -> bool:
        """A MAP frame of a geometry that is not ours."""
        geom_id = maybe_map_geometry(body)
        return geom_id is not None and (self.geom is None or geom_id != self.geom.geom_id)

    def _maybe_body(self, now_s: float, frame: Frame) -> Body:
        if frame.type == MAP:
            return maybe_map_update(frame.body, self._map.size)
        if frame.type == POSE:
            return maybe_pose(frame.body, frame.t_ms, now_s)
        if frame.type == STOP_ZONE:
            return maybe_stop_zone(frame.body, frame.t_ms, now_s)
        if frame.type == TILE:
            return maybe_tile_piece(frame.body)
        return maybe_digest(frame.body) if frame.type == DIGEST else None

    def _act(self, now_s: float, frame: Frame, body: Body, begins: bool) -> None:
        match body:
            case MapUpdate():
                self._apply(now_s, body)
            case Pose():
                self.pose = body
            case Geometry():
                self._adopt(body, begins)
            case StopZone():
                self.stop_zone = body
            case TilePiece():
                self.tiles.take(now_s, body, frame.t_ms)
            case Digest():
                self._compare(body)
            case None:
                self.ignored_types += 1

    # Section 4: the map

    def _adopt(self, geom: Geometry, begins: bool) -> None:
        """A geometry that does not fit ends the old one all the same: no map under a wrong one."""
        old, self.geom, self.need_geom, self.too_many_cells = self.geom, geom, False, 0
        if begins:
            self.pose = self.stop_zone = None  # of another run of the sender
            self._map_s = -math.inf
            self.tiles.begin_anew()
            if old is not None:
                self._left_sessions.append(old.session)
        if geom.width * geom.height > self.max_cells:
            self.too_many_cells = geom.width * geom.height
            self.geom = None
        layout = (geom.geom_id, geom.width, geom.height, geom.cell_m)
        if begins or old is None or layout != (old.geom_id, old.width, old.height, old.cell_m):
            self.need_full = self.differs = self.digest_ok = False
            self._map = CellMap(geom.width, geom.height) if self.geom else CellMap(0, 0)
            self.numbers.gap = None

    def _apply(self, now_s: float, update: MapUpdate) -> None:
        if self._map.move(update.ox, update.oy, self._expected_origin()):
            self.numbers.gap = None
        self.numbers.repair(update.repaired)
        self._map.apply(update)
        self._map_s = now_s

    def _expected_origin(self) -> tuple[int, int]:
        """About where a window lies with the robot in its middle; MAP tells it modulo 65 536."""
        if self.geom is None or self.pose is None:
            return 0, 0
        i, j = (math.floor(part / self.geom.cell_m) for part in (self.pose.x_m, self.pose.y_m))
        return i - self.geom.width // 2, j - self.geom.height // 2

    def _compare(self, digest: Digest) -> None:
        """A difference that no gap explains can only be mended by a new epoch."""
        known = self.geom is not None and digest.geom_id == self.geom.geom_id
        compares = known and not self.suspect and not self.blank
        self.digest_ok = compares and self.digest() == digest.crc
        if compares:
            self.differs = not self.digest_ok
            self.need_full = self.differs
