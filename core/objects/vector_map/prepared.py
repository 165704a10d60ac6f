"""A frame as the fields of objects want it: hulls with depth, cut into pieces, and the view."""

from typing import NamedTuple

import numpy as np
import shapely

from core.objects.records import Detection, Floats, FrameObjects
from core.objects.vector_map.contour import area_of
from core.objects.vector_map.seen import mark_seen, pieces_of, sectors_of
from core.objects.vector_map.settings import ObjectMapSettings


class PreparedFrame(NamedTuple):
    """A frame and what was made of it."""

    frame: FrameObjects
    sectors: Floats
    lens: Floats
    pieces: list[Floats]  # of each detection, marked where seen
    polygons: list[shapely.Polygon]


def thickened(frame: FrameObjects, s: ObjectMapSettings) -> FrameObjects:
    """A frame whose hulls all have some depth; detections that have no hull are left out."""
    found = tuple(one for d in frame.detections if (one := _thick(d, frame.origin, s)))
    return frame._replace(detections=found)


def prepared(frame: FrameObjects, s: ObjectMapSettings) -> PreparedFrame:
    """Make of a frame, by `thickened`, what the fields want."""
    sectors = sectors_of(frame.view, frame.origin)
    pieces = [pieces_of(one.polygon, 2.0 * s.cell_m) for one in frame.detections]
    for part in pieces:
        mark_seen(part, sectors, *frame.origin, s.view_gap_m + s.cell_m)
    polygons = [shapely.Polygon(one.polygon) for one in frame.detections]
    return PreparedFrame(frame, sectors, np.array(frame.origin), pieces, polygons)


def seen_of(pieces: Floats) -> Floats:
    """Those pieces (k, 5) of a hull that the frame saw."""
    return pieces[pieces[:, 4] > 0.0]


def _thick(
    detection: Detection, origin: tuple[float, float], s: ObjectMapSettings
) -> Detection | None:
    """A detection whose hull has some depth behind what was seen of it; None: no hull at all.

    Of a face seen straight on, a hull is a line: things are at least two cells deep.
    """
    corners = detection.polygon
    if len(corners) < 2:
        return None
    polygon = shapely.Polygon(corners) if len(corners) > 2 else shapely.LineString(corners)
    if not polygon.is_valid:
        polygon = polygon.convex_hull
    if polygon.is_empty or polygon.length <= 0.0:
        return None
    deep = 2.0 * s.cell_m
    if polygon.geom_type != "Polygon" or polygon.buffer(-0.5 * deep).is_empty:
        points = shapely.get_coordinates(polygon)
        away = points - np.array(origin)
        away = away / np.maximum(np.hypot(*away.T), 1e-9)[:, None]
        polygon = shapely.MultiPoint(np.vstack([points, points + deep * away])).convex_hull
        if polygon.geom_type != "Polygon":
            return None
    corners = np.asarray(polygon.exterior.coords)[:-1]
    if area_of(corners) < 0.0:
        corners = corners[::-1]
    return detection._replace(polygon=np.ascontiguousarray(corners))


def check_frame(frame: FrameObjects, last_s: float) -> None:
    """Raises ValueError where a number is not finite, or time runs backwards."""
    if not last_s <= frame.at_s < np.inf:
        raise ValueError(f"at_s: must be finite and at least {last_s}, is {frame.at_s}")
    if not np.isfinite(frame.origin).all():
        raise ValueError(f"origin: must be finite, is {frame.origin}")
    numbers = [frame.view, frame.walls, *(one.polygon for one in frame.detections)]
    heights = [(one.bottom_m, one.top_m) for one in frame.detections]
    if not all(np.isfinite(part).all() for part in [*numbers, np.array(heights)]):
        raise ValueError(f"frame of {frame.at_s} s: has numbers that are not finite")
