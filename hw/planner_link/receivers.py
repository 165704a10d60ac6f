"""All receivers of the planner link at once: one map for them, and one question of who drives.

Each link has its own numbers, epoch, budget and repair (`PlannerLink`). Drive requests, external
poses and the memory of who has sent what are common: while the request of one commander is valid,
no other one drives, by whatever wire; anybody may stop.
Source: planner link, sections 3, 7 and 9 (docs/planner-link.md).
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from core.records import ExternalPose, ObstacleWindow, PoseReport, StopZoneReport
from hw.device import Port
from hw.planner_link.poses import ExternalPoses
from hw.planner_link.replay_guard import Commanders
from hw.planner_link.requests import ELSEWHERE, Requests
from hw.planner_link.sender import PlannerLink
from hw.planner_link.tiles import TileSource


@dataclass(frozen=True, slots=True)
class Wire:
    """One receiver's wire, and what may come over it."""

    port: Port
    line_baud: int | None  # None: it has no such thing (UDP, TCP)
    drive_refusal: str  # why nobody may drive over it, in words; "" if one may
    pose_refusal: str  # likewise of external poses


class Planners:
    """The planner links of one run of mapod, in the order of their wires."""

    def __init__(
        self,
        wires: Sequence[Wire],
        *,
        size: int,
        cell_mm: int,
        session: int,
        tick_s: float,
        stale_ms: int,
        key: bytes | None = None,
        push: bool = True,
    ) -> None:
        """`push`: False: nothing is sent but what is asked for."""
        self.session, self._era = session, -1
        commanders = Commanders(session)
        self.requests = Requests(session, "", commanders)
        self.external_poses = ExternalPoses(commanders)
        self.links = [
            PlannerLink(
                wire.port,
                size=size,
                cell_mm=cell_mm,
                session=session,
                tick_s=tick_s,
                line_baud=wire.line_baud,
                key=key,
                stale_ms=stale_ms,
                drive_refusal=wire.drive_refusal,
                pose_refusal=wire.pose_refusal,
                push=push,
                shared=(self.requests, self.external_poses),
                number=number,
            )
            for number, wire in enumerate(wires)
        ]

    def poll(self, now_s: float) -> None:
        """Move all ports on, and take what the planners say."""
        for link in self.links:
            link.poll(now_s)

    def step(
        self,
        now_s: float,
        pose: PoseReport,
        window: ObstacleWindow,
        zone: StopZoneReport | None,
        tiles: TileSource | None,
    ) -> None:
        """One tick of all links; `window.changed` is what changed since the last one."""
        self._renew(now_s)
        for link in self.links:
            link.step(now_s, pose, window, zone, tiles)

    def _renew(self, now_s: float) -> None:
        """A new session, for all, before the frames' clock wraps (49 days)."""
        era, before = round(now_s * 1000) // 2**32, self._era
        self._era = era
        if before in (-1, era):
            return
        old = self.session.to_bytes(4, "little")
        self.session = int.from_bytes(hashlib.blake2s(old, digest_size=4).digest(), "little")
        self.requests.restart(self.session)
        for link in self.links:
            link.restart(self.session)

    def heard(self, now_s: float) -> bool:
        """Whether any planner has sent a valid frame within the last second."""
        return any(link.heard(now_s) for link in self.links)

    def take_external_poses(self) -> list[ExternalPose]:
        """Those that counted since the last call, from whatever link."""
        return self.external_poses.take_all()

    @property
    def doubt(self) -> str:
        """Why no request should be obeyed, in words.

        Any planner that stopped is a reason. A wire that is not open is one while the request came
        by it, or while there is no other.
        """
        for link in self.links:
            if link.stopped:
                return "the planner says it stopped"
        if self.requests.driver and self.requests.way == ELSEWHERE:
            return ""
        if self.requests.driver:
            return self.links[self.requests.way].port.cause
        return "" if any(not link.port.cause for link in self.links) else self._causes

    @property
    def _causes(self) -> str:
        return self.links[0].port.cause if self.links else ""

    @property
    def frames_sent(self) -> int:
        """To all planners, since the start."""
        return sum(link.frames_sent for link in self.links)

    @property
    def bytes_sent(self) -> int:
        """To all planners, since the start."""
        return sum(link.bytes_sent for link in self.links)

    @property
    def frames_lost(self) -> int:
        """MAP frames that ACKs have shown to be lost."""
        return sum(link.frames_lost for link in self.links)

    @property
    def ticks_held(self) -> int:
        """Ticks in which a link sent nothing: its wire was not open, or still full."""
        return sum(link.ticks_held for link in self.links)

    @property
    def answers_rejected(self) -> int:
        """Bytes from planners that were no valid frames."""
        return sum(link.answers_rejected for link in self.links)
