"""CoLa-A: the texts of the sheet and of a real sister model, and whatever else may come."""

import random
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.lms1xx.cola import INCOMPLETE_S, MAX_TEXT, PayloadError
from hw.lms1xx.cola_fields import TextFields, number
from hw.lms1xx.telegrams import MAX_BEAMS, Answer, Refusal, ScanTelegram, new_parser
from tests import VECTORS
from tests.hw.lms1xx.test_commands import FRAMES, TEXTS
from tests.hw.lms1xx.test_telegrams import in_words

MRS1000 = (VECTORS / "mrs1000_cola_a_one_scan.bin").read_bytes()
TIM781 = (VECTORS / "tim781_1s_d2h.bin").read_bytes()
SOME = [TEXTS["scan A"], TEXTS["scan B"], TEXTS["scan is 50"], TEXTS["write denied"]]
MIXED = [*SOME, FRAMES["scan A"], FRAMES["write denied"]]
JUNK = st.binary(max_size=30).map(lambda junk: junk.replace(b"\x02", b""))


def fed(
    *pieces: bytes, dialect: str = "ascii", now_s: float = 0.0, max_beams: int = MAX_BEAMS
) -> list[Any]:
    parser = new_parser(dialect, max_beams)  # type: ignore[arg-type]
    return [event for piece in pieces for event in parser.feed(now_s, piece)]


def without_dialect(scan: ScanTelegram) -> dict[str, Any]:
    """All of a telegram as comparable values."""
    fields = {name: getattr(scan, name) for name in ScanTelegram.__slots__ if name != "dialect"}
    fields["channels"] = [
        (c.content, c.scale, c.offset, c.first_deg, c.step_deg, c.raw.tolist())
        for c in scan.channels.values()
    ]
    return fields


@pytest.mark.parametrize("name", ["scan A", "scan B"])
@pytest.mark.parametrize("dialect", ["ascii", "auto"])
def test_the_text_of_a_scan_says_what_its_frame_says(name: str, dialect: str) -> None:
    [text] = fed(TEXTS[name], dialect=dialect, now_s=4.5)
    [packed] = fed(FRAMES[name], dialect="auto", now_s=4.5)
    assert without_dialect(text) == without_dialect(packed)
    assert (text.dialect, packed.dialect) == ("ascii", "binary")


def test_the_telegram_of_an_mrs1000_is_read_to_its_last_channel() -> None:
    [scan] = fed(MRS1000, max_beams=1101)
    names = ["DIST1", "DIST2", "DIST3", "RSSI1", "RSSI2", "RSSI3"]
    assert list(scan.channels) == names
    assert (scan.serial_number, scan.scan_hz, scan.layer_raw) == (0x107FA24, 50.0, 0xFE0C)
    assert (scan.telegram_counter, scan.scan_us) == (0x3FB0, 0x9B6285F9)
    assert scan.clock == (1970, 1, 1, 1, 55, 1, 0xE9E30)
    # The telegram once more, by its tokens: six channels of head, count, values.
    tokens = MRS1000[1:-1].split()
    for name in names:
        at = tokens.index(name.encode())
        channel = scan.channels[name]
        assert channel.first_deg == (int(tokens[at + 3], 16) - 2**32) / 10_000
        assert (channel.step_deg, len(channel.raw)) == (0.25, 1101)
        assert channel.raw.dtype.itemsize == (2 if name.startswith("DIST") else 1)
        raw = [int(token, 16) for token in tokens[at + 6 : at + 6 + 1101]]
        assert channel.raw.tolist() == raw


def test_a_tim781_is_read_in_its_real_segments() -> None:
    lines = (VECTORS / "tim781_1s_segments.csv").read_text(encoding="utf-8").split()[1:]
    parser, scans = new_parser("auto"), []
    for line in lines:
        arrived, offset, length = line.split(",")
        piece = TIM781[int(offset) : int(offset) + int(length)]
        for event in parser.feed(float(arrived), piece):
            assert isinstance(event, ScanTelegram)
            assert event.arrived_s == float(arrived)
            scans.append(event)
    assert len(scans) == 16
    counters = [scan.scan_counter for scan in scans]
    assert counters == list(range(counters[0], counters[0] + 16))
    for scan in scans:
        assert list(scan.channels) == ["DIST1", "RSSI1"]
        assert {len(channel.raw) for channel in scan.channels.values()} == {811}
        assert scan.scan_hz == 15.0
    first = np.frombuffer(TIM781, ">u2", 811, TIM781.index(b"DIST1") + 21)
    np.testing.assert_array_equal(scans[0].channels["DIST1"].raw, first)


