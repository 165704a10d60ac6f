"""The fake controller in time: pacing, watchdog, radio mode, restarts; and faults of every kind."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.ax3500.line import CHARACTER_S
from fakes.ax3500.properties import Mode
from tests.support.cases import examples
from tests.support.devices.bench_ax3500 import Bench

PROMPT = b"Roboteq v1.9b 06/01/07\rs\rEncoder v1.7\r00\r"
MODES: list[Mode] = ["rc", "rs232", "rs232_watchdog", "analog"]
WRITINGS = st.lists(
    st.tuples(
        st.floats(0.0, 0.3),
        st.binary(max_size=12)
        | st.sampled_from([b"?Q0\r", b"^00\r", b"\r" * 10, b"%rrrrrr\r", b"^FF\r", b"*99\r"])
        | st.from_regex(rb"[?!^*%][VAPRMEIKZDWQCac0-9 ]{0,5}\r", fullmatch=True),
    ),
    max_size=12,
)


@pytest.mark.parametrize(("count", "digits"), [(5, 1), (2000, 3), (-7986091, 6), (2**31 - 1, 8)])
def test_an_exchange_takes_the_time_of_section_10(count: int, digits: int) -> None:
    bench = Bench(paced=True, counter_offset=(count, 0))
    exchange_s = (5 + digits + 1) * CHARACTER_S
    sent = bench.run(exchange_s - 0.0002, b"?Q0\r", 0.0001)
    assert len(sent) == 4 + digits
    assert bench.run(0.0004, step_s=0.0001) == b"\r"


def test_the_answer_waits_for_its_delay_and_echoes_do_not() -> None:
    bench = Bench(paced=True, reply_delay_s=0.050)
    assert bench.run(0.045, b"?Q0\r?") == b"?Q0\r?"
    assert bench.run(0.020) == b"0\r"


def test_a_counter_is_taken_when_the_cr_has_arrived_whenever_one_looks() -> None:
    for look_s in (0.001, 0.005, 0.020):
        bench = Bench(paced=True)
        start_s, sent, asked = bench.now_s, b"", b"?Q0\r"
        for step in itertools.count(1):
            now_s = start_s + step * look_s
            bench.place(round(100_000 * (now_s - start_s)), 0)
            sent += bench.fake.exchange(now_s, asked)
            if asked:
                taken_s, asked = now_s - start_s + 4 * CHARACTER_S, b""
            if sent.count(b"\r") == 2:
                break
        assert int(sent.split(b"\r")[1], 16) == pytest.approx(100_000 * taken_s, abs=2)


@pytest.mark.parametrize("food", [b"\x00", b"\r", b"?", b"W"])
def test_any_character_feeds_the_watchdog(food: bytes) -> None:
    bench = Bench("rs232_watchdog")
    bench.drive(100, 100)
    for _ in range(5):
        assert bench.run(0.9, food) == food
    assert bench.fake.watchdog_stops == 0
    assert bench.run(2.0) == b"WW"
    assert bench.wheels.powers == [(100 / 127, 100 / 127), (0.0, 0.0)]
    bench.run(0.5, b"\r!A10\r")  # the next command moves again
    assert bench.wheels.powers[-1] == (16 / 127, 0.0)


@pytest.mark.parametrize("numbers", [12, 13, 14, 16])
@pytest.mark.parametrize("mode", ["rc", "analog"])
def test_radio_mode_logs_a_character_each_8_ms_and_answers_nothing(
    mode: Mode, numbers: int
) -> None:
    bench = Bench(mode, log_numbers=numbers)
    bench.drive(5, -1)
    bench.run(0.008 * 40)  # what was begun before the command
    sent = bench.run(4.0, b"?Q0\r!A7F\r")
    assert abs(len(sent) - 4.0 / 0.008) <= 2
    lines = sent.split(b"\r")[1:-1]
    assert len(lines) >= 13
    assert {*lines} == {b":05FF0501000000009999706C00000000"[: 1 + 2 * numbers]}
    assert bench.wheels.powers == [(5 / 127, -1 / 127)]


@pytest.mark.parametrize("echoes", [True, False])
def test_ten_cr_in_a_row_bring_rs232_mode_with_watchdog(echoes: bool) -> None:
    bench = Bench("rc", echoes_take_over=echoes)
    bench.run(0.1, (b"\r" * 9 + b"x") * 2)
    modes: list[Mode] = []
    for _ in range(10):
        modes.append(bench.fake.mode)
        sent = bench.run(0.04, b"\r")
    assert [*modes, bench.fake.mode] == ["rc"] * 10 + ["rs232_watchdog"]
    assert sent.endswith(b"\rOK\r" if echoes else b"OK\r")
    assert bench.run(0.5) == b""
    assert bench.ask("?Q0") == ["0"]
    assert bench.run(1.01) == b"W"
    bench.fake.restart(bench.now_s)
    bench.run(0.71)
    assert bench.fake.mode == "rc"


@pytest.mark.parametrize("mode", MODES)
def test_power_up_gives_the_prompt_and_the_stored_mode(mode: Mode) -> None:
    bench = Bench(mode, paced=True)
    bench.fake.mode = "rs232"
    bench.fake.restart(bench.now_s)
    assert bench.run(0.695, b"\r\r?Q0\r") == b""  # deaf
    assert bench.run(0.1).startswith(PROMPT + (b":" if mode in ("rc", "analog") else b"OK\r"))
    assert bench.fake.mode == mode


def test_a_restart_in_the_middle_of_an_answer_cuts_it_off_and_zeroes_the_counters() -> None:
    bench = Bench(paced=True, reply_delay_s=0.0)
    bench.place(91011186, 0)
    assert bench.run(0.010, b"?Q0\r") == b"?Q0\r56CB"
    bench.drive(50, 50)
    bench.fake.restart(bench.now_s)
    assert bench.wheels.powers[-1] == (0.0, 0.0)
    bench.place(91011186 + 7, 3)
    assert bench.run(0.8) == PROMPT + b"OK\r"
    assert bench.run(0.02, b"?Q0\r") == b"?Q0\r7\r"
    assert bench.run(0.02, b"?Q1\r") == b"?Q1\r3\r"


def test_the_letter_z_right_after_a_reset_is_the_end_of_the_encoders() -> None:
    bench = Bench()
    for wait_s, alive in ((0.8, False), (1.01, True)):
        bench.fake.restart(bench.now_s)
        bench.run(wait_s)
        bench.run(0.0, b"?Z\r")
        assert bench.ask("?Q0") == (["0"] if alive else [])
        assert bench.ask("?E") == ["70", "6C"]


@settings(max_examples=examples(25))
@given(writings=WRITINGS, mode=st.sampled_from(MODES), paced=st.booleans())
def test_how_often_one_looks_makes_no_difference_nor_does_it_speak_faster_than_its_wire(
    writings: list[tuple[float, bytes]], mode: Mode, paced: bool
) -> None:
    seldom, often = Bench(mode, paced=paced), Bench(mode, paced=paced)
    sent = [b"", b""]
    for wait_s, written in writings:
        sent[0] += seldom.fake.exchange(seldom.now_s, written)
        for k in range(len(written)):
            sent[1] += often.fake.exchange(often.now_s, written[k : k + 1])
        for k in range(1, 8):
            sent[1] += often.fake.exchange(often.now_s + wait_s * k / 8, b"")
        seldom.now_s = often.now_s = seldom.now_s + wait_s
    sent[0] += seldom.fake.exchange(seldom.now_s + 1.0, b"")
    sent[1] += often.fake.exchange(often.now_s + 1.0, b"")
    assert sent[0] == sent[1]
    assert max(sent[0], default=0) < 0x80
    if paced:
        assert len(sent[0]) <= (seldom.now_s + 1.0 - 100.0) / CHARACTER_S + 1


@pytest.mark.parametrize("rate", [0.1, 0.9])
def test_stray_w_stand_anywhere_and_change_nothing_else(rate: float) -> None:
    plain, stray = Bench(paced=True), Bench(paced=True, w_rate=rate)
    asked = b"?Q0\r?E\r^01\r!Q2\r" * 5
    with_w = stray.run(1.0, asked)
    assert b"W" in with_w
    assert with_w.replace(b"W", b"") == plain.run(1.0, asked)
    assert stray.fake.watchdog_stops == 0
