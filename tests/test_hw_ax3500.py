"""AX3500 lines and numbers, and counters made continuous: the sheet's tables, wraps, restarts."""

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.ax3500 import (
    Line,
    LineParser,
    WatchdogStop,
    battery_v_from_byte,
    celsius_from_thermistor,
    counter_text,
    encode_query,
    internal_v_from_byte,
    maybe_byte,
    maybe_counter,
    maybe_rollover,
    wrap_difference,
)
from hw.session import BadFrame
from hw.wheel_counters import Pair, WheelCounters

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


@pytest.mark.parametrize(("text", "count"), NUMBERS.items())
def test_the_number_table_of_the_sheet_holds_both_ways(text: str, count: int) -> None:
    assert maybe_counter(text) == count
    assert counter_text(count) == text


def test_the_table_of_counter_replies_holds_both_ways(vectors: Path) -> None:
    for decimal, reply, _ in rows(vectors / "ax3500_counter_replies.tsv"):
        assert maybe_counter(reply) == int(decimal)
        assert counter_text(int(decimal)) == reply


def test_the_table_of_scaled_replies_holds(vectors: Path) -> None:
    for query, reply, value in rows(vectors / "ax3500_scaled_replies.tsv"):
        byte = maybe_byte(reply)
        assert byte is not None
        number, unit, *which = value.split()
        if query == "?M":
            assert unit == "C"
            assert celsius_from_thermistor(byte) == pytest.approx(float(number))
        else:
            volts = battery_v_from_byte if which == ["main"] else internal_v_from_byte
            assert volts(byte) == pytest.approx(float(number), abs=6e-4)


def test_temperatures_are_linear_between_the_points_and_end_at_the_ends() -> None:
    assert celsius_from_thermistor(152) == pytest.approx(25.4, abs=0.05)
    values = [celsius_from_thermistor(value) for value in range(256)]
    assert values == sorted(values, reverse=True)
    assert (values[0], values[255]) == (150.0, -40.0)


@given(st.integers(-(2**31), 2**31 - 1))
def test_any_counter_comes_back_from_its_text(count: int) -> None:
    text = counter_text(count)
    assert maybe_counter(text) == maybe_counter(text.lower()) == count
    assert maybe_counter(f"{count % 2**32:08X}") == count
    assert len(text) <= 8


@pytest.mark.parametrize("text", ["", "123456789", "G", "+5", "-", "0x1", "1 2", "5\n", "OK"])
def test_a_damaged_counter_is_no_number(text: str) -> None:
    assert maybe_counter(text) is None


@pytest.mark.parametrize(
    "query", ["!A00", "!Q2", "%rrrrrr", "^01 05", "?Q4", "?Z", "", "?Q0\r!A7F"]
)
def test_what_does_more_than_read_cannot_be_encoded(query: str) -> None:
    with pytest.raises(ValueError, match="query"):
        encode_query(query)


def test_the_queries_of_the_sheet() -> None:
    assert encode_query("?Q0") == bytes.fromhex("3F 51 30 0D")
    assert encode_query("?Q1") == bytes.fromhex("3F 51 31 0D")
    assert encode_query("^8A") == bytes.fromhex("5E 38 41 0D")
    assert encode_query("?E") == bytes.fromhex("3F 45 0D")


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


def test_the_prompt_of_the_sheet_is_four_lines() -> None:
    prompt = bytes.fromhex(
        "52 6F 62 6F 74 65 71 20 76 31 2E 39 62 20 30 36 2F 30 31 2F 30 37 0D 73 0D"
        "45 6E 63 6F 64 65 72 20 76 31 2E 37 0D 30 30 0D"
    )
    assert texts(prompt) == ["Roboteq v1.9b 06/01/07", "s", "Encoder v1.7", "00"]


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


# ---- counters made continuous

MAX_COUNTS_PER_S = 2122.0  # 1 m/s at 0.15 m and 2000 counts a turn


def signed(count: int) -> int:
    """As the controller holds it, with two's complement wrap."""
    return (count + 2**31) % 2**32 - 2**31


def drive(
    counters: WheelCounters, raws: list[tuple[int, int]], begin_s: float, period_s: float = 0.05
) -> list[Pair | BadFrame]:
    """Read channel 1, then 0 12 ms later, each period."""
    results = []
    for k, (one, two) in enumerate(raws):
        t_s = begin_s + k * period_s
        results += [counters.take(1, t_s, two), counters.take(0, t_s + 0.012, one)]
    return [result for result in results if result is not None]


def pairs(results: list[Pair | BadFrame]) -> list[Pair]:
    return [result for result in results if isinstance(result, Pair)]


def test_both_channels_are_brought_to_one_instant() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    times_s = [0.05 * k for k in range(40)]
    travel = [530.0 * t_s**2 for t_s in times_s]  # 0.5 m/s2 on both wheels
    late = [530.0 * (t_s + 0.012) ** 2 for t_s in times_s]
    raws = [(int(one), int(two)) for one, two in zip(late, travel, strict=True)]
    results = pairs(drive(counters, raws, 0.0))
    assert len(results) == 39
    uncorrected = max(abs(one - two) for one, two in raws)
    bound = 1.0 + 530.0 * 0.05**2 / 4  # one count, and the sagitta of a quadratic over a period
    assert uncorrected > 10 * bound
    for pair in results:
        assert abs(pair.one - pair.two) <= bound


