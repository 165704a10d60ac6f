"""Cleaning a floor that nobody knows: look at it, sweep it, sweep what is left, go home.

What is free is what was seen and where no thing is known; nothing else gets a path. A plan is made
anew from what is clean and what is free now, never from a place in the old one. It drives nothing
and reads no clock: whoever drives says where the machine is, what it sees and when to plan.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from core.paths.cleaning.free_floor import NO_PLACE, FreeFloor
from core.paths.cleaning.frontiers import (
    FEW_CELLS,
    GRAZING_M,
    LEAST_CELLS,
    Block,
    Point,
    Viewpoint,
    block_square,
    frontier_blocks,
    next_viewpoint,
)
from core.paths.cleaning.parted import between, nearer, parted_off
from core.paths.cleaning.seen_floor import MOST, Doubt, SeenFloor
from core.paths.cleaning.swept_floor import SweptFloor
from core.paths.cleaning.things import Thing, outlines
from core.paths.coverage.plan import FIRST, LAST, plan_coverage, space_at
from core.paths.geometry.space import FloorError, grown, opened, polygons_in
from core.paths.geometry.visibility import VisibilityGraph
from core.paths.records import Machine, Segment
from core.records import F64, PassingThing

Goal = Literal["look", "sweep", "home", "wait", "done", "stuck"]
Place = tuple[float, float, float]  # x, y, yaw
LOOKS = 2  # at one frontier, at most: what is still unseen is seen while sweeping, or never
LOOKS_MOST, MOVED_M = 6, 0.15  # at one whose middle has moved by that since: it was seen in part
AT_M = 0.25  # from the dock, or from where it was to look: it is there
TURN_RAD = math.pi / 2  # by which it turns to look at what cuts it off
ARC = 16  # corners of the machine's outline
WON_M2 = 0.1  # of floor, seen or clean: less is no progress
BESIDE = 1.0 + math.sqrt(2.0)  # cells from what stands: each frame takes them away (`see`)
AHEAD_M = 0.04  # of the tool: where it is in the next instants
MUCH = 0.1  # of the floor: while more is left, what costs a long way is left for later
LIVELY = 3  # moving things, after which people are about: one may be a tracking error
DIRT_M2 = 0.005  # that is not clean: so little is left at the borders of bands
CLEAR_M = 0.08  # around the machine, that is clear where it starts,
LANE_CLEAR_M = 0.2  # and beside it on the way before the dock
BARRED_M = 1.5  # where it was barred: so near it cannot look (`frontiers.NEAR_M`, and its size)
PARTED_M2 = 1.0  # of unswept floor that something parts off: with less it goes home
GAP_LOOKS = 8  # at what parts it off, until it sweeps all that is left where it is


@dataclass(frozen=True, slots=True, kw_only=True)
class CleaningSettings:
    """How a machine cleans."""

    machine: Machine
    cell_m: float  # of seen and of clean floor
    size_m: float  # edge of the square around the start that is known at most
    seen_frames: int  # so often a cell must be seen to be free
    start_clear_m: float  # so far before the dock somebody has looked at the floor
    guard_m: float  # kept from the outlines of things, besides the machine's clearance
    explained_m: float  # unseen floor so near to a thing or a wall is no reason to look
    sliver_m: float  # what is left unswept and narrower gets no lane
    enough: float  # share of the floor that may be left at the end
    enough_lively: float  # the same where people are about: LIVELY
    rounds: int  # plans for what is left, at most, besides those round what barred the way
    tries: int  # plans in a row that win no floor, until it gives up


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What to drive next."""

    goal: Goal
    segments: tuple[Segment, ...] = ()
    yaw: float | None = None  # to turn to at the end
    viewpoint: Viewpoint | None = None
    why: str = ""  # of what waits, looks at what parts it off, or is stuck


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where the machine may be at a moment."""

    place: Place  # where it is
    things: list[Thing]
    free: BaseGeometry  # floor for its outline
    space: Polygon  # for its middle, as far as it gets from there
    beyond: MultiPolygon  # for its middle, but with no way from there
    graph: VisibilityGraph  # of the space

    def way(self, goal: tuple[float, float]) -> F64 | None:
        """To a goal, by way of the nearest places where it has room."""
        ends = [shapely.Point(self.place[:2]), shapely.Point(goal)]
        a, b = (shapely.get_coordinates(shapely.shortest_line(self.space, end))[0] for end in ends)
        way = self.graph.way(a, b)
        return None if way is None else np.vstack([[self.place[:2]], way])

    def bars(self) -> BaseGeometry:
        """What hides the floor behind it."""
        known = outlines(self.things)
        return shapely.union_all([one.buffer(GRAZING_M, quad_segs=2) for one in known])


class Cleaning:
    """One floor, from the dock and back to it."""

    def __init__(self, settings: CleaningSettings, dock: Place) -> None:
        s = self.settings = settings
        self._dock = dock
        at = dock[0], dock[1]
        self.floor = SeenFloor(at, s.size_m, s.cell_m, s.seen_frames)
        self.clean = SweptFloor(at, s.size_m, s.cell_m)
        lane = np.array([[0.0, -1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 1.0]])
        lane *= [s.start_clear_m, s.machine.radius_m + LANE_CLEAR_M]
        c, sin = math.cos(dock[2]), math.sin(dock[2])
        self.floor.vouch(lane @ np.array([[c, sin], [-sin, c]]) + at)
        self.floor.vouch(disc(at, s.machine.radius_m + CLEAR_M))
        self._looks, self._looks_in_all = Counter[Block](), Counter[Block]()  # at frontiers
        self._looked_at: dict[Block, tuple[float, float]] = {}
        self._doubts = dict[int, list[Doubt]]()  # by what is new: of floor below it
        self._rounds = self._tried = 0
        # Of paths that something parted off: a door opens again, and a path made anew beside the
        # ragged border of what was swept is longer than the rest of one that was made for all.
        self._path_beyond: F64 = np.empty((0, 2))
        self._gaps = list[Point]()  # where it looked, since it swept, at what parts floor off
        self._won_m2 = 0.0
        self._viewpoint: Viewpoint | None = None  # of the last task
        self._moved = set[int]()  # what was told to move

    def see(
        self, view: F64, standing: Iterable[Polygon], passing: Iterable[PassingThing] = ()
    ) -> None:
        """A frame's view (n, 2), and all near the machine that is known to stand or to move.

        Floor that somebody walks over stays as it was, also before he was seen to move.

        Args:
            standing: what the map has there.
            passing: all that is new or moves.
        """
        self.floor.add(view)
        for one in standing:
            self.floor.doubt(_outline(one.buffer(self.settings.cell_m)))
        doubts = dict[int, list[Doubt]]()
        for new in passing:
            mine = self._doubts.get(new.id, [])
            if new.is_moving:
                self._moved.add(new.id)
                for doubt in mine:
                    self.floor.restore(doubt)
                continue
            doubts[new.id] = mine
            if new.is_seen:
                wide = Polygon(new.outline_m).buffer(self.settings.cell_m)
                stays = len(mine) >= self.settings.seen_frames - 1
                doubt = self.floor.doubt(_outline(wide), stays)
                if len(mine) < MOST:  # by then there is nothing left to take
                    mine.append(doubt)
        self._doubts = doubts

    def drive(self, begin: Place, end: Place, sweeps: bool) -> None:
        """The machine has gone there: no thing stands where it stands."""
        machine = self.settings.machine
        self.floor.vouch(disc(end[:2], machine.radius_m))
        if sweeps:
            line = shapely.LineString([begin[:2], end[:2]]) if begin[:2] != end[:2] else None
            band = shapely.Point(end[:2]) if line is None else line
            self.clean.add(_outline(band.buffer(machine.width_m / 2)))

    def has_work(self, place: Place) -> bool:
        """Whether a tool that goes ahead there sweeps floor that is not clean yet."""
        x, y, yaw = place
        at = x + AHEAD_M * math.cos(yaw), y + AHEAD_M * math.sin(yaw)
        tool = disc(at, self.settings.machine.width_m / 2)
        return self.clean.count_below(tool) * self.settings.cell_m**2 > DIRT_M2

    def plan(
        self, place: Place, things: Sequence[Thing], may_look: bool, old: F64 | None = None,
        is_barred: bool = False,
    ) -> Task:  # fmt: skip
        """What to drive next; `stuck`, and why, when so many plans in a row have won nothing.

        Behind a third of them it looks no more, behind half of them it goes home. A look at a
        frontier that it came to is none of them: what one hides tells of no other, and each has a
        count.

        Args:
            things: all that is known to stand or to move, walls too.
            may_look: False: something barred the way; go on as before, whatever is unseen.
            old: what is left of the path (n, 2) that it sweeps along.
            is_barred: something bars its way, maybe floor that it does not see.
        """
        won_m2 = self.floor.area_m2 + self.clean.area_m2
        self._tried += not self._has_looked(place)
        if won_m2 > self._won_m2 + WON_M2:
            self._tried, self._won_m2 = 0, won_m2
        may_look = may_look and self._tried < self.settings.tries // 3
        barred = shapely.Point(place[:2]).buffer(BARRED_M) if is_barred else NO_PLACE
        task = self._next(place, things, may_look, old, barred)
        self._viewpoint = task.viewpoint
        if self._tried < self.settings.tries:
            return task
        return Task("stuck", why=task.why or f"the way is barred again and again, to {task.goal}")

    def _has_looked(self, place: Place) -> bool:
        """Whether it came to where it was to look."""
        at = self._viewpoint
        return at is not None and math.dist(place[:2], at.place) < AT_M

    def _next(
        self, place: Place, things: Sequence[Thing], may_look: bool, old: F64 | None,
        barred: BaseGeometry,
    ) -> Task:  # fmt: skip
        there, machine = FreeFloor(self.floor, things), self.settings.machine
        self.floor.explain(there.gaps())
        try:
            free = there.area(self.settings.guard_m, machine.radius_m, barred)
            space = space_at(MultiPolygon(polygons_in(free)), machine, place[:2])
        except FloorError:
            return Task("wait", why="the machine has no room where it stands")
        beyond = parted_off(free, machine, space)
        places = Places(place, list(things), free, space, beyond, VisibilityGraph(space))
        if may_look and (task := self._look(places)) is not None:
            return task
        is_off = space.distance(shapely.Point(self._dock[:2])) > AT_M
        waits_m2 = self._waiting_m2(places, is_off)
        path = self._path_beyond if old is None else np.vstack([old, self._path_beyond])
        is_beyond = nearer(path, beyond, space)
        task = self._sweep(places, waits_m2, path[~is_beyond], may_look)
        self._path_beyond = path if task is None else path[is_beyond]
        if task is not None:
            self._gaps.clear()
            return task
        if is_off:
            return self._look_at_gap(places, "something parts it from the dock")
        if waits_m2 > 0.0:
            return self._look_at_gap(places, "floor that was seen is parted off")
        way = places.way(self._dock[:2])
        if way is None:
            return Task("wait", why="there is no way to the dock")
        return Task("home", (Segment("travel", way),), self._dock[2])

    def frontiers(self, things: Sequence[Thing]) -> set[Block]:
        """Names of the frontiers that there are."""
        return set(self._blocks(things))

    def is_frontier(self, block: Block, things: Sequence[Thing]) -> bool:
        """Whether one of them is, by the things near it."""
        square, far_m = block_square(self.floor, block), self.settings.explained_m
        return block in self._blocks([one for one in things if one.outline.dwithin(square, far_m)])

    def _blocks(self, things: Sequence[Thing]) -> dict[Block, tuple[float, float]]:
        """Middles of frontiers; behind the first sweep of smaller ones too, which bar its way."""
        known = outlines(things)
        near, there = (
            self.floor.mask_of([one.buffer(far_m) for one in known])
            for far_m in (self.settings.explained_m, BESIDE * self.settings.cell_m)
        )
        least = FEW_CELLS if self._rounds > 0 else LEAST_CELLS
        return frontier_blocks(self.floor, near, there, least)

    def _look(self, places: Places) -> Task | None:
        blocks = self._blocks(places.things)
        left = {name: at for name, at in blocks.items() if self._is_worth_a_look(name, at)}
        seen_from = next_viewpoint(left, places.space, places.bars(), places.place)
        if seen_from is None:
            return None
        self._looks[seen_from.block] += 1
        self._looks_in_all[seen_from.block] += 1
        self._looked_at[seen_from.block] = seen_from.frontier
        way = places.way(seen_from.place)
        if way is None:
            return self._look(places)
        return Task("look", (Segment("travel", way),), _towards(seen_from), seen_from)

    def _is_worth_a_look(self, name: Block, at: tuple[float, float]) -> bool:
        if math.dist(at, self._looked_at.get(name, at)) > MOVED_M:
            self._looks[name] = 0
        return self._looks[name] < LOOKS and self._looks_in_all[name] < LOOKS_MOST

    def _work(self, free: BaseGeometry, space: BaseGeometry) -> tuple[BaseGeometry, BaseGeometry]:
        """Floor that the tool gets to from there, and what of it is not clean but for slivers."""
        target = grown(space, self.settings.machine.width_m / 2).intersection(free)
        left = target.difference(self.clean.area())
        return target, opened(left, self.settings.sliver_m / 2)

    def _waiting_m2(self, places: Places, is_off: bool) -> float:
        """Unswept floor that is parted off, as long as there are looks left at what does it.

        Args:
            is_off: from the dock, too.
        """
        unswept_m2 = self._work(places.free, places.beyond)[1].area
        if unswept_m2 < PARTED_M2:
            if not is_off:
                self._gaps.clear()  # nothing is parted off: what comes is something else
            return 0.0
        return unswept_m2 if len(self._gaps) < GAP_LOOKS else 0.0

    def _sweep(self, places: Places, waits_m2: float, old: F64, is_round: bool) -> Task | None:
        """What is left, but for what costs a long way while much is left, here or parted off."""
        s = self.settings
        target, left = self._work(places.free, places.space)
        is_vain = self._tried >= s.tries // 2  # what is left of its tries is for the way home
        enough = s.enough_lively if len(self._moved) >= LIVELY else s.enough
        # A plan while floor waits is no round, but the first one lets small frontiers count.
        rounds = max(1, self._rounds) if waits_m2 > 0.0 else self._rounds + is_round
        if rounds > s.rounds:
            self._rounds = rounds  # for good: plans round what bars its way home are none either
        if is_vain or rounds > s.rounds or left.area <= enough * target.area:
            return None
        try:
            prices = LAST if left.area + waits_m2 < MUCH * target.area else FIRST
            plan = plan_coverage(
                places.free, s.machine, places.place[:2], self._dock[:2],
                clean=target.difference(left), old=old, prices=prices,
            )  # fmt: skip
        except FloorError:
            return None
        if not any(segment.kind == "sweep" for segment in plan.segments):
            return None
        self._rounds = rounds
        return Task("sweep", plan.segments)

    def _look_at_gap(self, places: Places, why: str) -> Task:
        """At what parts floor off: it may be gone. Each second time it turns on the spot instead.

        What it has looked at most seldom comes first, the nearest of that; what a map holds counts
        as looked at once more.
        """
        near_m = self.settings.machine.margin_m + self.settings.explained_m
        ranks = {
            at: sum(math.dist(at, one) < AT_M for one in self._gaps) + (not is_new)
            for at, is_new in between(places.things, places.space, places.beyond, near_m)
        }
        least = min(ranks.values(), default=0)
        gaps = {(k, 0): at for k, (at, rank) in enumerate(ranks.items()) if rank == least}
        has_turned = not self._gaps or math.dist(self._gaps[-1], places.place[:2]) < AT_M
        seen_from = next_viewpoint(gaps, places.space, places.bars(), places.place)
        way = None if seen_from is None or not has_turned else places.way(seen_from.place)
        if seen_from is None or way is None:
            self._gaps.append(places.place[:2])
            return Task("look", (), places.place[2] + TURN_RAD, why=why)
        self._gaps.append(seen_from.frontier)
        return Task("look", (Segment("travel", way),), _towards(seen_from), why=why)


def _towards(seen_from: Viewpoint) -> float:
    (x, y), (at_x, at_y) = seen_from.place, seen_from.frontier
    return math.atan2(at_y - y, at_x - x)


def disc(at: Sequence[float], radius_m: float) -> F64:
    """A round outline (n, 2), within the true circle."""
    angle = np.arange(ARC) * (math.tau / ARC)
    return np.array(at) + radius_m * np.column_stack([np.cos(angle), np.sin(angle)])


def _outline(polygon: Polygon) -> F64:
    ring: F64 = shapely.get_coordinates(polygon.exterior)[:-1]
    return ring
