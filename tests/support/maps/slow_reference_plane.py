"""The paper's seven steps once more, slow and obvious, from their text: dicts, lists and `math`.

Of `core` nothing but the scene's settings is in it. Angles are the paper's: sigma from X (right)
counter-clockwise, yaw the same way, `gamma` about X (nose up is positive), `beta` about Y (right
side down is positive).
`margin` tells how near any decision came to going the other way, so that a test can leave out what
rounding decides.
"""

import math
from typing import TypeVar

from core.mapping.paper.steps import PaperSettings

T = TypeVar("T")
Cell = tuple[int, int]  # row along Y, column along X
Matrix = list[list[float]]


def product(a: Matrix, b: Matrix) -> Matrix:
    columns = list(zip(*b, strict=True))
    return [[sum(x * y for x, y in zip(row, col, strict=True)) for col in columns] for row in a]


def craig_zyx(alpha: float, beta: float, gamma: float) -> Matrix:
    """Craig's Z-Y-X Euler angles: about Z, then about the new Y, then about the newest X."""
    c, s = math.cos(alpha), math.sin(alpha)
    about_z = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    c, s = math.cos(beta), math.sin(beta)
    about_y = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    c, s = math.cos(gamma), math.sin(gamma)
    about_x = [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]
    return product(about_z, product(about_y, about_x))


