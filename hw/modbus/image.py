"""`RegisterImage`: all registers of one run of mapod, and the frozen views of its obstacle window.

A read is one indivisible copy. The window takes many reads: a *view* keeps one map until its owner
latches the next by reading register 1000 or writing 90, so no reader mixes two maps. While
nothing is published, or the map is not to be trusted, no cell says free, and what was frozen
before that is not told any more.
Time is an argument; nothing here waits.
"""

import math
import struct
from dataclasses import dataclass

from core.records import ObstacleMap, PoseReport, StopZoneReport
from hw.modbus.drive import Ask, DriveRegisters
from hw.modbus.layout import (
    COARSE,
    DRIVE,
    DRIVE_BLOCK,
    DRIVE_REQUEST,
    LATCH,
    LOW_END,
    WINDOW,
    Answer,
    Refusal,
    age_ms,
)
from hw.modbus.status import STALE_S, Published, Status
from hw.modbus.window import Packer, Snapshot

PACK_S = 0.1  # the window is packed no more often, but at once when trust in it is lost
VIEW_S = 60.0  # a map frozen longer ago is not told any more
WORD = struct.Struct(">H")
SLACK_S = 1e-6
ALL_HZ, ALL_BURST = 1200.0, 200.0  # requests of all clients, whatever port they come by


def next_generation(generation: int) -> int:
    """One more, modulo 65536, without 0.

    >>> next_generation(0), next_generation(65535)
    (1, 1)
    """
    return generation % 0xFFFF + 1


class TokenBucket:
    """Places at a pace, first come, first served: so many a second, and a burst after a rest."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        self._each_s, self._burst_s = 1.0 / rate_hz, burst / rate_hz
        self._booked_s = -math.inf  # up to when all is given away

    def book(self, now_s: float) -> float:
        """Take the next place; how long until it comes."""
        self._booked_s = max(self._booked_s, now_s - self._burst_s) + self._each_s
        return max(0.0, self._booked_s - now_s)


@dataclass(slots=True, eq=False)
class View:
    """One reader's own frozen map; changed by nothing but its latch."""

    held: Snapshot | None = None  # None: nothing was frozen yet


