"""Method `reference_plane`: the paper's chapter 4 to the letter, to be compared with.

Each range is compared with the one that flat floor would give. The paper's axes: X right, Y ahead,
Z up, origin on the ground under the lens; beam angle sigma counter-clockwise from X, so 90 deg is
straight ahead. Refuses to be better than the paper; where the paper leaves something open:
- a range that is NaN or not above 0 was not measured; one beyond the maximum counts as the maximum,
  and where the reference is at the maximum too, nothing was seen. A reference that does not meet
  the ground within the maximum range, in steps 1 and 6 alike, is the maximum range;
- the cell that decides whether to turn is the nearest ahead of the laser. The laser's own is not
  asked, no turn moves it. So once the robot has driven over seen floor, the map seldom turns;
- of two cells that land in one, the later in reading order (by Y, then X) stays;
- displacement is projected by the yaw since the last turn, to which the map's Y axis is aligned;
- the first scan changes no pitch and no roll; a restart counts yaw and displacement anew as well;
- an average at a bound is an obstacle.
What it costs: the compensation turns ground points about the ground under the lens, not rays about
the lens, which misplaces flat floor by 2 cm at 4.5 deg nose up (from 7.5 deg of tilt); that the
lens rises and sinks with the body is not in it (2 cm more); and a reference that met its maximum
has forgotten by how much, so it comes back wrong.
Source: the paper, sections 4.2, 4.5 and 4.6.
"""

import math
from dataclasses import dataclass

import numpy as np

from core.geometry import wrapped
from core.mapping.paper.grid import PaperGrid, index_of, put_height
from core.records import F64, I8, I32
from jit import kernel

AT_MAX_M = 1e-6  # a reference this near its cap is at it: step 6 turns the cap too, and rounds


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperSettings:
    """What the paper calls h, tilt, maximum range, cells, H_pos, H_neg, epsilon and eta."""

    lens_height_m: float
    tilt_rad: float  # looking down is positive
    max_range_m: float
    cells: int
    cell_m: float
    h_pos_m: float
    h_neg_m: float
    epsilon_rad: float  # pitch since the start that makes another ground
    eta_rad: float  # change of pitch from scan to scan below which it does
    compensated: bool  # False leaves pitch and roll compensation out


def craig_from_body(roll_rad: float, pitch_rad: float) -> tuple[float, float]:
    """Craig's Z-Y-X Euler angles beta about the paper's Y and gamma about its X.

    The paper's Y is the body's x and its X is the body's -y: right side down stays positive about
    Y, nose down is negative about X (yaw stays). The order of the two turns differs, which is of
    second order in the angles.
    """
    return roll_rad, -pitch_rad


def sigma_from_bearing(bearing_rad: F64) -> F64:
    """The paper's beam angles of bearings counter-clockwise from straight ahead."""
    return bearing_rad + math.pi / 2


@kernel
def _reset_reference(
    sigma_rad: F64, lens_height_m: float, tilt_rad: float, max_range_m: float, reference_m: F64
) -> None:
    """Step 1: ranges (n,) to flat floor as the lens is mounted."""
    for k in range(sigma_rad.size):
        # d = h / cos(phi), phi = 90 deg - tilt, and R_sigma = d / sin(sigma), of which
        # the quotient is kept whole: above the horizon it has no distance
        down = math.cos(math.pi / 2 - tilt_rad) * math.sin(sigma_rad[k])
        reference_m[k] = max_range_m
        if down > 0.0:
            reference_m[k] = min(max_range_m, lens_height_m / down)


