"""One hall, cleaned by a simulated machine in closed loop; no app, no wires.

The world's rays make a depth camera's picture, `FrameSteps` make objects of it, `ObjectMap` keeps
them, `Cleaning` plans on what is free, and a follower drives the path through the motor
controller's fake. The machine is told a pose that is wrong by a slow error, and drives by what the
walls of its map say of that. Each run follows from its seed alone, to the bit.
"""

import math
from dataclasses import dataclass, field

import msgspec
import numpy as np
import shapely
from shapely import Polygon

from core.config import Config
from core.objects.frame.steps import CameraPose, FrameSteps
from core.objects.vector_map.newcomers import Obstacle
from core.objects.vector_map.object_map import ObjectMap
from core.paths.cleaning.cleaning import TURN_RAD, Cleaning, CleaningSettings, Place, Task
from core.paths.cleaning.things import WALL_M, Thing, new_thing, outlines, thing_of, walls
from core.paths.geometry.rings import joined
from core.paths.geometry.space import polygons_in
from core.paths.records import Machine
from core.records import F64, DepthCamera, DepthImage, PassingThing
from fakes.ax3500.device import FakeAx3500
from fakes.scenes.halls import Hall
from fakes.visionary.faults import Faults
from fakes.visionary.lens import axis_of, lens_of, ways_of
from fakes.visionary.models import KINDS, Model
from fakes.visionary.picture import Camera
from fakes.world.path_follower import PERIOD_S, Limits, PathFollower
from fakes.world.rolling import RollingWorld
from tools.rig.cleaning.recent_views import RecentViews
from tools.rig.cleaning.truth import HIGH_M, Truth, gap_of
from tools.rig.cleaning.wall_fix import SIGMAS, TIME_S, WallFix

MODEL: Model = "t"  # 176 x 144 pixels, 62 by 52 degrees
FLYING_DEG = 12.0  # of a lens with so few pixels: at 3 degrees what flies less than 0.12 r stays
LEAST_CONFIDENCE = 6554  # as the settings of the app have it
TOP_M = HIGH_M + 0.05  # of what may meet the machine; heights err by some centimetres
FRAME_TICKS = 5  # 4 frames a second
LIMITS = Limits(speed_mps=0.8, accel_mps2=0.6, turn_radps=1.2, turn_accel_radps2=2.5)
MACHINE = Machine(radius_m=0.35, clearance_m=0.035, width_m=0.6, overlap_m=0.01)
REACH_CLEAR_M = 0.08  # from all that stands there: with less room for the machine it is no floor
SETTINGS = CleaningSettings(
    machine=MACHINE, cell_m=0.025, size_m=90.0, seen_frames=3, start_clear_m=1.4, guard_m=0.03,
    explained_m=0.15, sliver_m=0.05, enough=0.002, enough_lively=0.02, rounds=6, tries=24,
)  # fmt: skip
POSE_M, POSE_RAD = 0.01, math.radians(0.2)  # 1 sigma of the told pose
AHEAD_M = 0.9  # of the path that is looked at: the machine stands before what is on it
KEPT_M = MACHINE.margin_m  # from the path, by all that stands: guard_m is for what outlines change
SLACK_M = 0.005
HIDDEN_M = 0.02  # so far before it things are taken for the wall: a voxel, and noise
LAG_S, LAG_M = 0.2, 0.03  # of the way on which it comes to stand, where it heads
ENTERED_M = (0.1, 0.3, 0.5)  # of the path: what its front is about to enter there
VOUCHED_S, BLIND_S = 5.0, 12.0  # without a view over that it creeps; without any it stands
CREEP_MPS = 0.15
BLIND_TURNS = 9  # quarters on the spot in which no frame shows floor, until it gives up
STILL_S, STILL_M, STILL_RAD = 20.0, 0.05, 0.2  # moves less in that time: it plans again
STRAIGHT_M = 0.003  # by which the path that is followed may leave the planned one
HALTED_MPS = 0.02  # slower is standing
WAIT_S = 2.5  # before what passes, until another way is sought
LOOK_S = 1.2  # at a frontier
FIRST_FRAMES = 6  # before it sets out
NEAR_M = 2.5  # things that may be in the way
LIMIT_S = 14400.0  # a hall of 600 m2 takes three hours


@dataclass
class Tally:
    """What one run came to; polygons are the truth's, metres."""

    swept: list[F64] = field(default_factory=list)  # true places (n, 2) with the tool down
    swept_m: float = 0.0
    travel_m: float = 0.0
    collisions: list[str] = field(default_factory=list)  # in words
    least_gap_m: float = math.inf
    frames: int = 0
    doubts: int = 0
    plans: int = 0
    people_seen: int = 0  # frames in which somebody stood well in view
    people_missed: int = 0  # of these: nobody was reported there


