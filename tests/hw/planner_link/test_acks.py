"""ACK and HELLO: which are believed, what they repair, and what they can't bring about."""

import itertools
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.planner_mcu.receiver import FakePlanner
from hw.planner_link.frames import GEOM, POSE
from hw.planner_link.map_frames import RefreshCursor
from hw.planner_link.messages import ASK_POSE, NEED_FULL, NEED_GEOM, PLANNER_STOPPED, Ack, Hello
from hw.planner_link.peer import Peer
from hw.planner_link.recovery import MOST_LAG
from hw.planner_link.scheduler import UNTIMED
from mapod_link.asking import DIGEST_OK, hello_body
from mapod_link.frames import (
    ASK,
    HELLO,
    bytes_from_frame,
    frame_from_bytes,
    signed_bytes_from_frame,
)
from tests.support.cases import examples, few
from tests.support.link.planner_line import Line, Sky, SkyTiles


def quiet(size: int = 21, first_seq: int = 1) -> Line:
    """A line whose receiver says nothing by itself."""
    line = Line(Sky(size, 3), first_seq=first_seq, ack_every=0)
    line.sky.change(50)
    line.settle(0.3)
    return line


NUMBERS = itertools.count(1)


def acknowledge(
    line: Line,
    last: int | None = None,
    *,
    status: int = 0,
    mask: int = 2**32 - 1,
    echo: int | None = None,
    geom_id: int | None = None,
) -> None:
    """An ACK of the newest frame, unless it is said otherwise."""
    newest = frame_from_bytes(line.frames[-1])
    assert not isinstance(newest, str)
    last = newest.seq if last is None else last % 2**16
    echo = newest.t_ms if echo is None else echo
    geom_id = line.link.geom_id if geom_id is None else geom_id
    body = struct.pack("<HIIHHBB", last, mask, echo, 0, 0, status, geom_id)
    line.port.give(bytes_from_frame(8, next(NUMBERS), round(1000 * line.now_s), body))
    line.link.poll(line.now_s)


@pytest.mark.parametrize(
    ("ahead", "echo", "believed"),
    [
        (0, None, True), (0, 0, True), (-UNTIMED, 0, False), (1, None, False), (100, None, False),
        (-3, 7, False), (0, 1, False), (0, 0xFFFFFFFF, False), (-60_000, None, False),
        (30_000, 0, False),
    ],
)  # fmt: skip
def test_only_what_tells_the_time_of_a_frame_that_was_sent_is_believed(
    ahead: int, echo: int | None, believed: bool
) -> None:
    line = quiet(first_seq=65_500)
    repair, newest = line.link._repair, line.link._scheduler.seq
    before = repair._covered, len(repair._sent)
    acknowledge(line, newest + ahead, echo=echo)
    assert (repair._covered, len(repair._sent)) == ((newest, 0) if believed else before)
    assert line.link.counters.acks == 1


@pytest.mark.parametrize("key", [True, False])
def test_an_older_acknowledgement_does_not_take_back_a_stop_and_with_a_key_never(key: bool) -> None:
    peer = Peer(cells=81, push=True, has_key=key)
    peer.take_hello(0.0, Hello(1, 1, 5, 100, 368, False))
    assert peer.take_ack(0.0, Ack(9, 1_000_000, 1, 0, 0, PLANNER_STOPPED, 7))
    assert not peer.take_ack(0.0, Ack(8, 999_970, 1, 0, 0, 0, 7))  # it comes late
    assert peer.stopped
    older = Ack(5, 100, 1, 0, 0, 0, 7)  # of a planner that has started again, or a replay
    assert peer.take_ack(9.0, older) is not key
    assert peer.stopped is key
    peer.take_hello(9.0, Hello(1, 1, 6, 100, 368, False))
    assert peer.take_ack(9.0, older)
    peer.take_hello(9.0, Hello(1, 1, 5, 100, 368, False))  # anybody may repeat an old one
    assert peer.take_ack(9.0, older) is not key


def test_need_full_begins_a_new_epoch_but_no_flood_of_it_begins_many() -> None:
    line = quiet()
    before = line.link.geom_id
    for _ in range(50):
        acknowledge(line, status=NEED_FULL)
        line.tick()
    assert 4 <= (line.link.geom_id - before) % 256 <= 5
    acknowledge(line, status=NEED_FULL, geom_id=(line.link.geom_id - 1) % 256)
    now = line.link.geom_id
    line.settle(1.0)
    assert line.link.geom_id == now


def test_need_geom_is_answered_at_once_whatever_was_heard_before() -> None:
    line = quiet()
    count = line.planner.accepted[GEOM]
    acknowledge(line, 0, status=NEED_GEOM, echo=0, geom_id=0)
    line.tick()
    assert line.planner.accepted[GEOM] == count + 1


