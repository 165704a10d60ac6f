"""Outlines with as many corners as a planner is told: larger ones that go round the same bays.

Source: planner link, section 3 (OBJECTS).
"""

import numpy as np
import shapely

from core.objects.records import Floats

MOST_CORNERS = 64  # of the link's records
STEPS_M = (0.01, 0.02, 0.04, 0.08, 0.16)  # by which an outline may grow, the least that is enough


def told_outline(outline: Floats) -> tuple[Floats, bool]:
    """An outline (n, 2) of at most that many corners, and whether it is larger than the given one.

    An L of two walls stays an L, where its convex hull would cover the room between. What has too
    many corners even so is given back as it is: the link takes the hull then.
    """
    if len(outline) <= MOST_CORNERS:
        return outline, False
    own = shapely.Polygon(outline)
    for step_m in STEPS_M:
        wide = shapely.buffer(own, step_m, join_style="mitre", mitre_limit=2.0)
        simple = shapely.simplify(shapely.Polygon(wide.exterior), 0.9 * step_m)
        if len(simple.exterior.coords) - 1 <= MOST_CORNERS and simple.covers(own):
            ring = shapely.orient_polygons(simple).exterior
            return np.asarray(ring.coords)[:-1], True
    return outline, False
