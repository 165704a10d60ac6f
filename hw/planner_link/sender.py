"""The sender of the planner link: map, pose and health to one planner under a byte budget.

Every cell operation is absolute, so a lost frame spoils nothing that comes later; what it carried
is sent again, when an ACK shows the gap or when the rolling refresh passes by. While an input is
not to be trusted, free cells are published as unknown. A tick's frames go out together or not at
all: there is never a queue of outdated frames. A planner that only asks gets answers alone.
Source: planner link, sections 2 to 8.
"""

import math
from dataclasses import dataclass

from core.records import ObstacleMap, PoseReport, StopZoneReport
from hw.device import BadFrame, Port
from hw.planner_link.answers import Answers, AnswerSource
from hw.planner_link.frames import (
    DIGEST,
    DIGEST_BODY,
    DRIVE,
    EXTERNAL_POSE,
    GEOM,
    POSE,
    STOP_ZONE,
    FrameInput,
    Secret,
    encode_digest,
    encode_geom,
    encode_pose,
    encode_stop_zone,
)
from hw.planner_link.map_frames import SLICE_BODY, MapPublisher
from hw.planner_link.messages import (
    ASK_GEOM,
    ASK_POSE,
    ASK_ZONE,
    NEED_FULL,
    NEED_GEOM,
    Ack,
    Ask,
    Drive,
    External,
    Hello,
    decode_answer,
    is_kind,
)
from hw.planner_link.peer import Peer
from hw.planner_link.published import PublishedMap
from hw.planner_link.recovery import MOST_LAG, Repair
from hw.planner_link.requests import ExternalPoses, Requests
from hw.planner_link.scheduler import FrameScheduler
from hw.planner_link.vectors import Vectors, VectorSource

GEOM_EVERY_S = 1.0
DIGEST_EVERY_S = 1.0
ZONE_EVERY_S = 0.1
NEED_FULL_EVERY_S = 0.25
ROUNDING_S = 1e-6  # by so much a period may seem too short
UNHEARD_S = 5.0  # of a planner on datagrams that only asks: it may not know where we are


@dataclass(frozen=True, slots=True)
class Wire:
    """One receiver's wire, and what may come over it."""

    port: Port
    line_baud: int | None  # None: it has no such thing (UDP, TCP)
    drive_refusal: str  # why nobody may drive over it, as a message; "" if one may
    pose_refusal: str = "no external poses are taken here"  # likewise of external poses


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSettings:
    """What all links of one run have in common."""

    size: int  # cells along an edge of the window
    cell_mm: int
    tick_s: float  # nominal period of MAP frames
    stale_ms: int
    key: bytes | None = None
    push: bool = True  # False: nothing is sent but what is asked for
    first_seq: int = 1  # number of a link's first frame


@dataclass(slots=True)
class State:
    """What the next tick has to do besides what comes by itself, and what happened last, when."""

    geom_due: bool
    epoch_due: bool = False  # both ends are to start from unknown
    wanted: int = 0  # bits of ASK
    epoch: int = -1  # of the window; other than any
    geom_s: float = -math.inf
    called_s: float = -math.inf
    digest_s: float = -math.inf
    full_s: float = -math.inf  # NEED_FULL was obeyed
    zone_s: float = -math.inf
    zone: tuple[int, int] = (-1, -1)  # state and causes that were sent
    heard_s: float | None = None  # a valid frame, or the first poll less UNHEARD_S
    polled_s: float = -math.inf
    is_open: bool = False  # at that poll


@dataclass(slots=True)
class LinkCounters:
    """What happened since the start, for the log."""

    acks: int = 0
    answers_rejected: int = 0  # bytes from the planner that were no valid frame
    rejected_because: str = ""  # the newest of them
    ticks_held: int = 0  # in which nothing went out: the wire was not open, or still full


