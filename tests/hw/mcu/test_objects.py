"""The C header and the public receiver hold the same objects and path, or know that they do not.

Source: planner link, section 3 (OBJECTS, PATH), 5 and 14.
"""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from mapod_link.frames import GEOM, MAP, OBJECTS, PATH, POSE, bytes_from_frame
from mapod_link.receiver import Receiver
from tests.support.cases import examples
from tests.support.link.c_link import Ask
from tests.support.link.c_vectors import VectorReceiver, assert_they_agree, corners_mm
from tests.support.link.object_frames import (
    SQUARE,
    Corners,
    gone_record,
    object_record,
    objects_body,
    path_body,
)
from tests.support.link.planner_sender import geom_body, map_body, pose_body, vector

FATES = st.sampled_from(["arrives", "arrives", "arrives", "lost", "late", "twice"])
CORNERS = st.lists(
    st.tuples(st.integers(-32_768, 32_767), st.integers(-32_768, 32_767)), min_size=3, max_size=16
)


class TwoReceivers(RuleBasedStateMachine):
    """A sender's frames, kept, repeated, swapped, damaged and lost, to both receivers."""

    def __init__(self) -> None:
        super().__init__()
        self.receiver, self.header = Receiver(1), VectorReceiver()
        self.now_s, self.seq, self.geom_id, self.session = 1.0, 0xFFF0, 7, 5
        self.held: dict[int, bytes] = {}  # what was told
        self.path, self.path_number = [(0, 0)], 1
        self.late: list[bytes] = []
        self.is_seen = False  # the newest frame has arrived
        self.send(GEOM, geom_body(self.geom_id, session=self.session))

    def send(self, kind: int, body: bytes, fate: str = "arrives") -> None:
        self.seq += 1
        frame = bytes_from_frame(kind, self.seq, round(self.now_s * 1000), body)
        if fate == "late":
            self.late.append(frame)
        for _ in range({"late": 0, "lost": 0, "twice": 2}.get(fate, 1)):
            self.arrives(frame)
        self.is_seen = fate in ("arrives", "twice")

    def arrives(self, frame: bytes) -> None:
        before = self.receiver.feed_datagram(self.now_s, frame)
        assert self.header.feed_datagram(self.now_s, frame) == before

    def objects(self, records: list[bytes], ids: tuple[int, int], waiting: int, fate: str) -> None:
        held = list(self.held.values())
        body = objects_body(records, held, ids=ids, waiting=waiting, geom_id=self.geom_id)
        self.send(OBJECTS, body, fate)

    @rule(
        numbers=st.sets(st.integers(0, 11), max_size=3),
        corners=CORNERS,
        kind=st.integers(1, 4),
        age_ms=st.sampled_from([0, 40, 499, 65_535]),
        waiting=st.sampled_from([0, 0, 3]),
        fate=FATES,
    )
    def changes(
        self, numbers: set[int], corners: Corners, kind: int, age_ms: int, waiting: int, fate: str
    ) -> None:
        """New objects, and other outlines of old ones."""
        told = {n: object_record(n, kind, corners, age_ms=age_ms) for n in sorted(numbers)}
        self.held |= told
        self.objects(list(told.values()), (1, 0), waiting, fate)

    @rule(numbers=st.sets(st.integers(0, 11), max_size=3), fate=FATES)
    def some_are_gone(self, numbers: set[int], fate: str) -> None:
        for number in numbers:
            self.held.pop(number, None)
        self.objects([gone_record(number) for number in sorted(numbers)], (1, 0), 0, fate)

    @rule(first=st.integers(0, 12), size=st.integers(0, 12), fate=FATES, forgets=st.booleans())
    def refresh(self, first: int, size: int, fate: str, forgets: bool) -> None:
        """All that there is of a range; perhaps less than before."""
        last = first + size if size < 12 else 2**32 - 1
        inside = [number for number in self.held if first <= number <= last]
        if forgets and inside:
            del self.held[inside.pop()]
        self.objects([self.held[number] for number in inside], (first, last), 0, fate)

    @rule(body=st.binary(max_size=90), kind=st.sampled_from([OBJECTS, PATH]))
    def nonsense(self, body: bytes, kind: int) -> None:
        self.send(kind, bytes([self.geom_id]) + body)
        self.is_seen = False  # what it may have meant, nobody knows

    @rule(
        size=st.integers(0, 9),
        anew=st.booleans(),
        part=st.tuples(st.integers(0, 8), st.integers(1, 4)),
        fate=FATES,
    )
    def path_piece(self, size: int, anew: bool, part: tuple[int, int], fate: str) -> None:
        if anew:
            self.path_number += 1
            self.path = [(17 * k * self.path_number % 900, -k) for k in range(size)]
        first = min(part[0], max(0, len(self.path) - 1))
        body = path_body(
            self.path[first : first + part[1]],
            number=self.path_number,
            first=first,
            total=len(self.path),
            place=(-9000, 40_000),
            geom_id=self.geom_id,
        )
        self.send(PATH, body, fate)

    @rule(fate=FATES)
    def others(self, fate: str) -> None:
        self.send(MAP, map_body(geom_id=self.geom_id), fate)
        self.send(POSE, pose_body(), fate)

    @rule(restarts=st.booleans(), fate=FATES)
    def a_new_epoch(self, restarts: bool, fate: str) -> None:
        self.held.clear()
        self.geom_id, self.session = (self.geom_id + 1) % 256, self.session + restarts
        self.path_number += 1
        self.send(GEOM, geom_body(self.geom_id, session=self.session), fate)

    @rule()
    def what_was_late(self) -> None:
        while self.late:
            self.arrives(self.late.pop())

    @rule(seconds=st.sampled_from([0.04, 0.04, 0.12, 0.4, 0.8, 61.0]))
    def time_passes(self, seconds: float) -> None:
        """Never just up to a bound: one clock counts milliseconds, the other does not."""
        self.now_s += seconds

    @invariant()
    def they_agree(self) -> None:
        assert_they_agree(self.receiver, self.header, self.now_s)

    @invariant()
    def what_is_known_is_right(self) -> None:
        vectors = self.receiver.vectors
        if self.is_seen and vectors.objects_state(self.now_s)[0] == "known":
            assert vectors.objects.by_id.keys() == self.held.keys()
            places = {n: one.outline_m[0].tolist() for n, one in vectors.objects.by_id.items()}
            for number, record in self.held.items():
                first = int.from_bytes(record[28:30], "little", signed=True)
                assert round(places[number][0] * 1000) == 1000 + first
        if self.is_seen and vectors.path_state(self.now_s)[0] == "known":
            told = [(round(1000 * x), round(1000 * y)) for x, y in vectors.path.points_m]
            assert vectors.path.number == self.path_number
            assert told == [(x - 9000, y + 40_000) for x, y in self.path]