class Camcorder:
    """The camera on the machine: pictures of a world as the app gets them."""

    def __init__(self, world: RollingWorld, config: Config, seed: int) -> None:
        kind, mount = KINDS[MODEL], config.depth
        assert mount is not None
        self.faults = faults = Faults(MODEL)
        faults.mount_m = (mount.mount_x_m, mount.mount_y_m, mount.mount_z_m)
        faults.tilt_deg = mount.mount_tilt_deg
        self._lens, self._camera = lens_of(kind, 0), Camera(faults, kind, world.met, seed)
        columns, rows = self._lens.size_px
        rays = ways_of(self._lens, 0.0).reshape(rows, columns, 3) * (kind.unit_mm / 1000.0)
        self._rays = DepthCamera(rays.astype(np.float32), (0.0, 0.0, 0.0))
        self._place = np.array(faults.mount_m) - axis_of(faults.tilt_deg) * kind.away_mm / 1000.0
        self._tilt_rad = math.radians(faults.tilt_deg)
        self._counter = 0

    def image(self, now_s: float) -> DepthImage:
        maps = self._camera.maps(now_s, self._lens)
        self._counter += 1
        numbers = np.where(maps.third >= LEAST_CONFIDENCE, maps.raw, 0).astype(np.uint16)
        return DepthImage(now_s, numbers, self._rays, self._counter, now_s)

    def pose(self, place: Place) -> CameraPose:
        """Where the lens is, of a machine that is told to be at a place."""
        x, y, yaw = place
        c, s = math.cos(yaw), math.sin(yaw)
        cp, sp = math.cos(self._tilt_rad), math.sin(self._tilt_rad)
        T = np.eye(4)
        T[:3, :3] = [[c * cp, -s, c * sp], [s * cp, c, s * sp], [-sp, 0.0, cp]]
        bx, by, bz = self._place.tolist()
        T[:3, 3] = x + c * bx - s * by, y + s * bx + c * by, bz
        return CameraPose(T, 0.01, 0.008, 0.008, float(SIGMAS[0]), float(SIGMAS[2]))


