"""What a HELLO may bring about: nobody without the key silences a link for longer than a moment."""

import pytest

from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.asking import hello_body
from mapod_link.frames import HELLO, MAX_FRAME, bytes_from_frame, signed_bytes_from_frame
from tests.support.planner_line import Line, Sky

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


def test_no_frame_is_longer_than_the_protocol_allows_whatever_a_hello_says() -> None:
    line = Line(Sky(61, 3), key=KEY, session=SESSION)
    line.settle(0.5)
    line.planner.mute = True
    body = hello_body(OTHER, 2**32 - 1, 65_535)
    line.port.give(signed_bytes_from_frame(HELLO, 1, 1, body, KEY, SESSION, OTHER))
    line.sky.show(line.sky.every_other, 1)
    longest = 0
    for _ in range(20):
        line.tick()
        longest = max(longest, *map(len, line.frames))
    assert MAX_FRAME - 3 <= longest <= MAX_FRAME