TestTwoReceivers = TwoReceivers.TestCase
TestTwoReceivers.settings = settings(max_examples=examples(25), stateful_step_count=40)


def begun(*words: str) -> VectorReceiver:
    header = VectorReceiver(*words)
    header.feed_datagram(1.0, bytes_from_frame(GEOM, 1, 1000, geom_body()))
    return header


def told(header: VectorReceiver, seq: int, kind: int, body: bytes, now_s: float = 1.0) -> None:
    assert header.feed_datagram(now_s, bytes_from_frame(kind, seq, round(now_s * 1000), body))


def test_the_objects_and_the_path_of_the_worked_example_are_read_as_printed() -> None:
    header = VectorReceiver(max_cells=101 * 101)
    for name in ("geom", "objects", "objects_range", "path"):
        assert header.feed_datagram(1.12, vector(name))
    assert header.objects_worth(1.12) == "known"
    person, table = (header.objects(1.12)[number] for number in (258, 3))
    assert corners_mm(person) == [(14_200, -1_400), (14_500, -1_400), (14_350, -1_000)]
    assert corners_mm(table)[0] == (9_600, -3_300)
    assert (person.vx_mmps, person.vy_mmps, person.top_mm) == (600, -250, 1740)
    assert [header.way_point(k) for k in (2, 4)] == [(12_400, -2500, 1, 1), (12_900, -2800, 1, 1)]
    assert header.way_point(5) is None


def test_more_objects_than_there_is_room_for_are_told_until_they_fit() -> None:
    header = begun("-DMAPOD_OBJECTS_MAX=3u")
    records = [object_record(number) for number in range(4)]
    told(header, 2, OBJECTS, objects_body(records, records))
    assert header.objects_worth(1.0) == "left out"
    assert sorted(header.objects(1.0)) == [0, 1, 2]
    held = [records[number] for number in (0, 2, 3)]
    told(header, 3, OBJECTS, objects_body([gone_record(1)], held))
    assert header.objects_worth(1.0) == "left out"
    told(header, 4, OBJECTS, objects_body(held, held, ids=(0, 2**32 - 1)))
    assert header.objects_worth(1.0) == "known"
    assert sorted(header.objects(1.0)) == [0, 2, 3]


