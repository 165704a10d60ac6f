"""The path that the sender's robot is to drive, put together from its pieces.

Source: planner link, section 3 (PATH).
"""

import math
import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
PATH_HEAD = struct.Struct("<HBBHHHHHHii")  # see the sheet; the points follow
POINT_BYTES, NOWHERE, FARTHEST_MM = 4, 0xFFFF, 2_100_000_000
TRAVEL, SWEEP = 0, 1  # kinds of a segment; higher ones are of later days
PATH_STALE_S = 0.7  # no frame for so long: nobody knows whether this is still the path
SETTLE_S, RETRY_S = 0.5, 1.0  # the sender repairs by itself before it is asked; between questions


@dataclass(frozen=True, slots=True, eq=False)
class PathPiece:
    """One PATH frame."""

    number: int  # of the path
    geom_id: int
    kind: int  # of its points
    total: int  # points of the whole path
    first: int  # point of this piece
    segment: int
    segments: int
    ahead: int
    left_out: int
    points_m: F64  # (n, 2)


def maybe_path_piece(body: bytes) -> PathPiece | None:
    """None if length and numbers do not fit each other."""
    if len(body) < PATH_HEAD.size:
        return None
    head = PATH_HEAD.unpack_from(body)
    number, geom_id, kind, total, first, segment, segments, ahead, left_out, x_mm, y_mm = head
    points, rest = divmod(len(body) - PATH_HEAD.size, POINT_BYTES)
    fits = rest == 0 and number > 0 and first + points <= total and (points > 0 or total == 0)
    fits &= max(abs(x_mm), abs(y_mm)) <= FARTHEST_MM and (ahead == NOWHERE or ahead <= total)
    if not fits or (points and segment >= segments):
        return None
    offsets = np.frombuffer(body, "<i2", 2 * points, PATH_HEAD.size).reshape(points, 2)
    points_m = (np.array([x_mm, y_mm], np.float64) + offsets.astype(np.float64)) / 1000
    told = number, geom_id, kind, total, first, segment, segments, ahead, left_out
    return PathPiece(*told, points_m)


class Path:
    """The newest path, as far as it has arrived.

    Attributes:
        number: of the path; 0 before the first one.
        points_m: (n, 2) map frame, in the order of driving; NaN where a piece is missing.
        kinds, segments: (n,) what is done on the way to each point, and the segment that it is of.
        ahead: the point that the robot drives to; n: it has passed all; None: it drives to none.
        left_out: points behind the last that the sender could not tell; 65 535: that or more.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """A new epoch or run, or a long silence: what was told means nothing any more."""
        self._begin(0, 0)
        self._arrived_s = self._changed_s = self._asked_s = -math.inf
        self._gaps, self._damaged = -1, False

    def _begin(self, number: int, total: int) -> None:
        self.number, self.left_out = number, 0
        self.ahead: int | None = None
        self.points_m: F64 = np.full((total, 2), np.nan)
        self.kinds = np.zeros(total, np.uint8)
        self.segments = np.zeros(total, np.uint16)

    @property
    def whole(self) -> bool:
        """Every point that was told of is here."""
        return self.number > 0 and not bool(np.isnan(self.points_m).any())

    def damage(self) -> None:
        """A frame has come that could not be read."""
        self._damaged = True

    def take(self, now_s: float, piece: PathPiece, gaps: int) -> None:
        """One frame of the epoch in use; `gaps`: how often frames were missing so far."""
        if piece.number != self.number or piece.total != len(self.points_m):
            self._begin(piece.number, piece.total)
            self._changed_s = now_s
        part = slice(piece.first, piece.first + len(piece.points_m))
        self.points_m[part] = piece.points_m
        self.kinds[part], self.segments[part] = piece.kind, piece.segment
        self.ahead = None if piece.ahead == NOWHERE else piece.ahead
        self.left_out, self._arrived_s = piece.left_out, now_s
        self._gaps, self._damaged = gaps, False

    def state(self, now_s: float, gaps: int) -> tuple[str, str]:
        """("known" | "suspect" | "none", why): what the path here is worth."""
        if not self.number:
            return "none", "no path told yet"
        if self.is_stale(now_s):
            return "suspect", "the path comes late"
        if gaps != self._gaps:  # of another path, perhaps
            return "suspect", "a frame is missing"
        if self._damaged or not self.whole:
            return "suspect", "a piece is missing"
        return "known", ""

    def is_stale(self, now_s: float) -> bool:
        """Nobody tells of the path any more: it may be another one."""
        return now_s - self._arrived_s > PATH_STALE_S

    def is_question_due(self, now_s: float) -> bool:
        """A piece has been missing for a while: it is to be asked for, and noted so."""
        if not self.number or self.whole or now_s - self._changed_s < SETTLE_S:
            return False
        is_due = now_s - self._asked_s >= RETRY_S
        self._asked_s = now_s if is_due else self._asked_s
        return is_due