def test_the_digest_and_what_the_planner_makes_of_it_is_told() -> None:
    line = Line(Sky(21, 3))
    line.sky.change(50)
    line.settle(3.0)
    assert line.link.peer.status & DIGEST_OK
    epoch = line.link.geom_id
    for _ in range(60):
        line.planner._map._cells[::3, 3] = 3  # wrong again wherever the refresh has been
        line.tick()
    assert line.link.geom_id in (epoch + 1, epoch + 2)  # nobody knows what else is wrong
    line.settle(0.5)
    assert line.holds_what_is_meant()


def test_a_planner_that_never_answers_costs_no_memory() -> None:
    line = quiet()
    line.settle(11.0)
    assert not line.link._repair._sent
    assert len(line.link._publisher._cursor._marks) < 200
    assert line.link._scheduler.seq - line.link._repair.repaired < 100
    assert line.holds_what_is_meant()


@pytest.mark.parametrize("minutes", few([0.5, 15], 1))
def test_a_planner_that_hears_nothing_for_minutes_and_returns_is_told_all(minutes: float) -> None:
    line = Line(Sky(9, 3), rate_hz=25)
    line.sky.change(30)
    line.settle(1.0)
    line.planner.deaf = True
    for k in range(round(minutes * 60 * 25)):
        if k % 500 == 0:
            line.sky.change(3)
        line.tick()
        assert line.link._scheduler.seq - line.link._repair.repaired <= MOST_LAG + 100
    assert line.planner.stale(line.now_s)
    line.planner.deaf = False
    line.settle(2.0)
    assert not line.planner.suspect
    assert not line.planner.stale(line.now_s)
    assert line.holds_what_is_meant()


def test_if_nothing_can_be_repaired_for_long_a_new_epoch_begins() -> None:
    line = quiet()
    epoch = line.link.geom_id
    line.link._scheduler.seq += MOST_LAG + 100
    line.tick()
    assert line.link.geom_id == (epoch + 1) % 256
    assert line.link._scheduler.seq - line.link._repair.repaired < 20


def test_after_a_planner_that_was_too_small_a_larger_one_begins_anew() -> None:
    line = quiet()
    line.port.give(bytes_from_frame(9, 1, 1, hello_body(5, 100)))
    line.tick()
    assert "the planner can hold 100 cells" in line.link.peer.refusal
    count = line.planner.accepted[POSE]
    line.settle(1.0)
    assert line.planner.accepted[POSE] == count + 50
    epoch = line.link.geom_id
    line.port.give(bytes_from_frame(9, 2, 2, hello_body(5, 1000)))
    line.settle(0.1)
    assert line.link.peer.refusal == ""
    assert line.link.geom_id == (epoch + 1) % 256
    assert line.holds_what_is_meant()
    line.port.give(bytes_from_frame(9, 3, 3, hello_body(5, 1000, 40)))
    line.tick()
    assert line.link.peer.refusal == "the planner takes frames of 40 bytes, not of 48"
    assert all(len(frame) <= 40 for frame in line.frames)


def test_where_the_first_geometry_of_an_epoch_was_lost_its_maps_are_told_again() -> None:
    line = quiet()
    line.link._state.epoch_due = True
    line.tick()
    first = line.link._repair.epoch_seq
    line.settle(0.1)
    newest = line.link._scheduler.seq
    mask = 2**32 - 1 & ~(1 << newest - 1 - first)  # all but that GEOM
    acknowledge(line, mask=mask)
    assert line.link._map.lost == 21**2
    line.settle(0.3)
    acknowledge(line)
    assert line.link._map.lost == 0


