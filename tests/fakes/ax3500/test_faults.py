"""The fake controller's faults, each one attribute; its sisters; who moves the wheels, and when."""

from typing import Any

import pytest

from fakes.ax3500.device import FakeAx3500
from fakes.ax3500.properties import Model
from tests.support.devices.bench_ax3500 import Bench


def test_entering_rs232_mode_takes_the_vehicle_from_its_radio() -> None:
    bench = Bench("rc")
    bench.fake.command(100, -50)
    bench.run(0.02)
    bench.run(0.02, b"\r" * 10)
    assert bench.wheels.powers == [(100 / 127, -50 / 127), (0.0, 0.0)]
    bench.fake.command(90, 90)
    bench.run(0.1, b"!A10\r")
    assert bench.wheels.powers[2:] == [(16 / 127, 0.0)]


def test_the_stick_that_is_still_held_counts_again_once_the_controller_is_up() -> None:
    bench = Bench("rc")
    bench.fake.command(64, 64)
    bench.fake.power_cycle(bench.now_s)
    assert bench.run(0.6) == b""
    assert bench.wheels.powers[-1] == (0.0, 0.0)
    bench.run(0.2)
    assert bench.wheels.powers[-1] == (64 / 127, 64 / 127)


@pytest.mark.parametrize(
    ("attribute", "bad", "good", "bit"),
    [
        ("battery_v", 45.0, 24.0, 0x01),
        ("celsius", (20.0, 90.0), (20.0, 60.0), 0x02),
        ("battery_v", 7.0, 24.0, 0x04),
        ("status", 0x08, 0x00, 0x08),
    ],
)
def test_a_condition_takes_the_power_and_ends_by_itself(
    attribute: str, bad: object, good: object, bit: int
) -> None:
    bench = Bench()
    bench.drive(100, 100)
    setattr(bench.fake, attribute, bad)
    assert bench.ask("^89") == [f"{bit:02X}", "+"]
    assert (bench.ask("?V"), bench.wheels.powers[-1]) == (["00", "00"], (0.0, 0.0))
    setattr(bench.fake, attribute, good)
    assert bench.ask("^89") == ["00", "+"]
    assert bench.wheels.powers[-1] == (100 / 127, 100 / 127)


def test_an_emergency_stop_stays_until_a_reset_and_is_back_while_the_button_is_in() -> None:
    bench = Bench()
    bench.drive(100, 100)
    bench.fake.emergency_stop = True
    assert (bench.ask("?I"), bench.ask("^89")) == (["00", "00", "00"], ["80", "+"])
    assert bench.wheels.powers[-1] == (0.0, 0.0)
    bench.fake.reset(bench.now_s)
    bench.run(0.71)
    assert bench.ask("^89") == ["80", "+"]
    bench.fake.emergency_stop = False
    assert bench.ask("^89") == ["80", "+"]
    bench.fake.reset(bench.now_s)
    bench.run(0.71)
    assert (bench.ask("^89"), bench.ask("?I")) == (["00", "+"], ["00", "00", "01"])


def test_a_load_shows_in_amps_and_volts_and_passes() -> None:
    bench = Bench(load_a=20.0)
    bench.drive(127, -64)
    assert bench.ask("?A") == ["28", "14"]  # 20 A, 10 A
    assert bench.ask("?E") == [f"{round((24.06 - 0.06 * 30.08) * 256 / 55):02X}", "6C"]
    bench.drive(0, 0)
    assert (bench.ask("?A"), bench.ask("?E")) == (["00", "00"], ["70", "6C"])


@pytest.mark.parametrize(
    ("model", "identity", "amps", "output_d"),
    [
        ("AX3500", "68", "0B", ["-"]),
        ("AX1500", "22", "16", ["-"]),
        ("AX2850", "24", "06", ["+"]),
    ],
)
def test_each_of_the_family_has_its_identity_and_its_amps(
    model: Model, identity: str, amps: str, output_d: list[str]
) -> None:
    bench = Bench()
    bench.fake = FakeAx3500(bench.wheels, 1, "rs232", model=model, paced=False)
    bench.fake.reply_delay_s, bench.fake.amps = 0.0, (5.5, 0.0)
    bench.fake.exchange(bench.now_s, b"")
    assert bench.ask("^8A") == [identity, "+"]
    assert bench.ask("?A") == [amps, "00"]
    assert bench.ask("!D") == output_d


def test_without_its_encoder_module_its_prompt_is_shorter() -> None:
    bench = Bench(encoder=False)
    bench.fake.restart(bench.now_s)
    assert bench.run(0.71) == b"Roboteq v1.9b 06/01/07\rs\rOK\r"


