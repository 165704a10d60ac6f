"""Method `beams`: exact geometry for each beam, heights over the tracked ground, evidence in cells.

Source: design, section 7.
"""

import numpy as np

from core.config import Config
from core.grid.window import ObstacleWindow
from core.mapping.beams.carving import FreeSpaceCarver
from core.mapping.beams.cells import CellGrid
from core.mapping.beams.classifier import CellClassifier, lacks_floor
from core.mapping.beams.elevation import Elevation
from core.mapping.beams.ground import GroundTracker
from core.mapping.beams.ground_plane import heights_over
from core.mapping.body import BodyPose, body_pose_at
from core.mapping.freshness import Freshness
from core.mapping.layers import LayerView, ages_at, maybe_beams_layer, maybe_beams_values
from core.mapping.rays import BeamGeometry
from core.mapping.slip import FaceMatcher
from core.motion.attitude import AttitudeRing
from core.motion.odometry import Odometry
from core.records import F64, I64, PointSweep, Scan

LEAST_MOVED_M = 0.002  # between two scans, for the line to move on
STOOD_M, STOOD_SWEPT_M = 0.0005, 0.01  # less is standing
LINE_M, MOST_SWEPT = 8.0, 3.0  # how far off it is, and how much more it may be swept aside
EVIDENCE = {  # fields of a cell, by what they count
    "returns": "count",
    "scans that met it": "looks",
    "scans at the upper bound or above": "above",
    "scans at the lower bound or below": "below",
    "scans that missed floor": "miss",
    "scans in a row that passed through": "through",
}


class BeamMaps:
    """The maps of one run, kept up scan by scan."""

    def __init__(self, config: Config) -> None:
        scanner, obstacle = config.scanner, config.obstacle
        beams = scanner.options.spec.max_beams
        self._geometry = BeamGeometry.of(scanner)
        self.cells = CellGrid(config.map.cells, config.map.cell_m)
        self.window = ObstacleWindow(obstacle.window_cells, config.map.cell_m)
        bounds_m = (obstacle.h_pos_m, obstacle.h_neg_m)
        filters = config.map.cell_value == "kalman"
        self.elevation = Elevation(self.cells, *bounds_m, config.robot.height_m, filters, beams)
        robot = config.robot
        footprint = (robot.front_m, robot.rear_m, robot.width_m / 2)
        self.fresh = Freshness(self.cells.grid, obstacle.free_max_age_s, footprint)
        self.carver = FreeSpaceCarver(self.cells, self.fresh)
        self.ground = GroundTracker(self.cells, beams)
        self.face_matcher = FaceMatcher(self.cells.grid, beams)
        self._heights_m = np.zeros(beams)  # of a sweep's first returns, over the ground
        period_s = config.scanner.options.spec.period_s
        self._classifier = CellClassifier(self.cells, self.window, self.fresh, obstacle, period_s)
        self._h_neg_m = obstacle.h_neg_m
        self._body: BodyPose | None = None

    def warm(self) -> None:
        """Run the kernels to which the first scans do not come, once; the maps stay empty."""
        self.ground.warm()
        self.elevation.judge_again(self.ground.model, self.ground.model, 0.0)
        self.window.put(np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int8))
        lacks_floor(self.cells.flat, 0, self.cells.sub)

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Odometry) -> int:
        """Take a sweep that attitude and odometry cover; how many returns it had.

        What it says of the place goes to the odometry.
        """
        sweep = self._geometry.cast(scan, attitudes, odometry)
        body = body_pose_at(sweep.t_s, attitudes, odometry)
        self.cells.grid.follow(body.x_m, body.y_m)
        self.fresh.follow(sweep.t_s, body.x_m, body.y_m, body.heading)
        self._classifier.follow(body.x_m, body.y_m)
        self.ground.follow(sweep, body)
        self.cells.begin_scan()
        is_calm = self.ground.is_calm(sweep.t_s, body)
        is_straight, stood = self._moved(body)
        known = not self.ground.is_guess
        trust = (known and self.ground.is_sure(body), is_calm and is_straight, known)
        if self.ground.is_new:
            ground = self.ground
            self.elevation.judge_again(ground.model, ground.before, ground.lost_s)
        returns = self.elevation.add(sweep, self.ground.model, trust)
        heights_over(sweep.origins, sweep.rays, sweep.ranges_m, self.ground.model, self._heights_m)
        is_sure = self.ground.found and is_calm
        self.face_matcher.set_right(sweep, self._heights_m, body, odometry, is_sure=is_sure)
        clears = known and self.ground.is_even(body) and not self.ground.jitters
        self.carver.add(sweep, self.ground.model, clears=clears, stood=stood)
        self._classifier.decide(self.cells.touched[: self.cells.used])
        self.fresh.expire(self.window)
        return returns

    def _moved(self, body: BodyPose) -> tuple[bool, bool]:
        """Whether the line moves on with the robot, and whether the robot stands.

        A line of a robot that stands or turns meets the floor by chance.
        """
        before, self._body = self._body, body
        if before is None:
            return False, False
        moved_m = abs(body.travel_m - before.travel_m)
        (ax, ay), (bx, by) = before.heading, body.heading
        swept_m = abs(ax * by - ay * bx) * LINE_M
        is_straight = moved_m > LEAST_MOVED_M and swept_m < MOST_SWEPT * moved_m
        return is_straight, moved_m < STOOD_M and swept_m < STOOD_SWEPT_M

    def maybe_layer(self, name: str) -> LayerView | None:
        """A layer by its name; none where there is none."""
        return maybe_beams_layer(name, self.cells, self.window)

    def maybe_values(self, name: str, i: I64, j: I64) -> F64 | None:
        """Of a layer, at world cells."""
        if name == "cause":
            return self._classifier.causes(i, j).astype(np.float64)
        if name == "age":
            return ages_at(self.fresh, self.cells.grid, i, j)
        return maybe_beams_values(name, self.cells, self.window, i, j)

    def evidence(self, i: int, j: int) -> dict[str, float]:
        """What was counted in a world cell, by what it counts."""
        size = self.cells.grid.size
        record = self.cells.cells[j % size, i % size]
        return {about: int(record[field]) for about, field in EVIDENCE.items()}

    def erase(self) -> None:
        """Forget everything."""
        self.cells.grid.erase()
        self.window.erase()
        self.ground.erase()
        self.face_matcher.erase()

    def is_low(self, i: int, j: int) -> bool:
        """Whether an obstacle cell lies low, or is a place where floor was due and did not show."""
        grid = self.cells.grid
        if not self.window.is_obstacle(i, j):
            return False
        at = (j % grid.size) * grid.size + i % grid.size
        cell = self.cells.flat[at]
        stands = cell["above"] > 0
        return bool(
            (cell["count"] > 0 and cell["mean_m"] <= self._h_neg_m)
            or (
                not stands
                and (cell["below"] > 0 or lacks_floor(self.cells.flat, at, self.cells.sub))
            )
        )
