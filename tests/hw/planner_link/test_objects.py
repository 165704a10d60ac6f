"""Objects reach the planner by whatever line: its list is right, or it knows that it may not be."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from core.records import F64, OBJECT_MOVED, OBJECT_MOVING, OBJECT_STATIC, OBJECT_WALL, ObjectReport
from fakes.planner_mcu.receiver import FakePlanner
from hw.planner_link.object_records import MOST_CORNERS, REST, maybe_record
from hw.planner_link.objects import MOST_OBJECTS
from mapod_link.asking import hello_body
from mapod_link.frames import GEOM, HELLO, MAP, OBJECTS, bytes_from_frame
from mapod_link.objects import LinkObject
from tests.support.cases import examples
from tests.support.link.object_source import ObjectWorld, object_of, round_outline
from tests.support.link.planner_line import Line, Sky
from tests.support.link.planner_sender import whole


def line_of(world: ObjectWorld, **how: object) -> Line:
    """A planner that has heard the map; the objects come with it."""
    return Line(Sky(11, 3), vectors=world, **how)  # type: ignore[arg-type]


def is_told(report: ObjectReport, held: LinkObject) -> bool:
    """Whether an object arrived as it is, but for rounding."""
    same = held.outline_m.shape == report.outline_m.shape
    same = same and bool(np.abs(held.outline_m - report.outline_m).max() < 0.00051)
    heights = (held.bottom_m, held.top_m) == (report.bottom_m, report.top_m)
    velocity = held.velocity_mps == report.velocity_mps
    return same and heights and velocity and held.kind == report.kind


def holds_all(line: Line, world: ObjectWorld) -> bool:
    held = line.planner.vectors.objects.by_id
    if held.keys() != world.reports.keys():
        return False
    return all(is_told(report, held[number]) for number, report in world.reports.items())


def state(line: Line) -> tuple[str, str]:
    return line.planner.vectors.objects_state(line.now_s)


@pytest.mark.parametrize(
    ("baud", "ack_every", "loss"),
    [(None, 1, 0.0), (None, 1, 0.3), (None, 0, 0.3), (115_200, 16, 0.1), (921_600, 0, 0.2)],
)
def test_a_list_that_is_called_known_is_the_senders_whatever_gets_lost(
    baud: int | None, ack_every: int, loss: float
) -> None:
    world = ObjectWorld(7)
    line = line_of(world, baud=baud, rate_hz=25, ack_every=ack_every, loss=loss, seed=5)
    known = 0
    for k in range(400):
        line.sky.change(1)
        world.change(line.now_s, int(k % 7 == 0))
        line.tick()
        # a frame that got lost, and nothing after it yet: no gap can show
        seen = line.planner.numbers.last == line.link._scheduler.seq % 2**16
        if seen and state(line)[0] == "known":
            known += 1
            # what moves may have been told elsewhere a tenth of a second ago
            assert line.planner.vectors.objects.by_id.keys() == world.reports.keys()
            assert k % 7 < 3 or holds_all(line, world)
    assert known > 20
    line.loss = 0.0
    for _ in range(130):
        world.looked_s = line.now_s
        line.tick()
    assert state(line) == ("known", "")
    assert holds_all(line, world)


def test_what_is_lost_is_told_again_at_once_where_acks_come_and_a_deletion_likewise() -> None:
    world = ObjectWorld()
    world.put(object_of(5, round_outline(4, 1.0, 2.0, 0.5)))
    line = line_of(world)
    world.looked_s = line.now_s
    line.settle(1.0)
    assert holds_all(line, world)
    world.remove(5)
    line.loss, world.looked_s = 1.0, line.now_s
    line.tick()
    line.loss = 0.0
    line.settle(0.06)
    assert not line.planner.vectors.objects.by_id
    assert state(line) == ("known", "")


def test_a_new_epoch_and_a_new_run_begin_with_an_empty_list() -> None:
    world = ObjectWorld()
    world.put(object_of(5, round_outline(4, 1.0, 2.0, 0.5)))
    line = line_of(world)
    line.settle(0.5)
    assert line.planner.vectors.objects.by_id
    line.link._vectors.publish = lambda *_, **__: None  # type: ignore[method-assign]
    line.sky.epoch += 1
    line.tick()
    assert state(line) == ("none", "no objects told yet")
    assert not line.planner.vectors.objects.by_id


def test_moving_objects_come_first_and_after_the_changes_of_the_map() -> None:
    world = ObjectWorld()
    line = line_of(world)
    line.settle(0.5)
    for number in range(3):
        world.put(object_of(number, round_outline(60, 1.0, 2.0, 0.5)))
    world.put(object_of(9, round_outline(60, 1.0, 2.0, 0.5), OBJECT_MOVING, line.now_s))
    line.sky.change(3)
    line.tick()
    frames = whole(line.frames)
    kinds = [frame.type for frame in frames]
    assert kinds.index(MAP) < kinds.index(OBJECTS)
    [first, *_] = [frame.body[24] for frame in frames if frame.type == OBJECTS]
    assert first == 9


def test_a_moving_object_grows_old_by_itself_and_a_standing_one_does_not() -> None:
    world = ObjectWorld()
    line = line_of(world)
    world.put(object_of(1, round_outline(4, 1.0, 2.0, 0.5), OBJECT_MOVING, line.now_s - 0.1))
    world.put(object_of(2, round_outline(4, 3.0, 2.0, 0.5), OBJECT_MOVED, line.now_s - 0.1))
    line.settle(0.3)
    vectors = line.planner.vectors
    assert [one.id for one in vectors.fresh_objects(line.now_s)] == [1, 2]
    line.settle(0.2)
    assert [one.id for one in vectors.fresh_objects(line.now_s)] == [2]
    assert vectors.objects.age_s(vectors.objects.by_id[1], line.now_s) == pytest.approx(0.6)
    world.put(object_of(1, round_outline(4, 1.0, 2.0, 0.5), OBJECT_MOVING, line.now_s))
    line.settle(0.1)
    assert [one.id for one in vectors.fresh_objects(line.now_s)] == [1, 2]


def test_what_begins_to_move_is_told_with_the_next_tick() -> None:
    world = ObjectWorld()
    line = line_of(world)
    line.settle(0.1)
    for kind in (OBJECT_MOVED, OBJECT_MOVING, OBJECT_STATIC, OBJECT_WALL, OBJECT_MOVING):
        world.put(object_of(1, round_outline(4, 1.0, 2.0, 0.5), kind, line.now_s))
        line.tick()
        assert line.planner.vectors.objects.by_id[1].kind == kind


def test_a_planner_that_missed_the_geometry_is_told_all_objects_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = ObjectWorld()
    for number in range(30):
        world.put(object_of(number, round_outline(20, 1.0, number, 0.5)))
    line = line_of(world)
    line.settle(0.5)
    hears, missed = line.planner.feed_datagram, list[bytes]()

    def feed(now_s: float, data: bytes) -> bool:
        if data[0] & 15 == GEOM and not missed:
            missed.append(data)
            return False
        return hears(now_s, data)

    monkeypatch.setattr(line.planner, "feed_datagram", feed)
    line.sky.epoch += 1
    line.settle(0.2)
    assert missed
    assert holds_all(line, world)


def test_the_planner_knows_when_nothing_comes_when_nothing_looks_and_when_more_is_to_come() -> None:
    world = ObjectWorld()
    line = line_of(world)
    assert state(line) == ("none", "no objects told yet")
    line.settle(0.2)
    assert state(line) == ("suspect", "nothing looks for objects")
    world.looked_s = line.now_s
    line.settle(0.3)
    assert state(line) == ("known", "")
    world.put(replace(object_of(3, round_outline(4, 1.0, 2.0, 0.5)), top_m=math.nan))
    line.settle(0.1)
    assert state(line) == ("suspect", "1 objects are still to be told")
    line.link._vectors.publish = lambda *_, **__: None  # type: ignore[method-assign]
    line.settle(0.4)
    assert state(line) == ("suspect", "objects come late")


def test_many_objects_never_push_a_slow_line_beyond_its_rate_nor_hold_back_the_map() -> None:
    world, plain = ObjectWorld(7), Line(Sky(31, 3), baud=115_200, rate_hz=25, seed=5)
    line = Line(Sky(31, 3), baud=115_200, rate_hz=25, seed=5, vectors=world)
    world.plan(1, 400, 400)
    for _ in range(250):
        world.change(line.now_s, 6)
        for each in (plain, line):
            each.sky.change(3)
            each.tick()
            assert each.holds_what_is_meant()
    assert line.link._repair.repaired > line.link._scheduler.seq - 300
    rate = 115_200 / 10 * 0.85
    assert sum(line.tick_bytes) <= rate * 250 / 25 * 1.01
    assert sum(line.tick_bytes) > 1.5 * sum(plain.tick_bytes)


def test_a_list_that_is_not_the_senders_is_asked_for_and_comes() -> None:
    world = ObjectWorld()
    for number in range(30):
        world.put(object_of(number, round_outline(20, 1.0, number, 0.5)))
    line = line_of(world)
    line.settle(0.5)
    held = line.planner.vectors.objects.by_id
    del held[29]  # by a fault of its own, which no ACK shows
    world.looked_s = line.now_s + 1.0
    line.settle(0.2)
    assert state(line) == ("suspect", "the list is not the sender's")
    line.settle(0.5)
    assert state(line) == ("known", "")
    assert holds_all(line, world)


def test_who_only_asks_gets_the_objects_for_each_question_and_nothing_else() -> None:
    world = ObjectWorld()
    world.put(object_of(5, round_outline(4, 1.0, 2.0, 0.5)))
    line = line_of(world, planner=FakePlanner(poll_only=True))
    line.settle(0.1)
    line.planner.accepted.clear()  # of the time before its first HELLO
    line.settle(1.0)
    assert line.planner.accepted[OBJECTS] == 0
    for number in (6, 7):
        world.put(object_of(number, round_outline(4, 1.0, 2.0, 0.5)))
        world.remove(number - 1)
        world.looked_s = line.now_s
        line.planner.vectors.ask(objects=True)
        line.settle(0.1)
        assert state(line) == ("known", "")
        assert holds_all(line, world)
    line.settle(1.0)
    assert line.planner.accepted[OBJECTS] == 2


@pytest.mark.parametrize("max_frame", [75, 76, 128])
def test_a_planner_of_short_frames_gets_larger_outlines_or_none(max_frame: int) -> None:
    world = ObjectWorld()
    world.put(object_of(5, round_outline(60, 1.0, 2.0, 0.5)))
    line = line_of(world)
    body = hello_body(line.planner.nonce, 401 * 401, max_frame)
    line.planner._send = lambda *_: None  # type: ignore[method-assign]
    line.port.give(bytes_from_frame(HELLO, 1, 1, body))
    line.settle(0.3)
    held = line.planner.vectors.objects.by_id
    assert list(held) == ([5] if max_frame >= 76 else [])
    if held:
        assert held[5].enlarged
        assert len(held[5].outline_m) == 4 + (max_frame - 76) // 4


def test_more_objects_than_are_told_stay_counted_until_others_are_gone() -> None:
    world = ObjectWorld()
    for number in range(MOST_OBJECTS + 2):
        world.put(object_of(number, round_outline(3, 1.0, 2.0, 0.5)))
    line = line_of(world)
    world.looked_s = 1000.0
    line.settle(3.0)
    assert len(line.planner.vectors.objects.by_id) == MOST_OBJECTS
    assert state(line) == ("suspect", "2 objects are still to be told")
    world.remove(0)
    world.remove(1)
    line.settle(1.0)
    assert state(line) == ("known", "")


def scattered(n: int, seed: int, rounds: bool, size_m: float, place_m: float, digits: int) -> F64:
    """(n, 2) points in no order, or on a circle: then all of them are corners of their hull."""
    points = np.random.default_rng(seed).normal(size=(n, 2))
    points /= np.hypot(*points.T)[:, None] if rounds else 1.0
    return (points * size_m + place_m).round(digits)


OUTLINES = st.builds(
    scattered,
    st.integers(3, 200),
    st.integers(0, 2**20),
    st.booleans(),
    st.sampled_from([0.01, 1.0, 30.0, 3000.0]),
    st.sampled_from([0.0, -500.0, 2e6]),
    st.sampled_from([3, 9]),  # also whole millimetres
)


@settings(max_examples=examples(60))
@given(outline_m=OUTLINES, most=st.integers(4, MOST_CORNERS))
def test_an_outline_that_is_told_otherwise_contains_the_objects_own(
    outline_m: F64, most: int
) -> None:
    record = maybe_record(object_of(1, outline_m), most)
    if record is None:
        assert np.abs(outline_m).max() > 1e6 or np.ptp(outline_m, axis=0).max() > 16_000
        return
    *head, x_mm, y_mm, _, _, _, _, _, flags, unit_mm = REST.unpack_from(record)
    offsets = np.frombuffer(record, "<i2", offset=REST.size).reshape(-1, 2).astype(float)
    told_m = (np.array([x_mm, y_mm]) + unit_mm * offsets) / 1000
    assert len(told_m) == head[1] <= max(most, 4)
    if not flags:
        np.testing.assert_allclose(told_m, outline_m, atol=0.00051)
        return
    edges = np.roll(told_m, -1, axis=0) - told_m
    offsets_m = outline_m[None] - told_m[:, None]  # to the left of each edge lies all of it
    left = edges[:, :1] * offsets_m[..., 1] - edges[:, 1:] * offsets_m[..., 0]
    assert left.min() > -1e-6 * np.abs(outline_m).max()


@pytest.mark.parametrize(
    "wrong",
    [{"top_m": -0.1}, {"kind": 0}, {"kind": 5}, {"id": 2**32}, {"outline_m": np.zeros((2, 2))}],
)
def test_what_no_record_tells_is_none(wrong: dict[str, object]) -> None:
    right = object_of(1, round_outline(4, 0.0, 0.0, 1.0), OBJECT_STATIC)
    assert maybe_record(right, 64) is not None
    assert maybe_record(replace(right, **wrong), 64) is None


@pytest.mark.parametrize("step_m", [0.0, 0.1])
def test_an_outline_without_any_area_that_would_have_to_be_told_as_a_larger_one_is_none(
    step_m: float,
) -> None:
    flat = np.stack([step_m * np.arange(5), np.zeros(5)], axis=1)
    assert maybe_record(object_of(1, flat), 4) is None