def test_refusals_and_answers_are_read() -> None:
    assert fed(TEXTS["write denied"]) == [Refusal(0x0A, "ascii")]
    assert fed(b"\x02sFA 1A\x03\x02sAN Run 1\x03\x02sWA LMPoutputRange\x03") == [
        Refusal(0x1A, "ascii"),
        Answer("sAN", "Run", b"1", "ascii"),
        Answer("sWA", "LMPoutputRange", b"", "ascii"),
    ]


def test_numbers_are_read_leniently_and_never_wrongly() -> None:
    good = [
        (b"FFF92230", "i", -450_000),
        (b"fff92230", "i", -450_000),
        (b"-450000", "i", -450_000),
        (b"+5000", "H", 5000),
        (b"5000", "H", 0x5000),
        (b"000001388", "I", 5000),
        (b"FFFB", "h", -5),
        (b"7F", "b", 127),
    ]
    for token, code, value in good:
        assert number(token, code) == value
    bad = [
        (b"10000", "H"), (b"-1", "B"), (b"+FF", "H"), (b"1_0", "H"), (b"0x10", "H"), (b"", "B"),
        (b"-", "i"), (b"100000000", "I"), (b"-40000", "h"), (b"12345678901", "I"), (b"1.5", "H"),
    ]  # fmt: skip
    for token, code in bad:
        with pytest.raises(PayloadError):
            number(token, code)


def test_values_of_an_array_may_be_written_in_any_way() -> None:
    assert TextFields(b"0 1f  FFFF 0010 +20 rest").array(">u2", 5).tolist() == [
        0,
        31,
        65535,
        16,
        20,
    ]
    fields = TextFields(b" 1 2 3  4 left over ")
    assert fields.array("u1", 3).tolist() == [1, 2, 3]
    assert fields.fields("H") == (4,)
    assert fields.rest() == b"left over"
    for text, kind in ((b"1 2", "u1"), (b"1 2 100", "u1"), (b"1 2 g", ">u2"), (b"1 2 -1", ">u2")):
        with pytest.raises(PayloadError):
            TextFields(text).array(kind, 3)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b" 1388 168 ", b" 0 168 ", "scan frequency is 0"),
        (b"DIST1", b"DIST0", "unknown channel"),
        (b"3F800000", b"7FC00000", "scale nan"),
        (b" 3 539 ", b" 0 539 ", "0 points"),
        (b" 3 539 ", b" 3FF 539 ", "telegram ends early"),
        (b" 3 539 ", b" 43A 539 ", "1082 points a scan, more than 1081"),
        (b" 3 539 ", b" 3 10539 ", "is too big"),
        (b"C0A08 0", b"C0A08 0 0", "goes on after its end"),
        (b"C0A08 0", b"C0A08", "telegram ends early"),
        (b"sSN LMD", b"sSX LMD", "unknown telegram"),
        (b" 114097A ", b" 11409z7A ", "is no number"),
    ],
)
def test_a_text_that_cannot_be_true_is_rejected_and_the_next_is_read(
    old: bytes, new: bytes, reason: str
) -> None:
    text = TEXTS["scan A"].replace(old, new, 1)
    assert text != TEXTS["scan A"]
    bad, good = fed(text + TEXTS["write denied"])
    assert reason in bad.reason
    assert bad.skipped == text
    assert good == Refusal(0x0A, "ascii")


@given(
    st.lists(st.binary(max_size=200) | st.sampled_from(MIXED)), st.sampled_from(["auto", "ascii"])
)
def test_no_bytes_make_the_parser_raise_or_keep_more_than_a_telegram(
    pieces: list[bytes], dialect: str
) -> None:
    parser = new_parser(dialect)  # type: ignore[arg-type]
    for tick, piece in enumerate(pieces):
        parser.feed(tick * 0.1, piece)
        assert len(parser._buffer) <= MAX_TEXT + 200


