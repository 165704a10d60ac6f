"""Objects and path as pages get them: all that may be shown now, whenever that is another."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import msgspec

from mapod_link.objects import MOVED, MOVING, STATIC, WALL, LinkObject
from tools.terminal.outlines import current_objects, path_ahead
from tools.view.link_end import LinkEnd

MOST_OBJECTS, MOST_POINTS = 256, 2000  # that a page gets: the nearest, and the next
KINDS = {STATIC: "static", MOVED: "moved", MOVING: "moving", WALL: "wall"}  # others stand
NOT_HEARD = "the robot is not heard"


@dataclass(frozen=True, slots=True)
class VectorMessage:
    """One message of the socket; `key`: all that it says but its time."""

    key: object
    text: str


def vectors_of(
    end: LinkEnd, now_s: float, before: Mapping[str, VectorMessage]
) -> dict[str, VectorMessage]:
    """By type; those before where nothing is new, none of what nobody has ever told of."""
    told = {
        "objects": objects_of(end, now_s, before.get("objects")),
        "path": path_of(end, now_s, before.get("path")),
    }
    return {name: message for name, message in told.items() if message is not None}


def objects_of(end: LinkEnd, now_s: float, before: VectorMessage | None) -> VectorMessage | None:
    """The message `objects`; the one before where nothing is new; None: nobody tells of any.

    Where the list has gone, and where nobody knows it any more, it has none.
    """
    receiver = end.receiver
    state, why = receiver.vectors.objects_state(now_s)
    shown = [] if end.trouble else current_objects(receiver, now_s)
    why = NOT_HEARD if end.trouble or receiver.stale(now_s) else why
    near = sorted(shown, key=_distance_from(end))[:MOST_OBJECTS]
    key = end.epoch, state, why, len(shown), tuple((one.id, one.digest) for one in near)
    return _told("objects", now_s, key, before, state, lambda: {
        "why": why,
        "left_out": len(shown) - len(near),
        "objects": [about(one) for one in near],
    })  # fmt: skip


def path_of(end: LinkEnd, now_s: float, before: VectorMessage | None) -> VectorMessage | None:
    """The message `path`, likewise: the points that are still to be driven."""
    receiver, path = end.receiver, end.receiver.vectors.path
    state, why = receiver.vectors.path_state(now_s)
    part = slice(0, 0) if end.trouble else path_ahead(receiver, now_s)
    why = NOT_HEARD if end.trouble or receiver.stale(now_s) else why
    points_m, kinds = path.points_m[part], path.kinds[part]
    head, missing = points_m[:MOST_POINTS], int(math.isnan(points_m.sum()))
    key = end.epoch, state, why, path.number, len(points_m), missing and head.tobytes()
    return _told("path", now_s, key, before, state, lambda: {
        "why": why,
        "left_out": len(points_m) - len(head) + path.left_out * bool(len(points_m)),
        "points": head.round(3).ravel().tolist(),
        "kinds": kinds[:MOST_POINTS].tolist(),
    })  # fmt: skip


def about(one: LinkObject) -> dict[str, object]:
    """An object: outline as x, y, x, y, ... in metres of the map."""
    return {
        "id": one.id, "kind": KINDS.get(one.kind, "other"), "v": one.velocity_mps,
        "bottom_m": one.bottom_m, "top_m": one.top_m, "confidence": round(one.confidence, 2),
        "outline": one.outline_m.round(3).ravel().tolist(),
    }  # fmt: skip


def _told(
    kind: str,
    now_s: float,
    key: object,
    before: VectorMessage | None,
    state: str,
    what: Callable[[], dict[str, object]],
) -> VectorMessage | None:
    if before is not None and before.key == key:
        return before
    if before is None and state == "none":
        return None
    header = {"type": kind, "t_s": now_s, "state": state}
    return VectorMessage(key, msgspec.json.encode(header | what()).decode())


def _distance_from(end: LinkEnd) -> Callable[[LinkObject], tuple[float, int]]:
    """How far the nearest corner of an object is from the robot; then its id."""
    pose = end.receiver.pose
    x_m, y_m = (pose.x_m, pose.y_m) if pose else (0.0, 0.0)

    def distance(one: LinkObject) -> tuple[float, int]:
        x, y = (one.outline_m - (x_m, y_m)).T
        return float((x * x + y * y).min()), one.id

    return distance