class PlannerLink:
    """One planner on one port."""

    def __init__(
        self,
        wire: Wire,
        settings: LinkSettings,
        session: int,
        requests: Requests,
        external_poses: ExternalPoses,
        number: int,
    ) -> None:
        """`number`: which of a run's links it is."""
        self.wire, self._settings, self._number = wire, settings, number
        self.requests, self.external_poses = requests, external_poses
        self.session, key = session, settings.key
        cells = settings.size**2
        self.peer = Peer(cells=cells, push=settings.push, has_key=key is not None)
        self._input = FrameInput(wire.port)
        self._scheduler = FrameScheduler(
            wire.port, wire.line_baud, settings.tick_s, self._secret, SLICE_BODY, settings.first_seq
        )
        self._map = PublishedMap(settings.size)
        self._repair = Repair(self._map, settings.first_seq - 1)
        self._publisher = MapPublisher(self._scheduler, self._map, self._repair, session % 256)
        self._answers = Answers(self._scheduler, settings.cell_mm)
        self._vectors = Vectors(self._scheduler)
        self._state, self.counters = State(geom_due=settings.push), LinkCounters()

    @property
    def geom_id(self) -> int:
        """Number of the present epoch; after a restart of mapod hardly the same."""
        return self._publisher.geom_id

    @property
    def frames_sent(self) -> int:
        return self._scheduler.frames_sent

    @property
    def frames_lost(self) -> int:
        """MAP frames that ACKs have shown to be lost."""
        return self._repair.frames_lost

    def heard(self, now_s: float) -> bool:
        """Whether the planner has sent a valid frame within the last second."""
        return self._state.heard_s is not None and now_s - self._state.heard_s < 1.0

    def restart(self, session: int) -> None:
        """Go on as another run does, under a new session: also who only asks hears of it."""
        self.session = session
        self._scheduler.secret = self._secret
        self.peer.begin_session()
        self._state.epoch_due = self._state.geom_due = True

    @property
    def _secret(self) -> Secret | None:
        key = self._settings.key
        return Secret(key, self.session, self.peer.nonce) if key else None

    # What the planner says

    def poll(self, now_s: float) -> bool:
        """Move the port on, and take what the planner says; True while the port is open."""
        state = self._state
        state.polled_s, state.is_open = now_s, self.wire.port.poll(now_s)
        if state.heard_s is None:
            state.heard_s = now_s - UNHEARD_S
        for frame in self._input.read():
            self._take(now_s, frame)
        return state.is_open

    def _take(self, now_s: float, frame: bytes | BadFrame) -> None:
        if isinstance(frame, BadFrame):
            self._reject(frame.reason)
            return
        answer = decode_answer(frame, self._scheduler.secret)
        if isinstance(answer, BadFrame):
            self._reject(answer.reason)
            for kind, counted in ((DRIVE, self.requests), (EXTERNAL_POSE, self.external_poses)):
                if is_kind(frame, kind):
                    counted.refuse(answer.reason)
            return
        self._state.heard_s = now_s
        if not self.peer.proven and not isinstance(answer, Hello) and self.peer.prove():
            self._state.epoch_due = True
        match answer:
            case Ack():
                self._take_ack(now_s, answer)
            case Hello():
                self._take_hello(now_s, answer)
            case Ask() if not self.peer.take(now_s, answer):
                self._reject("an ASK that is older than the newest frame, or a repetition")
            case Ask():
                self._state.geom_due |= self._state.geom_s == -math.inf  # it may know another run
                self._state.wanted |= answer.wants
                self._answers.take(answer)
                self._vectors.take(answer.wants)
            case Drive():
                self.peer.take(now_s, answer)
                self.requests.take(now_s, answer, self.wire.drive_refusal, self._number)
            case External():
                self.peer.take(now_s, answer)
                self.external_poses.take(now_s, answer, self.wire.pose_refusal)

    def _reject(self, reason: str) -> None:
        self.counters.answers_rejected += 1
        self.counters.rejected_because = reason

    def _take_hello(self, now_s: float, hello: Hello) -> None:
        if self.peer.take_hello(now_s, hello):
            self._answers.forget()
            self._scheduler.secret = self._secret
            self._state.epoch_due = True
        self._scheduler.limit(self.peer.max_frame)
        self._state.geom_due = True

    def _take_ack(self, now_s: float, ack: Ack) -> None:
        if not self.peer.take_ack(now_s, ack):
            return
        self.counters.acks += 1
        if self.peer.polled and self.peer.end_polling():
            self._state.epoch_due = True
        newest = self._scheduler.maybe_sent(ack.last_seq, ack.echo_t_ms)
        if newest is not None and newest < self._repair.epoch_seq:
            return  # of another epoch: it says nothing of what is on its way now
        if newest is None:
            if ack.status & NEED_GEOM and not self.peer.polled:
                self._state.geom_due, self._repair.in_step = True, False
            return
        if self.peer.polled:
            return
        is_full_due = now_s - self._state.full_s >= NEED_FULL_EVERY_S
        if ack.status & NEED_FULL and ack.geom_id == self.geom_id and is_full_due:
            self._state.full_s, self._state.epoch_due = now_s, True
        elif not self._repair.take(newest, ack, self.geom_id):
            self._state.geom_due = True
        else:
            if self._repair.begun_again:
                self._vectors.tell_again()
            self._vectors.take_ack(newest, ack)

    def _begin_epoch(self, now_s: float) -> None:
        self._state.epoch_due = False
        self._state.geom_due |= not self.peer.polled
        # not soon after a GEOM that some have missed
        self._state.digest_s = now_s - DIGEST_EVERY_S / 2
        if self.peer.polled:
            self._map.put_away()
        self._publisher.begin_epoch()
        self._vectors.begin_epoch(self.geom_id)

    # What is published

    def step(
        self,
        now_s: float,
        pose: PoseReport,
        window: ObstacleMap,
        zone: StopZoneReport | None = None,
        tiles: AnswerSource | None = None,
        vectors: VectorSource | None = None,
    ) -> None:
        """One tick: take answers, if not taken yet, then write what the line has room for."""
        state, peer, scheduler = self._state, self.peer, self._scheduler
        is_open = state.is_open if now_s == state.polled_s else self.poll(now_s)
        lags = not peer.polled and scheduler.seq - self._repair.repaired > MOST_LAG
        if state.epoch_due or lags or window.epoch != state.epoch:
            state.epoch = window.epoch
            self._begin_epoch(now_s)
        if not peer.polled:
            self._publisher.follow(window)
        dt_s = scheduler.earn(now_s)
        if not is_open or scheduler.is_full:
            self.counters.ticks_held += 1
            return
        self._publish_state(now_s, pose, zone)
        if peer.polled:
            told = None if peer.refusal else window
            if told is not None:
                self._vectors.publish(now_s, scheduler.budget.credit, vectors, pushes=False)
            self._answers.publish(scheduler.budget.credit, told, self.geom_id, tiles)
        elif not peer.refusal:
            self._publisher.publish_changes()
            left = scheduler.budget.credit - scheduler.budget.saved
            self._vectors.publish(now_s, left, vectors, pushes=True)
            self._publish_rest(now_s, dt_s, window, tiles)
        state.wanted = 0
        scheduler.write(now_s)

    def _publish_state(self, now_s: float, pose: PoseReport, zone: StopZoneReport | None) -> None:
        settings, state, peer = self._settings, self._state, self.peer
        pushes, wanted = not peer.polled, state.wanted
        calls = not pushes and self._calls_out(now_s)
        due = pushes and now_s - state.geom_s >= GEOM_EVERY_S - ROUNDING_S
        if (state.geom_due or due or calls or wanted & ASK_GEOM) and not peer.refusal:
            state.geom_due, state.geom_s = False, now_s
            geom = (self.geom_id, settings.size, settings.cell_mm, self.session)
            self._scheduler.queue(GEOM, encode_geom(*geom, settings.tick_s, settings.stale_ms))
            self._repair.note_geom(self._scheduler.seq)
        if pushes or wanted & ASK_POSE or (calls and peer.refusal):
            self._scheduler.queue(POSE, encode_pose(pose))
        if zone is None:
            return
        due = now_s - state.zone_s >= ZONE_EVERY_S - ROUNDING_S
        new = state.zone != (zone.state, zone.causes)
        if (pushes and (due or new)) or wanted & ASK_ZONE:
            state.zone_s, state.zone = now_s, (zone.state, zone.causes)
            self._scheduler.queue(STOP_ZONE, encode_stop_zone(zone))

    def _calls_out(self, now_s: float) -> bool:
        """Whether a planner that only asks is to be shown where we are."""
        state = self._state
        if not self.wire.port.datagrams or state.heard_s is None:
            return False
        calls = now_s - state.heard_s >= UNHEARD_S - ROUNDING_S
        calls &= now_s - state.called_s >= GEOM_EVERY_S - ROUNDING_S
        state.called_s = now_s if calls else state.called_s
        return calls

    def _publish_rest(
        self, now_s: float, dt_s: float, window: ObstacleMap, tiles: AnswerSource | None
    ) -> None:
        """What was asked for, the refresh of the map, and its digest."""
        scheduler, budget = self._scheduler, self._scheduler.budget
        spare = budget.credit - budget.tick_bytes
        if self._answers.waiting:
            left = budget.credit - budget.saved - budget.tick_bytes / 2
            self._answers.publish(left, window, self.geom_id, tiles)
            spare = 0.0
        self._publisher.refresh(dt_s, spare)
        if now_s - self._state.digest_s < DIGEST_EVERY_S - ROUNDING_S:
            return
        is_known = self._map.lost == 0 and self._repair.repaired >= self._repair.epoch_seq
        if is_known and budget.credit >= scheduler.costs[DIGEST_BODY.size]:
            self._state.digest_s = now_s
            scheduler.queue(DIGEST, encode_digest(self.geom_id, self._map.digest()))
