"""The AX3500 session against the sheet's exchanges, and against everything that goes wrong."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.ax3500.session import IN_RC_MODE, Ax3500
from tests.support.scripted_ax3500 import TICK_S, Bench, Scripted, at_speed, still


def test_identity_is_asked_once_and_then_the_counters_by_turns() -> None:
    bench = Bench(Scripted(still(250, -235)))
    measured = bench.run(2.0)
    asked = [line for _, line in bench.device.asked_s]
    assert asked[:5] == [b"^8A", b"?Q1", b"?Q0", b"?Q1", b"?Q0"]
    counters = [line for line in asked if line.startswith(b"?Q")]
    assert set(counters[0::2]) == {b"?Q1"}
    assert set(counters[1::2]) == {b"?Q0"}
    assert (bench.state(), bench.ax.status.cause) == ("running", "")
    assert {(counts.left, counts.right) for counts in measured} == {(250.0, -235.0)}
    assert bench.ax.stream.identity == 0x68
    assert bench.ax.status.rejected == 0


@pytest.mark.parametrize("poll_hz", [1.0, 5.0, 20.0])
def test_pairs_come_at_the_pace_that_is_set(poll_hz: float) -> None:
    bench = Bench(Scripted(at_speed(500.0)), poll_hz=poll_hz)
    bench.run(3.0)
    measured = bench.run(10.0)
    assert len(measured) == pytest.approx(10.0 * poll_hz, abs=2)
    assert bench.ax.status.rejected == 0


def test_there_is_never_more_than_one_query_on_the_way() -> None:
    bench = Bench(Scripted(at_speed(500.0)), poll_hz=30.0)
    for _ in range(400):
        before = len(bench.device.asked_s)
        bench.run(TICK_S)
        if len(bench.device.asked_s) > before:
            assert len(bench.device.asked_s) == before + 1
            assert len(bench.device._queue) < 4 + 9


@pytest.mark.parametrize("begin", [0.0, 1e6, 2.0**31 - 1500, -(2.0**31) + 10, 2.0**31 - 400])
def test_counts_are_true_at_their_instant_also_over_the_wrap(begin: float) -> None:
    bench = Bench(Scripted(at_speed(900.0, begin)))
    measured = bench.run(4.0)
    zero = measured[0].left - 900.0 * measured[0].t_s
    for counts in measured:
        assert counts.left - zero == pytest.approx(900.0 * counts.t_s, abs=900 * TICK_S + 2)
        assert counts.right - counts.left == pytest.approx(0.0, abs=900 * TICK_S + 2)
    assert bench.ax.status.rejected == 0
    assert measured[-1].restarts == 0
    assert measured[-1].left - measured[0].left > 3000


def test_constant_acceleration_does_not_look_like_a_turn() -> None:
    acceleration = 2122.0 / 4.0  # 1 m/s after 4 s
    bench = Bench(Scripted(lambda t_s: (0.5 * acceleration * t_s**2,) * 2))
    measured = bench.run(4.0)
    differences = [counts.right - counts.left for counts in measured]
    uncorrected = 2122.0 * 0.012  # counts of travel between the two readings at the end
    assert uncorrected > 25
    sagitta = acceleration * 0.05**2 / 8  # of the true curve over the chord of one period
    assert max(map(abs, differences)) < 1.0 + sagitta


def test_channels_and_signs_are_those_of_the_settings() -> None:
    bench = Bench(Scripted(lambda t_s: (-300.0 * t_s, 500.0 * t_s)))
    bench.ax = Ax3500(
        bench.port,
        poll_hz=20.0,
        left_channel=2,
        right_channel=1,
        inverted_channels=(1,),
        enter_rs232=False,
        max_counts_per_s=2122.0,
        enable_motors=False,
    )
    first, *_, last = bench.run(2.0)
    passed_s = last.t_s - first.t_s
    assert last.left - first.left == pytest.approx(500.0 * passed_s, abs=5)
    assert last.right - first.right == pytest.approx(300.0 * passed_s, abs=5)


# ---- modes


def test_a_controller_in_radio_mode_is_left_alone_unless_allowed() -> None:
    device = Scripted(still(0, 0))
    device.in_rs232 = False
    bench = Bench(device)
    assert bench.run(5.0) == []
    assert (bench.state(), bench.ax.status.cause) == ("starting", IN_RC_MODE)
    assert device.heard.count(b"\r") == 0
    device.in_rs232 = True  # somebody else took it over
    bench.run(2.5)
    assert bench.state() == "running"


def test_a_controller_in_radio_mode_is_taken_over_where_allowed() -> None:
    device = Scripted(still(0, 0))
    device.in_rs232 = False
    bench = Bench(device, enter=True)
    assert len(bench.run(3.0)) > 20
    assert bench.state() == "running"
    assert device.heard.startswith(b"\r" * 10 + b"^8A\r?Q1\r?Q0\r")


def test_one_that_is_in_serial_mode_already_gets_no_carriage_returns() -> None:
    bench = Bench(Scripted(still(0, 0)), enter=True)
    bench.run(1.0)
    assert bench.device.heard.startswith(b"^8A\r?Q1\r")


def test_carriage_returns_that_were_spent_while_it_booted_are_sent_again() -> None:
    device = Scripted(still(0, 0))
    device.in_rs232, device.deaf = False, True
    bench = Bench(device, enter=True)
    bench.run(2.0)
    device.deaf = False
    bench.run(4.0)
    assert bench.state() == "running"


@pytest.mark.parametrize("identity", [b"-\r", None, b"68\r", b"68\r+\r", b"28\r"])
def test_identity_is_tolerated_in_every_form(identity: bytes | None) -> None:
    device = Scripted(still(0, 0))
    device.values[b"^8A"] = identity
    bench = Bench(device)
    bench.run(2.5)
    assert bench.state() == "running"


def test_a_controller_without_encoder_module_is_named() -> None:
    device = Scripted(still(0, 0))
    device.values[b"^8A"] = b"48\r"
    bench = Bench(device)
    assert bench.run(2.0) == []
    assert bench.ax.status.cause == "the controller has no encoder module: ^8A says 48"


# ---- faults


def test_silence_is_lost_after_two_seconds_and_found_again() -> None:
    bench = Bench(Scripted(at_speed(400.0)))
    before = bench.run(2.0)[-1]
    bench.device.mute = True
    bench.run(1.9)
    assert bench.ax.status.losses == 0
    bench.run(0.5)
    assert bench.state() == "starting"
    assert "no echo" in bench.ax.status.cause
    assert bench.ax.status.losses == 1
    bench.run(5.0)
    bench.device.mute = False
    after = bench.run(3.0)[-1]
    assert bench.state() == "running"
    assert after.restarts == 0
    passed_s = after.t_s - before.t_s
    assert after.left - before.left == pytest.approx(400.0 * passed_s, abs=8)


@pytest.mark.parametrize("tell", [True, False])
@pytest.mark.parametrize("in_rs232", [True, False])
def test_a_restart_while_polling_is_a_new_zero_and_no_travel(tell: bool, in_rs232: bool) -> None:
    bench = Bench(Scripted(at_speed(400.0, 50_000.0)), enter=True)
    before = bench.run(2.0)[-1]
    bench.device.restart(bench.now_s, in_rs232=in_rs232, tell=tell)
    measured = bench.run(4.0)
    assert bench.state() == "running"
    assert measured[-1].restarts == 1
    assert before.left > 50_000 > 400 * 4.5 > measured[-1].left
    one_zero = [counts for counts in measured if counts.restarts == 1]
    speed = (one_zero[-1].left - one_zero[0].left) / (one_zero[-1].t_s - one_zero[0].t_s)
    assert speed == pytest.approx(400.0, abs=5)


def test_a_restart_into_radio_mode_is_told_where_it_may_not_be_taken_over() -> None:
    bench = Bench(Scripted(still(9000, 9000)))
    bench.run(1.0)
    bench.device.restart(bench.now_s)
    bench.run(2.0)
    assert (bench.state(), bench.ax.status.cause) == ("starting", IN_RC_MODE)
    bench.device.in_rs232 = True
    assert bench.run(3.0)[-1].restarts == 1


def test_lost_and_late_answers_cost_one_pair_each() -> None:
    bench = Bench(Scripted(at_speed(400.0)))
    bench.run(1.0)
    bench.wire.mute = True
    bench.run(0.1)
    bench.wire.mute = False
    measured = bench.run(2.0)
    assert 1 <= bench.ax.status.rejected <= 2
    assert len(measured) >= 35
    assert measured[-1].left - measured[0].left == pytest.approx(
        400.0 * (measured[-1].t_s - measured[0].t_s), abs=6
    )


def test_an_answer_slower_than_the_time_out_never_gets_a_wrong_time() -> None:
    device = Scripted(at_speed(1000.0))
    bench = Bench(device)
    begin = bench.run(1.0)[-1]
    for delay_s in (0.15, 0.25, 0.3, 0.06, 0.5, 0.0):
        device.delay_s = delay_s
        for counts in bench.run(2.0):
            expected = 1000.0 * (counts.t_s - begin.t_s)
            assert counts.left - begin.left == pytest.approx(expected, abs=delay_s * 1000 / 2 + 10)


def test_watchdog_letters_anywhere_are_counted_and_harm_nothing() -> None:
    bench = Bench(Scripted(at_speed(400.0)))
    bench.run(1.0)
    for k in range(40):
        bench.run(TICK_S * (1 + k % 7))
        bench.port.give(b"W")
    measured = bench.run(1.0)
    assert bench.ax.stream.watchdog_stops == 40
    assert bench.ax.status.rejected == 0
    assert len(measured) >= 19


@pytest.mark.parametrize("damaged", [b"7G0\r", b"123456789\r", b"?Q1\r", b"-\r", b"7\x01\r", b"\r"])
def test_damaged_values_are_dropped_and_asked_again(damaged: bytes) -> None:
    bench = Bench(Scripted(still(300, 300)))
    bench.run(1.0)
    bench.device.values[b"?Q0"] = damaged
    assert len(bench.run(0.5)) <= 1
    del bench.device.values[b"?Q0"]
    assert bench.ax.status.rejected >= 1
    assert len(bench.run(1.0)) >= 15
    assert bench.ax.status.losses == 0


def test_a_counter_that_is_never_answered_is_a_loss_with_its_cause() -> None:
    bench = Bench(Scripted(still(0, 0)))
    bench.device.values[b"?Q0"] = bench.device.values[b"?Q1"] = None
    bench.run(4.0)
    assert bench.state() == "starting"
    assert bench.ax.status.cause == "no counters for 2 s: ?Q0 and ?Q1: no value after the echo"


def test_one_channel_alone_is_not_enough() -> None:
    bench = Bench(Scripted(still(0, 0)))
    bench.run(1.0)
    bench.device.values[b"?Q1"] = b"-\r"
    bench.run(2.5)
    assert bench.ax.status.losses == 1
    assert bench.ax.status.cause == "no counters for 2 s: ?Q1: refused"


def test_an_impossible_jump_is_dropped_and_counted() -> None:
    bench = Bench(Scripted(still(300, 300)))
    bench.run(1.0)
    bench.device.values[b"?Q1"] = b"7D0\r"
    while bench.device.asked_s[-1][1] != b"?Q1":
        bench.run(TICK_S)
    bench.run(0.02)
    del bench.device.values[b"?Q1"]
    measured = bench.run(1.0)
    assert bench.ax.status.rejected == 1
    assert bench.ax.status.rejections[0].reason.startswith("counter 2 jumped by 1700")
    assert {(counts.left, counts.right, counts.restarts) for counts in measured} == {(300, 300, 0)}


def test_a_pulled_cable_keeps_the_travel_that_the_counters_went_on_counting() -> None:
    bench = Bench(Scripted(at_speed(400.0, 30_000.0)))
    before = bench.run(2.0)[-1]
    bench.wire.cut = True
    bench.run(5.0)
    assert bench.state() == "closed"
    bench.wire.cut = False
    after = bench.run(3.0)[-1]
    assert after.restarts == 0
    assert after.left - before.left == pytest.approx(400.0 * (after.t_s - before.t_s), abs=8)


@given(offset=st.integers(0, 400), mask=st.integers(1, 255), dropped=st.booleans())
def test_any_byte_altered_or_lost_is_survived(offset: int, mask: int, dropped: bool) -> None:
    bench = Bench(Scripted(at_speed(400.0, 5000.0)), enter=True)
    if dropped:
        bench.wire.drop_at = {offset}
    else:
        bench.wire.alter_at = {offset: mask}
    bench.run(5.0)
    measured = bench.run(1.0)
    assert bench.state() == "running"
    assert len(measured) >= 19
    steps = {counts.restarts for counts in measured}
    assert len(steps) == 1
    assert measured[-1].left - measured[0].left == pytest.approx(
        400.0 * (measured[-1].t_s - measured[0].t_s), abs=6
    )


@given(st.integers(0, 2**32), st.sampled_from([0.002, 0.02]), st.booleans())
def test_a_line_that_is_damaged_now_and_then_is_survived(
    seed: int, rate: float, losing: bool
) -> None:
    bench = Bench(Scripted(at_speed(400.0, 5000.0)), enter=True, seed=seed)
    bench.run(1.0)
    bench.wire.damage_rate, bench.wire.drop_rate = (0.0, rate) if losing else (rate, 0.0)
    bench.run(3.0)
    bench.wire.damage_rate = bench.wire.drop_rate = 0.0
    bench.run(5.0)
    assert bench.state() == "running"
    assert len(bench.run(1.0)) >= 19


def test_noise_of_another_device_does_not_stop_the_search() -> None:
    bench = Bench(Scripted(still(0, 0)))
    bench.device.deaf = True
    for _ in range(100):
        bench.port.give(b"\x02sRA junk\x03\r\x01\r")
        bench.run(0.05)
    assert bench.ax.status.cause != ""
    bench.device.deaf = False
    bench.run(3.0)
    assert bench.state() == "running"