class RegisterImage:
    """The registers; `publish` fills them, `read` and `write` serve them."""

    def __init__(
        self, *, size: int, cell_mm: int, session: int, version: str, ask: Ask | None = None
    ) -> None:
        """An image of a window of size x size cells; without `ask` it has no drive registers."""
        self._packer = Packer(size, cell_mm)
        self._status = Status(session, version, self._packer)
        self.version = version
        self.drive = DriveRegisters(ask) if ask is not None else None
        self.pace = TokenBucket(ALL_HZ, ALL_BURST)
        self._said = Published()
        self._live = self._packer.blank
        self._generation = 0  # of the newest map
        self._epoch: int | None = None
        self._trusted = False  # as in the newest map
        self._broken_s = -math.inf  # what was frozen before is not trusted any more
        self._views: list[View] = []

    def new_view(self) -> View:
        self._views.append(View())
        return self._views[-1]

    def publish(
        self,
        now_s: float,
        pose: PoseReport,
        zone: StopZoneReport,
        window: ObstacleMap,
        *,
        planner_heard: bool = False,
        driven: tuple[float, float] = (0.0, 0.0),
        sigma_m: float = math.inf,
        sigma_rad: float = math.inf,
    ) -> None:
        """Take over how things are now; `driven` (m/s, rad/s) is what the motors are told to."""
        generation = next_generation(self._said.generation)
        fell_silent = now_s - self._said.at_s > STALE_S
        self._said = Published(now_s, generation, pose, zone, planner_heard, sigma_m, sigma_rad)
        if self.drive is not None:
            self.drive.driven = driven
        lost = self._trusted and not window.trusted
        since_s = now_s - self._live.taken_s
        if lost or fell_silent or window.epoch != self._epoch:
            self._broken_s = now_s
        if lost or window.epoch != self._epoch or not 0.0 <= since_s < PACK_S - SLACK_S:
            self._take_map(now_s, window, pose)

    def _take_map(self, now_s: float, window: ObstacleMap, pose: PoseReport) -> None:
        in_use = [self._live, *(view.held for view in self._views if view.held is not None)]
        self._generation = next_generation(self._generation)
        self._live = self._packer.pack(now_s, window, pose, self._generation, in_use)
        self._epoch, self._trusted = window.epoch, window.trusted

    def _newest(self, now_s: float) -> Snapshot:
        """The map that may be told now; the blank one if mapod has fallen silent."""
        return self._live if now_s - self._said.at_s <= STALE_S else self._packer.blank

    def read(
        self, now_s: float, view: View | None, first: int, count: int, utc_s: float = 0.0
    ) -> Answer:
        """Registers first..first+count as bytes; `view` None reads the newest map."""
        if not self.can_read(first, count):
            return Refusal.ADDRESS
        end = first + count
        if end <= LOW_END:
            return self._low(now_s, view, utc_s)[2 * first : 2 * end]
        if self.drive is not None and first < WINDOW:
            return self.drive.pack(now_s)[2 * (first - DRIVE) : 2 * (end - DRIVE)]
        return self._window(now_s, view, first, end)

    def can_read(self, first: int, count: int) -> bool:
        end = first + count
        drives = self.drive is not None and first >= DRIVE and end <= DRIVE + DRIVE_BLOCK.size
        in_window = WINDOW <= first <= end <= WINDOW + self._packer.block.size
        return end <= LOW_END or drives or in_window

    def _low(self, now_s: float, view: View | None, utc_s: float) -> bytes:
        """Status, latch and coarse map; what lies between reads 0."""
        newest = self._newest(now_s)
        status = self._status.pack(now_s, utc_s, self._said, newest)
        held = newest if view is None else view.held
        low = bytearray(2 * LOW_END)
        low[: len(status)] = status
        WORD.pack_into(low, 2 * LATCH, held.generation if held is not None else 0)
        low[2 * COARSE :] = newest.coarse.data
        WORD.pack_into(low, 2 * (COARSE + 1), age_ms(now_s - newest.scan_s))
        return bytes(low)

    def _window(self, now_s: float, view: View | None, first: int, end: int) -> Answer:
        """Of the window block; reading its first register on a view latches the newest map."""
        held = self._newest(now_s)
        if view is not None:
            if first == WINDOW or view.held is None:
                view.held = held
            held = view.held
            if held.generation and not self._may_tell(now_s, held):
                return Refusal.BUSY
        data = held.window[2 * (first - WINDOW) : 2 * (end - WINDOW)].tobytes()
        if first <= WINDOW + 1 < end:
            at = 2 * (WINDOW + 1 - first)
            return data[:at] + WORD.pack(age_ms(now_s - held.scan_s)) + data[at + 2 :]
        return data

    def _may_tell(self, now_s: float, held: Snapshot) -> bool:
        """Whether what was frozen may still be read: not for ever, and not once trust was lost."""
        silent = now_s - self._said.at_s > STALE_S
        young = 0.0 <= now_s - held.taken_s <= VIEW_S
        return young and not silent and held.taken_s >= self._broken_s

    def write(
        self,
        now_s: float,
        arrived_s: float,
        view: View | None,
        who: str,
        first: int,
        words: list[int],
    ) -> Refusal:
        """Take written registers; nothing but the latch and, where enabled, the drive request."""
        if first == LATCH and len(words) == 1:
            if view is not None:
                view.held = self._newest(now_s)
            return Refusal.NONE
        end = first + len(words)
        if self.drive is not None and first < DRIVE + DRIVE_REQUEST and end > DRIVE:
            return self.drive.write(now_s, arrived_s, who, first, words)
        return Refusal.ADDRESS
