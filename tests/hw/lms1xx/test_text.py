"""CoLa-A: the texts of the sheet and of a real sister model, and what cannot be true."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.lms1xx.cola import PayloadError
from hw.lms1xx.cola_fields import TextFields, number
from hw.lms1xx.telegrams import MAX_BEAMS, Refusal, ScanTelegram, new_parser
from tests import VECTORS
from tests.support.lms111_vectors import FRAMES, texted
from tests.support.lms111_vectors import TEXTS as PLAIN

MRS1000 = (VECTORS / "mrs1000_cola_a_one_scan.bin").read_bytes()
TIM781 = (VECTORS / "tim781_1s_d2h.bin").read_bytes()
TEXTS = {name: texted(text) for name, text in PLAIN.items()}


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
        (b"3F800000", b"7FC00000", "scale nan"),
        (b" 3 539 ", b" 3FF 539 ", "telegram ends early"),
        (b" 3 539 ", b" 43A 539 ", "1082 points a scan, more than 1081"),
        (b" 3 539 ", b" 3 10539 ", "is too big"),
        (b"C0A08 0", b"C0A08 0 0", "goes on after its end"),
        (b"C0A08 0", b"C0A08", "telegram ends early"),
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
    st.sampled_from([TEXTS["scan A"], TEXTS["scan B"], TEXTS["scan is 50"]]),
    st.lists(st.tuples(st.integers(5), st.binary(max_size=2))),
)
def test_no_text_makes_the_parser_raise(text: bytes, changes: list[tuple[int, bytes]]) -> None:
    payload = bytearray(text[1:-1])
    for at, value in changes:
        at %= len(payload)
        payload[at : at + 1] = value
    fed(b"\x02" + bytes(payload) + b"\x03")
