"""Bytes of web cameras: whole images, whatever is cut, missing, wrong or without an end."""

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.stripe.mjpeg import (
    MOST_HEAD,
    Jpeg,
    MjpegParser,
    Refused,
    StreamBegun,
    encode_request,
    maybe_size,
)
from tests.support.cases import cut, examples

FEWER = settings(max_examples=examples(60))
MOST = 5000
HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n"


def image(k: int, size: int = 300) -> bytes:
    """Looks like a JPEG to who does not decode it, and is another for each k."""
    return b"\xff\xd8" + bytes([k % 200]) * size + b"\xff\xd9"


def part(data: bytes, length: int | None = -1, mark: bytes = b"--frame") -> bytes:
    """A part of the stream; length -1: the true one, None: not told."""
    told = len(data) if length == -1 else length
    line = b"" if told is None else b"Content-Length: %d\r\n" % told
    return mark + b"\r\nContent-Type: image/jpeg\r\n" + line + b"\r\n" + data + b"\r\n"


def fed(*pieces: bytes) -> list[Any]:
    parser = MjpegParser(MOST)
    return [event for k, piece in enumerate(pieces) for event in parser.feed(0.1 * k, piece)]


def images_of(events: Sequence[Any]) -> list[bytes]:
    return [event.data for event in events if isinstance(event, Jpeg)]


def bad_of(events: Sequence[Any]) -> list[str]:
    return [event.reason for event in events if isinstance(event, BadFrame)]


@pytest.mark.parametrize("behind", [b"\r\n--frame\r\n", b"\r\n--frame", b"\n--frame\n"])
def test_an_image_begins_with_its_own_bytes_where_the_boundary_came_before(behind: bytes) -> None:
    parser, mark = MjpegParser(MOST), b"--frame\r\n"
    body = part(image(1)).removeprefix(mark).removesuffix(b"\r\n")
    begins = b"" if behind.endswith(b"\n") else b"\r\n"
    parser.feed(1.0, HEAD + behind)
    told = [parser.feed(float(k), begins + body + behind) for k in (2, 3, 4)]
    assert told == [[Jpeg(image(1), float(k), float(k))] for k in (2, 3, 4)]


def test_a_stream_by_hand_is_its_images_each_at_once() -> None:
    parser = MjpegParser(MOST)
    assert parser.feed(1.0, HEAD) == [StreamBegun()]
    begun = part(image(1))
    assert parser.feed(2.0, begun[:50]) == []
    assert parser.feed(2.5, begun[50:-2]) == [Jpeg(image(1), 2.0, 2.5)]
    assert parser.feed(2.6, begun[-2:]) == []
    assert parser.feed(3.0, part(image(2))) == [Jpeg(image(2), 3.0, 3.0)]


@pytest.mark.parametrize(
    ("line", "stamp_us"),
    [
        (b"X-Timestamp: 1700000000.123456", 1_700_000_000_123_456),
        (b"x-timestamp:7", 7_000_000),
        (b"X-Timestamp: 7.25", 7_250_000),
        (b"X-Timestamp: -7.2", None),
        (b"X-Timestamp: 7.5e3", None),
        (b"X-Timestamp: ", None),
    ],
)
def test_the_cameras_own_time_of_an_image_is_read_where_it_is_one(
    line: bytes, stamp_us: int | None
) -> None:
    stamped = part(image(1)).replace(b"\r\n\r\n", b"\r\n" + line + b"\r\n\r\n", 1)
    *_, with_time, without = fed(HEAD, stamped, part(image(2)))
    assert (with_time.stamp_us, without.stamp_us) == (stamp_us, None)


@pytest.mark.parametrize(
    "head",
    [
        b"HTTP/1.1 200 OK\nContent-Type: multipart/x-mixed-replace;boundary=--frame\n\n",
        b'HTTP/1.0 200 OK\r\ncontent-type: multipart/x-mixed-replace; boundary="frame"\r\n\r\n',
    ],
)
@pytest.mark.parametrize("length", [-1, None])
def test_what_cameras_do_differently_is_understood(head: bytes, length: int | None) -> None:
    stream = head + b"".join(part(image(k), length) for k in range(4)) + b"--frame"
    events = fed(stream.replace(b"\r\n", b"\n") if b"1.1" in head else stream)
    assert images_of(events) == [image(k) for k in range(4)]
    assert bad_of(events) == []


