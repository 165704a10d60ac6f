"""Pictures of a chessboard through a known lens, drawn ray by ray."""

import functools
import math
from typing import NamedTuple

import numpy as np

from fakes.stripe.faults import Faults
from fakes.stripe.lens import pixels_from_points, ways_from_pixels
from fakes.world.rotations import rotation_y, rotation_z
from tests.hw.stripe.pictures import U8
from tools.calibration.camera import Chessboard, View

SIZE = W, H = 640, 480
FINER = 2  # rays along a pixel's edge
BOARD = Chessboard(9, 6, 0.025)
DARK, LIGHT, WALL = 40.0, 200.0, 110.0
Numbers = tuple[float, ...]


class Held(NamedTuple):
    """How the board is held before the camera: where its middle is, and how it leans."""

    ahead_m: float
    left_m: float
    up_m: float
    aside_deg: float
    back_deg: float


LEANS_DEG = (
    *((30, 0), (-30, 5), (0, 30), (5, -30), (25, 25), (-25, 25)),
    *((25, -25), (-20, -30), (35, 10), (0, 0), (-35, -10), (10, 35)),
)


def _held(k: int, leans_deg: tuple[int, int]) -> Held:
    """So that all of it is in the picture, by its side where it is far."""
    ahead_m, way = 0.38 + 0.07 * (k % 4), 2.4 * k
    left_m = (0.5 * ahead_m - 0.165) * math.copysign(
        min(1.0, abs(1.5 * math.cos(way))), math.cos(way)
    )
    up_m = (0.37 * ahead_m - 0.115) * math.copysign(
        min(1.0, abs(1.5 * math.sin(way))), math.sin(way)
    )
    return Held(ahead_m, left_m, up_m, *leans_deg)


HELD = tuple(_held(k, leans_deg) for k, leans_deg in enumerate(LEANS_DEG))


def lens_of(focal_px: Numbers, centre_px: Numbers, distortion: Numbers) -> Faults:
    faults = Faults()
    faults.focal_px, faults.centre_px = (focal_px[0], focal_px[1]), (centre_px[0], centre_px[1])
    faults.distortion = (*distortion[:4], distortion[4])  # type: ignore[assignment]
    return faults


@functools.cache
def _ways(focal_px: Numbers, centre_px: Numbers, distortion: Numbers) -> np.ndarray:
    inside = (np.arange(FINER) + 0.5) / FINER - 0.5
    columns = (np.arange(W)[:, None] + inside).ravel()
    rows = (np.arange(H)[:, None] + inside).ravel()
    u, v = np.meshgrid(columns, rows)
    faults = lens_of(focal_px, centre_px, distortion)
    return ways_from_pixels(faults, u.ravel(), v.ravel())


def _stands(held: Held) -> tuple[np.ndarray, np.ndarray]:
    """Rotation from the board's axes (towards the camera, left, up) and its middle."""
    R = rotation_z(math.radians(held.aside_deg)) @ rotation_y(math.radians(held.back_deg))
    return R, np.array([held.ahead_m, held.left_m, held.up_m])


def picture(
    held: Held, focal_px: Numbers, centre_px: Numbers, distortion: Numbers, seed: int
) -> U8:
    """(H, W, 3) of the board, with a light edge of one square around it, and noise."""
    R, middle = _stands(held)
    ways = _ways(focal_px, centre_px, distortion) @ R
    at_m = (middle @ R)[0] / ways[:, :1] * ways - middle @ R
    across = -at_m[:, 1] / BOARD.square_m + (BOARD.across + 1) / 2  # in squares
    down = -at_m[:, 2] / BOARD.square_m + (BOARD.down + 1) / 2
    is_dark = (np.floor(across) + np.floor(down)) % 2 < 1
    wide, high = BOARD.across + 1, BOARD.down + 1
    is_board = (across > 0) & (across < wide) & (down > 0) & (down < high)
    is_edge = (across > -1) & (across < wide + 1) & (down > -1) & (down < high + 1)
    levels = np.where(is_board & is_dark, DARK, np.where(is_edge, LIGHT, WALL))
    grey = levels.reshape(H, FINER, W, FINER).mean(axis=(1, 3))
    grey += np.random.default_rng(seed).normal(0.0, 1.5, grey.shape)
    return np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


def view(held: Held, faults: Faults, name: str) -> View:
    """Where the corners are, exactly."""
    R, middle = _stands(held)
    flat = BOARD.corners_m - BOARD.corners_m.mean(axis=0)
    board = np.stack([np.zeros(len(flat)), -flat[:, 0], -flat[:, 1]], axis=1)
    return View(name, np.stack(pixels_from_points(faults, board @ R.T + middle), axis=1))
