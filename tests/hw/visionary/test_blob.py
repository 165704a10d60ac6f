"""The stream's messages, whole, damaged, and cut anywhere."""

from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.visionary.blob import MOST_BYTES, NO_END, Blob, BlobParser
from tests.support.devices.visionary_vectors import T_MINI, S


def fed(*pieces: bytes) -> list[bytes | str]:
    """Messages as bytes, and in words what was none."""
    parser, found = BlobParser(), list[bytes | str]()
    for piece in pieces:
        for at in range(0, len(piece), 1000):  # so that each is looked at before the next
            for event in parser.feed(0.0, piece[at : at + 1000]):
                found.append(bytes(event.data) if isinstance(event, Blob) else event.reason)
    return found


def changed(at: int, value: bytes) -> bytes:
    return T_MINI[:at] + value + T_MINI[at + len(value) :]


def test_the_segments_of_the_sheets_frame() -> None:
    parser = BlobParser()
    assert parser.feed(1.0, T_MINI[:700]) == []
    (blob,) = parser.feed(2.0, T_MINI[700:])
    assert isinstance(blob, Blob)
    assert (blob.change, len(blob.xml), len(blob.binary)) == (1, 1371, 100)
    assert bytes(blob.xml[:12]) == b"<SickRecord>"
    assert blob.binary[:4] == (96).to_bytes(4, "little")
    assert (blob.began_s, blob.arrived_s) == (1.0, 2.0)


PARTS = st.lists(st.tuples(st.binary(max_size=30), st.sampled_from([T_MINI, S])), max_size=4)


# Junk right behind a frame, in one piece.
@example([(b"", S), (b"junk" * 15, T_MINI)], [len(S) - 1])
@given(PARTS, st.lists(st.integers(0, 9000), max_size=12))
def test_messages_survive_junk_and_any_cutting(
    parts: list[tuple[bytes, bytes]], cuts: list[int]
) -> None:
    stream = b"".join(junk.replace(b"\x02", b"") + whole for junk, whole in parts)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    found = fed(*(stream[a:b] for a, b in pairwise(edges)))
    assert [one for one in found if isinstance(one, bytes)] == [whole for _, whole in parts]


LIKE_A_HEAD = st.sampled_from([T_MINI[:19], T_MINI[:40], S[:300], b"\x02" * 7, T_MINI[:-1], b"E"])


@given(st.lists(st.one_of(LIKE_A_HEAD, st.binary(max_size=60)), max_size=20))
def test_no_bytes_make_it_raise_and_it_finds_the_way_back(pieces: list[bytes]) -> None:
    found = fed(*pieces, *[T_MINI] * 5)
    assert found[-1] == T_MINI


@pytest.mark.parametrize(
    ("damaged", "reason"),
    [
        (changed(9, b"\x02"), "a message of version 2, type 62, not 1 and 62"),
        (changed(10, b"a"), "a message of version 1, type 61, not 1 and 62"),
        (changed(14, b"\x02"), "a message of 2 segments, not 3"),
        (changed(15, bytes(4)), "a message whose segments begin at 0, 1399, 1499 of 1512"),
        (changed(23, bytes(4)), "a message whose segments begin at 28, 0, 1499 of 1512"),
        (changed(4, b"\x7f"), f"a message of 2130707944 bytes, more than {MOST_BYTES}"),
        (T_MINI[:-1] + b"F", NO_END),
        (T_MINI[:900], NO_END),
        (T_MINI[200:], "no start of a message"),
    ],
)
def test_what_is_damaged_is_named_and_the_next_is_whole(damaged: bytes, reason: str) -> None:
    assert fed(damaged + T_MINI + S) == [reason, T_MINI, S]


@pytest.mark.parametrize("cuts", [(700, 900), (900, 700), (40, 41, 1400)])
def test_a_whole_message_behind_several_that_are_cut_is_not_lost(cuts: tuple[int, ...]) -> None:
    found = fed(b"".join(T_MINI[:cut] for cut in cuts) + T_MINI + S)
    assert [one for one in found if isinstance(one, bytes)] == [T_MINI, S]


class Counting(BlobParser):
    """Counts the bytes that it moves."""

    moved = 0

    def _move(self) -> None:
        self.moved += self._end - self._at
        super()._move()


FALSE_HEAD = T_MINI[:4] + (60).to_bytes(4, "big") + T_MINI[8:19] + bytes([0, 0, 0, 1])
FALSE_HEAD += b"".join(n.to_bytes(4, "big") for n in (40, 1, 50, 1)) + b"F" * 34


@pytest.mark.parametrize("false", [T_MINI[:19], FALSE_HEAD])
def test_starts_that_are_none_are_looked_at_once_each(false: bytes) -> None:
    parser, seen = Counting(), 0
    stream = changed(4, MOST_BYTES.to_bytes(4, "big"))[:300]
    stream += false * ((MOST_BYTES + 100) // len(false)) + T_MINI * 3
    for at in range(0, len(stream), 60_000):
        seen += sum(isinstance(one, Blob) for one in parser.feed(0.0, stream[at : at + 60_000]))
    assert seen == 3
    assert parser.moved <= 2 * len(stream)


def test_a_frame_stays_as_it_is_while_the_next_one_comes() -> None:
    parser = BlobParser()
    (first,) = parser.feed(0.0, T_MINI + S[:1000])
    assert isinstance(first, Blob)
    assert bytes(first.data) == T_MINI
    (second,) = parser.feed(0.0, S[1000:])
    assert isinstance(second, Blob)
    assert not isinstance(second, BadFrame)
    assert (bytes(first.data), bytes(second.data)) == (T_MINI, S)
