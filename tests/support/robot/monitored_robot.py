"""A monitor on free ground whose records are as new as they can be, and everything else to set."""

import math
from typing import Any

from config_file import load_config, with_changes
from core.config import Config
from core.driving.monitor import Monitor, Powers, Seen
from core.geometry import R_from_rpy, q_from_R
from core.grid.window import ObstacleWindow
from core.motion.track import Pose
from core.records import FREE, Attitude, DriveRequest, WheelCounts
from tests import ROOT

CONFIG = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
CONFIG = with_changes(CONFIG, robot={"enable_motors": True})
ROBOT = CONFIG.robot  # 0.52 m ahead of its axle, 0.20 m behind, 0.30 m to either side
TICK_S, SHORT_S = 0.01, 1e-4
FAR_S = 0.5  # of a request


def attitude(t_s: float, roll_rad: float = 0.0, pitch_rad: float = 0.0, size: float = 1.0) -> Any:
    q = size * q_from_R(R_from_rpy(roll_rad, pitch_rad, 0.7))
    return Attitude(t_s, tuple(q.tolist()), (0.0, 0.0, 0.0))


class Robot:
    """A monitor on free ground; all records are as new as they can be, unless they are held."""

    def __init__(self, config: Config = CONFIG) -> None:
        self.config, self.monitor = config, Monitor(config)
        self.window = ObstacleWindow(101, 0.2)
        self.window.cells[...] = FREE
        self.x_m = self.y_m = self.yaw_rad = 0.0
        self.moves = 0.0, 0.0  # by the counters
        self.counts = [0.0, 0.0]
        self.now_s, self.restarts, self.mapped_s = 100.0, 0, 100.0
        self.held: set[str] = set()  # what does not come any more
        self.vouched = False
        self.leans = 0.0, 0.0
        for _ in range(10):
            self.tick()
            self.passed((0.0, 0.0), (0.0, 0.0))

    def tick(self, seconds: float = TICK_S) -> None:
        """Time passes, and records come."""
        self.now_s += seconds
        robot = self.config.robot
        per_turn = 4 * robot.encoder_ppr * robot.gear_ratio
        per_m = per_turn / (2 * math.pi * robot.wheel_radius_m)
        rim_mps = self.moves[1] * robot.track_width_m / 2
        for k, speed_mps in enumerate((self.moves[0] - rim_mps, self.moves[0] + rim_mps)):
            self.counts[k] += speed_mps * seconds * per_m
        if "scans" not in self.held:
            self.monitor.scanned(self.now_s)
        if "map" not in self.held:
            self.mapped_s = self.now_s
        if "attitudes" not in self.held:
            self.monitor.turned(attitude(self.now_s, *self.leans))
        if "counts" not in self.held:
            left, right = self.counts
            self.monitor.counted(WheelCounts(self.now_s, left, right, self.restarts))

    def passed(self, powers: Powers, asked: tuple[float, float] | None, **seen: Any) -> Powers:
        """What goes out; `asked`: v and w of a request that holds."""
        given: dict[str, Any] = {
            "request": None if asked is None else DriveRequest(*asked, self.now_s + FAR_S),
            "pose": Pose(self.now_s, self.x_m, self.y_m, self.yaw_rad, 0.0, 0.0),
            "window": self.window,
            "mapped_s": self.mapped_s,
            "off_start_m": 0.0 if self.vouched else math.inf,
        }
        return self.monitor.passed(self.now_s, powers, Seen(**given | seen))

    def told(self, v_mps: float, w_radps: float, **seen: Any) -> str:
        """Asked and told to go so: why it may not."""
        rim_mps = w_radps * self.config.robot.track_width_m / 2
        full_mps = self.config.drive.full_power_mps
        powers = (v_mps - rim_mps) / full_mps, (v_mps + rim_mps) / full_mps
        out = self.passed(powers, (v_mps, w_radps), **seen)
        assert out == ((0.0, 0.0) if self.monitor.why else powers)
        return self.monitor.why

    def mark(self, i: int, j: int, state: int) -> None:
        self.window.cells[j % 101, i % 101] = state
