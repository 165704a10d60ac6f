"""LMS111 codec: the sheet's frames, the recorded session, and whatever else may come."""

import math
import struct
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.lms1xx import telegrams as lms111
from hw.lms1xx.cola import INCOMPLETE_S, MAX_PAYLOAD, REPORTED_SIZE, encode_frame
from hw.lms1xx.telegrams import Answer, Refusal, ScanTelegram, new_parser
from tests import VECTORS

FRAMES = {
    row.split("\t")[1]: bytes.fromhex(row.split("\t")[2])
    for row in (VECTORS / "lms111_frames.tsv").read_text(encoding="utf-8").splitlines()
    if not row.startswith("#")
}
RECORDED = (VECTORS / "lms111_session_d2h.bin").read_bytes()
SCAN_A, SCAN_B, LOGGED_IN = FRAMES["scan A"], FRAMES["scan B"], FRAMES["logged in"]
TELEGRAMS = [SCAN_A, LOGGED_IN, FRAMES["unknown variable"], FRAMES["device ready"], SCAN_B]
JUNK = st.binary(max_size=30)


def fed(*pieces: bytes, now_s: float = 0.0) -> list[Any]:
    parser = new_parser()
    return [event for piece in pieces for event in parser.feed(now_s, piece)]


def in_words(events: list[Any]) -> list[str]:
    """Telegrams as comparable text, and all skipped bytes."""
    words = []
    for event in events:
        if isinstance(event, ScanTelegram):
            values = {name: channel.raw.tolist() for name, channel in event.channels.items()}
            words.append(f"{event.polled} {event.scan_counter} {event.sent_us} {values}")
        else:
            words.append(repr(event))
    return words


def metres(telegram: ScanTelegram, content: str) -> list[float]:
    channel = telegram.channels[content]
    out = np.empty(len(channel.raw))
    lms111.ranges_m_from_channel(channel, slice(0, len(out)), out)
    return [float(value) for value in out]


# --- the sheet's frames


def test_answers_and_refusals_are_told_apart() -> None:
    events = fed(LOGGED_IN + FRAMES["not logged in"] + FRAMES["range written"])
    assert events == [
        Answer("sAN", "SetAccessMode", b"\x01"),
        Answer("sAN", "SetAccessMode", b"\x00"),
        Answer("sWA", "LMPoutputRange", b""),
    ]
    assert fed(FRAMES["subscribed"]) == [Answer("sEA", "LMDscandata", b"\x01")]
    denied, unknown = fed(FRAMES["write denied"] + encode_frame(b"sFA\x12\x34"))
    assert (denied, denied.reason) == (Refusal(0x0A), "write access denied")
    assert unknown.reason == "error code 4660"


def test_each_code_of_a_refusal_has_its_words_in_both_dialects() -> None:
    assert list(lms111.REFUSALS) == list(range(1, 0x1B))
    assert len(set(lms111.REFUSALS.values())) == 0x1A
    for code, words in lms111.REFUSALS.items():
        [packed] = fed(encode_frame(b"sFA" + struct.pack(">H", code)))
        [text] = new_parser("ascii").feed(0.0, f"\x02sFA {code:X}\x03".encode())
        assert isinstance(text, Refusal)
        assert packed.reason == text.reason == words


def test_vector_a_is_read() -> None:
    [scan] = fed(SCAN_A, now_s=12.5)
    assert (scan.arrived_s, scan.polled, scan.version) == (12.5, False, 1)
    assert (scan.serial_number, scan.status) == (18090362, (0, 0))
    assert (scan.telegram_counter, scan.scan_counter) == (63344, 12)
    assert (scan.scan_us, scan.sent_us) == (0x742AF1D6, 0x742AFE0A)
    assert (scan.outputs, scan.scan_hz, scan.measurement_hz) == ((4, 0), 50.0, 36_000.0)
    assert scan.clock == (2021, 3, 2, 12, 34, 56, 789_000)
    assert (scan.encoders, scan.position, scan.name, scan.comment) == ((), None, None, None)
    assert list(scan.channels) == ["DIST1", "RSSI1"]
    dist = scan.channels["DIST1"]
    assert (dist.first_deg, dist.step_deg, dist.raw.tolist()) == (90.0, 0.5, [1337, 3, 0])
    assert scan.channels["RSSI1"].raw.tolist() == [254, 0, 16]
    np.testing.assert_array_equal(metres(scan, "DIST1"), [1.337, math.nan, math.nan])


def test_vector_b_is_read() -> None:
    [scan] = fed(SCAN_B)
    assert (scan.polled, scan.scan_hz, scan.name) == (True, 25.0, "front")
    assert (scan.encoders, scan.clock) == (((1000, -5),), None)
    np.testing.assert_allclose(metres(scan, "DIST1"), [1.4, math.nan, 0.032])
    np.testing.assert_allclose(metres(scan, "DIST2"), [1.6, math.nan, math.nan])
    assert scan.channels["RSSI1"].raw.tolist() == [65535, 0, 1]
    assert scan.channels["RSSI2"].raw.tolist() == [12, 0, 0]
    assert (scan.channels["DIST2"].first_deg, scan.channels["DIST2"].step_deg) == (-45.0, 0.25)


