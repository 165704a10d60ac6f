"""CoLa streams of both dialects: cut anywhere, mixed with junk, damaged, never ending."""

import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.lms1xx.cola import INCOMPLETE_S, MAX_TEXT, REPORTED_SIZE, ColaParser
from hw.lms1xx.telegrams import MAX_BEAMS, Answer, Refusal, ScanTelegram, decode, new_parser
from tests import VECTORS
from tests.support.cases import cut, examples
from tests.support.devices.lms111_vectors import FRAMES, TEXTS, framed, texted

PACKED = [
    FRAMES[name] for name in ("scan A", "logged in", "unknown variable", "device ready", "scan B")
]
WRITTEN = [texted(TEXTS[name]) for name in ("scan A", "scan B", "scan is 50", "write denied")]
TELEGRAMS = {"binary": PACKED, "ascii": WRITTEN, "auto": [*PACKED, *WRITTEN]}
REFUSED, LOGGED_IN = texted(TEXTS["write denied"]), FRAMES["logged in"]
DIALECTS = st.sampled_from(list(TELEGRAMS))
FEWER = settings(max_examples=examples(25))


def fed(dialect: str, *pieces: bytes) -> list[Any]:
    parser = new_parser(dialect)  # type: ignore[arg-type]
    return [event for piece in pieces for event in parser.feed(0.0, piece)]


def comparable(events: list[Any]) -> list[str]:
    """Telegrams as texts, with the bytes skipped between them."""
    texts = []
    for event in events:
        if isinstance(event, ScanTelegram):
            values = {name: channel.raw.tolist() for name, channel in event.channels.items()}
            texts.append(f"{event.polled} {event.scan_counter} {event.sent_us} {values}")
        else:
            texts.append(repr(event))
    return texts


@FEWER
@given(st.data(), DIALECTS)
def test_no_bytes_make_the_parser_raise_or_keep_more_than_a_telegram(
    data: st.DataObject, dialect: str
) -> None:
    pieces = st.lists(st.binary(max_size=200) | st.sampled_from(TELEGRAMS["auto"]))
    parser = new_parser(dialect)  # type: ignore[arg-type]
    for tick, piece in enumerate(data.draw(pieces)):
        parser.feed(tick * 0.1, piece)
        assert len(parser._buffer) <= MAX_TEXT + 200


@FEWER
@given(st.data(), DIALECTS, st.lists(st.integers(0, 1200), max_size=8))
def test_telegrams_survive_junk_and_any_cutting(
    data: st.DataObject, dialect: str, cuts: list[int]
) -> None:
    junk = st.binary(max_size=30)
    if dialect != "binary":  # a start mark in it may be that of a text
        junk = junk.map(lambda piece: piece.replace(b"\x02", b""))
    parts = data.draw(st.lists(st.tuples(junk, st.sampled_from(TELEGRAMS[dialect])), max_size=6))
    stream = b"".join(piece + telegram for piece, telegram in parts) + data.draw(junk)
    events = fed(dialect, stream, b"\xff")  # after that byte nothing is the start of a telegram
    assert comparable(fed(dialect, *cut(stream, cuts), b"\xff")) == comparable(events)
    found = [event for event in events if not isinstance(event, BadFrame)]
    whole = fed(dialect, b"".join(telegram for _, telegram in parts))
    assert comparable(found) == comparable(whole)
    assert len(found) == len(parts)


@pytest.mark.parametrize("frame", PACKED, ids=["scan A", "answer", "refusal", "ready", "scan B"])
def test_any_byte_altered_is_rejected_and_the_next_telegrams_are_read(frame: bytes) -> None:
    after = LOGGED_IN + FRAMES["scan A"]
    for at in range(len(frame)):
        altered = frame[:at] + bytes([frame[at] ^ (0x01, 0x80, 0xFF)[at % 3]]) + frame[at + 1 :]
        parser = new_parser()
        events = parser.feed(0.0, altered + after)
        events += parser.feed(INCOMPLETE_S, b"\xff")  # a length too long has been waited for
        assert isinstance(events[0], BadFrame), at
        assert comparable(events[-2:]) == comparable(fed("binary", after)), at