@pytest.mark.parametrize(
    ("properties", "sent", "answer"),
    [
        ({"echoes": False}, b"?E\r", b"70\r6C\r"),
        ({"lf_after_cr": True}, b"?E\r", b"?E\r\n70\r\n6C\r\n"),
        ({"refuse": {"?r", "^01"}}, b"?R\r^01\r?P\r", b"?R\r-\r^01\r-\r?P\r00\r00\r"),
        ({"register_sign": "$"}, b"$A2\r*A2\r", b"$A2\r00\r+\r*A2\r-\r"),
        ({}, b"$A2\r*A2\r", b"$A2\r-\r*A2\r00\r+\r"),
        ({"encoder": False}, b"^8A\r?Q0\r!Q2\r", b"^8A\r48\r+\r?Q0\r-\r!Q2\r-\r"),
        ({"never_written": {0x0F}}, b"^0F\r^0F 08\r^0F\r", b"^0F\r-\r^0F 08\r+\r^0F\r08\r+\r"),
    ],
)
def test_what_it_says_depends_on_its_properties(
    properties: dict[str, Any], sent: bytes, answer: bytes
) -> None:
    assert Bench(**properties).run(0.0, sent) == answer


def test_deaf_it_does_not_answer_and_its_watchdog_strikes_and_mute_it_hears() -> None:
    bench = Bench("rs232_watchdog", deaf=True)
    assert bench.run(2.1, b"?Q0\r") == b"WW"
    bench.fake.deaf, bench.fake.mute = False, True
    assert bench.run(0.9, b"!A40\r?Q0\r") == b""
    assert bench.wheels.powers == [(64 / 127, 0.0)]
    bench.fake.mute = False
    assert bench.ask("?Q0") == ["0"]  # and says nothing later


def test_late_it_says_the_same_later() -> None:
    plain, late = Bench(paced=True), Bench(paced=True, late_s=0.3)
    assert late.run(0.29, b"?Q0\r?E\r") == b""
    assert late.run(0.1) == plain.run(0.39, b"?Q0\r?E\r")


def test_frozen_its_counters_stand_and_jump_afterwards() -> None:
    bench = Bench()
    bench.place(100, 200)
    assert bench.ask("?Q0") == ["64"]
    bench.fake.frozen = True
    bench.place(5000, 6000)
    bench.run(0.1)
    assert bench.ask("?Q0") == ["64"]
    bench.fake.frozen = False
    bench.run(0.01)
    assert bench.ask("?Q0") == ["1388"]


@pytest.mark.parametrize("after", [1, 4, 5])
def test_it_resets_by_itself_in_the_middle_of_a_poll(after: int) -> None:
    bench = Bench(reset_after=after)
    bench.place(1000, 1000)
    sent = bench.run(0.71, b"?Q0\r?Q1\r")
    assert sent.startswith(b"?Q0\r"[: after - 1] if after < 5 else b"?Q0\r3E8\r")
    assert sent.endswith(b"OK\r")
    assert (bench.ask("?Q0"), bench.fake.reset_after) == (["0"], 0)


def test_a_reset_keeps_what_was_on_the_way_and_a_power_cycle_loses_it() -> None:
    for cycle, kept in (("reset", b"?Q0\r0\r"), ("power_cycle", b"")):
        bench = Bench(paced=True, reply_delay_s=0.0)
        bench.fake.exchange(bench.now_s, b"?Q0\r")
        bench.now_s += 0.0045
        bench.fake.encoders.sample(bench.now_s)
        answered = bench.fake.exchange(bench.now_s, b"")
        getattr(bench.fake, cycle)(bench.now_s)
        rest = bench.run(0.8)
        assert (answered + rest).startswith(kept or answered)
        assert rest.endswith(b"OK\r")
        assert (b"\r0\r" in answered + rest[:4]) == bool(kept)


def test_a_bad_address_hangs_the_module_over_a_reset_but_not_over_a_loss_of_power() -> None:
    bench = Bench()
    assert bench.ask("*99") == ["00", "+"]  # a destination
    assert bench.ask("*9C") == []
    bench.run(0.71, b"%rrrrrr\r")
    assert [bench.ask(line) for line in ("?Q0", "!Q2", "*88")] == [[]] * 3
    assert bench.ask("?E") == ["70", "6C"]
    bench.fake.power_cycle(bench.now_s)
    bench.run(0.71)
    assert bench.ask("?Q0") == ["0"]
