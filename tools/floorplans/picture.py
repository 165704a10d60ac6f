"""A picture of a floor plan and of a path that sweeps it: x to the right, y up, to scale."""

from collections.abc import Sequence

import numpy as np
import shapely
from PIL import Image, ImageDraw
from shapely.geometry.base import BaseGeometry

from core.paths.geometry.space import polygons_in
from core.paths.records import Segment
from core.records import F64

EDGE_PX, TEXT_PX, OVER = 12, 18, 2  # drawn so many times as large, then made smaller
WALL, FREE, REACHED, MISSED = "#303030", "#b8b8b8", "#ffffff", "#e04030"
INK = {"sweep": "#1f5fbf", "travel": "#2a9d3a"}
LEGEND = (
    (REACHED, "can be swept"),
    (MISSED, "missed"),
    (FREE, "too narrow"),
    (INK["sweep"], "sweeps"),
    (INK["travel"], "travels"),
)
Layer = tuple[BaseGeometry, str]


class Sheet:
    """A drawing of a floor at so many pixels the metre."""

    def __init__(self, floor: BaseGeometry, size_px: int) -> None:
        self._low_x, _, high_x, self._high_y = floor.bounds
        low_y = floor.bounds[1]
        wide, high = high_x - self._low_x, self._high_y - low_y
        self._scale = OVER * (size_px - 2 * EDGE_PX) / max(wide, high)
        edge = 2 * OVER * EDGE_PX
        size = (round(self._scale * wide) + edge, round(self._scale * high) + edge + OVER * TEXT_PX)
        self._image = Image.new("RGB", size, WALL)
        self._draw = ImageDraw.Draw(self._image)

    def _pixels(self, points: F64) -> list[tuple[float, float]]:
        x = (points[:, 0] - self._low_x) * self._scale + OVER * EDGE_PX
        y = (self._high_y - points[:, 1]) * self._scale + OVER * EDGE_PX
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def area(self, shape: BaseGeometry, colour: str) -> None:
        """Fill polygons; cut into triangles, so that holes stay as they are."""
        for polygon in polygons_in(shape):
            for part in polygons_in(shapely.constrained_delaunay_triangles(polygon)):
                self._draw.polygon(self._pixels(shapely.get_coordinates(part)), fill=colour)

    def line(self, points: F64, colour: str) -> None:
        """A path, with a dot at each end."""
        self._draw.line(self._pixels(points), fill=colour, width=round(1.5 * OVER))

    def dot(self, point: F64, colour: str) -> None:
        """A place."""
        [(x, y)] = self._pixels(point[None])
        r = 4 * OVER
        self._draw.ellipse((x - r, y - r, x + r, y + r), fill=colour, outline="black")

    def done(self, legend: Sequence[tuple[str, str]]) -> Image.Image:
        """The picture, with the legend below."""
        small = self._image.resize((self._image.width // OVER, self._image.height // OVER))
        draw = ImageDraw.Draw(small)
        x, y = EDGE_PX, small.height - TEXT_PX
        for colour, text in legend:
            draw.rectangle((x, y, x + 10, y + 10), fill=colour)
            draw.text((x + 14, y - 1), text, fill="white")
            x += 22 + round(draw.textlength(text))
        return small


def drawn(
    floor: BaseGeometry, layers: Sequence[Layer], segments: Sequence[Segment], size_px: int = 900
) -> Image.Image:
    """Areas one upon the other, then the path, with its first and last point."""
    sheet = Sheet(floor, size_px)
    sheet.area(floor, FREE)
    for shape, colour in layers:
        sheet.area(shape, colour)
    for segment in segments:
        sheet.line(segment.points, INK[segment.kind])
    if segments:
        sheet.dot(np.asarray(segments[0].points[0]), "#ffd040")
        sheet.dot(np.asarray(segments[-1].points[-1]), "#d070e0")
    return sheet.done(LEGEND)
