"""What the fake camera sees at an instant: the world in its light, and the laser's line on it.

The laser's rays go out in a fan and end where they meet something. The camera sees such a place if
nothing is between: it gets light by what the surface returns, by how it faces the camera, and by
the square of the distance. Ambient light is known at every few pixels, so shadows are soft.

Left out: lenses out of focus, motion blur, a shutter that rolls, mirrors, light that has been
returned twice, the camera's curve of brightness.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fakes.rays.sight import Met
from fakes.stripe.drawing import U8, draw_line, expose
from fakes.stripe.faults import Faults
from fakes.stripe.lens import pixels_from_points, ways_from_pixels
from fakes.stripe.light import levels_from, returned
from fakes.wires.timing import F64
from fakes.world.rotations import rotation_y

Sight = Callable[[float, F64, F64], Met]  # instant, rays' begins and ways (n, 3) in the body
WIDTH, HEIGHT = 640, 480  # of its sensor
EVERY_PX = 8  # between places whose ambient light is known
RAYS = 3000  # of the laser's fan
HIDDEN_M = 1e-3  # a place so much behind what the camera meets is not seen
LASER = 490.0  # levels in a column, summed, of what returns all and faces a camera 1 m away
MIDDLE_GREY, MOST_GAIN = 110.0, 4.0  # of an automatic exposure
LEAKS = (0.02, 0.10, 1.0)  # of the laser's light: two colours off, one off, its own
CHANNELS = {"blue": 0, "green": 1, "red": 2}
SIGMA_OF_FWHM = 1.0 / (2.0 * math.sqrt(2.0 * math.log(2.0)))
CHANCES = 1 << 20


class Line(NamedTuple):
    """The truth of an image's line, ray by ray of the laser, (n,): those that the camera sees."""

    columns: F64
    rows: F64
    ranges_m: F64  # from the camera
    levels: F64  # of its light, at the brightest pixel, without an end


class Camera:
    """Lens, sensor and laser.

    Args:
        sight: what rays meet.
    """

    def __init__(self, faults: Faults, sight: Sight, seed: int) -> None:
        self.line: Line | None = None  # of the newest image
        self._faults, self._sight = faults, sight
        self._random = np.random.default_rng([seed, 9])
        self._chance = self._random.standard_normal(CHANCES).astype(np.float32)
        self._light = np.zeros((HEIGHT, WIDTH), np.float32)
        self._grid: tuple[tuple[object, ...], F64] | None = None  # lens, and its ways

    def image(self, t_s: float) -> U8:
        """(HEIGHT, WIDTH, 3) blue, green, red, exposed at t_s."""
        faults = self._faults
        R_body_camera = rotation_y(math.radians(faults.tilt_deg))
        centre = np.array(faults.mount_m)
        ambient = self._ambient(t_s, centre, R_body_camera)
        gain = faults.exposure
        if faults.auto_exposure:
            gain *= min(MOST_GAIN, MIDDLE_GREY / max(1e-3, float(ambient.mean())))
        self._light[:] = 0.0
        sigma_px = faults.line_px * SIGMA_OF_FWHM
        self.line = self._lit(t_s, centre, R_body_camera, sigma_px)
        summed = self.line.levels * sigma_px * math.sqrt(2 * math.pi) / self._rays_a_pixel
        up = int(faults.along == "rows")
        draw_line(self.line.columns, self.line.rows, summed, sigma_px, up, self._light)
        own = CHANNELS[faults.colour]
        response = np.array([LEAKS[2 - abs(own - k)] for k in range(3)])
        image = np.empty((HEIGHT, WIDTH, 3), np.uint8)
        first = int(self._random.integers(CHANCES))
        expose(
            *(ambient, EVERY_PX, self._light, response, gain, faults.speckle, faults.noise),
            *(self._chance, first, image),
        )
        return image

    @property
    def _rays_a_pixel(self) -> float:
        """Of the laser, in a column of the middle."""
        step_rad = 2 * math.radians(self._faults.fan_deg) / RAYS
        return 1.0 / (step_rad * self._faults.focal_px[0])

    def _ambient(self, t_s: float, centre: F64, R_body_camera: F64) -> F64:
        """Levels at every few pixels, (m, k, 3)."""
        faults = self._faults
        rows, columns = np.mgrid[0 : HEIGHT + EVERY_PX : EVERY_PX, 0 : WIDTH + EVERY_PX : EVERY_PX]
        lens = (faults.focal_px, faults.centre_px, faults.distortion)
        if self._grid is None or self._grid[0] != lens:
            places = columns.ravel().astype(float), rows.ravel().astype(float)
            self._grid = lens, ways_from_pixels(faults, *places)
        ways = self._grid[1] @ R_body_camera.T
        met = self._sight(t_s, np.broadcast_to(centre, ways.shape), ways)
        levels = levels_from(met, faults.ambient, faults.reflectivity, faults.texture)
        return np.ascontiguousarray(levels.reshape(*rows.shape, 3))

    def _lit(self, t_s: float, centre: F64, R_body_camera: F64, sigma_px: float) -> Line:
        """Where the laser's light falls, as far as the camera sees it."""
        faults = self._faults
        begin_camera, ways_camera = laser_rays(faults)
        begins = np.broadcast_to(centre + R_body_camera @ begin_camera, ways_camera.shape)
        ways = ways_camera @ R_body_camera.T
        met = self._sight(t_s, begins, ways)
        is_lit = np.isfinite(met.ranges_m)
        places_body = begins + np.where(is_lit, met.ranges_m, 1.0)[:, None] * ways
        towards = places_body - centre
        ranges_m = np.linalg.norm(towards, axis=1)
        looks = towards / ranges_m[:, None]
        before = self._sight(t_s, np.broadcast_to(centre, looks.shape), looks)
        columns, rows = pixels_from_points(faults, towards @ R_body_camera)
        is_seen = is_lit & (before.ranges_m >= ranges_m - HIDDEN_M) & np.isfinite(columns)
        facing = np.abs(np.einsum("ni,ni->n", met.normals, before.ways))
        shares = returned(met, faults.reflectivity, faults.texture)[:, CHANNELS[faults.colour]]
        levels = faults.laser * LASER * shares * facing / ranges_m**2
        levels = levels / (sigma_px * math.sqrt(2 * math.pi))
        return Line(columns[is_seen], rows[is_seen], ranges_m[is_seen], levels[is_seen])


def laser_rays(faults: Faults) -> tuple[F64, F64]:
    """Where the laser is (3,), and its rays' ways (RAYS, 3); in the camera's axes."""
    beta, fan = math.radians(faults.laser_deg), math.radians(faults.fan_deg)
    angles = (np.arange(RAYS) + 0.5) / RAYS * 2 * fan - fan
    beside, ahead = np.sin(angles), np.cos(angles)
    down, ahead = -ahead * math.sin(beta), ahead * math.cos(beta)
    if faults.along == "columns":
        return np.array([0.0, 0.0, faults.baseline_m]), np.stack([ahead, beside, down], axis=1)
    return np.array([0.0, faults.baseline_m, 0.0]), np.stack([ahead, down, beside], axis=1)
