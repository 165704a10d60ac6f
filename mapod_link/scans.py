"""The newest sweep of the sender's scanner, asked for and put together from its pieces.

A sweep is of one instant: what gets lost is not asked for again, but the newest sweep is.
Source: planner link, section 3, ASK and SCAN.
"""

import math
import struct
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mapod_link.asking import ASK_SCAN, ask_body

F64 = npt.NDArray[np.float64]
SCAN_HEAD = struct.Struct("<HBBHHHxxIiii")  # id, status, unit, count, first, returns, t, lens
POINT_BYTES = 6
RETRY_S = 0.5  # no piece for so long: something got lost


class ScanPiece(NamedTuple):
    """One SCAN frame; its length fits what it says."""

    id: int
    status: int  # 0 points follow
    total: int  # points of all pieces together
    first: int  # point of this piece
    returns: int
    t_ms: int
    lens_m: tuple[float, float, float]
    points_m: F64  # (n, 3)


@dataclass(frozen=True, slots=True)
class SweepPoints:
    """What one sweep met."""

    t_ms: int  # sender's clock, of its last beam
    arrived_s: float  # receiver's clock, when it was whole
    lens_m: tuple[float, float, float]  # map frame: where that beam began
    points_m: F64  # (n, 3), map frame, beam by beam
    returns: int  # that the sweep had: more than there are points where they were thinned out


def maybe_scan_piece(body: bytes) -> ScanPiece | None:
    """None if length and numbers do not fit each other."""
    if len(body) < SCAN_HEAD.size:
        return None
    ask_id, status, unit_mm, count, first, returns, t_ms, *lens_mm = SCAN_HEAD.unpack_from(body)
    points, rest = divmod(len(body) - SCAN_HEAD.size, POINT_BYTES)
    fits = rest == 0 and first + points <= count and (points > 0 or count == 0)
    if not (points == rest == 0 if status else unit_mm > 0 and fits):
        return None
    offsets = np.frombuffer(body, "<i2", 3 * points, SCAN_HEAD.size).reshape(points, 3)
    points_m = (np.array(lens_mm, np.float64) + unit_mm * offsets.astype(np.float64)) / 1000
    x_m, y_m, z_m = (part / 1000 for part in lens_mm)
    return ScanPiece(ask_id, status, count, first, returns, t_ms, (x_m, y_m, z_m), points_m)


class Scans:
    """The newest sweep that was asked for, and the answer under way."""

    def __init__(self) -> None:
        self.newest: SweepPoints | None = None  # whole; None: none was, or none may be told
        self._wanted, self._id, self._due_s = False, 0, -math.inf
        self._t_ms: int | None = None  # of the sweep under way
        self._points_m: F64 = np.zeros((0, 3))
        self._here: npt.NDArray[np.bool_] = np.zeros(0, np.bool_)

    def ask(self) -> None:
        self._wanted = True

    def maybe_question(self, now_s: float) -> bytes | None:
        """The body of an ASK frame, if one is due."""
        if not self._wanted or now_s < self._due_s:
            return None
        self._id, self._due_s, self._t_ms = self._id % 0xFFFF + 1, now_s + RETRY_S, None
        return ask_body(self._id, ASK_SCAN)

    def take(self, now_s: float, piece: ScanPiece) -> None:
        """One SCAN frame; of another question than the newest: left alone."""
        if not self._wanted or piece.id != self._id:
            return
        self._due_s = now_s + RETRY_S
        if piece.status:
            self.newest = None
            self._end()
            return
        if self._t_ms != piece.t_ms or len(self._here) != piece.total:
            self._t_ms = piece.t_ms
            self._points_m, self._here = np.zeros((piece.total, 3)), np.zeros(piece.total, np.bool_)
        part = slice(piece.first, piece.first + len(piece.points_m))
        self._points_m[part], self._here[part] = piece.points_m, True
        if self._here.all():
            self.newest = SweepPoints(
                piece.t_ms, now_s, piece.lens_m, self._points_m, piece.returns
            )
            self._end()

    def begin_anew(self) -> None:
        """Another run of the sender: its map frame may be another one."""
        self.newest, self._t_ms, self._due_s = None, None, -math.inf

    def _end(self) -> None:
        """The answer is here: the next question may go out at once."""
        self._wanted, self._t_ms, self._due_s = False, None, -math.inf
