"""The C planner before a map that a test draws: the real sender tells it, nothing moves by itself.

For tests of what the planner asks for. The robot stands or is where the test puts it.
"""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from config_file import load_config
from core.driving.stop_zone import StopZone
from core.grid.ring import RingGrid
from core.records import FREE, I8, OBSTACLE, UNKNOWN, ObstacleMap, PoseReport, StopZoneReport
from fakes.wires.wire import MemoryPort
from hw.planner_link.receivers import one_link
from mapod_link.frames import DRIVE, frame_from_bytes
from tools.rig.planner.build import ROOT
from tools.rig.planner.host import CPlanner, PlannerSettings, PlannerState

ROBOT = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8")).robot
CELL_M, SIZE = 0.2, 101
TICK_S = 0.05
HEALTHY, RUNNING = 0x7F, 1
CLEAR, STOP = 1, 3  # states of a stop zone
Drive = tuple[float, float, float]  # m/s, rad/s, s


def zone_report(
    ahead_mps: float = 1.0, behind_mps: float = 1.0, state: int = CLEAR
) -> StopZoneReport:
    """A stop zone that allows so much."""
    far = (math.inf,) * 8
    return StopZoneReport(
        9.0, math.inf, 9.0, math.inf, math.inf, ahead_mps, behind_mps, math.inf, 0.0, far, state, 0
    )


def drives_of(frames: list[bytes]) -> list[Drive]:
    """What the DRIVE frames among them ask for."""
    asked = []
    for data in frames:
        frame = frame_from_bytes(data)
        assert not isinstance(frame, str)
        if frame.type == DRIVE:
            v, w = (int.from_bytes(frame.body[k : k + 2], "little", signed=True) for k in (8, 10))
            asked.append((v / 1000, w / 1000, int.from_bytes(frame.body[12:14], "little") / 1000))
    return asked


class Bench:
    """A planner, its sender, and the map between them; `cells` is [j, i] about the origin.

    Attributes:
        place: x, y, yaw of the robot; moves: its v, w as measured.
        lose: the sender's frames are lost while this is set.
        cell_mm: as told when a run of the sender begins.
        obeys: the robot moves as it is asked to, exactly.
    """

    def __init__(self, settings: PlannerSettings | None = None, size: int = SIZE) -> None:
        self.planner = CPlanner(settings or PlannerSettings(), nonce=7)
        self.size = size
        self.cells: I8 = np.full((size, size), FREE, dtype=np.int8)
        self.corner = -(size // 2)
        self.place, self.moves = (0.0, 0.0, 0.0), (0.0, 0.0)
        self.health, self.mode, self.zone = HEALTHY, RUNNING, zone_report()
        self.lose = self.silent = self.obeys = False
        self.session, self.now_s, self.cell_mm = 5, 100.0, round(CELL_M * 1000)
        self.asked: list[Drive] = []
        self.heard: list[bytes] = []  # frames of the sender
        self.begin_link()

    def begin_link(self) -> None:
        """A run of the sender begins."""
        self.port = MemoryPort(datagrams=True)
        self.link = one_link(
            self.port, size=self.size, cell_mm=self.cell_mm, session=self.session, tick_s=TICK_S
        )
        self._told: I8 = np.full((self.size, self.size), UNKNOWN, dtype=np.int8)

    def ring(self) -> I8:
        """The cells as `RingGrid` lays them out."""
        return np.roll(self.cells, (self.corner, self.corner), axis=(0, 1))

    def tick(self) -> None:
        """One tick of the sender, and what the planner says to it."""
        self.now_s += TICK_S
        if not self.silent:
            self._tell()
        frames = self.planner.poll(self.now_s)
        self.asked += drives_of(frames)
        for frame in frames:
            self.port.give(frame)
        if self.obeys and self.asked:
            self._move()

    def _tell(self) -> None:
        ring = self.ring()
        changed = np.flatnonzero(ring != self._told).astype(np.int32)
        self._told = ring
        window = ObstacleMap(ring, self.corner, self.corner, changed, 0, True)
        pose = PoseReport(
            *self.place, 0.0, 0.0, *self.moves, self.health, 0.02, 0.01, 0.05, self.mode
        )
        self.link.step(self.now_s, pose, window, self.zone, None)
        for frame in self.port.take_datagrams():
            if not self.lose:
                self.heard.append(frame)
                self.planner.feed_datagram(self.now_s, frame)

    def _move(self) -> None:
        v, w, _ = self.asked[-1]
        x, y, yaw = self.place
        middle = yaw + w * TICK_S / 2
        yaw = math.remainder(yaw + w * TICK_S, math.tau)
        self.place = (
            x + v * TICK_S * math.cos(middle), y + v * TICK_S * math.sin(middle), yaw
        )  # fmt: skip
        self.moves = (v, w)

    def run(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        """So much time; the map does not follow the robot."""
        for _ in range(round(seconds / TICK_S)):
            self.tick()
            if each:
                each()

    def jump(self, by_m: float) -> None:
        """So far in x and y, heading along x; the map goes with it."""
        self.place = (by_m, by_m, 0.0)
        self.corner += round(by_m / CELL_M)
        self._told[:] = UNKNOWN

    def put(self, x: tuple[float, float], y: tuple[float, float], state: int) -> None:
        """All cells that a rectangle touches get this state."""
        i, j = (
            slice(
                *(max(0, math.floor(edge / CELL_M) + k - self.corner) for k, edge in enumerate(way))
            )
            for way in (x, y)
        )
        self.cells[j, i] = state

    @property
    def state(self) -> PlannerState:
        """Of the planner, now."""
        return self.planner.state(self.now_s)

    @property
    def newest(self) -> tuple[float, float]:
        """The motion that it asked for last."""
        return self.asked[-1][:2] if self.asked else (0.0, 0.0)

    def is_safe(self, clear_m: float = 0.0) -> bool:
        """Whether the newest motion is one that the app's own stop zone lets pass, at full."""
        size = ROBOT.front_m, ROBOT.rear_m, ROBOT.width_m, ROBOT.stop_margin_m
        zone = StopZone(*size, ROBOT.brake_mps2, 0.45)
        motion = self.newest
        rate_mps = zone.rate_mps(*motion)
        if rate_mps < 0.001:
            return True
        grid = RingGrid(self.size, CELL_M)
        grid.corner_i = grid.corner_j = self.corner
        found = zone.look(grid, self.ring(), self.place, motion, (0.0, 0.0, clear_m), 0.0, 0.0)
        return zone.allowed_mps(found.free_m) >= rate_mps


def random_ground(bench: Bench, seed: int, share: float) -> npt.NDArray[np.int8]:
    """Rectangles of obstacles and of unknown ground, all over the window."""
    random = np.random.default_rng(seed)
    while float((bench.cells != FREE).mean()) < share:
        x, y = random.uniform(-10.0, 9.0, 2)
        width, height = random.uniform(0.1, 2.0, 2)
        state = OBSTACLE if random.random() < 0.5 else UNKNOWN
        bench.put((x, x + width), (y, y + height), state)
    return bench.cells


def set_out(bench: Bench, x_m: float, y_m: float) -> None:
    """To a goal, with a robot that obeys."""
    bench.obeys = True
    bench.run(0.3)
    bench.planner.goal(x_m, y_m)


def driving(bench: Bench, seconds: float = 1.0) -> Bench:
    """One that asks to drive straight ahead over free ground, the robot standing."""
    bench.run(0.3)
    bench.planner.goal(8.0, 0.0)
    bench.run(seconds)
    assert bench.newest[0] > 0.05, bench.state
    return bench