@settings(max_examples=examples(25))
@given(
    moves=st.lists(
        st.tuples(st.integers(-4, 4), st.integers(-4, 4), st.integers(1, 40)), max_size=40
    ),
    size=st.integers(3, 9),
)
def test_a_round_is_complete_when_each_cell_was_told_or_has_entered_since(
    moves: list[tuple[int, int, int]], size: int
) -> None:
    way, corner = RefreshCursor(size), (0, 0)
    # world cell: frame in which it was told, or entered
    told = {(i, j): 0 for i in range(size) for j in range(size)}
    for seq, (di, dj, count) in enumerate(moves, start=1):
        if di or dj:
            corner = (corner[0] + di, corner[1] + dj)
            way.follow(di, dj)
            inside = [(corner[0] + i, corner[1] + j) for i in range(size) for j in range(size)]
            told = {cell: told.get(cell, seq) for cell in inside}
        end = min(size**2, way.cell + count)
        for cell in range(way.cell, end):
            told[corner[0] + cell % size, corner[1] + cell // size] = seq
        if (newest := way.advance(seq, end)) > 0:
            assert min(told.values()) >= newest


@pytest.mark.parametrize("key", [None, bytes(32)])
def test_a_hello_takes_back_a_stop_only_where_none_can_be_forged(key: bytes | None) -> None:
    line = Line(Sky(9, 3), key=key)
    line.settle(0.1)
    line.planner.stopped = True
    line.settle(0.1)
    assert line.link.peer.stopped
    line.planner.mute = True
    line.port.give(bytes_from_frame(9, 1, 1, hello_body(999, 10_000)))
    line.tick()
    assert line.link.peer.stopped == (key is not None)


KEY, SESSION, OTHER = bytes(range(32)), 77, 0xBAD
RECOVERED_S = 1.0


def keyed() -> Line:
    """A link with a key, its planner up to date."""
    line = Line(Sky(21, 3), key=KEY, session=SESSION)
    line.sky.change(50)
    line.settle(1.0)
    assert line.holds_what_is_meant()
    return line


def is_kept_up(line: Line) -> bool:
    """Whether changes reach the planner again, soon."""
    line.settle(RECOVERED_S)
    line.sky.change(50)
    line.settle(0.2)
    return line.holds_what_is_meant() and not line.planner.stale(line.now_s)


@pytest.mark.parametrize(
    ("own_nonce", "max_cells", "max_frame", "poll"),
    [(True, 2**32 - 1, 368, True), (False, 0, 368, False), (True, 10_000, 0, False)],
)
def test_a_forged_hello_does_not_silence_a_link_with_a_key(
    own_nonce: bool, max_cells: int, max_frame: int, poll: bool
) -> None:
    line = keyed()
    nonce = line.planner.nonce if own_nonce else OTHER
    line.port.give(bytes_from_frame(HELLO, 1, 1, hello_body(nonce, max_cells, max_frame, poll)))
    assert is_kept_up(line)
    # after a stranger's nonce that of the planner is new again
    line.port.give(bytes_from_frame(HELLO, 1, 1, hello_body(OTHER, max_cells)))
    line.port.give(
        bytes_from_frame(HELLO, 1, 1, hello_body(line.planner.nonce, max_cells, max_frame, poll))
    )
    assert is_kept_up(line)


def test_a_replayed_hello_of_a_planner_that_asked_does_not_silence_its_successor() -> None:
    line = keyed()
    body = hello_body(OTHER, 10_000, poll=True)
    genuine = signed_bytes_from_frame(HELLO, 9, 9000, body, KEY, SESSION, OTHER)
    line.port.give(genuine)
    line.tick()
    assert line.link.peer.polled
    assert is_kept_up(line)
    line.loss = 1.0  # the one geometry that a planner gets which only asks
    line.port.give(genuine)
    line.tick()
    line.loss = 0.0
    assert not line.link.peer.polled
    assert is_kept_up(line)


def test_with_a_key_a_planner_that_only_asks_is_believed_once_it_signs() -> None:
    line = Line(Sky(21, 3), key=KEY, planner=FakePlanner(5, KEY, poll_only=True))
    line.settle(1.0)
    sent = line.link.frames_sent
    line.settle(1.0)
    assert line.link.frames_sent == sent


def test_an_acknowledgement_ends_polling_that_somebody_else_asked_for() -> None:
    line = Line(Sky(21, 3))
    line.settle(0.5)
    line.port.give(bytes_from_frame(HELLO, 1, 1, hello_body(OTHER, 10_000, poll=True)))
    assert is_kept_up(line)


@pytest.mark.parametrize("poll_only", [False, True])
def test_no_flood_of_forged_hellos_silences_a_planner_that_is_heard(poll_only: bool) -> None:
    planner, tiles = FakePlanner(5, KEY, poll_only=poll_only), SkyTiles(Sky(21, 3))
    line = Line(tiles.sky, key=KEY, planner=planner, tiles=tiles)
    line.settle(1.0)
    assert line.link.peer.proven
    answered = 0
    for number in range(150):
        for nonce in range(1, 10):
            line.port.give(bytes_from_frame(HELLO, 1, 1, hello_body(1000 * number + nonce, 441)))
        question = planner.ask_tile("height", 0, 0, 3, 3)
        line.tick()
        line.tick()
        answered += question.complete
        assert line.link.peer.nonce == planner.nonce
    assert answered > 140
    assert poll_only or line.holds_what_is_meant()


def test_a_planner_that_starts_again_under_a_flood_is_heard_once_its_forerunner_is_silent() -> None:
    line = keyed()
    line.planner = FakePlanner(99, KEY)
    for number in range(250):
        line.port.give(bytes_from_frame(HELLO, 1, 1, hello_body(1000 + number, 441)))
        line.tick()
    assert line.link.peer.nonce == line.planner.nonce
    assert line.holds_what_is_meant()


def test_with_a_key_a_question_counts_once_and_a_repetition_does_not_hold_the_link() -> None:
    line = keyed()
    nonce, rejected = line.planner.nonce, line.link.counters.answers_rejected
    body = struct.pack("<HBBhhHH", 7, ASK_POSE, 0, 0, 0, 0, 0)
    genuine = signed_bytes_from_frame(ASK, 60_000, 10_000_000, body, KEY, SESSION, nonce)
    line.planner.mute = True
    for _ in range(80):
        line.port.give(genuine)
        line.tick()
    assert line.link.counters.answers_rejected == rejected + 79
    line.port.give(bytes_from_frame(HELLO, 1, 1, hello_body(OTHER, 441)))
    line.tick()
    assert line.link.peer.nonce == OTHER
