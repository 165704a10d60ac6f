"""All receivers of the planner link at once: one map for them, and one question of who drives.

Each link has its own numbers, epoch, budget and repair (`PlannerLink`). Drive requests, external
poses and the memory of who has sent what are common: while the request of one commander is valid,
no other one drives, by whatever wire; anybody may stop.
Source: planner link, sections 3, 7 and 9.
"""

import hashlib
from collections.abc import Sequence
from typing import Any

from core.records import ObstacleMap, PoseReport, StopZoneReport
from hw.device import Port
from hw.planner_link.answers import AnswerSource
from hw.planner_link.requests import NO_LINK, ExternalPoses, ReplayGuard, Requests
from hw.planner_link.sender import LinkSettings, PlannerLink, Wire
from hw.planner_link.vectors import VectorSource


class Planners:
    """The planner links of one run of mapod, in the order of their wires."""

    def __init__(self, wires: Sequence[Wire], settings: LinkSettings, session: int) -> None:
        self.session, self._era = session, -1
        self.renewed_because = ""  # why this session is not the run's first one, in words
        self._has_key = settings.key is not None
        guard = self._guard = ReplayGuard(session, has_key=self._has_key)
        asked = self.requests, self.external_poses = Requests(guard), ExternalPoses(guard)
        self.links = [
            PlannerLink(wire, settings, session, *asked, number)
            for number, wire in enumerate(wires)
        ]

    def poll(self, now_s: float) -> None:
        for link in self.links:
            link.poll(now_s)

    def step(
        self,
        now_s: float,
        pose: PoseReport,
        window: ObstacleMap,
        zone: StopZoneReport | None,
        tiles: AnswerSource | None,
        vectors: VectorSource | None = None,
    ) -> None:
        """One tick of all links; `window.changed` is what changed since the last one."""
        era, before = round(now_s * 1000) // 2**32, self._era
        self._era = era
        if self._has_key and self._is_full:
            self._renew("no further commander can be told from a replay")
        elif before not in (-1, era):
            self._renew("the clock of the frames wraps")
        for link in self.links:
            link.step(now_s, pose, window, zone, tiles, vectors)

    def _renew(self, because: str) -> None:
        """A new session, for all: before the frames' clock wraps (49 days), or memory is full."""
        self.renewed_because = because
        old = self.session.to_bytes(4, "little")
        self.session = int.from_bytes(hashlib.blake2s(old, digest_size=4).digest(), "little")
        self._guard.restart(self.session)
        for link in self.links:
            link.restart(self.session)

    @property
    def _is_full(self) -> bool:
        """Whether no further planner or commander can be told from a replay."""
        return self._guard.is_full or any(link.peer.is_full for link in self.links)

    @property
    def backlog(self) -> int:
        """Bytes that wait for a wire to take them, which polling hands over."""
        bytes_left = 0
        for link in self.links:
            bytes_left += link.wire.port.backlog
        return bytes_left

    def heard(self, now_s: float) -> bool:
        """Whether any planner has sent a valid frame within the last second."""
        return any(link.heard(now_s) for link in self.links)

    @property
    def stop_reason(self) -> str:
        """Why no request should be obeyed, as a message.

        Any planner that stopped is a reason. A wire that is not open is one while the request came
        by it, or while there is no other.
        """
        if any(link.peer.stopped for link in self.links):
            return "the planner says it stopped"
        if self.requests.driver:
            driven = self.requests.link
            return "" if driven == NO_LINK else self.links[driven].wire.port.cause
        causes = [link.wire.port.cause for link in self.links]
        return causes[0] if causes and all(causes) else ""

    @property
    def counters(self) -> dict[str, int]:
        """What happened on all links since the start, for the log."""
        links = self.links
        return {
            "frames_sent": sum(link.frames_sent for link in links),
            "frames_lost": sum(link.frames_lost for link in links),
            "answers_rejected": sum(link.counters.answers_rejected for link in links),
            "link_ticks_held": sum(link.counters.ticks_held for link in links),
        }


def one_link(
    port: Port,
    *,
    session: int,
    line_baud: int | None = None,
    drive_refusal: str = "",
    pose_refusal: str = "no external poses are taken here",
    **settings: Any,
) -> PlannerLink:
    """A link by itself, for benches; `settings` as in `LinkSettings`, some with a usual value."""
    known = LinkSettings(**{"cell_mm": 50, "tick_s": 0.02, "stale_ms": 150, **settings})
    wire = Wire(port, line_baud, drive_refusal, pose_refusal)
    return Planners([wire], known, session).links[0]
