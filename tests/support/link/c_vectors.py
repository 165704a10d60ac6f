"""The C header's objects and path, for tests of the header."""

from ctypes import Structure, byref
from ctypes import c_uint32 as u32

from mapod_link.receiver import Receiver
from tests.support.link.c_link import CReceiver
from tools.conformance.c_receiver import c_struct

WITH_OBJECTS = "-DMAPOD_LINK_OBJECTS"
WORTHS = (
    "known", "none", "late", "gap", "left out", "differs", "waiting", "blind",
)  # fmt: skip
WORDS = {  # what the public receiver says instead
    "": "known", "no objects told yet": "none", "no path told yet": "none",
    "objects come late": "late", "the path comes late": "late", "a frame is missing": "gap",
    "the list is not the sender's": "differs", "a piece is missing": "differs",
    "nothing looks for objects": "blind",
}  # fmt: skip


class VectorReceiver(CReceiver):
    """A receiver of the header that keeps objects and the path."""

    def __init__(self, *settings: str, max_cells: int = 100) -> None:
        super().__init__(1, max_cells=max_cells, settings=(WITH_OBJECTS, *settings))

    def vectors(self, now_s: float) -> Structure:
        """`struct vectors` of library.c."""
        known = c_struct("vectors")()
        self._call("vectors", u32(self._ms(now_s)), byref(known))
        return known

    def objects_worth(self, now_s: float) -> str:
        return WORTHS[self.vectors(now_s).objects_worth]

    def path_worth(self, now_s: float) -> str:
        return WORTHS[self.vectors(now_s).path_worth]

    def objects(self, now_s: float) -> dict[int, Structure]:
        """`struct shown` of library.c, by id."""
        held = {}
        for k in range(self.vectors(now_s).count):
            one = c_struct("shown")()
            self._call("object", u32(self._ms(now_s)), u32(k), byref(one))
            held[one.id] = one
        return held

    def way_point(self, k: int) -> tuple[int, int, int, int] | None:
        """x, y (mm), segment and kind; None: it has not arrived."""
        one = c_struct("way_point")()
        self._call("way_point", u32(k), byref(one))
        return (one.x_mm, one.y_mm, one.segment, one.kind) if one.here else None


def corners_mm(shown: Structure) -> list[tuple[int, int]]:
    """Map frame."""
    unit, x_mm, y_mm = shown.unit_mm, shown.x_mm, shown.y_mm
    corners = zip(shown.corner_x[: shown.corners], shown.corner_y[: shown.corners], strict=True)
    return [(x_mm + unit * x, y_mm + unit * y) for x, y in corners]


def worth_of(said: tuple[str, str]) -> str:
    """What the public receiver says, as the header calls it."""
    return "waiting" if said[1].endswith("still to be told") else WORDS[said[1]]


def assert_they_agree(receiver: Receiver, header: VectorReceiver, now_s: float) -> None:
    """Both hold the same objects and path, and think the same of them."""
    vectors, known = receiver.vectors, header.vectors(now_s)
    assert worth_of(vectors.objects_state(now_s)) == WORTHS[known.objects_worth]
    assert worth_of(vectors.path_state(now_s)) == WORTHS[known.path_worth]
    held = header.objects(now_s)
    assert held.keys() == vectors.objects.by_id.keys()
    for number, one in vectors.objects.by_id.items():
        other = held[number]
        outline = [(round(1000 * x), round(1000 * y)) for x, y in one.outline_m]
        assert outline == corners_mm(other)
        assert (one.kind, one.digest, one.seen_ms) == (other.kind, other.digest, other.seen_ms)
        assert vectors.objects.is_old(one, now_s) == bool(other.old)
    path = vectors.path
    assert (path.number, len(path.points_m)) == (known.number, known.total)
    for k, (x_m, y_m) in enumerate(path.points_m):
        told = header.way_point(k)
        assert (told is None) == bool(x_m != x_m)
        if told is not None:
            assert told[:2] == (round(1000 * x_m), round(1000 * y_m))
            assert told[2:] == (path.segments[k], path.kinds[k])