def test_an_outline_of_more_corners_than_there_is_room_for_becomes_its_box() -> None:
    header = begun("-DMAPOD_CORNERS_MAX=4u")
    star = [(0, 900), (-300, 100), (-700, 50), (5, -400), (800, 20)]
    record = object_record(3, corners=star, unit_mm=2)
    told(header, 2, OBJECTS, objects_body([record], [record]))
    assert header.objects_worth(1.0) == "known"
    shown = header.objects(1.0)[3]
    assert shown.flags == 1
    assert corners_mm(shown) == [(-400, -2800), (2600, -2800), (2600, -200), (-400, -200)]


def test_a_path_of_more_points_than_there_is_room_for_is_told_so() -> None:
    header = begun("-DMAPOD_PATH_MAX=4u")
    points = [(k, -k) for k in range(6)]
    told(header, 2, PATH, path_body(points[3:], first=3, total=6))
    assert header.path_worth(1.0) == "differs"
    told(header, 3, PATH, path_body(points[:3], first=0, total=6))
    assert header.path_worth(1.0) == "left out"
    assert [header.way_point(k) for k in range(4)] == [(k, -k, 0, 1) for k in range(4)]


def test_what_has_grown_old_stays_so_though_the_clocks_wrap() -> None:
    header, moving = begun(), object_record(1, kind=3, age_ms=100)
    told(header, 2, OBJECTS, objects_body([moving, object_record(2)], [moving, object_record(2)]))
    assert [header.objects(1.4)[n].old for n in (1, 2)] == [0, 0]
    assert [header.objects(1.41)[n].old for n in (1, 2)] == [1, 0]
    assert header.objects_worth(1.36) == "late"
    assert [header.objects(1.0 + 2**32 / 1000)[n].old for n in (1, 2)] == [1, 0]
    assert header.objects_worth(1.0 + 2**32 / 1000) == "late"


@pytest.mark.parametrize(
    "record",
    [
        object_record(1, corners=SQUARE[:2]),
        object_record(1, corners=SQUARE * 17),
        object_record(1, place=(2_100_000_001, 0)),
        object_record(1, place=(0, -(2**31))),
        object_record(1, unit_mm=0),
        object_record(1, heights=(5, 4)),
        object_record(1)[:-1],
        gone_record(1) + b"\0",
        gone_record(1)[:3] + b"\1" + gone_record(1)[4:],
    ],
)
def test_a_record_that_can_not_be_leaves_the_list_as_it_is_and_makes_it_suspect(
    record: bytes,
) -> None:
    header, receiver = begun(), Receiver(1)
    receiver.feed_datagram(1.0, bytes_from_frame(GEOM, 1, 1000, geom_body()))
    right = object_record(4)
    for seq, records in ((2, [right]), (3, [gone_record(4), record[:348]])):
        frame = bytes_from_frame(OBJECTS, seq, 1000, objects_body(records, [right]))
        for end in (header, receiver):
            if len(frame) <= 368:
                assert end.feed_datagram(1.0, frame)
        assert list(header.objects(1.0)) == [4]
        if len(frame) <= 368:
            assert header.objects_worth(1.0) == ("known" if seq == 2 else "differs")
    assert_they_agree(receiver, header, 1.0)


def test_objects_and_path_may_be_asked_for() -> None:
    header = begun()
    assert header.ask(1.0, Ask(7, 0x60))[8:12].hex(" ") == "07 00 60 00"


@given(body=st.binary(max_size=356), kind=st.sampled_from([OBJECTS, PATH]))
def test_any_body_is_taken_without_harm_and_alike(body: bytes, kind: int) -> None:
    receiver, header = Receiver(1), begun()
    receiver.feed_datagram(1.0, bytes_from_frame(GEOM, 1, 1000, geom_body()))
    frame = bytes_from_frame(kind, 2, 1000, body)
    assert receiver.feed_datagram(1.0, frame)
    assert header.feed_datagram(1.0, frame)
    assert_they_agree(receiver, header, 1.0)
