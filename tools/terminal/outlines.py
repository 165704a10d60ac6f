"""Objects and path of a planner link: what of them may be shown, and the cells that they lie on."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mapod_link.objects import LinkObject
from mapod_link.receiver import Receiver

F64 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint8]
OBSTACLE = 2  # a path is not drawn over it
OBJECT, MOVING, PATH = 4, 5, 6  # drawn over the cells
SHARE = 0.4  # of a cell: the way between two samples of a line


def current_objects(receiver: Receiver, now_s: float) -> list[LinkObject]:
    """Those that may be shown as there: none of a link or list that is stale.

    What moved and was not seen lately is left out.
    """
    vectors = receiver.vectors
    if receiver.stale(now_s) or vectors.objects.is_stale(now_s):
        return []
    return vectors.fresh_objects(now_s)


def path_ahead(receiver: Receiver, now_s: float) -> slice:
    """The points of the link's path that are still to be driven, from the one passed last.

    None of a link or path that is stale, or of one that is done.
    """
    path = receiver.vectors.path
    done = path.ahead is not None and path.ahead >= len(path.points_m)
    if done or receiver.stale(now_s) or path.is_stale(now_s):
        return slice(0, 0)
    return slice(max((path.ahead or 0) - 1, 0), None)


def objects_words(receiver: Receiver, now_s: float) -> str:
    """How many are shown, and why that may not be all; "": nobody tells of objects."""
    state, why = receiver.vectors.objects_state(now_s)
    if state == "none":
        return ""
    shown = current_objects(receiver, now_s)
    moving = sum(one.moves for one in shown)
    words = f"{len(shown)}, {moving} moving" if moving else f"{len(shown)}"
    return f"{words}; not sure: {why}" if why else words


def path_words(receiver: Receiver, now_s: float) -> str:
    """How much of it is left; "": nobody tells of a path."""
    state, why = receiver.vectors.path_state(now_s)
    if state == "none":
        return ""
    points = len(receiver.vectors.path.points_m[path_ahead(receiver, now_s)])
    words = f"{points} points" if points else "none"
    return f"{words}; not sure: {why}" if why else words


@dataclass(frozen=True, slots=True)
class Lines:
    """What is drawn over the cells of a window."""

    objects: tuple[F64, ...] = ()  # (n, 2) corners, in cells from the window's lowest corner
    moving: tuple[F64, ...] = ()
    path: F64 | None = None  # (n, 2); NaN where a point is not known

    @property
    def any(self) -> bool:
        return bool(self.objects or self.moving or self.path is not None)

    def draw(self, image: U8, shape: tuple[int, ...], factor: int) -> None:
        """Into an image of a window of `shape`, in which factor x factor cells are one."""
        if self.path is not None:
            row, col = self._drawn(self.path, image, shape, factor)
            bare = image[row, col] != OBSTACLE
            image[row[bare], col[bare]] = PATH
        for kind, outlines in ((OBJECT, self.objects), (MOVING, self.moving)):
            for outline in outlines:
                closed = np.vstack([outline, outline[:1]])
                image[self._drawn(closed, image, shape, factor)] = kind

    @staticmethod
    def _drawn(
        line: F64, image: U8, shape: tuple[int, ...], factor: int
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """(row, column) of the image's pixels that a line in the window meets."""
        height, width = shape
        cells = cells_on(line, (width, height), SHARE * factor)
        row, col = (width - 1 - cells[:, 0]) // factor, (height - 1 - cells[:, 1]) // factor
        inside = (row < image.shape[0]) & (col < image.shape[1])
        return row[inside], col[inside]


def lines_of(receiver: Receiver, now_s: float) -> Lines:
    """What may be shown now; nothing while there is no window."""
    if receiver.geom is None or receiver.origin is None:
        return Lines()
    cell_m, origin = receiver.geom.cell_m, np.array(receiver.origin, np.float64)
    shown = current_objects(receiver, now_s)
    points_m = receiver.vectors.path.points_m[path_ahead(receiver, now_s)]
    return Lines(
        tuple(one.outline_m / cell_m - origin for one in shown if not one.moves),
        tuple(one.outline_m / cell_m - origin for one in shown if one.moves),
        points_m / cell_m - origin if len(points_m) else None,
    )


def cells_on(line: F64, size: tuple[int, int], step: float) -> npt.NDArray[np.int64]:
    """The cells of a window of `size` (columns, rows) that a line of (n, 2) corners meets: (k, 2).

    Sampled each `step` cells. However long a line is, only what lies in the window costs anything;
    where a corner is NaN there is no line.
    """
    begin, way = line[:-1], np.diff(line, axis=0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        at_low, at_high = -begin / way, (np.array(size, np.float64) - begin) / way
    still = way == 0.0  # along an axis: in the window all the way, or never
    within = (begin >= 0.0) & (begin < size)
    first = np.where(still, np.where(within, 0.0, np.inf), np.minimum(at_low, at_high)).max(axis=1)
    last = np.where(still, np.where(within, 1.0, -np.inf), np.maximum(at_low, at_high)).min(axis=1)
    first, last = np.maximum(first, 0.0), np.minimum(last, 1.0)
    kept = first <= last  # not where a corner is NaN
    begin, way, first, last = begin[kept], way[kept], first[kept], last[kept]
    count = np.ceil(np.hypot(*way.T) * (last - first) / step).astype(np.int64) + 1
    which = np.repeat(np.arange(len(count)), count)
    sample = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    share = first[which] + (last - first)[which] * sample / np.maximum(count - 1, 1)[which]
    cells = np.floor(begin[which] + share[:, None] * way[which]).astype(np.int64)
    inside = ((cells >= 0) & (cells < size)).all(axis=1)
    return np.unique(cells[inside], axis=0)
