"""What a frame of the depth camera told, as the bytes of a record.

MessagePack, of arrays as their bytes, little-endian. Its pixels are not recorded: they are a
thousand times as much as all else.
"""

from typing import Any

import msgspec
import numpy as np

from core.objects.seen import Seen
from core.pose_fix import PoseFix
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
            seen.fix and [part.astype("<f8").tobytes() for part in (seen.fix.M, seen.fix.y)],
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


class Frame(msgspec.Struct, array_like=True):
    """A `Seen`; in older recordings without the last field."""

    t_s: float
    epoch: int
    doubt: str
    lens_m: tuple[float, float, float]
    directions: bytes
    ranges: bytes
    standing: bytes
    changed: list[Told]
    gone: tuple[int, ...]
    fix: tuple[bytes, bytes] | None = None


DECODER = msgspec.msgpack.Decoder(Frame)


def seen_from_bytes(data: bytes) -> Seen:
    """The same again. Raises RecordingError: the bytes are no such message."""
    try:
        frame = DECODER.decode(data)
        return Seen(
            *(frame.t_s, frame.epoch, frame.doubt, frame.lens_m),
            *(_array(frame.directions, "<f4", 3), _array(frame.ranges, "<f4", 0)),
            _array(frame.standing, "<i8", 2),
            tuple(
                ObjectReport(
                    *(one.id, one.kind, _array(one.outline, "<f8", 2), one.bottom_m, one.top_m),
                    *(one.velocity_mps, one.confidence, one.seen_s, one.enlarged),
                )
                for one in frame.changed
            ),
            frame.gone,
            None if frame.fix is None else _fix(*frame.fix),
        )
    except (msgspec.DecodeError, ValueError) as error:
        raise RecordingError(f"what a depth frame told is damaged: {error}") from None


def _fix(M: bytes, y: bytes) -> PoseFix:
    fix = PoseFix(_array(M, "<f8", 0).reshape(3, 3), _array(y, "<f8", 0).reshape(3))
    if not (np.isfinite(fix.M).all() and np.isfinite(fix.y).all()):
        raise ValueError("what walls say is no number")
    return fix


def _array(data: bytes, kind: str, width: int) -> Any:
    """(n, width), or (n,) for a width of 0."""
    flat = np.frombuffer(data, kind)
    return flat.reshape(-1, width) if width else flat
