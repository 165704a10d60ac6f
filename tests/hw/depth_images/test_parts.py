"""Parts of a stream: cut anywhere, with junk between, and damaged."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from fakes.kinect.device import part as told
from hw.depth_images.parts import END, MARK, MOST_HEAD, Part, PartsParser
from hw.device import BadFrame
from hw.ports.parts import HEAD, part

JUNK = st.binary(max_size=30).map(lambda junk: junk.replace(b"-", b""))


@given(
    st.lists(st.tuples(JUNK, st.binary(min_size=1, max_size=60))),
    st.lists(st.integers(0, 2000)),
)
def test_parts_survive_junk_and_any_cutting(
    given_parts: list[tuple[bytes, bytes]], cuts: list[int]
) -> None:
    stream = HEAD + b"".join(junk + part(data, 1_500_000, "k") for junk, data in given_parts)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    parser = PartsParser(100)
    events = [event for a, b in pairwise(edges) for event in parser.feed(float(a), stream[a:b])]
    found = [event for event in events if isinstance(event, Part)]
    assert [one.data for one in found] == [data for _, data in given_parts]
    assert all((one.kind, one.stamp_s, one.number) == ("k", 1.5, -1) for one in found)
    assert all(one.began_s <= one.arrived_s for one in found)


def test_what_the_fake_says_is_what_the_ports_say() -> None:
    assert told(b"x", "k", 1.5, None) == b"".join(
        [MARK, b"Content-Length: 1\r\nContent-Type: k\r\nX-Timestamp: 1.500000", END, b"x\r\n"]
    )
    assert told(b"x", "", None, None) == part(b"x", None)
    [one] = PartsParser(10).feed(2.0, told(b"x", "k", 1.5, 7))
    assert one == Part(b"x", "k", 1.5, 7, 2.0, 2.0)


def test_a_length_that_cannot_be_waits_for_nothing() -> None:
    good = part(b"good", None)
    for wrong in (b"Content-Length: 101", b"Content-Length: 0", b"Content-Length: -1", b"X: 1"):
        events = PartsParser(100).feed(1.0, MARK + wrong + END + b"data\r\n" + good)
        assert isinstance(events[0], BadFrame)
        assert "length is missing, or can't be" in events[0].reason
        assert isinstance(events[-1], Part)
    short = MARK + b"Content-Length: 9" + END + b"cut"
    events = PartsParser(100).feed(1.0, short + good + good)
    assert [type(event) for event in events] == [BadFrame, Part, Part]
    endless = PartsParser(100)
    assert [type(one) for one in endless.feed(1.0, MARK + b"a" * MOST_HEAD)] == [BadFrame]


def test_what_follows_a_part_that_was_cut_began_when_that_was_found() -> None:
    parser, whole = PartsParser(100), part(b"whole", None)
    assert parser.feed(1.0, part(b"a part that is cut", None)[:-9]) == []
    _, one, other = parser.feed(1.5, whole + whole)
    assert isinstance(one, Part)
    assert isinstance(other, Part)
    assert (one.began_s, other.began_s) == (1.5, 1.5)


@given(st.lists(st.binary(max_size=64) | st.just(MARK) | st.just(b"Content-Length: 3\r\n\r\n")))
def test_no_bytes_make_the_parser_raise_or_fill(pieces: list[bytes]) -> None:
    parser = PartsParser(100)
    for piece in pieces:
        parser.feed(0.0, piece)
        assert len(parser._buffer) <= MOST_HEAD + 64 + len(MARK)
