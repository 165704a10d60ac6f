"""What one frame told, all of it, as it enters the app at a tick: the only thing that does."""

from msgspec import Struct

from core.pose_fix import PoseFix
from core.records import F32, I64, ObjectReport


class Seen(Struct, frozen=True, eq=False):
    """One frame's message. With a doubt it tells nothing, and nothing else of it counts."""

    t_s: float  # host monotonic clock, the middle of its exposure
    # of the map in which it was placed, by how often maps were erased; in a recording less how
    # often they were when it entered, for a file may begin in the middle of a run
    epoch: int
    doubt: str  # in a word; "": none
    lens_m: tuple[float, float, float]  # sensor frame: where the rays begin
    directions: F32  # (n, 3) unit vectors, sensor frame
    ranges_m: F32  # (n,)
    standing: I64  # (k, 2) world cells i, j of the map in which something bars the way
    changed: tuple[ObjectReport, ...]  # objects: new ones, and those of which something differs
    gone: tuple[int, ...]  # their ids
    fix: PoseFix | None = None  # what known walls say of the pose; as it enters, of the body's
