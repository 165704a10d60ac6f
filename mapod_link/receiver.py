"""A receiver of the planner link: bytes in; map, pose and stop zone out, and what it answers.

It refuses every frame that section 5 refuses, and such a frame changes nothing but counters. It
opens nothing and reads no clock: time comes with each call, in seconds of any clock that never goes
back, and what is to be sent comes out of `poll`.
Source: planner link, sections 3 to 6 and 9.
"""

import math
from collections import Counter

from mapod_link import asking
from mapod_link.bodies import (
    Body,
    Digest,
    Geometry,
    MapUpdate,
    Pose,
    StopZone,
    maybe_body,
    maybe_map_geometry,
)
from mapod_link.cell_map import U8, CellMap
from mapod_link.counting import Ignored, Numbers
from mapod_link.frames import (
    ACK,
    ASK,
    DRIVE,
    EXTERNAL_POSE,
    GEOM,
    HELLO,
    MAP,
    SCAN,
    Frame,
    Outbox,
    frame_from_bytes,
)
from mapod_link.scans import ScanPiece, SweepPoints
from mapod_link.serial_line import Deframer, serial_from_frame
from mapod_link.tiles import DEAF_S, MOST_CELLS, Tile, TilePiece, Tiles
from mapod_link.vectors import ObjectsPiece, PathPiece, Vectors

HELLO_PERIOD_S = 0.25
NOTHING_S = 1e-6  # of rounding, where ticks and periods agree