class SlowPlane:
    """All of the paper's method for one run; lengths in metres, angles in radians."""

    def __init__(self, scene: PaperSettings, sigmas: list[float]) -> None:
        self.scene, self.sigmas, self.max_range = scene, sigmas, scene.max_range_m
        self.h, self.phi = scene.lens_height_m, math.pi / 2 - scene.tilt_rad
        self.cells, self.cell = scene.cells, scene.cell_m
        self.heights: dict[Cell, list[float]] = {}
        self.states: dict[Cell, int] = {}
        self.margin = math.inf
        self.events: set[str] = set()
        self.last: tuple[float, float] | None = None  # gamma and beta at the last scan
        self.total_pitch = 0.0
        self.yaw_turned: float | None = None  # yaw at the last turn
        self.at_scroll = self.rest = 0.0
        self.reference = self.step_1()

    def above(self, value: float, bound: float) -> bool:
        """Whether a value exceeds a bound; remembers how clearly."""
        self.margin = min(self.margin, abs(value - bound))
        return value > bound

    def cell_at(self, x: float, y: float) -> Cell:
        """The cell of a point; the laser is the middle of the maps."""
        found = []
        for length in (y, x):
            exact = length / self.cell + self.cells / 2
            self.margin = min(self.margin, abs(exact - round(exact)))
            found.append(math.floor(exact))
        return found[0], found[1]

    def centre(self, at: Cell) -> tuple[float, float]:
        """X and Y of the middle of a cell."""
        y, x = ((index + 0.5 - self.cells / 2) * self.cell for index in at)
        return x, y

    def inside(self, at: Cell) -> bool:
        return 0 <= at[0] < self.cells and 0 <= at[1] < self.cells

    def step_1(self) -> list[float]:
        """The reference plane: d = h / cos(phi), R = d / sin(sigma), capped."""
        d = self.h / math.cos(self.phi)
        return [min(self.max_range, d / math.sin(sigma)) for sigma in self.sigmas]

    def scan(
        self, ranges: list[float], yaw: float, gamma: float, beta: float, travel: float
    ) -> None:
        """One scan, in the paper's order."""
        if self.yaw_turned is None:
            self.begin(yaw, travel)
        self.step_5(yaw)
        self.step_4(yaw, travel)
        if self.ground_changed(gamma, beta):
            self.events.add("restart")
            self.heights, self.states = {}, {}
            self.reference = self.step_1()
            self.begin(yaw, travel)
        self.step_2(ranges)
        self.step_3()

    def begin(self, yaw: float, travel: float) -> None:
        """Yaw and travel count from here."""
        self.yaw_turned, self.at_scroll, self.rest = yaw, travel, 0.0

    def step_5(self, yaw: float) -> None:
        """Turn both maps, if the nearest cell of the central column would move by over a cell."""
        assert self.yaw_turned is not None
        change = math.remainder(yaw - self.yaw_turned, 2 * math.pi)
        turn = craig_zyx(-change, 0.0, 0.0)

        def turned(at: Cell) -> tuple[float, float]:
            x, y = self.centre(at)
            return turn[0][0] * x + turn[0][1] * y, turn[1][0] * x + turn[1][1] * y

        column = [at for at in self.heights if at[1] == self.cells // 2 and self.centre(at)[1] > 0]
        if not column:
            return
        nearest = min(column)
        (x, y), (xt, yt) = self.centre(nearest), turned(nearest)
        far_x, far_y = self.above(abs(xt - x), self.cell), self.above(abs(yt - y), self.cell)
        if not (far_x or far_y):
            return
        self.events.add("turn")
        self.yaw_turned = yaw
        heights, states = self.heights, self.states
        self.heights, self.states = {}, {}
        for at in sorted(heights):
            to = self.cell_at(*turned(at))
            if self.inside(to):
                self.heights[to], self.states[to] = heights[at], states[at]

    def step_4(self, yaw: float, travel: float) -> None:
        """Move the rows back by the whole cells that the robot went ahead."""
        assert self.yaw_turned is not None
        ahead = self.rest + (travel - self.at_scroll) * math.cos(yaw - self.yaw_turned)
        if not self.above(abs(ahead), self.cell):
            return
        exact = ahead / self.cell
        self.margin = min(self.margin, abs(exact - round(exact)))
        rows = math.trunc(exact)
        self.events.add("scroll ahead" if rows > 0 else "scroll back")
        self.rest, self.at_scroll = ahead - rows * self.cell, travel
        self.heights = self.moved(self.heights, rows)
        self.states = self.moved(self.states, rows)

    def moved(self, content: dict[Cell, T], rows: int) -> dict[Cell, T]:
        """What stays on the map, each cell in its new row."""
        places = {(row - rows, column): kept for (row, column), kept in content.items()}
        return {at: kept for at, kept in places.items() if self.inside(at)}

    def ground_changed(self, gamma: float, beta: float) -> bool:
        """Step 7, and where it does not act, step 6."""
        d_gamma, d_beta = (gamma - self.last[0], beta - self.last[1]) if self.last else (0.0, 0.0)
        self.last = gamma, beta
        self.total_pitch += d_gamma
        tilted = self.above(abs(self.total_pitch), self.scene.epsilon_rad)
        quick = self.above(abs(d_gamma), self.scene.eta_rad)
        if tilted and not quick:
            self.total_pitch = 0.0
            return True
        turn = craig_zyx(0.0, d_beta, d_gamma)
        pairs = zip(self.sigmas, self.reference, strict=True)
        self.reference = [self.step_6(sigma, r, turn) for sigma, r in pairs]
        return False

    def step_6(self, sigma: float, r: float, turn: Matrix) -> float:
        """A reference range after a turn: the line through the turned point meets the ground."""
        omega = math.acos(min(1.0, self.h / r))
        r_xy = r * math.sin(omega)
        point = [[r_xy * math.cos(sigma)], [r_xy * math.sin(sigma)], [0.0]]
        [[x], [y], [z]] = product(turn, point)
        if z >= self.h:
            return self.max_range
        ground = (self.h * x / (self.h - z), self.h * y / (self.h - z), 0.0)
        return min(self.max_range, math.dist((0.0, 0.0, self.h), ground))

    def step_2(self, ranges: list[float]) -> None:
        """The height of each beam, into its cell."""
        for sigma, expected, measured in zip(self.sigmas, self.reference, ranges, strict=True):
            if math.isnan(measured) or measured <= 0.0:
                continue
            real = min(measured, self.max_range)
            expected_at_max = self.above(expected, self.max_range - 1e-6)
            if real == self.max_range and expected_at_max:
                self.events.add("nothing seen")
                continue
            rho = math.acos(min(1.0, self.h / expected))
            height = math.cos(rho) * (expected - real)
            r_xy = real * math.sin(rho)
            at = self.cell_at(r_xy * math.cos(sigma), r_xy * math.sin(sigma))
            if self.inside(at):
                self.heights.setdefault(at, []).append(height)

    def step_3(self) -> None:
        """Definition 1 on every cell that holds information."""
        h_pos, h_neg = self.scene.h_pos_m, self.scene.h_neg_m
        for at in self.heights:
            average = self.average(at)
            low, high = self.above(average, h_neg), self.above(average, h_pos)
            self.states[at] = -1 if low and not high and average != h_pos else 1

    def average(self, at: Cell) -> float:
        return sum(self.heights[at]) / len(self.heights[at])