@pytest.mark.parametrize(
    ("stuck", "after", "good"),
    [
        (b"\2\2\2\2\0\0\x40\0sRA x", LOGGED_IN, Answer("sAN", "SetAccessMode", b"\1")),
        (b"\2sRA LMPsc", REFUSED, Refusal(0x0A, "ascii")),
    ],
    ids=["binary", "ascii"],
)
def test_a_telegram_that_never_completes_is_waited_for_only_so_long(
    stuck: bytes, after: bytes, good: Answer | Refusal
) -> None:
    parser = new_parser("auto")
    assert parser.feed(1.0, stuck) == []
    assert parser.feed(1.0 + INCOMPLETE_S - 0.01, b"") == []
    assert parser.feed(1.0 + INCOMPLETE_S, b"") == []  # now it is junk, told with what follows
    junk = BadFrame("telegram never completed", stuck)
    assert parser.feed(1.1 + INCOMPLETE_S, after) == [junk, good]


def test_a_text_without_an_end_is_kept_only_so_far_and_a_new_start_ends_it() -> None:
    parser, skipped = new_parser("ascii"), 0
    for piece in range(200):  # at once: no time passes
        for event in parser.feed(1.0, b"\x02sRA " * (piece == 0) + b"x" * 1000):
            skipped += len(event.skipped)  # type: ignore[union-attr]
        assert len(parser._buffer) <= MAX_TEXT + 1000
    assert skipped > 190_000
    assert fed("ascii", b"\x02sRA LMPsc" + REFUSED) == [
        BadFrame("telegram cut short", b"\x02sRA LMPsc"),
        Refusal(10, "ascii"),
    ]


def test_endless_junk_is_told_in_bounded_pieces_and_little_junk_after_a_while() -> None:
    events = fed("binary", bytes(3 * REPORTED_SIZE + 10))
    assert [len(event.skipped) for event in events] == [REPORTED_SIZE] * 3
    parser = new_parser()
    assert parser.feed(0.0, b"hello") == []
    assert parser.feed(INCOMPLETE_S, b"") == [BadFrame("no telegram", b"hello")]
    assert parser.feed(2 * INCOMPLETE_S, b"") == []


def test_the_start_mark_within_a_damaged_telegram_does_no_harm() -> None:
    frame = framed(b"sRA x " + b"\x02\x02" * 200)
    damaged = frame[:10] + b"\xff" + frame[11:]
    bad, good = fed("binary", damaged + frame)
    assert bad == BadFrame("wrong checksum", damaged)
    assert good == Answer("sRA", "x", b"\x02\x02" * 200)


@pytest.mark.parametrize("file", ["mrs1000_cola_a_one_scan.bin", "tim781_1s_d2h.bin"])
def test_a_damaged_stream_costs_no_more_decoding_than_a_clean_one(file: str) -> None:
    unit, chance = (VECTORS / file).read_bytes(), random.Random(5)
    stream = unit * (100_000 // len(unit))
    damaged = bytearray(stream)
    for at in chance.sample(range(len(stream)), len(stream) // 100):
        damaged[at] ^= chance.randrange(1, 256)
    assert decoded_bytes(bytes(damaged)) <= 1.05 * decoded_bytes(stream)


def decoded_bytes(data: bytes) -> int:
    decoded = []

    def count(now_s: float, payload: bytes, dialect: str) -> None:
        decoded.append(len(payload))
        decode(now_s, payload, dialect, MAX_BEAMS)  # type: ignore[arg-type]

    parser = ColaParser(count, "auto")
    for at in range(0, len(data), 1448):
        parser.feed(at * 1e-6, data[at : at + 1448])
    return sum(decoded)