class Drift:
    """The slow error of a pose that something else tells: x, y, yaw."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng([seed, 0xD21F])
        self._off = np.zeros(3)  # exact at the dock, as its mark is known

    def step(self) -> None:
        keep = math.exp(-PERIOD_S / TIME_S)
        sigmas = math.sqrt(1 - keep * keep) * np.array([POSE_M, POSE_M, POSE_RAD])
        self._off = keep * self._off + sigmas * self._random.standard_normal(3)

    def told(self, place: Place) -> Place:
        x, y, yaw = (np.array(place) + self._off).tolist()
        return x, y, yaw


class HallRun:
    """A machine in a hall, tick by tick, until it is back at its dock or gives up."""

    def __init__(self, hall: Hall, config: Config, seed: int) -> None:
        assert config.objects is not None
        assert config.object_map is not None
        objects = msgspec.structs.replace(config.objects, flying_deg=FLYING_DEG, top_m=TOP_M)
        self.hall, self.tally, self.now_s = hall, Tally(), 0.0
        self.world = RollingWorld(hall.scene, seed)
        self.map = ObjectMap(config.object_map)
        self.cleaning = Cleaning(SETTINGS, (0.0, 0.0, 0.0))
        self.task = Task("wait")
        self.obstacles: tuple[Obstacle, ...] = ()
        self._controller = FakeAx3500(self.world, seed, "rc")
        self._follower, self._drift = PathFollower(LIMITS), Drift(seed)
        self.camera, self._steps = Camcorder(self.world, config, seed), FrameSteps(objects)
        self._turns = 0  # on the spot, for floor to be seen
        self._tick, self._at, self._halts = 0, (0.0, 0.0, 0.0), False
        self._fix = WallFix()
        self._barred_s = self._arrived_s = math.inf
        self._version, self._passing = 0, list[Thing]()
        self._checked, self._known = -1, dict[float, list[Thing]]()  # by how thick walls are
        self.truth, self._is_hit = Truth(hall), False
        self._views, self._stood = RecentViews(VOUCHED_S), (0.0, self._at)  # since when, where
        self.world.step_to(0.0)

    @property
    def is_over(self) -> bool:
        return self.task.goal in ("done", "stuck") or self.now_s > LIMIT_S

    def step(self) -> None:
        """One tick."""
        self._tick += 1
        self.now_s = self._tick * PERIOD_S
        before = self.world.place
        self.world.step_to(self.now_s)
        self.truth.moved = self.world.scene.movers
        self._drift.step()
        told = self._drift.told(self.world.place)
        self._fix.step(PERIOD_S)
        place, sweeps = self._by_walls(told), self._sweeps
        self.cleaning.drive(self._at, place, sweeps)
        self._count(before, self.world.place, sweeps)
        self._at = place
        if self._tick % FRAME_TICKS == 0:
            self._look(told)
        may_mps = self._may_mps(place)
        self._go_on(place, is_barred=may_mps == 0.0)
        self._controller.command(*self._follower.power(place, 0.0 if self._halts else may_mps))
        self._controller.exchange(self.now_s, b"")

    # what it sees

    def _by_walls(self, told: Place) -> Place:
        """Where it is by the walls that it saw."""
        x, y, yaw = (np.array(told) + self._fix.off).tolist()
        return x, y, yaw

    def _look(self, pose: Place) -> None:
        image, lens = self.camera.image(self.now_s), self.camera.pose(pose)
        told = self._steps.find(image, lens, self.map.walls.landmarks())
        self.tally.frames += 1
        if told.doubt:
            self.tally.doubts += 1
            return
        if (by := told.correction) is not None:
            self._fix.measure(by, np.array(told.objects.origin) - pose[:2])
        place = self._by_walls(pose)
        update = self.map.update(told.objects)
        self.obstacles, self._version = update.obstacles, update.version
        passing = [
            PassingThing(one.id, one.polygon, one.is_moving, one.last_seen_s == self.now_s)
            for one in update.obstacles
        ]
        self._passing = [new_thing(one.outline_m) for one in passing]
        self._count_people()
        frame = update.correction.frame(told.objects)
        self._turns = 0
        self._views.add(self.now_s, frame.origin, frame.view)
        self.cleaning.see(frame.view, self._near(place, self._mapped()), passing)

    def things(self) -> list[Thing]:
        """All that is known to be somewhere, walls too."""
        return self._mapped() + self._passing

    def _mapped(self, wall_m: float = WALL_M) -> list[Thing]:
        """What is in the map, and walls as thick as that to either side."""
        if self._version != self._checked:
            self._checked, self._known = self._version, {}
        if wall_m not in self._known:
            found = [thing_of(one.polygon, one.finished) for one in self.map.objects()]
            for wall in self.map.walls.records():
                found += walls(wall.segments, wall_m)
            self._known[wall_m] = found
        return self._known[wall_m]

    # what it drives

    @property
    def _sweeps(self) -> bool:
        """Whether the tool is down: where all is clean it need not be."""
        return self.task.goal == "sweep" and self.cleaning.has_work(self._at)

    def _may_mps(self, place: Place) -> float:
        """0 where something is right ahead or no frame shows floor; slow where none vouches."""
        rest = self._follower.rest(place)
        if len(rest) < 2:
            return LIMITS.speed_mps
        line, here = shapely.LineString(_first(rest, AHEAD_M)), shapely.Point(place[:2])
        heading = _heading(place, LAG_M + LAG_S * max(0.0, self.world.speeds[0]))
        there = self._mapped(HIDDEN_M) + self._passing
        for one in self._near(place, there):  # away from what it is too near to it may go
            most_m = here.distance(one) - SLACK_M
            if line.distance(one) < min(KEPT_M, most_m):
                return 0.0
            if heading.distance(one) < min(MACHINE.radius_m, most_m):
                return 0.0
        swath = line.buffer(MACHINE.radius_m).difference(here.buffer(MACHINE.radius_m + 0.05))
        for part in polygons_in(swath):
            if not self.cleaning.floor.is_free(shapely.get_coordinates(part.exterior)[:-1]):
                return 0.0
        if self.is_blind:
            return 0.0
        vouched = self._views.vouch(_entered(line), self.now_s)
        return LIMITS.speed_mps if vouched else CREEP_MPS

    @property
    def is_blind(self) -> bool:
        """Whether no frame has shown floor for long."""
        return self.now_s - self._views.last_s > BLIND_S

    def _near(self, place: Place, things: list[Thing]) -> list[Polygon]:
        here = shapely.Point(place[:2])
        return [one for one in outlines(things) if one.dwithin(here, NEAR_M)]

    def _go_on(self, place: Place, is_barred: bool) -> None:
        """A new task where the old one is done, or where nothing goes on."""
        self._barred_s = min(self._barred_s, self.now_s) if is_barred else math.inf
        since_s, (x, y, yaw) = self._stood
        moved_m, turned = (
            math.dist((x, y), place[:2]),
            abs(math.remainder(place[2] - yaw, math.tau)),
        )
        if moved_m > STILL_M or turned > STILL_RAD:
            self._stood = self.now_s, place
        elif self.now_s - since_s > STILL_S:
            self._stood = self.now_s, place
            return self._plan(place)
        if self.task.goal == "look" and self._tick % 10 == 0:
            self._halts = self._halts or self._is_seen()
        if self._halts:
            return self._plan(place) if abs(self.world.speeds[0]) < HALTED_MPS else None
        if self.now_s - self._barred_s > WAIT_S:
            self._barred_s = math.inf
            if self.is_blind:
                return self._look_round(place)
            return self._plan(place, self.task.goal == "look", is_barred=True)
        if not self._follower.is_done or self.tally.frames < FIRST_FRAMES:
            return None
        if self.task.goal == "home":
            self.task = Task("done")
            return None
        if self.task.goal == "look":
            self._arrived_s = min(self._arrived_s, self.now_s)
            if self.now_s - self._arrived_s < LOOK_S:
                return None
        return self._look_round(place) if self.is_blind else self._plan(place)

    def _look_round(self, place: Place) -> None:
        """Turn on the spot until a frame shows floor; not for ever."""
        self._turns += 1
        yaw, why = place[2] + TURN_RAD, "no frame shows floor"
        self.task = Task("look" if self._turns < BLIND_TURNS else "stuck", (), yaw, why=why)
        self._follower.follow(np.array([place[:2]]), yaw)

    def _is_seen(self) -> bool:
        at = self.task.viewpoint
        return at is not None and not self.cleaning.is_frontier(at.block, self.things())

    def _plan(self, place: Place, may_look: bool = True, is_barred: bool = False) -> None:
        self._arrived_s, self._halts = math.inf, False
        self.tally.plans += 1
        old = self._follower.rest(place) if self.task.goal == "sweep" else None
        self.task = self.cleaning.plan(place, self.things(), may_look, old, is_barred)
        if self.task.goal in ("wait", "done", "stuck"):
            self._barred_s = self.now_s
            self._follower.follow(np.array([place[:2]]))
            return
        points = joined([np.array([place[:2]]), *(one.points for one in self.task.segments)])
        way = shapely.simplify(shapely.LineString(points), STRAIGHT_M) if len(points) > 1 else None
        points = points if way is None else shapely.get_coordinates(way)
        self._follower.follow(points, self.task.yaw)

    # what is true

    def _count(self, before: Place, now: Place, sweeps: bool) -> None:
        step_m = math.dist(before[:2], now[:2])
        if sweeps:
            self.tally.swept_m += step_m
            self.tally.swept.append(np.array([*before[:2], *now[:2]]))
        else:
            self.tally.travel_m += step_m
        bars = self.truth.boxes_at(self.now_s)
        people = np.zeros((0, 3)) if self.world.crowd is None else self.world.crowd.people()
        away_m, what = gap_of(now, bars, people)
        gap_m = away_m - MACHINE.radius_m
        self.tally.least_gap_m = min(self.tally.least_gap_m, gap_m)
        is_hit = gap_m < 0.0 and step_m > 1e-4
        if is_hit and not self._is_hit:
            at = f"after {self.now_s:.1f} s at x {now[0]:.2f}, y {now[1]:.2f} m"
            self.tally.collisions.append(f"{what}, {at}, {step_m / PERIOD_S:.2f} m/s")
        self._is_hit = is_hit

    def _count_people(self) -> None:
        """Whether each who stands well in view was reported."""
        if self.world.crowd is None:
            return
        place = self.world.place
        eye_x, eye_y = self.camera.pose(place).T_map_sensor[:2, 3].tolist()
        for px, py, _ in self.world.crowd.people().tolist():
            if not self.truth.is_in_view(place, (eye_x, eye_y), (px, py), self.now_s):
                continue
            self.tally.people_seen += 1
            at = shapely.Point(px, py)
            told = outlines(self._passing)
            self.tally.people_missed += not any(one.dwithin(at, 0.5) for one in told)


def _heading(place: Place, metres: float) -> shapely.LineString:
    x, y, yaw = place
    return shapely.LineString([(x, y), (x + metres * math.cos(yaw), y + metres * math.sin(yaw))])


def _entered(line: shapely.LineString) -> F64:
    """(n, 2): where the machine's front comes to as its middle goes along a line."""
    at = np.array([s for s in ENTERED_M if s <= line.length] or [line.length])
    ends, before = (
        shapely.get_coordinates(shapely.line_interpolate_point(line, m)) for m in (at, at - 0.05)
    )
    step = ends - before
    lengths = np.maximum(np.hypot(*step.T), 1e-9)[:, None]
    return np.asarray(ends + MACHINE.radius_m * step / lengths)


def _first(points: F64, metres: float) -> F64:
    """The first metres of a line (n, 2)."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    at = np.concatenate([[0.0], np.cumsum(steps)])
    if at[-1] <= metres:
        return points
    k = int(np.searchsorted(at, metres))
    share = (metres - at[k - 1]) / steps[k - 1]
    return np.vstack([points[:k], points[k - 1] + share * (points[k] - points[k - 1])])
