"""AX3500 lines and numbers: the sheet's tables, and whatever else may come over the wire."""

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.ax3500.lines import (
    BATTERY_V,
    INTERNAL_V,
    Line,
    LineParser,
    WatchdogStop,
    celsius_from_thermistor,
    encode_query,
    maybe_byte,
    maybe_counter,
    maybe_rollover,
    wrap_difference,
)
from hw.device import BadFrame

# section 5, both columns
NUMBERS = {
    "0": 0, "5": 5, "08": 8, "0FA": 250, "7D0": 2000, "080": 128, "0FFFF": 65535,
    "56CB872": 91011186, "7FFFFFFF": 2**31 - 1, "F": -1, "A": -6, "B": -5, "F15": -235,
    "830": -2000, "80": -128, "F0000": -65536, "862455": -7986091, "80000000": -(2**31),
}  # fmt: skip
WIRE = st.sampled_from([b"?Q0\r", b"7D0\r", b"W", b"\0", b"\n", b"\r", b"+\r", b"OK\r", b":00"])


def rows(path: Path) -> list[list[str]]:
    return [line.split("\t") for line in path.read_text().splitlines() if line[0] != "#"]


def texts(data: bytes) -> list[str]:
    return [event.text for event in LineParser().feed(0.0, data) if isinstance(event, Line)]


def test_the_tables_of_counter_replies_hold(vectors: Path) -> None:
    for text, count in NUMBERS.items():
        assert maybe_counter(text) == count
    for decimal, reply, _ in rows(vectors / "ax3500_counter_replies.tsv"):
        assert maybe_counter(reply) == int(decimal)


def test_the_table_of_scaled_replies_holds(vectors: Path) -> None:
    for query, reply, value in rows(vectors / "ax3500_scaled_replies.tsv"):
        byte = maybe_byte(reply)
        assert byte is not None
        number, unit, *which = value.split()
        if query == "?M":
            assert unit == "C"
            assert celsius_from_thermistor(byte) == pytest.approx(float(number))
        else:
            step_v = BATTERY_V if which == ["main"] else INTERNAL_V
            assert byte * step_v == pytest.approx(float(number), abs=6e-4)


def test_temperatures_are_linear_between_the_points_and_end_at_the_ends() -> None:
    assert celsius_from_thermistor(152) == pytest.approx(25.4, abs=0.05)
    values = [celsius_from_thermistor(value) for value in range(256)]
    assert values == sorted(values, reverse=True)
    assert (values[0], values[255]) == (150.0, -40.0)


@pytest.mark.parametrize("text", ["", "123456789", "G", "+5", "-", "0x1", "1 2", "5\n", "OK"])
def test_a_damaged_counter_is_no_number(text: str) -> None:
    assert maybe_counter(text) is None


@pytest.mark.parametrize("query", ["!A00", "!Q2", "%rrrrrr", "^01 05", "?Q4", "", "?Q0\r!A7F"])
def test_what_does_more_than_read_cannot_be_encoded(query: str) -> None:
    with pytest.raises(ValueError, match="query"):
        encode_query(query)


def test_a_watchdog_letter_inside_an_echo_is_taken_out_and_told() -> None:
    events = LineParser().feed(1.0, bytes.fromhex("3F 51 57 30 0D 37 44 30 0D"))
    assert events == [WatchdogStop(), Line("?Q0", 1.0), Line("7D0", 1.0)]


def test_parity_bits_nul_and_line_feed_are_taken_out() -> None:
    assert texts(b"\xbf\x51\xb0\x8d\n\0\r7\x00D\n0\r") == ["?Q0", "7D0"]


def test_a_line_carries_the_time_of_its_first_character() -> None:
    parser = LineParser()
    assert parser.feed(1.0, b"\rW\n") == [WatchdogStop()]
    assert parser.feed(2.0, b"7") == []
    assert parser.feed(3.0, b"D0\r") == [Line("7D0", 2.0)]


@given(pieces=st.lists(WIRE, max_size=20), cuts=st.lists(st.integers(0, 80)))
def test_where_the_stream_is_cut_makes_no_difference(pieces: list[bytes], cuts: list[int]) -> None:
    stream = b"".join(pieces)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    parser = LineParser()
    events = [event for a, b in pairwise(edges) for event in parser.feed(0.0, stream[a:b])]
    assert events == LineParser().feed(0.0, stream)


@given(st.lists(st.binary(max_size=200)))
def test_no_bytes_make_the_parser_raise_or_keep_more_than_a_line(pieces: list[bytes]) -> None:
    parser = LineParser()
    for piece in pieces:
        for event in parser.feed(0.0, piece):
            assert not isinstance(event, Line) or 0 < len(event.text) <= 64
    assert len(parser._text) <= 64


def test_lines_survive_a_line_without_end_and_control_characters() -> None:
    events = LineParser().feed(0.0, b"A" * 130 + b"\r\x01\x02\r7D0\r")
    assert [type(event) for event in events] == [BadFrame, BadFrame, BadFrame, Line]
    assert events[-1] == Line("7D0", 0.0)


def test_differences_go_the_short_way_round() -> None:
    assert wrap_difference(-(2**31), 2**31 - 1) == 1
    assert wrap_difference(2**31 - 1, -(2**31)) == -1
    assert wrap_difference(5, -6) == 11


def test_a_rollover_to_zero_is_told_from_a_restart() -> None:
    assert maybe_rollover(0, 2**31 - 1) == 1
    assert maybe_rollover(-1, -(2**31)) == -2
    assert maybe_rollover(0, -(2**31)) == -1
    assert maybe_rollover(0, 10**6) is None
    assert maybe_rollover(2 * 10**6, 2**31 - 1) is None
