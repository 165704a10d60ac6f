"""The sender of the planner link: map, pose and health to one planner under a byte budget.

Every cell operation is absolute, so a lost frame spoils nothing that comes later; what it told is
told again, when an ACK shows the gap or when the rolling refresh passes by. While an input is not
to be trusted, free cells are told as unknown. A tick's frames go out together or not at all: there
is never a queue of outdated frames. A planner that only asks costs nothing but its answers.
Source: planner link, sections 2 to 8 (docs/planner-link.md).
"""

import math

from core.records import ExternalPose, ObstacleWindow, PoseReport, StopZoneReport
from hw.device import BadFrame, Port
from hw.planner_link.frames import (
    DIGEST,
    DIGEST_BODY,
    DRIVE,
    EXTERNAL_POSE,
    GEOM,
    POSE,
    STOP_ZONE,
    Deframer,
    Secret,
    encode_digest,
    encode_geom,
    encode_pose,
    encode_stop_zone,
)
from hw.planner_link.map_frames import SLICE_BODY, MapTeller
from hw.planner_link.messages import (
    ASK_GEOM,
    ASK_POSE,
    ASK_TILE,
    ASK_ZONE,
    DIGEST_OK,
    NEED_FULL,
    NEED_GEOM,
    PLANNER_STOPPED,
    Ack,
    Ask,
    Drive,
    External,
    Hello,
    decode_answer,
    is_kind,
)
from hw.planner_link.poses import ExternalPoses
from hw.planner_link.publisher import MapSender
from hw.planner_link.recovery import Repair
from hw.planner_link.replay_guard import Commanders
from hw.planner_link.requests import Requests
from hw.planner_link.scheduler import Outbox
from hw.planner_link.tiles import NoTiles, Tiles, TileSource