@given(
    begin=st.sampled_from([2**31 - 300, -(2**31) + 300, 0]),
    steps=st.lists(st.tuples(st.integers(-100, 100), st.integers(-100, 100)), min_size=2),
)
def test_travel_is_continuous_over_the_wrap(begin: int, steps: list[tuple[int, int]]) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    one = two = begin
    raws = []
    for step_one, step_two in steps:
        one, two = one + step_one, two + step_two
        raws.append((signed(one), signed(two)))
    begin = signed(begin + steps[0][1]) - steps[0][1]  # the first reading is the zero
    results = drive(counters, raws, 0.0)
    assert len(pairs(results)) == len(results) == len(steps) - 1
    assert counters.restarts == 0
    travelled = pairs(results)[-1].two - begin
    assert travelled == sum(step for _, step in steps)


@pytest.mark.parametrize("direction", [1, -1])
def test_travel_is_continuous_where_the_counter_goes_on_from_zero(direction: int) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    end = 2**31 if direction > 0 else 2**31 + 1
    travel = [end - 200 + 50 * k for k in range(10)]
    rolled = [direction * (count - end if count >= end else count) for count in travel]
    results = drive(counters, [(count, count) for count in rolled], 0.0)
    assert len(pairs(results)) == len(results) == 9
    assert counters.restarts == 0
    assert pairs(results)[-1].two - rolled[0] == direction * 450


@given(st.integers(1, 18), st.integers(0, 1), st.integers(-(2**31), 2**31 - 1))
def test_one_misread_counter_is_dropped_and_leaves_no_trace(
    at: int, channel: int, misread: int
) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    raws = [[100_000 + 40 * k, 100_000 + 40 * k] for k in range(20)]
    raws[at][channel] = misread
    results = drive(counters, [(one, two) for one, two in raws], 0.0)
    if abs(misread - (100_000 + 40 * at)) > 250:
        assert sum(isinstance(result, BadFrame) for result in results) == 1
    last = pairs(results)[-1]
    assert last.two == 100_000 + 40 * 19
    assert counters.restarts == 0


def test_counters_that_stay_elsewhere_are_believed_in_the_end_without_travel() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, [(50 * k, 50 * k) for k in range(10)], 0.0)
    results = drive(counters, [(70_000 + 50 * k, 90_000 + 50 * k) for k in range(10)], 0.5)
    assert counters.restarts == 1
    assert sum(isinstance(result, BadFrame) for result in results) <= 6
    assert pairs(results)[-1].two == 90_450


def test_both_counters_back_near_zero_are_a_restart_at_once() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, [(80_000, 80_000), (80_010, 80_010)], 0.0)
    results = drive(counters, [(0, 0), (0, 0), (4, 4), (8, 8)], 0.1)
    assert counters.restarts == 1
    assert sum(isinstance(result, BadFrame) for result in results) == 2
    assert pairs(results)[-1].two == 8


def test_travel_over_an_outage_counts_where_the_zero_was_kept() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, [(50_000, 50_000), (50_010, 50_010)], 0.0)
    results = drive(counters, [(55_000, 54_000), (55_010, 54_010)], 5.0)
    assert counters.restarts == 0
    assert pairs(results)[-1].two == 54_010


def test_an_outage_long_enough_to_drive_back_to_zero_still_counts_as_a_restart() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, [(50_000, 50_000), (50_010, 50_010)], 0.0)
    results = drive(counters, [(30, 30), (40, 40)], 60.0)
    assert counters.restarts == 1
    assert pairs(results)[-1].two == 40


def test_a_robot_that_stood_still_near_zero_over_an_outage_keeps_its_zero() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    drive(counters, [(500, 500), (500, 500)], 0.0)
    drive(counters, [(500, 500), (500, 500)], 10.0)
    assert counters.restarts == 0


def test_a_told_restart_makes_the_next_readings_the_new_zero() -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    counters.forget_zero()  # before anything was known: nothing is lost
    drive(counters, [(100, 100), (110, 110)], 0.0)
    assert counters.restarts == 0
    counters.forget_zero()
    results = drive(counters, [(0, 0), (5, 5)], 0.1)
    assert counters.restarts == 1
    [pair] = pairs(results)
    assert pair.t_s == pytest.approx(0.15)
    assert pair.one == pytest.approx(5 * 38 / 50)
    assert pair.two == 5


@given(st.lists(st.tuples(st.integers(0, 1), st.floats(0, 1), st.integers(-(2**31), 2**31 - 1))))
def test_no_readings_raise_and_instants_only_go_forward(
    readings: list[tuple[int, float, int]],
) -> None:
    counters = WheelCounters(MAX_COUNTS_PER_S, 0.5)
    t_s, last_s = 0.0, -1.0
    for channel, dt_s, raw in readings:
        t_s += dt_s
        result = counters.take(channel, t_s, raw)
        if isinstance(result, Pair):
            assert last_s <= result.t_s <= t_s
            last_s = result.t_s
