"""A plan over the floor, as the bytes of a record: MessagePack, of arrays as their bytes."""

import msgspec
import numpy as np

from core.paths.cleaning.planned import Planned
from core.records import PathSegment
from recording.records import RecordingError

Told = tuple[float, int, str, str, list[tuple[bool, bytes]], float, float]
DECODER = msgspec.msgpack.Decoder(Told)


def bytes_from_planned(planned: Planned) -> bytes:
    """All of it, to the bit."""
    segments = [(one.sweeps, one.points_m.astype("<f8").tobytes()) for one in planned.segments]
    p = planned
    return msgspec.msgpack.encode((p.t_s, p.epoch, p.goal, p.why, segments, p.seen_m2, p.clean_m2))


def planned_from_bytes(data: bytes) -> Planned:
    """The same again. Raises RecordingError: the bytes are no such message."""
    try:
        t_s, epoch, goal, why, told, seen_m2, clean_m2 = DECODER.decode(data)
        segments = tuple(
            PathSegment(sweeps, np.frombuffer(points, "<f8").reshape(-1, 2))
            for sweeps, points in told
        )
        return Planned(t_s, epoch, goal, why, segments, seen_m2, clean_m2)
    except (msgspec.DecodeError, ValueError) as error:
        raise RecordingError(f"a plan over the floor is damaged: {error}") from None
