"""What a frame of the depth camera told, as the bytes of a record.

MessagePack, of arrays as their bytes, little-endian. Its pixels are not recorded: they are a
thousand times as much as all else.
"""

from typing import Any

import msgspec
import numpy as np

from core.objects.seen import Seen
from core.records import ObjectReport
from recording.records import RecordingError


def bytes_from_seen(seen: Seen) -> bytes:
    """All of it, to the bit."""
    return msgspec.msgpack.encode(
        (
            *(seen.t_s, seen.epoch, seen.doubt, seen.lens_m),
            *(seen.directions.astype("<f4").tobytes(), seen.ranges_m.astype("<f4").tobytes()),
            seen.standing.astype("<i8").tobytes(),
            [
                (
                    *(one.id, one.kind, one.outline_m.astype("<f8").tobytes()),
                    *(one.bottom_m, one.top_m, one.velocity_mps, one.confidence, one.seen_s),
                    one.enlarged,
                )
                for one in seen.changed
            ],
            seen.gone,
        )
    )


class Told(msgspec.Struct, array_like=True):
    """An `ObjectReport`; in older recordings without the last field."""

    id: int
    kind: int
    outline: bytes
    bottom_m: float
    top_m: float
    velocity_mps: tuple[float, float]
    confidence: float
    seen_s: float
    enlarged: bool = False


Whole = tuple[
    float, int, str, tuple[float, float, float], bytes, bytes, bytes, list[Told], tuple[int, ...]
]
DECODER = msgspec.msgpack.Decoder(Whole)


def seen_from_bytes(data: bytes) -> Seen:
    """The same again. Raises RecordingError: the bytes are no such message."""
    try:
        t_s, epoch, doubt, lens_m, directions, ranges, standing, changed, gone = DECODER.decode(
            data
        )
        return Seen(
            *(t_s, epoch, doubt, lens_m),
            *(_array(directions, "<f4", 3), _array(ranges, "<f4", 0), _array(standing, "<i8", 2)),
            tuple(
                ObjectReport(
                    *(one.id, one.kind, _array(one.outline, "<f8", 2), one.bottom_m, one.top_m),
                    *(one.velocity_mps, one.confidence, one.seen_s, one.enlarged),
                )
                for one in changed
            ),
            gone,
        )
    except (msgspec.DecodeError, ValueError) as error:
        raise RecordingError(f"what a depth frame told is damaged: {error}") from None


def _array(data: bytes, kind: str, width: int) -> Any:
    """(n, width), or (n,) for a width of 0."""
    flat = np.frombuffer(data, kind)
    return flat.reshape(-1, width) if width else flat
