"""What an AX3500 says: lines and values by the sheet's tables, and whatever else may come."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.ax3500.device import FakeAx3500
from fakes.wires.wire import Wire
from hw.ax3500.lines import (
    BATTERY_V,
    CHARACTER_S,
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
from hw.ax3500.values import VALUES, ControllerState, describe_status, state_after_answer
from hw.device import BadFrame
from tests.support.cases import cut
from tests.support.devices.bench_ax3500 import FakeBench

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
    values = [celsius_from_thermistor(value) for value in range(256)]
    assert values == sorted(values, reverse=True)
    assert (values[0], values[255]) == (150.0, -40.0)
    assert values[152] == pytest.approx(25.4, abs=0.05)


@pytest.mark.parametrize("text", ["", "123456789", "G", "+5", "-", "0x1", "1 2", "5\n", "OK"])
def test_a_damaged_counter_is_no_number(text: str) -> None:
    assert maybe_counter(text) is None


@pytest.mark.parametrize("query", ["!A00", "!Q2", "%rrrrrr", "^01 05", "?Q4", "", "?Q0\r!A7F"])
def test_what_does_more_than_read_cannot_be_encoded(query: str) -> None:
    with pytest.raises(ValueError, match="query"):
        encode_query(query)


def test_what_is_no_character_of_a_line_is_taken_out_and_a_watchdog_letter_told() -> None:
    events = LineParser().feed(1.0, bytes.fromhex("3F 51 57 30 0D 37 44 30 0D"))
    before_s = 1.0 - 3 * CHARACTER_S
    assert events == [WatchdogStop(), Line("?Q0", before_s), Line("7D0", before_s)]
    parity_nul_and_line_feed = b"\xbf\x51\xb0\x8d\n\0\r7\x00D\n0\r"
    assert texts(parity_nul_and_line_feed) == ["?Q0", "7D0"]


def test_a_line_carries_the_time_of_its_first_character_read_alone_or_with_all_others() -> None:
    parser = LineParser()
    assert parser.feed(1.0, b"\rW\n") == [WatchdogStop()]
    assert parser.feed(2.0, b"7") == []
    assert parser.feed(3.0, b"D0\r") == [Line("7D0", 2.0)]
    assert parser.feed(4.0, b"7D0\r") == [Line("7D0", 4.0 - 3 * CHARACTER_S)]


@given(pieces=st.lists(WIRE, max_size=20), cuts=st.lists(st.integers(0, 80)))
def test_where_the_stream_is_cut_makes_no_difference(pieces: list[bytes], cuts: list[int]) -> None:
    stream = b"".join(pieces)
    parser = LineParser()
    events = [event for piece in cut(stream, cuts) for event in parser.feed(0.0, piece)]
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
    assert events[-1] == Line("7D0", -3 * CHARACTER_S)


def test_differences_go_the_short_way_round_and_a_rollover_is_told_from_a_restart() -> None:
    assert wrap_difference(-(2**31), 2**31 - 1) == 1
    assert wrap_difference(2**31 - 1, -(2**31)) == -1
    assert wrap_difference(5, -6) == 11
    for count, before, rolled in (
        (0, 2**31 - 1, 1), (-1, -(2**31), -2), (0, -(2**31), -1),
        (0, 10**6, None), (2 * 10**6, 2**31 - 1, None),  # a restart
    ):  # fmt: skip
        assert maybe_rollover(count, before) == rolled


AX3500 = 0x68


def answered(query: str, *texts: str, identity: int | None = AX3500) -> ControllerState:
    state = state_after_answer(ControllerState(), query, list(texts), 1.0, identity)
    assert state is not None
    return state


def test_the_examples_of_the_sheet() -> None:
    state = answered("?E", "70", "6C")
    assert state.battery_v == pytest.approx(24.06, abs=0.005)
    assert state.internal_v == pytest.approx(12.02, abs=0.005)
    assert answered("?A", "0B", "00").amps == (5.5, 0.0)
    assert answered("?M", "98", "80").celsius == pytest.approx((25.4, 35.0), abs=0.05)
    assert answered("?I", "00", "01", "01").emergency_stop is False
    assert answered("?I", "00", "01", "00").emergency_stop is True


@pytest.mark.parametrize(
    ("identity", "amps"),
    [(0x68, 8.0), (0x48, 8.0), (0x02, 4.0), (0x04, 16.0), (0x24, 16.0), (0x01, None), (None, None)],
)
def test_amps_follow_the_model_and_are_unknown_where_its_scale_is(
    identity: int | None, amps: float | None
) -> None:
    expected = None if amps is None else (amps, 0.0)
    assert answered("?A", "10", "00", identity=identity).amps == expected


def test_status_bits_have_names() -> None:
    assert answered("^89", "02").trouble == "the controller reports overtemperature"
    assert describe_status(0xFF) == (
        *("overvoltage", "overtemperature", "undervoltage", "outputs forced off"),
        *("status bit 4", "short circuit", "encoder error", "emergency stop"),
    )


@pytest.mark.parametrize(
    ("status", "cut_off"),
    [(0x00, False), (0x01, True), (0x82, True), (0x40, False), (0x41, False), (0x10, False)],
)
@pytest.mark.parametrize("pressed", [False, True])
def test_counts_tell_that_the_wheels_have_no_power_but_not_where_counters_may_be_wrong(
    status: int, cut_off: bool, pressed: bool
) -> None:
    bench = FakeBench()
    bench.run(2.0)
    bench.fake.status, bench.fake.emergency_stop = status, pressed
    cut_off |= pressed and status in (0x00, 0x01, 0x82)
    assert [counts.cut_off for counts in bench.run(3.0)][-1] is cut_off


@pytest.mark.parametrize(
    ("query", "texts"),
    [("?E", ["70", "G0"]), ("?E", ["70"]), ("?I", ["00", "00", "02"]), ("?A", ["1", "00"])],
)
def test_a_damaged_answer_changes_nothing(query: str, texts: list[str]) -> None:
    assert state_after_answer(ControllerState(), query, texts, 1.0, AX3500) is None


def test_what_is_refused_is_not_known_any_more() -> None:
    state = ControllerState()
    for query, count in VALUES.items():
        state = state_after_answer(state, query, ["01"] * count, 1.0, AX3500) or state
    assert len(state.measured()) == 6
    assert (state.status, state.emergency_stop) == (1, False)
    for query in VALUES:
        state = state_after_answer(state, query, ["-"], 2.0, AX3500) or state
    assert state == ControllerState(taken_s=dict.fromkeys(VALUES, 2.0))
    assert state.measured() == {}


@pytest.mark.parametrize(("model", "amps"), [("AX3500", 7.5), ("AX2850", 7.0)])
def test_values_of_each_model_are_told_in_si_units_beside_the_counters(
    model: str, amps: float
) -> None:
    bench = FakeBench()
    bench.fake = FakeAx3500(bench.wheels, 1, model=model)  # type: ignore[arg-type, assignment]
    bench.fake.amps = (amps, 0.0)
    bench.wire = Wire(bench.fake, bench.port, 1)
    bench.run(4.0)
    expected = {"battery_v": 24.06, "internal_v": 12.02, "amps_1": amps, "amps_2": 0.0}
    expected |= {"celsius_1": 25.0, "celsius_2": 25.0, "watchdog_stops": 0}
    assert bench.ax.measured() == pytest.approx(expected, abs=0.2)
    state = bench.ax.stream.controller
    assert (state.status, bench.ax.emergency_stop, bench.ax.trouble) == (0, False, "")
    assert all(bench.now_s - taken_s < 2.5 for taken_s in state.taken_s.values())
    assert bench.ax.identity == {"AX3500": "^8A 68", "AX1500": "^8A 22", "AX2850": "^8A 24"}[model]