class Receiver:
    """A planner's end of the link, without its wire. Nothing raises on bytes.

    Args:
        nonce: random, 1 to 2^32 - 1, drawn at each start; 0 where there is no return path.
        key: 32 bytes: frames without a valid tag are dropped, answers are signed. None: no tags.
        ack_every: accepted frames per ACK; 0 sends nothing at all (a link without a return path).
        ack_period_s: an ACK at least so often.
        max_cells: of the largest window that it takes.
        poll_only: keep no map; push nothing, for all is asked for.

    Raises:
        ValueError: not such a nonce, a key or a number of cells.

    Attributes:
        geom: newest geometry; None until one has arrived that this receiver can hold.
        pose, stop_zone: newest; None until one has arrived in this run of the sender.
        stopped: PLANNER_STOPPED in each ACK: the sender moves nothing while it is set.
        accepted: frames taken, by type. rejected: frames refused, by reason.
        ignored: how many frames were left alone. numbers: which frames have arrived.
        needs: what is not as it should be with the map here. vectors: objects and the path.
    """

    def __init__(
        self,
        nonce: int,
        *,
        key: bytes | None = None,
        ack_every: int = 16,
        ack_period_s: float = 0.1,
        max_cells: int = MOST_CELLS,
        poll_only: bool = False,
    ) -> None:
        for name, number in (("nonce", nonce), ("max_cells", max_cells)):
            if not 0 <= number < 2**32:
                raise ValueError(f"{name} must be within 0..{2**32 - 1}, is {number}")
        self.nonce, self.poll_only, self.stopped = nonce, poll_only, False
        self.accepted: Counter[int] = Counter()
        self.rejected: Counter[str] = Counter()
        self.geom: Geometry | None = None
        self.pose: Pose | None = None
        self.stop_zone: StopZone | None = None
        self.numbers, self.ignored, self.needs = Numbers(key), Ignored(), asking.Needs()
        self.tiles, self._map, self._deframer = Tiles(), CellMap(0, 0), Deframer()
        self.vectors = Vectors(self.numbers)
        self._talk = asking.Talk(Outbox(key), ack_every, ack_period_s, max_cells)

    @property
    def cells(self) -> U8:
        """(height, width) read-only view, row-major from `origin`: 0 unknown, 1 free, 2 obstacle.

        Later frames change what it shows; a new geometry has another one.
        """
        return self._map.cells

    def window(self) -> U8:
        """(height, width) copy of all cells."""
        return self._map.cells.copy()

    def cell(self, col: int, row: int) -> int:
        """Of the window; what lies outside is unknown."""
        return self._map.cell(col, row)

    def cell_at(self, x_m: float, y_m: float) -> int:
        """The cell at a place in the map frame; what lies outside of the window is unknown."""
        if self.geom is None or self.origin is None or not math.isfinite(x_m + y_m):
            return 0
        i, j = self.geom.cell_of(x_m, y_m)
        return self._map.cell(i - self.origin[0], j - self.origin[1])

    @property
    def origin(self) -> tuple[int, int] | None:
        """World cell (i, j) of cells[0, 0], which begins at (i, j) * cell_m; None while blank."""
        return self._map.origin

    @property
    def suspect(self) -> bool:
        """A frame is missing that may have changed cells: some cell may be outdated."""
        return self.numbers.gap is not None

    @property
    def blank(self) -> bool:
        """There is no map yet."""
        return self.origin is None

    def stale(self, now_s: float) -> bool:
        """Poses or maps do not arrive in time: nothing that is known may be used."""
        if self.geom is None or self.pose is None:
            return True
        return now_s - min(self.pose.arrived_s, self.numbers.map_s) > self.geom.stale_s

    def advice(self, now_s: float) -> tuple[str, str]:
        """("go" | "slow" | "stop", why): what section 5 makes a planner do, whatever its way."""
        if self.poll_only:
            return "stop", "a receiver that only asks keeps no map"
        if cells := self.needs.too_many_cells:
            return "stop", f"the window has {cells} cells, too many for this receiver"
        if self.needs.full:
            return "stop", "the map is not the sender's"
        if self.pose is None or self.blank:
            return "stop", "no map yet"
        if why := "link stale" if self.stale(now_s) else self.pose.stop_reason():
            return "stop", why
        return ("slow", "a frame is missing") if self.suspect else ("go", "")

    def allowed_mps(self, now_s: float) -> tuple[float, float]:
        """How fast the robot may go straight ahead and back, besides what `advice` says."""
        return self.stop_zone.allowed_mps(now_s) if self.stop_zone else (0.0, 0.0)

    def digest(self) -> int:
        """CRC-32 of the window, as a DIGEST frame tells it."""
        return self._map.digest()

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
        before = self.numbers.taken
        reason = frame if isinstance(frame, str) else self._take(now_s, frame)
        if reason:
            self.rejected[reason] += 1
        return self.numbers.taken > before

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send now, a datagram each; `serial_from_frame` makes them fit a serial line."""
        talk = self._talk
        if not talk.ack_every:
            return []
        # Nobody is known, or whoever sends does not know us: it may have started again
        unheard = now_s - talk.unheard_s > DEAF_S or self.tiles.is_unheard(now_s)
        stranger = self.needs.auth_failed or talk.hello_wanted or unheard
        if (self.geom is None or stranger) and now_s >= talk.hello_due_s:
            talk.hello_due_s, talk.hello_wanted = now_s + HELLO_PERIOD_S, False
            hello = asking.hello_body(self.nonce, talk.max_cells, poll=self.poll_only)
            self._send(now_s, HELLO, hello)
        period_s = talk.ack_period_s / (2 if self.needs.geom or self.needs.full else 1)
        if not self.poll_only and now_s - talk.acked_s >= period_s - NOTHING_S:
            self.acknowledge(now_s)
        if self._may_ask:
            for body in self.tiles.questions(now_s) + self.vectors.questions(now_s):
                self._send(now_s, ASK, body)
        return talk.outbox.take()

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """The receiver on a serial line: what came, and what it sends until now_s."""
        self.feed_stream(now_s, received)
        return b"".join(serial_from_frame(frame) for frame in self.poll(now_s))

    # What may be asked for; all of it goes out with the next poll

    def greet(self) -> None:
        """Say HELLO once more: to a sender that has just been met."""
        self._talk.hello_wanted, self._talk.hello_due_s = True, -math.inf

    def acknowledge(self, now_s: float) -> None:
        """One ACK as of now, besides those that are due; none before the first frame."""
        if self.numbers.any and self._talk.ack_every:
            self._talk.acked_s, self._talk.unacked = now_s, 0
            self._send(now_s, ACK, self.ack(now_s))

    def ask(
        self, now_s: float, *, geometry: bool = False, pose: bool = False, stop_zone: bool = False
    ) -> bool:
        """Ask for what comes with the next tick; False while nobody would listen (see `drive`)."""
        what = asking.ASK_GEOM * geometry | asking.ASK_POSE * pose | asking.ASK_ZONE * stop_zone
        if not what or not self._may_ask:
            return False
        self._talk.asks += 1
        self._send(now_s, ASK, asking.ask_body(self._talk.asks, what))
        return True

    def ask_tile(
        self, layer: str, i: int, j: int, width: int, height: int, *, in_window: bool = False
    ) -> Tile:
        """A rectangle of the sender's map; it fills as `poll` asks and frames are fed.

        Args:
            layer: "class", "height", "variance", "slope", "cause", "age", "z", "edge",
                "foothold", "filled", "filled_sigma" or "foothold_sigma".
            i, j: lowest column and row; of the endless grid (as `origin`), or of the window.
            width, height: cells along map x and y, at most 32 767 along either and 160 801 in all;
                else `ValueError`.
        """
        return self.tiles.ask(layer, (i, j), (height, width), in_window)

    def ask_scan(self) -> None:
        """Ask for the newest sweep, `scan` once it is whole; nothing if that is under way."""
        self.tiles.scans.ask()

    @property
    def scan(self) -> SweepPoints | None:
        """The newest sweep; None before the first, and while the sender trusts none."""
        return self.tiles.scans.newest

    def drive(self, now_s: float, v_mps: float, w_radps: float, valid_s: float) -> bool:
        """Ask the robot to move, forward and counter-clockwise, for up to 1 s; 0 s: stop now.

        To be repeated at least three times within `valid_s`. False: nothing is sent, for the run of
        the sender is not known, or there is no return path. `ValueError`: no frame can tell that.
        """
        if self.geom is None or not self._talk.ack_every:
            return False
        body = asking.drive_body(self.geom.session, self.nonce, v_mps, w_radps, valid_s)
        self._send(now_s, DRIVE, body)
        return True

    def external_pose(
        self,
        now_s: float,
        x_m: float,
        y_m: float,
        yaw_rad: float | None,
        *,
        sigma_x_m: float,
        sigma_y_m: float,
        sigma_yaw_rad: float = 0.0,
        correlation: float = 0.0,
        age_s: float = 0.0,
        upright: asking.Upright | None = None,
    ) -> bool:
        """Tell where a positioning system saw the robot; see `asking.external_body`. As `drive`."""
        if self.geom is None or not self._talk.ack_every:
            return False
        body = asking.external_body(
            self.geom.session, self.nonce, x_m, y_m, yaw_rad,
            sigma_x_m=sigma_x_m, sigma_y_m=sigma_y_m, sigma_yaw_rad=sigma_yaw_rad,
            correlation=correlation, age_s=age_s, upright=upright,
        )  # fmt: skip
        self._send(now_s, EXTERNAL_POSE, body)
        return True

    def ack(self, now_s: float) -> bytes:
        """The body of an ACK as of now."""
        numbers, needs = self.numbers, self.needs
        status = needs.status(self.geom is None, self.stale(now_s), self.suspect, self.stopped)
        newest = numbers.last, numbers.mask, numbers.t_ms, now_s - numbers.counted_s
        geom_id = self.geom.geom_id if self.geom else 0
        return asking.ack_body(*newest, self.rejected.total(), status, geom_id)

    @property
    def _may_ask(self) -> bool:
        """There is a way back; and with a key, a session to sign for."""
        has_session = self._talk.outbox.key is None or self.geom is not None
        return bool(self._talk.ack_every) and has_session

    def _send(self, now_s: float, frame_type: int, body: bytes) -> None:
        session = self.geom.session if self.geom else None
        self._talk.outbox.put(now_s, frame_type, body, session, self.nonce)
        if frame_type == ASK:
            self._talk.unheard_s = min(self._talk.unheard_s, now_s)

    # Section 5: which frames count

    def note(self, now_s: float, frame: Frame) -> None:
        """Called with each frame that is taken; to be extended by those who measure."""
        self._talk.unacked, self._talk.unheard_s = self._talk.unacked + 1, math.inf
        if self._talk.unacked >= self._talk.ack_every > 0 and not self.poll_only:
            self.acknowledge(now_s)
        if frame.type == MAP and self.poll_only:  # a sender that has started since pushes again
            self._talk.hello_wanted = True

    def _take(self, now_s: float, frame: Frame) -> str:
        """Checks a frame, then lets it act; gives the reason if it is rejected."""
        if ACK <= frame.type <= EXTERNAL_POSE:  # goes to the sender: an echo, also of our own
            self.ignored.types += 1
            return ""
        numbers, foreign = self.numbers, self._is_foreign(frame)
        body = None if foreign else maybe_body(frame, now_s, self._map.size)
        geom = body if isinstance(body, Geometry) else None
        self.needs.auth_failed = not numbers.is_genuine(frame, geom or self.geom, self.nonce)
        if self.needs.auth_failed:
            return "tag"
        begins = geom is not None and (self.geom is None or geom.session != self.geom.session)
        anew = numbers.is_after_silence(frame)
        if not begins and not numbers.is_newer(frame):
            self.ignored.repeated += 1
            return ""
        if body is None and not foreign and GEOM <= frame.type <= SCAN:
            return "body"
        if anew and not begins:
            self._map.forget()
            self.vectors.forget()
            numbers.gap = None
        numbers.count(now_s, frame, begins or anew)
        self.accepted[frame.type] += 1
        if foreign:
            self.ignored.maps += 1
            self.needs.geom = True
        else:
            self._act(now_s, frame, body, begins)
        self.note(now_s, frame)
        return ""

    def _is_foreign(self, frame: Frame) -> bool:
        """A MAP frame of a geometry that is not ours."""
        geom_id = maybe_map_geometry(frame.body) if frame.type == MAP else None
        return geom_id is not None and (self.geom is None or geom_id != self.geom.geom_id)

    def _act(self, now_s: float, frame: Frame, body: Body | None, begins: bool) -> None:
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
            case ScanPiece():
                self.tiles.scans.take(now_s, body)
            case Digest():
                self._compare(body)
            case ObjectsPiece() | PathPiece():
                self.vectors.take(now_s, body, frame.t_ms, self.geom)
            case None:
                self.ignored.types += 1
                self.vectors.damage(frame.type)

    # Section 4: the map

    def _adopt(self, geom: Geometry, begins: bool) -> None:
        """A geometry that does not fit ends the old one all the same: no map under a wrong one."""
        old, cells, self.needs.geom = self.geom, geom.width * geom.height, False
        fits = cells <= self._talk.max_cells
        self.geom, self.needs.too_many_cells = (geom, 0) if fits else (None, cells)
        if begins:
            self.pose = self.stop_zone = None  # of another run of the sender
            self.numbers.map_s = -math.inf
            self.tiles.begin_anew()
            if old is not None:
                self.numbers.leave(old.session)
        if begins or old is None or geom.layout != old.layout:
            self.needs.full = self.needs.digest_ok = False
            self._map = CellMap(geom.width, geom.height) if self.geom else CellMap(0, 0)
            self.numbers.gap = None
            self.vectors.forget()

    def _apply(self, now_s: float, update: MapUpdate) -> None:
        corner = self.geom.corner_around(self.pose) if self.geom and self.pose else None
        if self._map.move(update.ox, update.oy, corner):
            self.numbers.gap = None
        self.numbers.repair(update.repaired)
        self._map.apply(update)
        self.numbers.map_s = now_s

    def _compare(self, digest: Digest) -> None:
        """A difference that no gap explains can only be mended by a new epoch."""
        known = self.geom is not None and digest.geom_id == self.geom.geom_id
        compares = known and not self.suspect and not self.blank
        self.needs.digest_ok = compares and self.digest() == digest.crc
        if compares:
            self.needs.full = not self.needs.digest_ok
