"""What LMS111 telegrams say, packed and written out: the sheet's, recorded ones, untrue ones."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.lms1xx.cola import PayloadError
from hw.lms1xx.cola_fields import TextFields, number
from hw.lms1xx.telegrams import (
    MAX_BEAMS,
    Answer,
    Refusal,
    ScanTelegram,
    new_parser,
    ranges_m_from_channel,
)
from tests import VECTORS
from tests.support.devices.lms111_vectors import FRAMES, TEXTS, framed, texted

RECORDED = (VECTORS / "lms111_session_d2h.bin").read_bytes()
MRS1000 = (VECTORS / "mrs1000_cola_a_one_scan.bin").read_bytes()
TIM781 = (VECTORS / "tim781_1s_d2h.bin").read_bytes()
SCAN_A, LOGGED_IN = FRAMES["scan A"], FRAMES["logged in"]


def fed(stream: bytes, now_s: float = 0.0, max_beams: int = MAX_BEAMS) -> list[Any]:
    return list(new_parser("auto", max_beams).feed(now_s, stream))


def metres(telegram: ScanTelegram, content: str) -> list[float]:
    channel = telegram.channels[content]
    return list(ranges_m_from_channel(channel, slice(0, len(channel.raw))))


# --- the sheet's frames and texts


def test_answers_and_refusals_are_told_apart() -> None:
    events = fed(LOGGED_IN + FRAMES["not logged in"] + FRAMES["range written"])
    assert events == [
        Answer("sAN", "SetAccessMode", b"\x01"),
        Answer("sAN", "SetAccessMode", b"\x00"),
        Answer("sWA", "LMPoutputRange", b""),
    ]
    assert fed(FRAMES["subscribed"]) == [Answer("sEA", "LMDscandata", b"\x01")]
    denied, unknown, text = fed(FRAMES["write denied"] + framed(b"sFA\x12\x34") + texted("sFA A"))
    assert (denied, denied.reason) == (Refusal(0x0A), "write access denied")
    assert unknown.reason == "error code 4660"
    assert (text, text.reason) == (Refusal(0x0A, "ascii"), "write access denied")


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
    [scan] = fed(FRAMES["scan B"])
    assert (scan.polled, scan.scan_hz, scan.name) == (True, 25.0, "front")
    assert (scan.encoders, scan.clock) == (((1000, -5),), None)
    np.testing.assert_allclose(metres(scan, "DIST1"), [1.4, math.nan, 0.032])
    np.testing.assert_allclose(metres(scan, "DIST2"), [1.6, math.nan, math.nan])
    assert scan.channels["RSSI1"].raw.tolist() == [65535, 0, 1]
    assert scan.channels["RSSI2"].raw.tolist() == [12, 0, 0]
    assert scan.channels["DIST2"].layout == (-45.0, 0.25, 3)


@pytest.mark.parametrize("name", ["scan A", "scan B"])
def test_the_text_of_a_scan_says_what_its_frame_says(name: str) -> None:
    def values(scan: ScanTelegram) -> dict[str, Any]:
        found = {name: getattr(scan, name) for name in ScanTelegram.__annotations__}
        del found["dialect"]
        channels = found.pop("channels").values()
        rows = [(c.content, c.scale, c.offset, c.layout, c.raw.tolist()) for c in channels]
        return found | {"rows": rows}

    text, packed = fed(texted(TEXTS[name]) + FRAMES[name], now_s=4.5)
    assert values(text) == values(packed)
    assert (text.dialect, packed.dialect) == ("ascii", "binary")


# --- recordings


def test_the_recorded_session_is_read_to_the_last_byte() -> None:
    events = fed(RECORDED, now_s=3.0)
    scans = [event for event in events if isinstance(event, ScanTelegram)]
    assert len(events) == 108
    assert not [event for event in events if isinstance(event, BadFrame)]
    assert [scan.scan_counter for scan in scans] == list(range(4, 62))
    assert {len(scan.channels["DIST1"].raw) for scan in scans} == {541}
    first = metres(scans[0], "DIST1")
    assert [first[i] for i in (0, 270, 540)] == [0.093, 1.339, 0.077]
    assert scans[0].clock == (1970, 1, 1, 2, 55, 34, 889_000)


def test_the_telegram_of_an_mrs1000_is_read_to_its_last_channel() -> None:
    [scan] = fed(MRS1000, max_beams=1101)
    names = ["DIST1", "DIST2", "DIST3", "RSSI1", "RSSI2", "RSSI3"]
    assert list(scan.channels) == names
    assert (scan.serial_number, scan.scan_hz) == (0x107FA24, 50.0)
    assert (scan.telegram_counter, scan.scan_us) == (0x3FB0, 0x9B6285F9)
    assert scan.clock == (1970, 1, 1, 1, 55, 1, 0xE9E30)
    # The telegram once more, by its tokens: six channels of head, count, values.
    tokens = MRS1000[1:-1].split()
    for name in names:
        at = tokens.index(name.encode())
        channel = scan.channels[name]
        first_deg = (int(tokens[at + 3], 16) - 2**32) / 10_000
        assert channel.layout == (first_deg, 0.25, 1101)
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
    counters = [scan.scan_counter for scan in scans]
    assert counters == list(range(counters[0], counters[0] + 16))
    for scan in scans:
        assert list(scan.channels) == ["DIST1", "RSSI1"]
        assert {len(channel.raw) for channel in scan.channels.values()} == {811}
        assert scan.scan_hz == 15.0
    first = np.frombuffer(TIM781, ">u2", 811, TIM781.index(b"DIST1") + 21)
    np.testing.assert_array_equal(scans[0].channels["DIST1"].raw, first)


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
    [scan] = fed(framed(payload))
    assert scan.position == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1)
    assert (scan.name, scan.comment, scan.clock, scan.event) == ("front", "", None, b"event")


def test_distances_may_be_scaled_shifted_and_of_eight_bits() -> None:
    payload = scan_payload(
        wide=channel(scale=2.0, offset=-100.0, values=b"\x00\x64\x00\x20\x00\x0f", points=3),
        narrow=channel(b"DIST2", values=b"\xff\x10\x0f", points=3),
    )
    [scan] = fed(framed(payload))
    np.testing.assert_allclose(metres(scan, "DIST1"), [0.1, math.nan, math.nan])  # 0.2 - 0.1; < 0
    np.testing.assert_allclose(metres(scan, "DIST2"), [0.255, 0.016, math.nan])


def text_a(old: bytes, new: bytes) -> bytes:
    """The text of scan A with one thing changed."""
    assert old in TEXTS["scan A"]
    return texted(TEXTS["scan A"].replace(old, new, 1))


@pytest.mark.parametrize(
    ("telegram", "reason"),
    [
        *(
            (framed(payload), reason)
            for payload, reason in (
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
            )
        ),
        (text_a(b"3F800000", b"7FC00000"), "scale nan"),
        (text_a(b" 3 539 ", b" 3FF 539 "), "telegram ends early"),
        (text_a(b" 3 539 ", b" 43A 539 "), "1082 points a scan, more than 1081"),
        (text_a(b" 3 539 ", b" 3 10539 "), "is too big"),
        (text_a(b" 3 539 ", b" 3 " + 400 * b"F" + b" "), "is no number"),
        (text_a(b"C0A08 0", b"C0A08 0 0"), "goes on after its end"),
        (text_a(b"C0A08 0", b"C0A08"), "telegram ends early"),
        (text_a(b" 114097A ", b" 11409z7A "), "is no number"),
    ],
)
def test_a_telegram_that_cannot_be_true_is_rejected_and_the_next_is_read(
    telegram: bytes, reason: str
) -> None:
    bad, good = fed(telegram + LOGGED_IN)
    assert reason in bad.reason
    assert bad.skipped == telegram
    assert good == Answer("sAN", "SetAccessMode", b"\x01")


# --- numbers in texts


def test_numbers_are_read_leniently_and_never_wrongly() -> None:
    good = [
        (b"FFF92230", "i", -450_000), (b"fff92230", "i", -450_000), (b"-450000", "i", -450_000),
        (b"+5000", "H", 5000), (b"5000", "H", 0x5000), (b"000001388", "I", 5000),
        (b"FFFB", "h", -5), (b"7F", "b", 127),
    ]  # fmt: skip
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
    five = TextFields(b"0 1f  FFFF 0010 +20 rest").array(">u2", 5)
    assert five.tolist() == [0, 31, 65535, 16, 20]
    fields = TextFields(b" 1 2 3  4 left over ")
    assert fields.array("u1", 3).tolist() == [1, 2, 3]
    assert fields.fields("H") == (4,)
    assert fields.rest() == b"left over"
    for text, kind in ((b"1 2", "u1"), (b"1 2 100", "u1"), (b"1 2 g", ">u2"), (b"1 2 -1", ">u2")):
        with pytest.raises(PayloadError):
            TextFields(text).array(kind, 3)


# --- whatever a payload may hold

PAYLOADS = [FRAMES[name][8:-1] for name in ("scan A", "scan B")]
PAYLOADS += [TEXTS[name] for name in ("scan A", "scan B", "scan is 50")]


@given(
    st.sampled_from(PAYLOADS),
    st.lists(st.tuples(st.integers(5), st.binary(max_size=2))),
    st.integers(0),
)
def test_no_payload_in_a_right_frame_makes_the_parser_raise(
    payload: bytes, changes: list[tuple[int, bytes]], cut: int
) -> None:
    changed = bytearray(payload)
    for at, values in changes:
        at %= len(changed)
        changed[at : at + 1] = values
    for some in (changed, changed[: cut % len(changed)]):
        fed(framed(bytes(some)))
        fed(texted(bytes(some)))