@kernel
def _turn_reference(
    sigma_rad: F64,
    lens_height_m: float,
    max_range_m: float,
    beta_rad: float,
    gamma_rad: float,
    reference_m: F64,
) -> None:
    """Step 6: ranges (n,) after the body turned by gamma about X, then beta about Y."""
    cb, sb = math.cos(beta_rad), math.sin(beta_rad)
    cg, sg = math.cos(gamma_rad), math.sin(gamma_rad)
    for k in range(sigma_rad.size):
        down = min(1.0, lens_height_m / reference_m[k])
        level_m = reference_m[k] * math.sqrt((1.0 - down) * (1.0 + down))
        x_m, y_m = level_m * math.cos(sigma_rad[k]), level_m * math.sin(sigma_rad[k])
        xt_m = cb * x_m + sb * sg * y_m
        yt_m = cg * y_m
        zt_m = -sb * x_m + cb * sg * y_m
        if zt_m >= lens_height_m:
            reference_m[k] = max_range_m
            continue
        share = lens_height_m / (lens_height_m - zt_m)
        floor_m = math.sqrt((share * xt_m) ** 2 + (share * yt_m) ** 2 + lens_height_m**2)
        reference_m[k] = min(max_range_m, floor_m)


@kernel
def _compare_and_add(
    ranges_m: F64,
    reference_m: F64,
    sigma_rad: F64,
    lens_height_m: float,
    max_range_m: float,
    average_m: F64,
    count: I32,
    cell_m: float,
    touched: I32,
) -> int:
    """Step 2: the height and the cell of each beam; returns how many cells are in `touched`."""
    cells = count.shape[0]
    used = 0
    for k in range(ranges_m.size):
        if not ranges_m[k] > 0.0:
            continue
        real_m = min(max_range_m, ranges_m[k])
        if real_m == max_range_m and reference_m[k] > max_range_m - AT_MAX_M:
            continue
        cos_rho = min(1.0, lens_height_m / reference_m[k])
        sin_rho = math.sqrt((1.0 - cos_rho) * (1.0 + cos_rho))
        level_m = real_m * sin_rho
        column = index_of(level_m * math.cos(sigma_rad[k]), cell_m, cells)
        row = index_of(level_m * math.sin(sigma_rad[k]), cell_m, cells)
        if 0 <= row < cells and 0 <= column < cells:
            put_height(average_m, count, row, column, cos_rho * (reference_m[k] - real_m))
            touched[used] = row * cells + column
            used += 1
    return used


