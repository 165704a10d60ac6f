"""What an AX3500 tells beside its counters: SI values, words, and None for what is not told."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.ax3500.device import FakeAx3500
from fakes.wires.wire import Wire
from hw.ax3500.values import (
    VALUES,
    ControllerState,
    maybe_amps_divider,
    maybe_state_after_log_line,
    state_after_answer,
    volts_from_analog,
)
from tests.support.bench_ax3500_session import FakeBench

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
    assert answered("?I", "00", "01", "01").inputs == (False, True)
    assert answered("?I", "00", "01", "01").emergency_stop is False
    assert answered("?I", "00", "01", "00").emergency_stop is True
    assert answered("?Z", "FF", "81").speeds_raw == (-1, -127)
    assert answered("?V", "7F", "00").powers == (1.0, 0.0)
    assert [volts_from_analog(raw) for raw in (0x81, 0x00, 0x7F)] == [0.0, 2.5, 5.0]


@pytest.mark.parametrize(
    ("identity", "amps"),
    [(0x68, 8.0), (0x48, 8.0), (0x02, 4.0), (0x04, 16.0), (0x24, 16.0), (0x01, None), (None, None)],
)
def test_amps_follow_the_model_and_are_unknown_where_its_scale_is(
    identity: int | None, amps: float | None
) -> None:
    expected = None if amps is None else (amps, 0.0)
    assert answered("?A", "10", "00", identity=identity).amps == expected
    assert (maybe_amps_divider(identity) is None) is (amps is None)


def test_status_bits_are_words() -> None:
    assert answered("^89", "02").trouble == "the controller reports overtemperature"
    assert answered("^89", "FF").status_words == (
        *("overvoltage", "overtemperature", "undervoltage", "outputs forced off"),
        *("status bit 4", "short circuit", "encoder error", "emergency stop"),
    )


@pytest.mark.parametrize(
    ("query", "texts"),
    [
        ("?E", ["70", "G0"]),
        ("?E", ["70"]),
        ("^89", ["00", "00"]),
        ("?I", ["00", "00", "02"]),
        ("?A", ["1", "00"]),
    ],
)
def test_a_damaged_answer_changes_nothing(query: str, texts: list[str]) -> None:
    assert state_after_answer(ControllerState(), query, texts, 1.0, AX3500) is None


def test_what_is_refused_is_not_known_any_more() -> None:
    state = ControllerState()
    for query, count in VALUES.items():
        state = state_after_answer(state, query, ["01"] * count, 1.0, AX3500) or state
    assert None not in (state.battery_v, state.amps, state.speeds_raw, *state.analog_v)
    for query in VALUES:
        state = state_after_answer(state, query, ["-"], 2.0, AX3500) or state
    assert state == ControllerState(taken_s=dict.fromkeys(state.taken_s, 2.0))


def test_an_older_board_refuses_its_third_and_fourth_input() -> None:
    bench = FakeBench()
    bench.fake.refuse = {"?R"}
    bench.run(5.0)
    first, second = bench.ax.controller.analog_v
    assert first == pytest.approx((2.5, 2.5), abs=0.02)
    assert second is None
    assert bench.ax.status.rejected == 0


def test_a_logging_line_tells_commands_powers_and_the_rest() -> None:
    line = ":" + "7F81" + "40007F81" + "0B00" + "9880" + "706C" + "00"
    state = maybe_state_after_log_line(ControllerState(), line, 3.0, AX3500)
    assert state is not None
    assert state.commands == (1.0, -1.0)
    assert state.powers == pytest.approx((64 / 127, 0.0))
    assert state.analog_v == ((5.0, 0.0), None)
    assert state.amps == (5.5, 0.0)
    assert state.celsius == pytest.approx((25.4, 35.0), abs=0.05)
    assert state.battery_v == pytest.approx(24.06, abs=0.005)
    assert set(state.taken_s.values()) == {3.0}


@pytest.mark.parametrize("numbers", [12, 13, 14, 16])
def test_a_monitor_that_may_not_enter_tells_what_logging_lines_hold(numbers: int) -> None:
    bench = FakeBench("rc", enable=True)
    bench.fake.log_numbers = numbers
    bench.fake.command(64, -32)
    bench.run(3.0, (1.0, 1.0))
    state = bench.ax.controller
    assert state.battery_v == pytest.approx(24.06, abs=0.2)
    assert state.commands == pytest.approx((64 / 127, -32 / 127))
    assert state.powers == pytest.approx((64 / 127, 32 / 127))
    assert b"!" not in bench.port.written
    assert bench.ax.status.state == "starting"


@given(st.text("0123456789ABCDEFabcdef:G \r", max_size=40))
def test_no_line_makes_the_decoder_raise(text: str) -> None:
    state = maybe_state_after_log_line(ControllerState(), text, 0.0, None)
    assert state is None or state.battery_v is not None


def test_values_come_in_si_units_beside_the_counters() -> None:
    bench = FakeBench()
    bench.run(6.0)
    state = bench.ax.controller
    assert state.battery_v == pytest.approx(24.06, abs=0.2)
    assert None not in (state.amps, state.celsius, state.powers, state.speeds_raw)
    assert None not in state.analog_v
    assert (state.status, state.emergency_stop, state.trouble) == (0, False, "")
    assert all(bench.now_s - taken_s < 2.5 for taken_s in state.taken_s.values())


@pytest.mark.parametrize(("model", "amps"), [("AX3500", 7.5), ("AX1500", 7.5), ("AX2850", 7.0)])
def test_the_amps_of_each_model_come_out_right(model: str, amps: float) -> None:
    bench = FakeBench()
    bench.fake = FakeAx3500(bench.wheels, 1, model=model)  # type: ignore[arg-type]
    bench.fake.amps = (amps, 0.0)
    bench.wire = Wire(bench.fake, bench.port, 1)
    bench.run(4.0)
    assert bench.ax.controller.amps == (amps, 0.0)
