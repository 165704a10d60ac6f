"""OBJECTS and PATH bodies written from the sheet once more, and a sender of them without a mind.

Source: planner link, section 3. Shares no code with hw/planner_link nor with mapod_link/objects.py.
"""

import struct
import zlib
from collections.abc import Sequence

Corners = Sequence[tuple[int, int]]
SQUARE = ((-500, -500), (500, -500), (500, 500), (-500, 500))


def object_record(
    number: int,
    kind: int = 1,
    corners: Corners = SQUARE,
    place: tuple[int, int] = (1000, -2000),
    age_ms: int = 40,
    unit_mm: int = 1,
    heights: tuple[int, int] = (0, 1200),
    velocity: tuple[int, int] = (0, 0),
) -> bytes:
    head = struct.pack("<HBBIii", age_ms, kind, len(corners), number, *place)
    head += struct.pack("<hhhhBBBB", *heights, *velocity, 204, 0, unit_mm, 0)
    return head + b"".join(struct.pack("<hh", *corner) for corner in corners)


def gone_record(number: int) -> bytes:
    return struct.pack("<HBBI", 0, 0, 0, number)


def objects_body(
    records: Sequence[bytes] = (),
    held: Sequence[bytes] = (),
    *,
    ids: tuple[int, int] = (1, 0),
    waiting: int = 0,
    look_ms: int = 60,
    geom_id: int = 7,
) -> bytes:
    """`held`: the records of all objects that must be there behind this frame."""
    digest = sum(zlib.crc32(record[2:]) for record in held) % 2**32
    head = struct.pack("<BxHHHIII", geom_id, len(held), waiting, look_ms, digest, *ids)
    return head + b"".join(records)


def path_body(
    points: Corners,
    *,
    number: int = 1,
    first: int = 0,
    total: int | None = None,
    kind: int = 1,
    segment: int = 0,
    segments: int = 1,
    ahead: int = 0,
    left_out: int = 0,
    place: tuple[int, int] = (0, 0),
    geom_id: int = 7,
) -> bytes:
    total = len(points) if total is None else total
    counts = total, first, segment, segments, ahead, left_out
    head = struct.pack("<HBBHHHHHHii", number, geom_id, kind, *counts, *place)
    return head + b"".join(struct.pack("<hh", *point) for point in points)
