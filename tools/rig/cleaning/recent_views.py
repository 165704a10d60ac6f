"""What frames looked over not long ago: only there does a machine drive on at full speed.

A frame in which the floor is known vouches for all between the lens and the far edge of its view.
What is low and nearer than the near edge it cannot see; what is as high as a leg it would have met.
Map frame, metres, seconds.
"""

import math
from collections import deque

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from core.records import F64

LEAST_M = 0.02  # of floor that is seen at a bearing: less vouches for nothing


class RecentViews:
    """Views of the last seconds.

    Args:
        keep_s: so long a view vouches for what it looked over.
    """

    def __init__(self, keep_s: float) -> None:
        self._keep_s = keep_s
        self._views = deque[tuple[float, BaseGeometry]]()
        self.last_s = -math.inf  # of the newest view

    def add(self, t_s: float, lens: tuple[float, float], view: F64) -> None:
        """A frame's view (n, 2), and where its lens was; one without floor vouches for nothing."""
        if len(view) < 3 or not np.isfinite(view).all():
            return
        self.last_s = t_s
        over = shapely.buffer(_looked_over(lens, view), 0.0)
        shapely.prepare(over)
        self._views.append((t_s, over))

    def vouch(self, points: F64, now_s: float) -> bool:
        """Whether each of some places (n, 2) was looked over in the last seconds."""
        while self._views and now_s - self._views[0][0] > self._keep_s:
            self._views.popleft()
        seen = np.zeros(len(points), dtype=bool)
        for _, over in reversed(self._views):
            seen |= shapely.contains_xy(over, points[:, 0], points[:, 1])
            if seen.all():
                return True
        return bool(seen.all())


def _looked_over(lens: tuple[float, float], view: F64) -> Polygon:
    """From the lens to the far edge, at all bearings at which floor was seen."""
    off = view - lens
    ahead = off.mean(axis=0)
    turn = np.arctan2(ahead[0] * off[:, 1] - ahead[1] * off[:, 0], off @ ahead)
    bearings, which = np.unique(np.round(turn, 6), return_inverse=True)
    near, far = np.full(len(bearings), np.inf), np.zeros(len(bearings))
    np.minimum.at(near, which.ravel(), np.hypot(*off.T))
    np.maximum.at(far, which.ravel(), np.hypot(*off.T))
    reach = np.where(far - near > LEAST_M, far, 0.0)
    angles = math.atan2(ahead[1], ahead[0]) + bearings
    ends = np.array(lens) + reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return Polygon([lens, *ends])