@given(st.sampled_from(SOME[:3]), st.lists(st.tuples(st.integers(5), st.binary(max_size=2))))
def test_no_text_makes_the_parser_raise(text: bytes, changes: list[tuple[int, bytes]]) -> None:
    payload = bytearray(text[1:-1])
    for at, value in changes:
        at %= len(payload)
        payload[at : at + 1] = value
    fed(b"\x02" + bytes(payload) + b"\x03")


@given(st.lists(st.tuples(JUNK, st.sampled_from(MIXED)), max_size=6), JUNK)
def test_telegrams_of_both_dialects_survive_junk(
    parts: list[tuple[bytes, bytes]], tail: bytes
) -> None:
    stream = b"".join(junk + telegram for junk, telegram in parts) + tail
    events = fed(stream, b"\xff", dialect="auto")
    found = [event for event in events if not isinstance(event, BadFrame)]
    whole = fed(b"".join(telegram for _, telegram in parts), dialect="auto")
    assert in_words(found) == in_words(whole)
    assert len(found) == len(parts)


@given(
    st.lists(st.tuples(st.binary(max_size=20), st.sampled_from(MIXED)), max_size=6),
    st.lists(st.integers(0, 1200), max_size=8),
)
def test_where_a_mixed_stream_is_cut_makes_no_difference(
    parts: list[tuple[bytes, bytes]], cuts: list[int]
) -> None:
    stream = b"".join(junk + telegram for junk, telegram in parts)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    pieces = [stream[a:b] for a, b in pairwise(edges)]
    assert in_words(fed(*pieces, dialect="auto")) == in_words(fed(stream, dialect="auto"))


def test_a_text_that_never_ends_is_waited_for_only_so_long_and_only_so_far() -> None:
    parser = new_parser("ascii")
    assert parser.feed(1.0, b"\x02sRA LMPsc") == []
    assert (
        parser.feed(1.0 + INCOMPLETE_S, b"") == []
    )  # now it is junk, to be told with what follows
    bad, good = parser.feed(1.1 + INCOMPLETE_S, TEXTS["write denied"])
    assert bad == BadFrame("telegram never completed", b"\x02sRA LMPsc")
    assert good == Refusal(0x0A, "ascii")
    parser, skipped = new_parser("ascii"), 0
    for piece in range(200):  # at once: no time passes
        for event in parser.feed(1.0, b"\x02s" * (piece == 0) + b"x" * 1000):
            skipped += len(event.skipped)  # type: ignore[union-attr]
        assert len(parser._buffer) <= MAX_TEXT + 1000
    assert skipped > 190_000
    stuck = b"\x02sRA LMPsc" + TEXTS["write denied"]  # a new start tells that the other was none
    assert fed(stuck) == [BadFrame("telegram cut short", b"\x02sRA LMPsc"), Refusal(10, "ascii")]


@pytest.mark.parametrize("dialect", ["ascii", "binary"])
def test_a_damaged_stream_costs_no_more_decoding_than_a_clean_one(dialect: str) -> None:
    unit = {"ascii": MRS1000, "binary": TIM781}[dialect]
    stream = unit * (200_000 // len(unit))
    damaged, chance = bytearray(stream), random.Random(5)
    for at in chance.sample(range(len(stream)), len(stream) // 100):
        damaged[at] ^= chance.randrange(1, 256)
    counts = []
    for data in (stream, bytes(damaged)):
        parser = new_parser("auto")
        looked_at = 0
        decode = parser._decode

        def counted(now_s: float, payload: bytes, dialect: Any, decode: Any = decode) -> Any:
            nonlocal looked_at
            looked_at += len(payload)
            return decode(now_s, payload, dialect)

        parser._decode = counted
        for at in range(0, len(data), 1448):
            parser.feed(at * 1e-6, data[at : at + 1448])
        counts.append(looked_at)
    assert counts[1] <= 1.05 * counts[0]