def test_the_recorded_session_is_read_to_the_last_byte() -> None:
    events = fed(RECORDED, now_s=3.0)
    scans = [event for event in events if isinstance(event, ScanTelegram)]
    assert len(events) == 108
    assert not [event for event in events if isinstance(event, BadFrame)]
    assert [scan.scan_counter for scan in scans] == list(range(4, 62))
    assert {len(scan.channels["DIST1"].raw) for scan in scans} == {541}
    first = metres(scans[0], "DIST1")
    assert [first[i] for i in (0, 270, 540)] == [0.093, 1.339, 0.077]
    assert [scan.status for scan in scans] == [(1, 0)] * 7 + [(0, 0)] * 51
    assert scans[0].clock == (1970, 1, 1, 2, 55, 34, 889_000)
    assert events[0] == Answer("sAN", "SetAccessMode", b"\x01")
    assert Answer("sRA", "FirmwareVersion", b"\x00\x09V1.80.2  ") in events


# --- layouts


def scan_payload(
    *,
    frequency: int = 5000,
    encoders: bytes = b"\0\0",
    wide: bytes = b"\0\0",
    narrow: bytes = b"\0\0",
    options: bytes = bytes(10),
) -> bytes:
    head = SCAN_A[8 : 8 + 44] + struct.pack(">II", frequency, 360)
    return head + encoders + wide + narrow + options


def channel(
    content: bytes = b"DIST1",
    *,
    values: bytes = b"\x05\x39",
    points: int = 1,
    scale: float = 1.0,
    offset: float = 0.0,
    step: int = 5000,
) -> bytes:
    head = struct.pack(">5sffiHH", content, scale, offset, 900_000, step, points)
    return b"\0\1" + head + values


def test_every_optional_block_is_read() -> None:
    position = b"\0\1" + struct.pack(">6fB", 1, 2, 3, 4, 5, 6, 1)
    texts = b"\0\1\5front" + b"\0\1\0"
    payload = scan_payload(wide=channel(), options=position + texts + b"\0\0" + b"\0\1event")
    [scan] = fed(encode_frame(payload))
    assert scan.position == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1)
    assert (scan.name, scan.comment, scan.clock) == ("front", "", None)
    assert scan.event == b"event"


def test_distances_may_be_scaled_shifted_and_of_eight_bits() -> None:
    payload = scan_payload(
        wide=channel(scale=2.0, offset=-100.0, values=b"\x00\x64\x00\x20\x00\x0f", points=3),
        narrow=channel(b"DIST2", values=b"\xff\x10\x0f", points=3),
    )
    [scan] = fed(encode_frame(payload))
    np.testing.assert_allclose(metres(scan, "DIST1"), [0.1, math.nan, math.nan])  # 0.2 - 0.1; < 0
    np.testing.assert_allclose(metres(scan, "DIST2"), [0.255, 0.016, math.nan])


def test_a_part_of_a_channel_can_be_read_into_a_slot() -> None:
    [scan] = [e for e in fed(RECORDED) if isinstance(e, ScanTelegram) and e.scan_counter == 4]
    out = np.zeros(3)
    lms111.ranges_m_from_channel(scan.channels["DIST1"], slice(269, 272), out)
    assert out[1] == 1.339


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (scan_payload(frequency=0, wide=channel()), "scan frequency is 0"),
        (scan_payload(encoders=b"\0\x09", wide=channel()), "9 encoders"),
        (scan_payload(wide=b"\0\x11" + bytes(400)), "17 channels"),
        (scan_payload(wide=channel(b"dist1")), "unknown channel b'dist1'"),
        (scan_payload(wide=channel(points=0, values=b"")), "0 points at a step of 5000"),
        (
            scan_payload(wide=channel(points=1141, values=bytes(2282))),
            "1141 points a scan, more than",
        ),
        (scan_payload(wide=channel(step=0)), "1 points at a step of 0"),
        (scan_payload(wide=channel(points=500)), "telegram ends early"),
        (scan_payload(wide=channel(scale=math.nan)), "scale nan"),
        (scan_payload(wide=channel(scale=-1.0)), "scale -1.0"),
        (scan_payload(wide=channel(offset=math.inf)), "offset inf"),
        (scan_payload(wide=channel(), options=b"\0\2" + bytes(8)), "position flag is 2"),
        (scan_payload(wide=channel(), options=bytes(9)), "telegram ends early"),
        (scan_payload(wide=channel(), options=bytes(11)), "goes on after its end"),
        (scan_payload()[:40], "telegram ends early"),
        (b"sXX name", "unknown telegram"),
        (b"sAN", "unknown telegram"),
        (b"sFA\x00", "unknown telegram"),
        (b"sRA \xff\xfe", "unknown telegram"),
    ],
)
def test_a_telegram_that_cannot_be_true_is_rejected_and_the_next_is_read(
    payload: bytes, reason: str
) -> None:
    bad, good = fed(encode_frame(payload) + LOGGED_IN)
    assert reason in bad.reason
    assert bad.skipped == encode_frame(payload)
    assert good == Answer("sAN", "SetAccessMode", b"\x01")


