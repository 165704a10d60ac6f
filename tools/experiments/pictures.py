"""Pictures of maps in the paper's colours: the robot's start looks up, 1 m is drawn to scale.

Elevation: blue where the height is within the band of floor, yellow below, grey to black above.
Obstacles: green free, red obstacle, orange without information.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from core.records import FREE, OBSTACLE
from tools.experiments.views import MapView

Pixels = npt.NDArray[np.uint8]
BAND_M = 0.06  # heights within it are drawn as floor
BLACK_AT_M = 1.5  # heights from there on are drawn black
BLUE, YELLOW, WHITE = (40, 90, 220), (245, 210, 40), (255, 255, 255)
GREEN, RED, ORANGE = (60, 170, 75), (215, 40, 40), (250, 165, 60)
BLACK, EDGE, ROBOT = (0, 0, 0), (120, 120, 120), (255, 255, 255)
WIDE_PX, HIGH_PX = 320, 420  # of one map, at most
MARGIN_PX, TITLE_PX, LABEL_PX = 8, 20, 16


def elevation_pixels(heights_m: npt.NDArray[np.float64]) -> Pixels:
    """Colours (size, size, 3) of heights [j, i]; white where there is none."""
    seen = np.isfinite(heights_m)
    h = np.where(seen, heights_m, 0.0)
    grey = 190.0 * (1.0 - np.clip((h - BAND_M) / (BLACK_AT_M - BAND_M), 0.0, 1.0))
    pixels = np.repeat(grey[:, :, None], 3, axis=2).astype(np.uint8)
    pixels[np.abs(h) <= BAND_M] = BLUE
    pixels[h < -BAND_M] = YELLOW
    pixels[~seen] = WHITE
    return pixels


def obstacle_pixels(states: npt.NDArray[np.int8]) -> Pixels:
    """Colours (size, size, 3) of states [j, i]."""
    pixels = np.empty((*states.shape, 3), dtype=np.uint8)
    pixels[...] = ORANGE
    pixels[states == FREE] = GREEN
    pixels[states == OBSTACLE] = RED
    return pixels


def upright(pixels: npt.NDArray[np.uint8]) -> Pixels:
    """From [j, i] along map y, x to an image's rows and columns: x up, y to the left."""
    return np.ascontiguousarray(np.swapaxes(pixels, 0, 1)[::-1, ::-1])


def rendered(
    heights_m: npt.NDArray[np.float64], states: npt.NDArray[np.int8]
) -> tuple[Image.Image, Image.Image]:
    heights, obstacles = upright(elevation_pixels(heights_m)), upright(obstacle_pixels(states))
    return Image.fromarray(heights), Image.fromarray(obstacles)


def _cropped(view: MapView, x_m: tuple[float, float], y_m: tuple[float, float]) -> MapView:
    """The part of a view within a rectangle of the map, padded to a square by its longer edge."""
    x, y = view.centres_m()
    columns = np.nonzero((x > x_m[0]) & (x < x_m[1]))[0]
    rows = np.nonzero((y > y_m[0]) & (y < y_m[1]))[0]
    at = np.ix_(rows, columns)
    return MapView(
        view.name,
        view.corner_i + int(columns[0]),
        view.corner_j + int(rows[0]),
        view.cell_m,
        view.states[at],
        view.heights_m[at],
        view.pose,
    )


def _panel(view: MapView, pixels: Pixels) -> Image.Image:
    """One map, enlarged to at most WIDE_PX x HIGH_PX, with the robot, its heading and 1 m."""
    rows, columns = view.states.shape  # along y, along x
    scale = min(WIDE_PX / rows, HIGH_PX / columns)
    scale = max(1.0, np.floor(scale)) if scale > 1 else scale
    size = (max(1, round(rows * scale)), max(1, round(columns * scale)))
    picture = Image.fromarray(upright(pixels)).resize(size, Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(picture)
    x_m, y_m, yaw_rad = view.pose

    def pixel(x: float, y: float) -> tuple[float, float]:
        along, across = x / view.cell_m - view.corner_i, y / view.cell_m - view.corner_j
        return picture.width - across * scale, picture.height - along * scale

    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    outline = [(0.52, 0.0), (-0.2, 0.3), (-0.2, -0.3)]
    corners = [pixel(x_m + c * u - s * v, y_m + s * u + c * v) for u, v in outline]
    draw.polygon(corners, fill=ROBOT, outline=BLACK)
    foot, metre_px = picture.height - 6, scale / view.cell_m
    draw.line([(6, foot), (6 + metre_px, foot)], fill=BLACK, width=3)
    draw.text((6, foot - 14), "1 m", fill=BLACK)
    draw.rectangle([0, 0, picture.width - 1, picture.height - 1], outline=EDGE)
    return picture


def draw_maps(
    path: Path,
    title: str,
    views: Sequence[MapView],
    x_m: tuple[float, float],
    y_m: tuple[float, float],
) -> None:
    """Elevation and obstacles of each method, side by side, of a rectangle of the map, as PNG.

    The two maps of a method stand one above the other where they are broad, else beside it.
    """
    pairs = []
    for view in views:
        part = _cropped(view, x_m, y_m)
        layers = (elevation_pixels(part.heights_m), obstacle_pixels(part.states))
        pairs.append((view.name, [_panel(part, layer) for layer in layers]))
    wide = max(panel.width for _, panels in pairs for panel in panels)
    high = max(panel.height for _, panels in pairs for panel in panels)
    beside = high > 1.2 * wide
    per_method = wide + MARGIN_PX + beside * (wide + MARGIN_PX)
    tall = high if beside else 2 * high + MARGIN_PX
    size = (MARGIN_PX + len(pairs) * per_method, TITLE_PX + LABEL_PX + tall + MARGIN_PX)
    sheet = Image.new("RGB", size, WHITE)
    draw = ImageDraw.Draw(sheet)
    draw.text((MARGIN_PX, 4), title, fill=BLACK)
    for k, (name, panels) in enumerate(pairs):
        left, top = MARGIN_PX + k * per_method, TITLE_PX + LABEL_PX
        draw.text((left, TITLE_PX), name, fill=BLACK)
        step = (wide + MARGIN_PX, 0) if beside else (0, high + MARGIN_PX)
        for n, panel in enumerate(panels):
            sheet.paste(panel, (left + n * step[0], top + n * step[1]))
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)
