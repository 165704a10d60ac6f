"""Cleaning beside the loop: what frames saw and where the machine was, put together when asked.

One thread alone works with the plan; others hand over views and places, which wait until then. It
reads no clock.
Source: docs/coverage.md, "In the app".
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import shapely
from msgspec.structs import replace
from shapely import Polygon

from core.coverage_settings import CoverageSettings
from core.paths.cleaning.cleaning import Cleaning, CleaningSettings, Task
from core.paths.cleaning.planned import Place, Planned
from core.paths.cleaning.things import Thing, new_thing, outlines, thing_of, walls
from core.paths.records import Machine
from core.records import F64, FloorView, PassingThing, PathSegment

MOST_WAITING = 4096  # views or places; the oldest go first
NEAR_M = 2.5  # things that a frame may lay on floor which was seen
BARRED_S = 20.0  # for so long a place that barred the way counts as a thing
LOOK_EVERY_S = 0.5  # whether what is looked for has been seen is asked so often
TURN_M = 0.04  # of a path whose end means a direction alone


class Request(NamedTuple):
    """What the app wants of the plan now."""

    t_s: float
    epoch: int
    place: Place
    wants: str  # "": nothing but what the views change; "new": a plan; "other": the way is barred
    barred: tuple[float, float, float] | None  # x, y and edge of a cell that bars the way, metres
    rest: F64  # (n, 2) what is ahead of the path that it sweeps along; else (0, 2)


class LiveCleaning:
    """The cleaning of one floor, by a machine whose app goes on meanwhile."""

    def __init__(self, settings: CoverageSettings, start_clear_m: float) -> None:
        """`start_clear_m`: so far before the dock somebody has looked at the floor."""
        self._settings, self._start_clear_m = settings, start_clear_m
        self._cleaning = self._begun()
        self._views: deque[FloorView] = deque(maxlen=MOST_WAITING)
        self._ways: deque[tuple[Place, Place, bool]] = deque(maxlen=MOST_WAITING)
        self._standing: list[Thing] = []  # of the map of objects, walls too
        self._passing: tuple[PassingThing, ...] = ()  # of the newest view
        self._barred: deque[tuple[float, Polygon]] = deque()  # until when
        self._task, self._looked_s = Task("wait"), -math.inf

    def _begun(self) -> Cleaning:
        s = self._settings
        dock = s.dock_x_m, s.dock_y_m, math.radians(s.dock_yaw_deg)
        return Cleaning(cleaning_settings(s, self._start_clear_m), dock)

    def see(self, view: FloorView) -> None:
        """A frame has told this; any thread."""
        self._views.append(view)

    def drive(self, begin: Place, end: Place, sweeps: bool) -> None:
        """The machine has gone there; any thread."""
        self._ways.append((begin, end, sweeps))

    def step(self, asked: Request) -> Planned | None:
        """Take in all that waits; another task, if one is asked for or has become due."""
        while self._ways:
            self._cleaning.drive(*self._ways.popleft())
        while self._views:
            self._take(self._views.popleft(), asked.place)
        if asked.barred is not None:
            x, y, edge_m = asked.barred
            half = edge_m / 2
            cell = shapely.box(x - half, y - half, x + half, y + half)
            self._barred.append((asked.t_s + BARRED_S, cell))
        while self._barred and self._barred[0][0] < asked.t_s:
            self._barred.popleft()
        if asked.wants:
            may_look = asked.wants == "new" or self._task.goal == "look"
            return self._planned(asked, may_look)
        return self._planned(asked, True) if self._is_seen(asked) else None

    def _take(self, view: FloorView, place: Place) -> None:
        if view.standing is not None:
            self._standing = [thing_of(one.outline_m, one.seen) for one in view.standing]
            self._standing += walls(view.walls_m)
        self._passing, here = view.passing, shapely.Point(place[:2])
        around = {one.id for one in view.passing if Polygon(one.outline_m).contains(here)}
        mine = [one for one in view.passing if one.id in around]
        new = [one for one in mine if one.is_seen and not one.is_moving]
        passing = [
            replace(one, is_seen=one.is_seen and one.id not in around) for one in view.passing
        ]
        known = _rims(self._standing + self._barring() + _new(new), here)
        near = [one for one in outlines(known) if one.dwithin(here, NEAR_M)]
        self._cleaning.see(view.view_m, near, passing)

    def _barring(self) -> list[Thing]:
        return [new_thing(cell) for _, cell in self._barred]

    def _things(self, here: shapely.Point) -> list[Thing]:
        """All that stands or passes, and places that barred the way."""
        return _rims(self._standing + _new(self._passing) + self._barring(), here)

    def _is_seen(self, asked: Request) -> bool:
        """Whether what it goes to look at has been seen on the way."""
        at = self._task.viewpoint
        if at is None or asked.t_s - self._looked_s < LOOK_EVERY_S:
            return False
        self._looked_s = asked.t_s
        things = self._things(shapely.Point(asked.place[:2]))
        return not self._cleaning.is_frontier(at.block, things)

    def _planned(self, asked: Request, may_look: bool) -> Planned:
        things = self._things(shapely.Point(asked.place[:2]))
        old, is_barred = np.vstack([[asked.place[:2]], asked.rest]), asked.wants == "other"
        task = self._task = self._cleaning.plan(asked.place, things, may_look, old, is_barred)
        self._looked_s = asked.t_s
        told = [PathSegment(one.kind == "sweep", one.points) for one in task.segments]
        seen_m2, clean_m2 = self._cleaning.floor.area_m2, self._cleaning.clean.area_m2
        whole = _from_here(told, asked.place, task)
        return Planned(asked.t_s, asked.epoch, task.goal, task.why, whole, seen_m2, clean_m2)

    def warm(self) -> None:
        """Run every kernel once, so that none is compiled while a robot drives."""
        cleaning, here = self._begun(), self._settings
        x, y = here.dock_x_m, here.dock_y_m
        room = shapely.box(x - 1.6, y - 1.6, x + 1.6, y + 1.6)
        corners: F64 = shapely.get_coordinates(room.exterior)[:-1]
        for _ in range(here.seen_frames):
            cleaning.see(corners, [])
        wall = Thing(shapely.box(x + 1.5, y - 1.5, x + 1.6, y + 1.5))
        for _ in range(3):
            cleaning.plan((x, y, 0.0), [wall], may_look=True)
        cleaning.plan((x, y, 0.0), [wall], may_look=False)


def cleaning_settings(s: CoverageSettings, start_clear_m: float) -> CleaningSettings:
    """The settings as `Cleaning` wants them."""
    machine = Machine(
        radius_m=s.radius_m, clearance_m=s.clearance_m, width_m=s.width_m, overlap_m=s.overlap_m
    )
    return CleaningSettings(
        machine=machine, cell_m=s.cell_m, size_m=s.size_m, seen_frames=s.seen_frames,
        start_clear_m=start_clear_m, guard_m=s.guard_m, explained_m=s.explained_m,
        sliver_m=s.sliver_m, enough=s.enough, enough_lively=s.enough_lively, rounds=s.rounds,
        tries=s.tries,
    )  # fmt: skip


def _new(passing: Iterable[PassingThing]) -> list[Thing]:
    return [new_thing(one.outline_m) for one in passing]


def _rims(things: list[Thing], here: shapely.Point) -> list[Thing]:
    """The same; of what surrounds the machine, a row of walls, its rim."""
    solid = [one for one in things if not one.outline.contains(here)]
    around = [one for one in outlines(things) if one.contains(here)]
    rings = [shapely.get_coordinates(one.exterior) for one in around]
    return solid + [side for ring in rings for side in walls(np.hstack([ring[:-1], ring[1:]]))]


def _from_here(told: list[PathSegment], place: Place, task: Task) -> tuple[PathSegment, ...]:
    """The path from where the machine is; a direction at its end is a short edge that way."""
    here = np.array([place[:2]])
    if told and math.dist(place[:2], told[0].points_m[0]) > TURN_M / 2:
        told = [PathSegment(False, np.vstack([here, told[0].points_m[:1]])), *told]
    if task.yaw is not None and task.goal != "home":
        end = told[-1].points_m[-1:] if told else here
        off = TURN_M * np.array([[math.cos(task.yaw), math.sin(task.yaw)]])
        told = [*told, PathSegment(False, np.vstack([end, end + off]))]
    return tuple(told)
