"""The truth of a run: what the robot touched, what it went over, how it moved. 50 times a second.

A collision is any overlap of the robot's footprint with something solid that rises 0.15 m or more
above the ground on which it stands and begins below its height; with a person; or with
ground 0.15 m or more below. Glass is solid, grass and the like are not. Something that lasts is
counted once. Who or what comes to a robot that has stood for half a second is counted apart.

It knows nothing of the app: the same judge serves a loop on a simulated clock, and the processes of
the live rig. Map frame, whose origin and x axis are those of the robot's start; seconds since then.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from fakes.scenes.scene import Scene
from fakes.world.rig import AnyWorld
from fakes.world.world import World
from tools.rig.truth.contact import (
    NOTHING,
    USUAL,
    Footprint,
    Ground,
    Near,
    Place,
    Plane,
    box_gap,
    disc_gap,
    parts_of,
    plane_under,
)

F64 = npt.NDArray[np.float64]
RATE_HZ = 50
FROM_M = DROP_M = 0.14  # 0.15 m; the plane under a body that nods lies a centimetre off
STANDING_MPS, STANDING_RADPS = 0.02, 0.03
STOOD_S = 0.5  # a robot that has stood so long bumps into nobody
DRIVING_MPS = 0.05
AGAIN_S = 1.0  # out of touch for so long, and it is another contact
LOOK_M = 2.0  # how far gaps are told
WHOLE_TURN = 2 * math.pi
NOBODY = np.zeros((0, 3))


@dataclass(frozen=True, slots=True)
class Contact:
    """One contact, told once."""

    at_s: float
    kind: str  # "thing", "drop" or "person"
    what: str
    x_m: float  # of the robot
    y_m: float
    speed_mps: float  # of the robot

    def words(self) -> str:
        return (
            f"{self.what} at {self.at_s:.1f} s, robot at ({self.x_m:.2f}, {self.y_m:.2f}) m "
            f"with {self.speed_mps:.2f} m/s"
        )


class Truth(Struct, frozen=True):
    """The body at an instant, and the people around it."""

    since_s: float
    place: Place
    height_m: float = 0.0  # of the body's origin
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    people: F64 | None = None  # (n, 3) x, y, radius


def truth_of(world: AnyWorld, since_s: float) -> Truth:
    x, y, yaw, pitch_rad, roll_rad = world.pose()
    people = world.people() if isinstance(world, World) else None
    return Truth(since_s, (x, y, yaw), world.height_m(), pitch_rad, roll_rad, people)


class Judge:
    """One run in one scene; `step` with each truth, in order."""

    def __init__(self, scene: Scene, footprint: Footprint = USUAL) -> None:
        self.scene, self.ground = scene, Ground(scene, footprint)
        self.collisions: list[Contact] = []  # that count
        self.bumps: list[Contact] = []  # that came to a robot that stood
        self.v_mps = self.w_radps = 0.0  # how it truly moves: forward, counter-clockwise
        self.driven_m = self.stands_s = 0.0  # way of the axle's middle; how long it has stood
        self.least_gap_m, self.nearest = math.inf, ""  # while it drove; inf: nothing within 2 m
        self.truth = Truth(0.0, (0.0, 0.0, 0.0))
        self._touched: dict[str, float] = {}  # what, and when last
        self._began = False

    @property
    def plane(self) -> Plane:
        now = self.truth
        return plane_under(now.place, now.height_m, now.pitch_rad, now.roll_rad)

    @property
    def _speed_mps(self) -> float:
        """Of its fastest point, at most."""
        return abs(self.v_mps) + self.ground.footprint.reach_m * abs(self.w_radps)

    @property
    def is_driving(self) -> bool:
        return self._speed_mps > DRIVING_MPS

    def step(self, truth: Truth) -> None:
        if self._began:
            self._move(truth)
        self.truth, self._began = truth, True
        plane = self.plane
        for near in (
            self.ground.nearest(truth.place, plane, FROM_M, LOOK_M),
            self.nearest_mover(FROM_M),
        ):
            self._note(near, "thing")
        self._note(self.nearest_person(), "person")
        found = self.ground.at_outline(truth.place, plane, DROP_M)
        if found:
            self._touch("drop" if found == "a drop" else "thing", found)

    def _move(self, truth: Truth) -> None:
        passed_s = truth.since_s - self.truth.since_s
        if passed_s <= 0.0:
            return
        (x0, y0, yaw0), (x1, y1, yaw1) = self.truth.place, truth.place
        self.driven_m += math.hypot(x1 - x0, y1 - y0)
        middle = (yaw0 + yaw1) / 2
        along_m = (x1 - x0) * math.cos(middle) + (y1 - y0) * math.sin(middle)
        self.v_mps = along_m / passed_s
        turn_rad = (yaw1 - yaw0 + math.pi) % WHOLE_TURN - math.pi
        self.w_radps = turn_rad / passed_s
        stands = abs(self.v_mps) < STANDING_MPS and abs(self.w_radps) < STANDING_RADPS
        self.stands_s = self.stands_s + passed_s if stands else 0.0

    def _note(self, near: Near, kind: str) -> None:
        if near.gap_m < 0.0:
            self._touch(kind, near.what)
        elif self.is_driving and near.gap_m < self.least_gap_m:
            self.least_gap_m, self.nearest = near.gap_m, near.what

    def _touch(self, kind: str, what: str) -> None:
        now_s, (x, y, _) = self.truth.since_s, self.truth.place
        before_s = self._touched.get(what, -math.inf)
        self._touched[what] = now_s
        if now_s - before_s < AGAIN_S:
            return
        contact = Contact(now_s, kind, what, x, y, self._speed_mps)
        comes = kind == "person" or any(mover.name == what for mover in self.scene.movers)
        (self.bumps if comes and self.stands_s >= STOOD_S else self.collisions).append(contact)

    def nearest_mover(self, from_m: float, place: Place | None = None) -> Near:
        """The nearest part, where it is now, of what moves by a timetable."""
        place, best, plane = place or self.truth.place, NOTHING, self.plane
        rect, height_m = self.ground.footprint.rect, self.ground.footprint.height_m
        for mover in self.scene.movers:
            for part in parts_of(mover, self.truth.since_s):
                low_m, high_m = part[-2:]
                if high_m - plane.z < from_m or low_m - plane.z >= height_m:
                    continue
                if len(part) == 6:
                    gap_m = box_gap(place, rect, (part[0], part[1], part[2], part[3]))
                else:
                    gap_m = disc_gap(place, rect, part[0], part[1], part[2])
                if gap_m < min(best.gap_m, LOOK_M):
                    best = Near(gap_m, mover.name)
        return best

    def nearest_person(self, place: Place | None = None) -> Near:
        """The nearest of those who see where they walk."""
        place, best = place or self.truth.place, NOTHING
        people = NOBODY if self.truth.people is None else self.truth.people
        for number, (x, y, radius_m) in enumerate(people.tolist()):
            gap_m = disc_gap(place, self.ground.footprint.rect, x, y, radius_m)
            if gap_m < min(best.gap_m, LOOK_M):
                best = Near(gap_m, f"person {number + 1}")
        return best
