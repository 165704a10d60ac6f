"""What an AX3500 tells beside its counters: SI values, status bits, None where it is silent."""

import pytest

from fakes.ax3500.device import FakeAx3500
from fakes.wires.wire import Wire
from hw.ax3500.values import VALUES, ControllerState, describe_status, state_after_answer
from tests.support.bench_ax3500 import FakeBench

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
