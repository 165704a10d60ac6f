"""What a depth frame told, as a recording keeps it: all of it, and that of older recordings."""

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from core.objects.seen import Seen
from core.pose_fix import PoseFix
from core.records import OBJECT_MOVING, OBJECT_WALL, ObjectReport
from recording.frames import bytes_from_seen, seen_from_bytes
from recording.records import RecordingError

BOX = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.5]])
WALL = ObjectReport(5, OBJECT_WALL, BOX, 0.0, 32.767, (0.0, 0.0), 0.9, 7.25, True)
WALKER = ObjectReport(6, OBJECT_MOVING, BOX + 1.0, 0.1, 1.8, (0.4, -0.2), 1.0, 7.5)


def seen(*changed: ObjectReport) -> Seen:
    rays = np.ones((2, 3), np.float32), np.ones(2, np.float32)
    return Seen(7.5, 2, "", (0.1, 0.0, 0.9), *rays, np.array([[3, -4]]), changed, (8, 9))


def told(one: ObjectReport) -> tuple[object, ...]:
    fields = msgspec.structs.asdict(one)
    return *fields.pop("outline_m").ravel().tolist(), *fields.values()


def test_all_of_it_comes_back() -> None:
    fix = PoseFix(np.arange(9.0).reshape(3, 3), np.arange(3.0))
    again = seen_from_bytes(bytes_from_seen(replace(seen(WALL, WALKER), fix=fix)))
    assert again.fix is not None
    assert np.array_equal(again.fix.M, fix.M)
    assert np.array_equal(again.fix.y, fix.y)
    assert [told(one) for one in again.changed] == [told(WALL), told(WALKER)]
    assert (again.t_s, again.epoch, again.gone, again.lens_m) == (7.5, 2, (8, 9), (0.1, 0.0, 0.9))
    assert again.standing.tolist() == [[3, -4]]


def test_an_older_recording_says_nothing_of_larger_outlines_nor_of_walls() -> None:
    parts = msgspec.msgpack.decode(bytes_from_seen(seen(WALKER)))[:-1]
    parts[7] = [one[:-1] for one in parts[7]]
    again = seen_from_bytes(msgspec.msgpack.encode(parts))
    (walker,) = again.changed
    assert told(walker) == told(WALKER)
    assert not walker.enlarged
    assert again.fix is None


def test_a_fix_of_another_size_or_of_no_numbers_is_refused() -> None:
    parts = msgspec.msgpack.decode(bytes_from_seen(seen()))
    for damaged in ([bytes(64), bytes(24)], [bytes(72), np.full(3, np.nan).tobytes()]):
        parts[-1] = damaged
        with pytest.raises(RecordingError, match="damaged"):
            seen_from_bytes(msgspec.msgpack.encode(parts))


def test_an_object_that_lacks_a_field_is_refused() -> None:
    parts = msgspec.msgpack.decode(bytes_from_seen(seen(WALKER)))
    parts[7] = [one[:-2] for one in parts[7]]
    with pytest.raises(RecordingError, match="damaged"):
        seen_from_bytes(msgspec.msgpack.encode(parts))
