"""A camera's lens, from pictures of a chessboard: OpenCV's calibration, and how far to believe it.

The errors are those that the corners' own contradictions explain (OpenCV's standard deviations). No
such number tells of pictures that are too alike: what these do not show is looked for here.
Source: Z. Zhang, A Flexible New Technique for Camera Calibration, 2000; OpenCV, calibrateCamera.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from core.records import F64, U8
from hw.device import BadFrame
from hw.stripe.geometry import Lens
from hw.stripe.images import MISSING, Decoder, maybe_opencv

SUFFIXES = (".jpg", ".jpeg", ".png")
LEAST_VIEWS, FEW_VIEWS = 4, 10  # below which nothing is fitted; below which that is told
SAME_SHARE = 0.02  # of the image's width, by which corners of two pictures differ at least
REGIONS = 4  # of the image, across and down: each wants corners
LEAST_COVERED = 0.7  # of the regions
LEAST_TILT_DEG = 15.0  # of a board to the camera's axis, about either axis of the image
MUCH_PX, MUCH_SHARE = 0.5, 0.005  # of the corners' rms; of the error of a focal length
OUTLIER_TIMES = 3.0  # the median picture's rms
ORDER = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")  # as OpenCV gives errors, and Lens


class BoardsError(Exception):
    """The pictures can't be used, or tell too little; says why."""


@dataclass(frozen=True, slots=True)
class Chessboard:
    """What is on the pictures."""

    across: int  # inner corners, where four squares meet
    down: int
    square_m: float

    @property
    def corners_m(self) -> F64:
        """(n, 3), row by row, on the board."""
        rows, columns = np.mgrid[0 : self.down, 0 : self.across]
        flat = np.stack([columns.ravel(), rows.ravel(), np.zeros(rows.size)], axis=1)
        return np.asarray(flat * self.square_m, np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One picture's corners."""

    name: str
    corners_px: F64  # (n, 2), in the order of the board's


@dataclass(frozen=True, slots=True, eq=False)
class LensFit:
    """A lens, and how well it is known."""

    views: tuple[View, ...]
    lens: Lens
    sigmas: Lens  # 1 sigma of each number; 0: it was not sought
    rms_px: float  # of all corners
    view_rms_px: F64  # (n,) of each picture's
    normals: F64  # (n, 3) of the boards, in the camera's axes: right, down, ahead


def views_in(
    folder: Path, board: Chessboard, image_px: tuple[int, int]
) -> tuple[list[View], list[str]]:
    """The pictures of a folder in which the whole board is found, and why the others are left out.

    Raises:
        BoardsError: there are none at all, or no library to read them with.
        OSError: no such folder.
    """
    decoder = Decoder(image_px)
    if decoder.is_missing:
        raise BoardsError(MISSING)
    names = sorted(one.name for one in folder.iterdir() if one.suffix.lower() in SUFFIXES)
    if not names:
        raise BoardsError(f"{folder}: has no pictures, which end with {', '.join(SUFFIXES)}")
    views, left_out = [], []
    for name in names:
        try:
            image = decoder.image((folder / name).read_bytes())
        except OSError as error:
            image = BadFrame(str(error.strerror), b"")
        if isinstance(image, BadFrame):
            left_out.append(f"{name}: {image.reason}")
        elif (corners_px := maybe_corners(image, board)) is None:
            left_out.append(
                f"{name}: no board of {board.across} x {board.down} inner corners in it: is all of "
                "it to be seen, with a light edge around it, and sharp?"
            )
        else:
            views.append(View(name, corners_px))
    return views, left_out


def maybe_corners(image: U8, board: Chessboard) -> F64 | None:
    """The inner corners (n, 2), pixels, of an image (h, w, 3); None: no whole board."""
    cv2 = maybe_opencv()
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    is_found, corners = cv2.findChessboardCornersSB(grey, (board.across, board.down), flags=flags)
    return np.asarray(corners, np.float64).reshape(-1, 2) if is_found else None


def fit(
    views: Sequence[View], board: Chessboard, image_px: tuple[int, int], with_k3: bool
) -> LensFit:
    """The lens that explains the corners best.

    Args:
        image_px: width and height.
        with_k3: the third number of radial distortion as well; else it is 0.

    Raises:
        BoardsError: too few, or none that fits.
    """
    if len(views) < LEAST_VIEWS:
        raise BoardsError(
            f"needs {LEAST_VIEWS} pictures or more in which the board is found, "
            f"{FEW_VIEWS} to 30 are good; there are {len(views)}"
        )
    cv2 = maybe_opencv()
    places = [board.corners_m.astype(np.float32)] * len(views)
    seen = [view.corners_px.astype(np.float32) for view in views]
    flags = 0 if with_k3 else cv2.CALIB_FIX_K3
    try:
        rms_px, matrix, distortion, turned, _, errors, _, view_rms = cv2.calibrateCameraExtended(
            places, seen, image_px, None, None, flags=flags
        )
    except cv2.error as error:
        raise BoardsError(f"OpenCV finds no lens that fits these pictures: {error.err}") from None
    lens = Lens(
        *(float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))),
        *(float(number) for number in distortion.ravel()[:5]),
    )
    sigmas = Lens(*(float(error) for error in errors.ravel()[: len(ORDER)]))
    if not np.isfinite([*lens, *sigmas]).all():
        raise BoardsError(
            "these pictures do not tell the lens: the board must lean, each time anew"
        )
    normals = np.array([cv2.Rodrigues(one)[0][:, 2] for one in turned])
    normals *= np.where(normals[:, 2:] < 0.0, -1.0, 1.0)
    return LensFit(tuple(views), lens, sigmas, float(rms_px), view_rms.ravel(), normals)


