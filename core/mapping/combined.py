"""One obstacle map of two sensors: the scanner's and a depth camera's, each by its own method.

Each sensor has a map of its own, so that the errors of one never pass for those of the other. A
cell is an obstacle where either says so, and free where one says so and the other does not object.
What the newest frame shows to stand is an obstacle at once. A camera that has not told anything
lately frees no cell, and takes none of its obstacles back.
Source: design, sections 7 and 10.
"""

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from core.config import Config
from core.device_settings import Scanner
from core.grid.window import ObstacleWindow, Shown, put_state
from core.mapping import causes
from core.mapping.layers import GroundSource, RingLayer
from core.mapping.method import Maps
from core.mapping.rays import check_sweep, span_s
from core.mapping.surface.maps import SurfaceMaps
from core.motion.attitude import AttitudeRing
from core.motion.track import Track
from core.records import F64, FREE, I8, I64, OBSTACLE, UNKNOWN, PointSweep, Scan, ScannerSpec
from jit import kernel

FRAME_RAYS = 3072  # of a frame, at most
LEAST_STALE_S, STALE_PERIODS = 0.3, 4  # age from which the newest frame is stale
NO_CELLS: I64 = np.zeros((0, 2), np.int64)


class OfCamera(Struct, frozen=True):
    """A depth camera, as the options of a scanner."""

    spec: ScannerSpec

    def describe(self) -> str:
        return "frames of a depth camera"


def camera_stale_s(config: Config) -> float:
    """The age from which a camera's newest frame is stale; inf: there is no camera."""
    if not config.has_camera or config.depth is None:
        return math.inf
    return max(LEAST_STALE_S, STALE_PERIODS * config.depth.options.period_s)


def as_scanner(config: Config) -> Config:
    """The settings of a robot whose scanner is its depth camera."""
    depth, objects = config.depth, config.objects
    assert depth is not None
    assert objects is not None
    far_m = objects.max_range_m
    spec = ScannerSpec(
        period_s=depth.options.period_s,
        max_beams=FRAME_RAYS,
        max_range_m=far_m,
        echoes=1,
        sigma_m=objects.noise_m,
        sigma_share=objects.noise_m / far_m + objects.noise_per_m2 * far_m,
        is_plane=False,
        directions=np.array([[1.0, 0.0, 0.0]]),
    )
    degrees = depth.mount_roll_deg, depth.mount_tilt_deg, depth.mount_yaw_deg
    return replace(
        config,
        scanner=Scanner(depth.driver, "none", *depth.mount_xyz_m, *degrees, OfCamera(spec)),
        obstacle=replace(config.obstacle, soft_free_below_m=0.0),
    )


@kernel
def _state_at(i: int, j: int, of: Shown) -> int:
    """Of a world cell; UNKNOWN outside."""
    ring = of.ring
    if not (0 <= i - ring.corner_i < ring.size and 0 <= j - ring.corner_j < ring.size):
        return UNKNOWN
    return int(of.cells[j % ring.size * ring.size + i % ring.size])


@kernel
def _combine(
    scanned: Shown, camera: Shown, frees: bool, standing: I64, mask: I8, shown: Shown, used: int
) -> int:
    """All cells of `shown` anew; returns how many changes are noted.

    Args:
        frees: the camera's free cells count.
        standing: (k, 2) world cells i, j that are obstacles in any case.
        mask: (size * size,) of zeros, and so again behind.
    """
    size, low_i, low_j = shown.ring.size, shown.ring.corner_i, shown.ring.corner_j
    for clear in range(2):
        for k in range(standing.shape[0]):
            i, j = standing[k, 0], standing[k, 1]
            if 0 <= i - low_i < size and 0 <= j - low_j < size:
                mask[j % size * size + i % size] = 1 - clear
        if clear == 1:
            break
        for j in range(low_j, low_j + size):
            for i in range(low_i, low_i + size):
                at = j % size * size + i % size
                one, other = _state_at(i, j, scanned), _state_at(i, j, camera)
                state = UNKNOWN
                if one == OBSTACLE or other == OBSTACLE or mask[at] == 1:
                    state = OBSTACLE
                elif one == FREE or (other == FREE and frees):
                    state = FREE
                used = put_state(at, state, shown, used)
    return used