# --- streams


@given(st.lists(st.binary(max_size=200) | st.sampled_from(TELEGRAMS)))
def test_no_bytes_make_the_parser_raise_or_keep_more_than_a_frame(pieces: list[bytes]) -> None:
    parser = new_parser()
    for tick, piece in enumerate(pieces):
        parser.feed(tick * 0.1, piece)
        assert len(parser._buffer) <= MAX_PAYLOAD + 9


@given(st.sampled_from([SCAN_A, SCAN_B]), st.lists(st.tuples(st.integers(16), st.integers(0, 255))))
def test_no_payload_with_a_right_checksum_makes_the_parser_raise(
    frame: bytes, changes: list[tuple[int, int]]
) -> None:
    payload = bytearray(frame[8:-1])
    for at, value in changes:
        payload[at % len(payload)] = value
    fed(encode_frame(bytes(payload)))
    fed(encode_frame(bytes(payload[: changes[0][0] % len(payload)] if changes else payload)))


@given(st.lists(st.tuples(JUNK, st.sampled_from(TELEGRAMS)), max_size=6), JUNK)
def test_telegrams_survive_junk(parts: list[tuple[bytes, bytes]], tail: bytes) -> None:
    stream = b"".join(junk + frame for junk, frame in parts) + tail
    events = fed(stream, b"\xff")  # a last byte, after which nothing is the start of a frame
    found = [event for event in events if not isinstance(event, BadFrame)]
    assert in_words(found) == in_words(fed(b"".join(frame for _, frame in parts)))


@given(
    st.lists(st.tuples(JUNK, st.sampled_from(TELEGRAMS)), max_size=6),
    st.lists(st.integers(0, 1200), max_size=8),
)
def test_where_the_stream_is_cut_makes_no_difference(
    parts: list[tuple[bytes, bytes]], cuts: list[int]
) -> None:
    stream = b"".join(junk + frame for junk, frame in parts)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    events = fed(*(stream[a:b] for a, b in pairwise(edges)))
    assert in_words(events) == in_words(fed(stream))


def test_a_stream_that_comes_byte_by_byte_is_read_the_same() -> None:
    stream = b"\x02\x02" + SCAN_A + b"\x02\x02\x02\x02\x00\x00" + SCAN_B + b"\x02" + LOGGED_IN
    whole = fed(stream)
    assert in_words(fed(*(bytes([byte]) for byte in stream))) == in_words(whole)
    assert [event.skipped for event in whole if isinstance(event, BadFrame)] == [
        b"\x02\x02",
        b"\x02\x02\x02\x02\x00\x00",
        b"\x02",
    ]


@pytest.mark.parametrize("mask", [0x01, 0x80, 0xFF])
@pytest.mark.parametrize("frame", [SCAN_A, SCAN_B, LOGGED_IN], ids=["scan A", "scan B", "answer"])
def test_any_byte_altered_is_rejected_and_the_next_telegrams_are_read(
    frame: bytes, mask: int
) -> None:
    after = LOGGED_IN + SCAN_A
    for at in range(len(frame)):
        altered = frame[:at] + bytes([frame[at] ^ mask]) + frame[at + 1 :]
        parser = new_parser()
        events = parser.feed(0.0, altered + after)
        events += parser.feed(INCOMPLETE_S, b"\xff")  # a length too long has been waited for
        assert isinstance(events[0], BadFrame), at
        assert in_words(events[-2:]) == in_words(fed(after)), at


def test_a_length_that_never_completes_is_waited_for_only_so_long() -> None:
    parser = new_parser()
    stuck = b"\x02\x02\x02\x02\x00\x00\x40\x00sRA then silence"
    assert parser.feed(1.0, stuck + LOGGED_IN) == []
    assert parser.feed(1.0 + INCOMPLETE_S - 0.01, b"") == []
    assert parser.feed(1.0 + INCOMPLETE_S, b"") == [
        BadFrame("telegram never completed", stuck),
        Answer("sAN", "SetAccessMode", b"\x01"),
    ]


def test_endless_junk_is_told_in_bounded_pieces_and_little_junk_after_a_while() -> None:
    events = fed(bytes(3 * REPORTED_SIZE + 10))
    assert [len(event.skipped) for event in events] == [REPORTED_SIZE] * 3
    parser = new_parser()
    assert parser.feed(0.0, b"hello") == []
    assert parser.feed(INCOMPLETE_S, b"") == [BadFrame("no telegram", b"hello")]
    assert parser.feed(2 * INCOMPLETE_S, b"") == []


def test_the_start_mark_within_scan_data_does_no_harm() -> None:
    values = b"\x02\x02" * 200
    payload = scan_payload(wide=channel(values=values, points=200))
    damaged = bytearray(encode_frame(payload))
    damaged[100] ^= 0x40
    bad, scan = fed(bytes(damaged) + encode_frame(payload))
    assert bad == BadFrame("wrong checksum", bytes(damaged))
    assert scan.channels["DIST1"].raw.tolist() == [0x0202] * 200