def rms_with(lens: Lens, views: Sequence[View], board: Chessboard) -> float:
    """By how much some lens misses the corners, pixels, with each board where it fits it best."""
    cv2: Any = maybe_opencv()
    matrix = np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])
    distortion, squares = np.array(lens[4:]), []
    for view in views:
        _, turned, moved = cv2.solvePnP(board.corners_m, view.corners_px, matrix, distortion)
        there, _ = cv2.projectPoints(board.corners_m, turned, moved, matrix, distortion)
        squares.append(((there.reshape(-1, 2) - view.corners_px) ** 2).sum(axis=1).mean())
    return math.sqrt(float(np.mean(squares)))


def doubts(found: LensFit, image_px: tuple[int, int]) -> list[str]:
    """What a person should know before believing it."""
    told, views = [], found.views
    if len(views) < FEW_VIEWS:
        told.append(f"few pictures: {len(views)}; take {FEW_VIEWS} to 30")
    for one, other in combinations(views, 2):
        off_px = np.abs(one.corners_px - other.corners_px).max()
        if off_px < SAME_SHARE * image_px[0]:
            told.append(f"{one.name} and {other.name} show the same: one of them tells nothing new")
    told += _too_alike(found.normals)
    covered = np.zeros((REGIONS, REGIONS), bool)  # by row and column
    for view in views:
        u, v = np.clip((view.corners_px / image_px * REGIONS).astype(int), 0, REGIONS - 1).T
        covered[v, u] = True
    if covered.mean() < LEAST_COVERED:
        told.append(
            f"corners in {covered.mean():.0%} of the image alone: where there are none, the "
            "distortion is a guess; take pictures with the board at its edges and in its corners"
        )
    most = OUTLIER_TIMES * float(np.median(found.view_rms_px))
    for view, rms_px in zip(views, found.view_rms_px, strict=True):
        if rms_px > most:
            told.append(f"{view.name} fits {rms_px:.2f} px badly: blurred, or the board was bent?")
    if found.rms_px > MUCH_PX:
        told.append(
            f"corners are missed by {found.rms_px:.2f} px: is the board flat, the picture sharp?"
        )
    share = max(found.sigmas.fx / found.lens.fx, found.sigmas.fy / found.lens.fy)
    if share > MUCH_SHARE:
        told.append(f"the focal length is known to {share:.1%} alone")
    return told


def _too_alike(normals: F64) -> list[str]:
    """Whether boards lean too little: one that faces the camera tells no focal length."""
    sideways = np.degrees(np.arctan2(normals[:, 0], normals[:, 2]))
    upward = np.degrees(np.arctan2(normals[:, 1], normals[:, 2]))
    return [
        f"the board leans {way} by {np.abs(off_deg).max():.0f} deg at most: lean it by 20 to 45 "
        "deg in some pictures, or the focal length is a guess"
        for way, off_deg in (("to the side", sideways), ("up or down", upward))
        if np.abs(off_deg).max() < LEAST_TILT_DEG
    ]