class CombinedMaps:
    """The maps of both sensors, and what they say together.

    Attributes:
        scanned: the scanner's, by the method of the settings.
        camera: the camera's, by method `surface`.
        window: what the planner gets.
    """

    def __init__(self, config: Config, scanned: Maps) -> None:
        self.scanned, self.camera = scanned, SurfaceMaps(as_scanner(config), are_pictures=True)
        self.window = ObstacleWindow(config.obstacle.window_cells, config.map.cell_m)
        self.fresh = scanned.fresh
        self._mask: I8 = np.zeros(self.window.cells.size, np.int8)
        self._standing = NO_CELLS
        self._stale_s, self._epoch = camera_stale_s(config), scanned.window.epoch
        self._now_s = -math.inf  # newest sweep of either

    def warm(self) -> None:
        """Run the kernels to which the first sweeps do not come, once."""
        self.scanned.warm()
        self.camera.warm()
        self._combine()

    def add(self, scan: Scan | PointSweep, attitudes: AttitudeRing, odometry: Track) -> int:
        """Take a sweep of the scanner's; how many returns were used."""
        count = self.scanned.add(scan, attitudes, odometry)
        if self.scanned.window.epoch != self._epoch:  # the method has begun anew by itself
            self._forget()
        self._now_s = max(self._now_s, span_s(scan)[1])
        self._combine()
        return count

    def add_frame(
        self, sweep: PointSweep, standing: I64, attitudes: AttitudeRing, odometry: Track
    ) -> int:
        """Take a frame of the camera's that both cover; how many returns were used.

        Args:
            standing: (k, 2) world cells in which it shows something that bars the way.

        Raises:
            ValueError: it has more rays than a frame may have, or its arrays do not fit together.
        """
        check_sweep(sweep, FRAME_RAYS)
        count = self.camera.add(sweep, attitudes, odometry)
        self._now_s = max(self._now_s, span_s(sweep)[1])
        self._standing = standing
        self._combine()
        return count

    def _combine(self) -> None:
        source, window = self.scanned.window, self.window
        corner = source.grid.corner_i, source.grid.corner_j
        if corner != (window.grid.corner_i, window.grid.corner_j):
            cell_m, half = window.grid.cell_m, window.grid.size // 2
            window.follow((corner[0] + half + 0.5) * cell_m, (corner[1] + half + 0.5) * cell_m)
        frees = self._now_s - self.camera.fresh.now_s <= self._stale_s
        window.used = _combine(
            source.shown, self.camera.window.shown, frees, self._standing, self._mask,
            window.shown, window.used,
        )  # fmt: skip

    def _forget(self) -> None:
        """All but what the scanner's map holds."""
        self.camera.erase()
        self.window.erase()
        self._standing, self._epoch = NO_CELLS, self.scanned.window.epoch
        self._now_s = -math.inf

    def erase(self) -> None:
        """Forget everything."""
        self.scanned.erase()
        self._forget()

    def maybe_ring(self, name: str) -> RingLayer | None:
        """A layer of the scanner's map."""
        return self.scanned.maybe_ring(name)

    def maybe_ground(self) -> GroundSource | None:
        """Likewise."""
        return self.scanned.maybe_ground()

    def causes(self, i: I64, j: I64) -> F64:
        """Codes (n,): the scanner's where it says the same, else the camera's."""
        grid, found = self.window.grid, self.scanned.causes(i, j)
        inside = (i >= grid.corner_i) & (i < grid.corner_i + grid.size)
        inside &= (j >= grid.corner_j) & (j < grid.corner_j + grid.size)
        shown = self.window.cells[j % grid.size, i % grid.size]
        differs = np.flatnonzero(inside & (states_of(found) != shown))
        seen = self.camera.causes(i[differs], j[differs])
        agrees = states_of(seen) == shown[differs]
        found[differs] = np.where(agrees, seen, BY_ITSELF[shown[differs] + 1])
        return found

    def ages_s(self, i: I64, j: I64) -> F64:
        """Seconds (n,) since either has seen world cells; NaN: never, or outside."""
        return np.fmin(self.scanned.ages_s(i, j), self.camera.ages_s(i, j))

    def evidence(self, i: int, j: int) -> dict[str, float]:
        """What both have counted in a world cell."""
        of_camera = self.camera.evidence(i, j)
        return self.scanned.evidence(i, j) | {f"camera: {k}": v for k, v in of_camera.items()}


# by a shown state + 1: of what neither map explains any more, or the newest frame alone shows
BY_ITSELF = np.array([causes.FREE_BEFORE, causes.UNKNOWN_BEFORE, causes.STANDS], dtype=float)


def states_of(codes: F64) -> I8:
    """The states (n,) that causes (n,) explain."""
    is_free = (codes >= causes.FIRST_FREE) & (codes < causes.FIRST_OBSTACLE)
    bars = (codes >= causes.FIRST_OBSTACLE) & (codes < causes.FIRST_DOUBT)
    return np.where(bars, OBSTACLE, np.where(is_free, FREE, UNKNOWN)).astype(np.int8)
