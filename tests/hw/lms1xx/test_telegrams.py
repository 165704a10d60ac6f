"""What LMS111 telegrams say: the sheet's frames, the recorded session, and what cannot be true."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.lms1xx import telegrams as lms111
from hw.lms1xx.cola import encode_frame
from hw.lms1xx.telegrams import Answer, Refusal, ScanTelegram, new_parser
from tests import VECTORS
from tests.support.lms111_vectors import FRAMES

RECORDED = (VECTORS / "lms111_session_d2h.bin").read_bytes()
SCAN_A, SCAN_B, LOGGED_IN = FRAMES["scan A"], FRAMES["scan B"], FRAMES["logged in"]


def fed(*pieces: bytes, now_s: float = 0.0) -> list[Any]:
    parser = new_parser()
    return [event for piece in pieces for event in parser.feed(now_s, piece)]


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


@given(st.sampled_from([SCAN_A, SCAN_B]), st.lists(st.tuples(st.integers(16), st.integers(0, 255))))
def test_no_payload_with_a_right_checksum_makes_the_parser_raise(
    frame: bytes, changes: list[tuple[int, int]]
) -> None:
    payload = bytearray(frame[8:-1])
    for at, value in changes:
        payload[at % len(payload)] = value
    fed(encode_frame(bytes(payload)))
    fed(encode_frame(bytes(payload[: changes[0][0] % len(payload)] if changes else payload)))