GEOM_EVERY_S = 1.0
DIGEST_EVERY_S = 1.0
ZONE_EVERY_S = 0.1
NEED_FULL_EVERY_S = 0.25
UNHEARD_S = 5.0  # of a planner on datagrams that only asks: it may not know where we are
LEAST_MAX_FRAME = 48  # bytes of a frame that a planner must take to get a map
CLOSE_S = 1e-6  # of rounding, in periods
Shared = tuple[Requests, ExternalPoses]


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
        push: bool = True,
        shared: Shared | None = None,
        number: int = 0,
        first_seq: int = 1,
    ) -> None:
        """`shared`: what all links of a run have in common; `number`: which of them this one is."""
        self.port, self._number, self._push = port, number, push
        self._size, self._cell_mm = size, cell_mm
        self.session, self._tick_s, self._stale_ms = session, tick_s, stale_ms
        self._key, self._nonce = key, 0  # of the planner's newest HELLO
        self._drive_refusal, self._pose_refusal = drive_refusal, pose_refusal
        commanders = Commanders(session)
        own = Requests(session, "", commanders), ExternalPoses(commanders)
        self.requests, self.external_poses = shared or own
        self._outbox = Outbox(
            port,
            line_baud=line_baud,
            tick_s=tick_s,
            secret=self._secret,
            slice_body=SLICE_BODY,
            first_seq=first_seq,
        )
        self._map = MapSender(size)
        self._repair = Repair(self._map, first_seq - 1, strict=key is not None)
        self._teller = MapTeller(self._outbox, self._map, self._repair)
        self._tiles, self._wanted = Tiles(cell_mm), 0  # bits of ASK
        self._deframer = Deframer()
        self.polled = not push  # nothing is pushed
        self.refusal = ""  # why no map is announced, in words
        self._geom_id, self._epoch = session % 256, -1  # after a restart hardly the same number
        self._geom_due, self._epoch_due = push, False
        self._geom_s = self._called_s = self._zone_s = self._full_s = self._digest_s = -math.inf
        self._heard_s: float | None = None  # a valid frame, or the first poll less UNHEARD_S
        self._zone_told = (-1, -1)  # state and causes
        self.acks = self.answers_rejected = self.ticks_held = 0
        self.planner_status = 0  # of the newest ACK
        self.round_trip_s = math.nan

    @property
    def frames_sent(self) -> int:
        """Since the start."""
        return self._outbox.frames_sent

    @property
    def bytes_sent(self) -> int:
        """As they went over the wire, since the start."""
        return self._outbox.bytes_sent

    @property
    def frames_lost(self) -> int:
        """MAP frames that ACKs have shown to be lost."""
        return self._repair.frames_lost

    @property
    def digest_ok(self) -> bool:
        """The planner says that its map agreed with the newest DIGEST."""
        return bool(self.planner_status & DIGEST_OK)

    @property
    def stopped(self) -> bool:
        """The planner says that it stopped."""
        return bool(self.planner_status & PLANNER_STOPPED)

    @property
    def doubt(self) -> str:
        """Why no request of the planner's should be obeyed, in words."""
        return self.port.cause or ("the planner says it stopped" if self.stopped else "")

    def heard(self, now_s: float) -> bool:
        """Whether the planner has sent a valid frame within the last second."""
        return self._heard_s is not None and now_s - self._heard_s < 1.0

    def take_external_poses(self) -> list[ExternalPose]:
        """Those that counted since the last call, each with its instant on the host's clock."""
        return self.external_poses.take_all()

    def restart(self, session: int) -> None:
        """Go on as another run does, under a new session: also who only asks is told."""
        self.session = session
        self._outbox.secret = self._secret
        self._epoch_due = self._geom_due = True

    # What the planner says

    def poll(self, now_s: float) -> bool:
        """Move the port on, and take what the planner says; True while the port is open."""
        is_open = self.port.poll(now_s)
        if self._heard_s is None:
            self._heard_s = now_s - UNHEARD_S
        for piece in self.port.read():
            frames = [piece] if self.port.datagrams else self._deframer.feed(piece)
            for frame in frames:
                self._take(now_s, frame)
        return is_open

    def _take(self, now_s: float, frame: bytes | BadFrame) -> None:
        answer = frame if isinstance(frame, BadFrame) else decode_answer(frame, self._outbox.secret)
        if not isinstance(answer, BadFrame):
            self._heard_s = now_s
        match answer:
            case Ack():
                self._take_ack(now_s, answer)
            case Hello():
                self._take_hello(answer)
            case Ask():
                self._wanted |= answer.wants
                if answer.wants & ASK_TILE:
                    self._tiles.take(answer)
            case Drive():
                self.requests.take(now_s, answer, self._drive_refusal, self._number)
            case External():
                self.external_poses.take(now_s, answer, self._pose_refusal)
            case BadFrame(reason, data):
                self.answers_rejected += 1
                if isinstance(frame, BadFrame):
                    return
                if is_kind(data, DRIVE):
                    self.requests.refuse(reason)
                elif is_kind(data, EXTERNAL_POSE):
                    self.external_poses.refuse(reason)

    @property
    def _secret(self) -> Secret | None:
        return Secret(self._key, self.session, self._nonce) if self._key else None

    def _take_hello(self, hello: Hello) -> None:
        """A planner has started: it holds nothing, and wants to know the geometry."""
        self._outbox.max_frame = hello.max_frame
        refusal = ""
        if hello.max_cells < self._size**2:
            refusal = (
                f"the planner can hold {hello.max_cells} cells, the window has {self._size**2}: "
                "lower obstacle.window_cells"
            )
        elif hello.max_frame < LEAST_MAX_FRAME:
            refusal = f"the planner takes frames of {hello.max_frame} bytes, not of 48"
        polled = hello.polls or not self._push
        if (hello.nonce, refusal, polled) != (self._nonce, self.refusal, self.polled):
            self._nonce, self.refusal, self.polled = hello.nonce, refusal, polled
            if self._key is None:  # else anybody could take back that the planner stopped
                self.planner_status = 0
            self._repair.note_hello(hello.nonce)
            self._tiles.forget()
            self._outbox.secret = self._secret
            self._epoch_due = True
        self._geom_due = True

    def _take_ack(self, now_s: float, ack: Ack) -> None:
        if self._repair.is_late(ack):
            return
        self.acks += 1
        self.planner_status = ack.status
        newest = self._outbox.maybe_sent(ack.last_seq, ack.echo_t_ms)
        if newest is not None and newest < self._repair.epoch_seq:
            return  # of another epoch: it says nothing of what is on its way now
        if newest is None:
            if ack.status & NEED_GEOM and not self.polled:
                self._geom_due, self._repair.in_step = True, False
            return
        round_trip_s = ((round(now_s * 1000) - ack.echo_t_ms) % 2**32) / 1000 - ack.hold_s
        self.round_trip_s = round_trip_s if round_trip_s < 60 else math.nan
        if self.polled:
            return
        is_full_due = now_s - self._full_s >= NEED_FULL_EVERY_S
        if ack.status & NEED_FULL and ack.geom_id == self._geom_id and is_full_due:
            self._full_s, self._epoch_due = now_s, True
        elif not self._repair.take(newest, ack, self._geom_id):
            self._geom_due = True

    def _begin_epoch(self, now_s: float) -> None:
        """New geometry number: both ends start from unknown."""
        self._geom_id, self._epoch_due = (self._geom_id + 1) % 256, False
        self._geom_due |= not self.polled
        self._digest_s = now_s - DIGEST_EVERY_S / 2  # not soon after a GEOM that some have missed
        if self.polled:
            self._map.put_away()
        self._teller.begin_epoch(self._geom_id)

    # What the planner is told

    def step(
        self,
        now_s: float,
        pose: PoseReport,
        window: ObstacleWindow,
        zone: StopZoneReport | None = None,
        tiles: TileSource | None = None,
    ) -> None:
        """One tick: take answers, then write the frames that the line has room for.

        Args:
            zone: None: no STOP_ZONE frame goes out.
            tiles: None: no layer can be asked for.
        """
        is_open = self.poll(now_s)
        lags = not self.polled and self._repair.lags(self._outbox.seq)
        if self._epoch_due or lags or window.epoch != self._epoch:
            self._epoch = window.epoch
            self._begin_epoch(now_s)
        if not self.polled:
            self._teller.follow(window)
        dt_s = self._outbox.earn(now_s)
        if not is_open or self._outbox.is_full:
            self.ticks_held += 1
            return
        self._tell_state(now_s, pose, zone)
        source = tiles or NoTiles()
        if self.polled:
            self._tell_tiles(self._outbox.credit, window, source)
        elif not self.refusal:
            self._tell_map(now_s, dt_s, window, source)
        self._wanted = 0
        self._outbox.write(now_s)

    def _tell_state(self, now_s: float, pose: PoseReport, zone: StopZoneReport | None) -> None:
        """GEOM, POSE and STOP_ZONE, where they are due or asked for."""
        pushes, wanted = not self.polled, self._wanted
        calls = self._calls_out(now_s)
        due = pushes and now_s - self._geom_s >= GEOM_EVERY_S - CLOSE_S
        if not self.refusal and (self._geom_due or due or calls or wanted & ASK_GEOM):
            self._geom_due, self._geom_s = False, now_s
            geom = (self._geom_id, self._size, self._cell_mm, self.session)
            self._outbox.queue(GEOM, encode_geom(*geom, self._tick_s, self._stale_ms))
            self._repair.note_geom(self._outbox.seq)
        if pushes or wanted & ASK_POSE or (calls and self.refusal):
            self._outbox.queue(POSE, encode_pose(pose))
        if zone is None:
            return
        due = now_s - self._zone_s >= ZONE_EVERY_S - CLOSE_S
        new = self._zone_told != (zone.state, zone.causes)
        if (pushes and (due or new)) or wanted & ASK_ZONE:
            self._zone_s, self._zone_told = now_s, (zone.state, zone.causes)
            self._outbox.queue(STOP_ZONE, encode_stop_zone(zone))

    def _calls_out(self, now_s: float) -> bool:
        """Whether a planner that only asks is to be shown where we are."""
        if not self.polled or not self.port.datagrams or self._heard_s is None:
            return False
        unheard = now_s - self._heard_s >= UNHEARD_S - CLOSE_S
        if not unheard or now_s - self._called_s < GEOM_EVERY_S - CLOSE_S:
            return False
        self._called_s = now_s
        return True

    def _tell_map(
        self, now_s: float, dt_s: float, window: ObstacleWindow, source: TileSource
    ) -> None:
        """Changes, tiles, refresh and digest of a planner that is told without asking."""
        outbox = self._outbox
        self._teller.tell_changes()
        spare = outbox.credit - outbox.tick_bytes
        if self._tiles.waiting:
            self._tell_tiles(outbox.credit - outbox.saved - outbox.tick_bytes / 2, window, source)
            spare = 0.0
        self._teller.refresh(dt_s, spare)
        is_known = self._map.lost == 0 and self._repair.repaired >= self._repair.epoch_seq
        due = now_s - self._digest_s >= DIGEST_EVERY_S - CLOSE_S
        if is_known and due and outbox.credit >= outbox.cost(DIGEST_BODY.size):
            self._digest_s = now_s
            outbox.queue(DIGEST, encode_digest(self._geom_id, self._map.digest()))

    def _tell_tiles(self, budget: float, window: ObstacleWindow, source: TileSource) -> None:
        if self._tiles.waiting:
            corner = None if self.refusal else (window.corner_i, window.corner_j)
            self._tiles.tell(self._outbox, budget, corner, window.trusted, self._geom_id, source)