@pytest.mark.parametrize("told", [b"--myb", b"----WebKitX", b"-" * 24 + b"d74496d6"])
@pytest.mark.parametrize("is_told_with_hyphens", [True, False])
@pytest.mark.parametrize("length", [-1, None])
def test_a_boundary_that_begins_with_hyphens_is_read_told_with_the_delimiters_or_without(
    told: bytes, is_told_with_hyphens: bool, length: int | None
) -> None:
    mark = told if is_told_with_hyphens else b"--" + told
    parts = b"".join(part(image(k), length, mark) for k in range(4))
    stream = HEAD.replace(b"=frame", b"=" + told) + parts + mark
    for pieces in ([stream], cut(stream, range(0, 20_000, 1))):
        events = fed(*pieces)
        assert images_of(events) == [image(k) for k in range(4)]
        assert bad_of(events) == []


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"HTTP/1.0 401 Unauthorized\r\n\r\n", "401 Unauthorized"),
        (b"HTTP/1.0 200 OK\r\nContent-Type: text/html\r\n\r\n<html>", "something else"),
        (HEAD[:-2] + b"Transfer-Encoding: chunked\r\n\r\n", "in chunks"),
        (b"SSH-2.0-OpenSSH\r\n\r\n", "no web camera"),
    ],
)
def test_a_refusal_is_told_and_ends_it(answer: bytes, why: str) -> None:
    (refused,) = fed(answer, part(image(1)))
    assert isinstance(refused, Refused)
    assert why in refused.why


@pytest.mark.parametrize(
    ("damaged", "reason"),
    [
        (part(image(1)[:-50]), "a JPEG without its end"),
        (part(image(1)[:-50], length=304), "a JPEG without its end"),  # the next one is in it
        (part(b"<html>"), "a part is no JPEG"),
        (part(image(1), length=MOST + 1), "a part's length that can't be"),
        (part(image(1), length=0), "a part's length that can't be"),
        (part(image(1), mark=b"--other"), "bytes before a boundary"),
        (b"--frame\r\nX: " + b"x" * 2 * MOST_HEAD, "no end of a part's headers"),
        (part(image(1, 2 * MOST), length=None), "an image without an end"),
        (part(image(1), length=200), "a JPEG without its end"),
    ],
)
def test_damage_is_told_and_costs_no_other_image(damaged: bytes, reason: str) -> None:
    rest = part(image(2)) + part(image(3)) + part(image(4))
    for pieces in ([HEAD + damaged + rest], cut(HEAD + damaged + rest, range(0, 40_000, 7))):
        events = fed(*pieces)
        assert images_of(events) == [image(2), image(3), image(4)]
        assert reason in bad_of(events)


def test_headers_without_an_end_and_a_boundary_that_never_comes_keep_little() -> None:
    for head in (b"", HEAD):
        parser = MjpegParser(MOST)
        told = [
            e for k in range(100) for e in parser.feed(0.1 * k, (head if k == 0 else b"y" * 999))
        ]
        assert bad_of(told)
        assert len(parser._buffer) <= MOST_HEAD + 2000


@FEWER
@given(st.data())
def test_where_the_stream_is_cut_makes_no_difference(data: st.DataObject) -> None:
    lengths = data.draw(st.lists(st.sampled_from([-1, None]), min_size=1, max_size=5))
    stream = HEAD + b"".join(part(image(k), n) for k, n in enumerate(lengths)) + b"--frame"
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=12))
    events = fed(*cut(stream, cuts))
    assert images_of(events) == [image(k) for k in range(len(lengths))]
    assert bad_of(events) == []


@FEWER
@given(st.data())
def test_damaged_anywhere_it_finds_its_way_back(data: st.DataObject) -> None:
    stream = bytearray(HEAD + b"".join(part(image(k)) for k in range(3)))
    at = data.draw(st.integers(len(HEAD), len(stream) - 1))
    stream[at : at + data.draw(st.integers(1, 200))] = data.draw(st.binary(max_size=200))
    rest = b"".join(part(image(k, 600)) for k in range(10, 30))  # longer than a wrong length
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=6))
    events = fed(*cut(bytes(stream), cuts), rest)
    assert images_of(events)[-3:] == [image(k, 600) for k in (27, 28, 29)]


@FEWER
@given(st.lists(st.binary(max_size=400) | st.sampled_from([HEAD, part(image(1)), b"--frame\r\n"])))
def test_no_bytes_make_it_raise_or_keep_more_than_an_image(pieces: list[bytes]) -> None:
    parser = MjpegParser(MOST)
    for tick, piece in enumerate([HEAD, *pieces]):
        for event in parser.feed(0.1 * tick, piece):
            assert isinstance(event, StreamBegun | Refused | Jpeg | BadFrame)
        assert len(parser._buffer) <= max(MOST, MOST_HEAD) + 500


def test_the_size_is_read_from_the_bytes_of_a_jpeg() -> None:
    begin = b"\xff\xd8\xff\xe0\x00\x04ab\xff\xff\xc0\x00\x11\x08\x01\xe0\x02\x80\x03"
    assert maybe_size(begin) == (640, 480)
    for end in range(len(begin) - 2):
        assert maybe_size(begin[:end]) is None
    assert maybe_size(b"\xff\xd8\x00" + begin) is None


def test_the_request_is_one_of_http_1_0() -> None:
    assert encode_request("10.0.0.1", "/s?a=1").startswith(b"GET /s?a=1 HTTP/1.0\r\nHost: 10.0.0.1")
    assert encode_request("10.0.0.1", "/").endswith(b"\r\n\r\n")