class ReferencePlane:
    """The paper's maps of one run, for beams at fixed angles `sigma_rad` (n,).

    Raises:
        ValueError: the lens is not above ground, or the ground is beyond the maximum range.
    """

    def __init__(self, settings: PaperSettings, sigma_rad: F64) -> None:
        if not 0.0 < settings.lens_height_m < settings.max_range_m:
            raise ValueError(f"lens height and maximum range do not fit: {settings}")
        self.settings = settings
        self.grid = PaperGrid(settings.cells, settings.cell_m, settings.h_pos_m, settings.h_neg_m)
        self.turns = self.restarts = 0  # how often the map was turned; the ground changed
        self._pitch_last_rad = self._roll_last_rad = math.nan  # of the last scan; NaN: none yet
        self._pitched_rad = 0.0  # since the start or the last restart
        self._yaw_turned_rad = math.nan  # yaw at the last turn; NaN: the next scan's
        self._scrolled_at_m = 0.0  # displacement at the last scroll
        self._rest_m = 0.0  # what that scroll left over
        self.set_beams(sigma_rad)

    @property
    def elevation_m(self) -> F64:
        """Average heights (cells, cells), [row, column] = [Y, X]; NaN where nothing was seen."""
        return self.grid.average_m

    @property
    def obstacles(self) -> I8:
        """States (cells, cells): OBSTACLE, UNKNOWN or FREE, laid out as `elevation_m`."""
        return self.grid.states

    @property
    def reference_m(self) -> F64:
        """Ranges (n,) at which flat floor is expected now."""
        return self._reference_m

    def set_beams(self, sigma_rad: F64) -> None:
        """Other beam angles (n,): the reference of step 1, as at the start; the maps stay."""
        self._sigma_rad = np.array(sigma_rad, dtype=np.float64)
        self._reference_m = np.zeros(self._sigma_rad.size)
        self._touched: I32 = np.zeros(self._sigma_rad.size, dtype=np.int32)
        self.touched = self._touched[:0]  # flat indices of the cells that the newest scan met
        self._reset_reference()

    def _reset_reference(self) -> None:
        s = self.settings
        _reset_reference(
            self._sigma_rad, s.lens_height_m, s.tilt_rad, s.max_range_m, self._reference_m
        )
        self._pitched_rad = 0.0

    def erase(self) -> None:
        """Forget both maps, and from where yaw and displacement were counted; not the plane."""
        self.grid.erase()
        self._yaw_turned_rad = math.nan

    def add(
        self,
        ranges_m: F64,
        yaw_rad: float,
        pitch_rad: float,
        roll_rad: float,
        displacement_m: float,
    ) -> int:
        """Take a scan (n,), in the paper's order; returns how many beams fell into the maps.

        Args:
            yaw_rad: counter-clockwise, with pitch (nose down) and roll (right side down) the
                body's at the scan.
            displacement_m: since the start, mean of both wheels, forward positive.
        """
        if math.isnan(self._yaw_turned_rad):
            self._count_from(yaw_rad, displacement_m)
        self._rotate(yaw_rad)
        self._scroll(yaw_rad, displacement_m)
        if self._update_plane(pitch_rad, roll_rad):
            self._count_from(yaw_rad, displacement_m)
        self.touched = self._touched[: self._compare_and_add(ranges_m)]
        self.grid.decide(self.touched)
        return self.touched.size

    def _count_from(self, yaw_rad: float, displacement_m: float) -> None:
        self._yaw_turned_rad, self._scrolled_at_m, self._rest_m = yaw_rad, displacement_m, 0.0

    def _rotate(self, yaw_rad: float) -> None:
        """Step 5: the content turns against the robot, once that shows in the nearest cell."""
        turned_rad = -wrapped(yaw_rad - self._yaw_turned_rad)
        if self.grid.turn_needed(turned_rad):
            self.grid.turn(turned_rad)
            self._yaw_turned_rad = yaw_rad
            self.turns += 1

    def _scroll(self, yaw_rad: float, displacement_m: float) -> None:
        """Step 4: whole cells along Y; the rest is carried on."""
        cell_m = self.settings.cell_m
        along = math.cos(yaw_rad - self._yaw_turned_rad)
        ahead_m = self._rest_m + (displacement_m - self._scrolled_at_m) * along
        if abs(ahead_m) > cell_m:
            rows = int(ahead_m / cell_m)
            self.grid.scroll(rows)
            self._rest_m = ahead_m - rows * cell_m
            self._scrolled_at_m = displacement_m

    def _update_plane(self, pitch_rad: float, roll_rad: float) -> bool:
        """Steps 6 and 7; True where the ground changed and both maps were erased."""
        s = self.settings
        pitched_rad, rolled_rad = pitch_rad - self._pitch_last_rad, roll_rad - self._roll_last_rad
        if math.isnan(pitched_rad):
            pitched_rad = rolled_rad = 0.0
        self._pitch_last_rad, self._roll_last_rad = pitch_rad, roll_rad
        self._pitched_rad += pitched_rad
        if abs(self._pitched_rad) > s.epsilon_rad and abs(pitched_rad) < s.eta_rad:
            self._reset_reference()
            self.grid.erase()
            self.restarts += 1
            return True
        if s.compensated:
            beta_rad, gamma_rad = craig_from_body(rolled_rad, pitched_rad)
            _turn_reference(
                self._sigma_rad,
                s.lens_height_m,
                s.max_range_m,
                beta_rad,
                gamma_rad,
                self._reference_m,
            )
        return False

    def _compare_and_add(self, ranges_m: F64) -> int:
        s, grid = self.settings, self.grid
        return _compare_and_add(
            ranges_m,
            self._reference_m,
            self._sigma_rad,
            s.lens_height_m,
            s.max_range_m,
            grid.average_m,
            grid.count,
            s.cell_m,
            self._touched,
        )
