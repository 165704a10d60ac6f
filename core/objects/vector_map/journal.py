"""What changed since when: versions, deletions and a digest of the whole, for who keeps a copy.

A version counts the changes of a run. Whoever has the map of version v gets what was changed or
deleted behind it; where deletions that far back are no longer known, the answer is the whole map.
"""

import hashlib
import math
from collections import OrderedDict
from itertools import takewhile

import numpy as np
import shapely
from msgspec import Struct

from core.objects.records import Floats

KEPT_DELETIONS = 4096  # so far back a copy can lie without being sent the whole map
MM = 1000.0


class Shape(Struct, frozen=True, eq=False):
    """One thing as it is told: whole millimetres, so that both ends have the same numbers."""

    id: int
    kind: str  # "object" or "wall"
    corners_mm: np.ndarray  # (n, 2) int32: a polygon; of a wall (2 n, 2), ends of its segments
    bottom_mm: int
    top_mm: int

    @property
    def digest(self) -> int:
        """64 bits of what is told of it: id, kind, heights and corners, little-endian."""
        head = np.array([self.id, self.bottom_mm, self.top_mm, len(self.corners_mm)], dtype="<i8")
        body = self.kind.encode() + head.tobytes() + self.corners_mm.astype("<i4").tobytes()
        return int.from_bytes(hashlib.blake2b(body, digest_size=8).digest(), "little")

    def differs_by_m(self, other: "Shape") -> float:
        """How far corners or heights are apart, m; of other numbers of corners, how far outlines.

        inf: a wall has other numbers of segments.
        """
        if self.corners_mm.shape == other.corners_mm.shape:
            apart = float(np.abs(self.corners_mm - other.corners_mm).max(initial=0))
        elif self.kind == "wall":
            return math.inf
        else:
            ring = shapely.LinearRing(self.corners_mm)
            apart = float(ring.hausdorff_distance(shapely.LinearRing(other.corners_mm)))
        heights = abs(self.bottom_mm - other.bottom_mm), abs(self.top_mm - other.top_mm)
        return float(max(apart, *heights)) / MM


def shape_of(number: int, kind: str, corners: Floats, bottom_m: float, top_m: float) -> Shape:
    """From metres: corners (n, 2)."""
    corners_mm = np.rint(MM * corners).astype(np.int32)
    return Shape(number, kind, corners_mm, round(MM * bottom_m), round(MM * top_m))


class Changes(Struct, frozen=True, eq=False):
    """From an older copy to the map as it is now."""

    version: int
    is_whole: bool  # forget all that is not in `changed`
    changed: tuple[Shape, ...]
    deleted: tuple[int, ...]  # ids
    digest: int  # of the whole map, when these are applied


class Journal:
    """The told state of every thing, in the order of its last change."""

    def __init__(self, kept_deletions: int = KEPT_DELETIONS) -> None:
        self._kept_deletions = kept_deletions
        self.version, self.digest = 0, 0
        self._told: OrderedDict[int, tuple[int, Shape]] = OrderedDict()
        self._deleted: OrderedDict[int, int] = OrderedDict()  # id: version
        self._forgotten = 0  # deletions up to this version are no longer known

    def maybe_told(self, number: int) -> Shape | None:
        """What is told of a thing now; None: nothing."""
        found = self._told.get(number)
        return None if found is None else found[1]

    def tell(self, shape: Shape) -> None:
        self._take(shape.id)
        self.version += 1
        self._told[shape.id] = self.version, shape
        self.digest ^= shape.digest

    def delete(self, number: int) -> None:
        """A thing is gone; one that was never told is not missed."""
        if not self._take(number):
            return
        self.version += 1
        self._deleted[number] = self.version
        if len(self._deleted) > self._kept_deletions:
            _, self._forgotten = self._deleted.popitem(last=False)

    def since(self, version: int) -> Changes:
        """What a copy of that version lacks; 0: a copy that has nothing yet.

        Raises:
            ValueError: there has been no such version.
        """
        if not 0 <= version <= self.version:
            raise ValueError(f"version: must be within 0..{self.version}, is {version}")
        is_whole = version == 0 or version < self._forgotten
        after = 0 if is_whole else version
        newer = takewhile(lambda entry: entry[0] > after, reversed(self._told.values()))
        changed = tuple(shape for _, shape in newer)[::-1]
        gone = takewhile(lambda entry: entry[1] > after, reversed(self._deleted.items()))
        deleted = () if is_whole else tuple(number for number, _ in gone)[::-1]
        return Changes(self.version, is_whole, changed, deleted, self.digest)

    def _take(self, number: int) -> bool:
        before = self._told.pop(number, None)
        if before is not None:
            self.digest ^= before[1].digest
        return before is not None
