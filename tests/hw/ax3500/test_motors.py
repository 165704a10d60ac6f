"""Motors on the fake controller: never without leave, and zero on any doubt."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from fakes.ax3500.properties import Mode
from hw.ax3500.motors import Motors, encode_motor
from tests.support.cases import few
from tests.support.devices.bench_ax3500 import FakeBench

HALF = pytest.approx((0.5, 0.5), abs=0.01)
STOPPED = (0.0, 0.0)


def motor_bench(mode: Mode = "rs232_watchdog", **settings: Any) -> FakeBench:
    """A session that may command its controller; the controller's watchdog is on."""
    return FakeBench(mode, enable=True, **settings)


def idle_motors() -> Motors:
    """Both channels at an acknowledged zero, zero wished."""
    motors = Motors(True, 1, 2, ())
    motors.adopt_modes(2, 0, False)
    motors.look(1.0)
    for channel in (1, 2):
        assert motors.maybe_command("") == (channel, 0)
        motors.sent(channel, 0)
        motors.acknowledged(channel, 0)
    assert motors.maybe_command("") is None
    motors.wish(0.0, 0.0)
    motors.look(1.1)
    return motors


# ---- leave


def test_motors_never_move_without_leave() -> None:
    bench = FakeBench("rc", enter=True)
    bench.start((0.5, 0.5))
    bench.ax.stop()
    bench.run(0.5, (0.5, 0.5))
    assert bench.wheels.powers == []
    assert b"!" not in bench.port.written
    assert bench.ax.trouble == ""
    with pytest.raises(ValueError, match="not enabled"):
        encode_motor(1, 0, enabled=False)
    with pytest.raises(ValueError, match="motors: channel"):
        encode_motor(1, 128, enabled=True)


@pytest.mark.parametrize(("mode", "moves"), [(0xC4, True), (0xC5, True), (0x02, False)])
def test_the_motor_mode_decides_what_a_command_means(mode: int, moves: bool) -> None:
    bench = motor_bench()
    bench.fake.set_parameter(0x01, mode)
    bench.fake.reset(0.0)
    bench.start((0.5, -0.25), seconds=4.0)
    assert bench.wheels.power() == pytest.approx((0.5, -0.25) if moves else STOPPED, abs=0.02)
    assert ("position" in bench.ax.trouble) is not moves
    assert ("position" in bench.ax.status.cause) is not moves


@pytest.mark.parametrize(
    ("mode", "refused", "cause"),
    [
        ("rs232_watchdog", "^00", "^00"),
        ("rs232_watchdog", "^01", "^01"),
        ("rs232_watchdog", "^89", "does not tell its status"),
        ("rs232_watchdog", "?I", "does not tell its status"),
        ("rs232", "", "without watchdog (^00 is 01, must be 02)"),
    ],
)
def test_what_a_controller_does_not_tell_keeps_the_motors_off(
    mode: Mode, refused: str, cause: str
) -> None:
    bench = motor_bench(mode)
    bench.fake.refuse = {refused}
    bench.start((0.5, 0.5))
    assert bench.wheels.powers == []
    bench.ax.stop()
    assert (b"!" in bench.port.written) is (refused in ("^89", "?I"))  # which lets zeros through
    assert cause in bench.ax.status.cause
    assert bench.ax.status.state == "running"


@pytest.mark.parametrize("refused", [set[str](), {"^00"}])
def test_entering_rs232_mode_switches_the_watchdog_on(refused: set[str]) -> None:
    bench = motor_bench("rc", enter=True)
    bench.fake.refuse = refused
    bench.start((0.5, 0.5), seconds=4.0)
    assert bench.wheels.power() == HALF


# ---- wishes


def test_motors_follow_the_wish_and_are_refreshed_within_the_watchdog() -> None:
    bench = motor_bench()
    bench.start((7.0, -7.0))
    assert bench.wheels.power() == (1.0, -1.0)
    for k in range(20):
        wish = (0.2 + 0.02 * k, -0.02 * k)
        bench.run(0.1, wish)
        assert bench.wheels.power() == pytest.approx(wish, abs=0.01)
    bench.run(0.1, (0.5, -0.25))
    changes = len(bench.wheels.powers)
    bench.run(2.5, (0.5, -0.25))
    assert (bench.fake.watchdog_stops, len(bench.wheels.powers)) == (0, changes)


@pytest.mark.parametrize("wish", [None, (math.nan, 0.5), (0.5, math.inf), (0.0, 0.0)])
def test_no_wish_or_nonsense_is_zero(wish: tuple[float, float] | None) -> None:
    bench = motor_bench()
    bench.start((0.5, 0.5))
    assert bench.wheels.power() == HALF
    bench.run(0.16, wish)
    assert bench.wheels.power() == STOPPED
    bench.run(0.1, (0.5, 0.5))
    assert bench.wheels.power() == HALF


def test_channels_and_signs_hold_for_motors_too() -> None:
    bench = motor_bench(left_channel=2, right_channel=1, invert=[1])
    bench.start((0.5, 0.25))
    assert bench.wheels.power() == pytest.approx((-0.25, 0.5), abs=0.01)


@pytest.mark.parametrize("fault", ["", "mute", "cut"])
def test_stop_writes_zeros_and_is_settled_when_they_are_acknowledged_or_nobody_is_there(
    fault: str,
) -> None:
    bench = FakeBench("rs232_watchdog", enable=True)
    assert bench.ax.settled  # nothing was ever sent
    bench.start((0.5, 0.5))
    assert not bench.ax.settled
    bench.fake.mute, bench.wire.cut = fault == "mute", fault == "cut"
    bench.ax.stop()
    assert bench.port.written.endswith(b"\r!A00\r!B00\r")
    assert not bench.ax.settled
    bench.run(0.1)
    assert fault or bench.wheels.power() == STOPPED
    assert bench.ax.settled is (fault != "mute")


# ---- trouble


TROUBLES: dict[str, Callable[[FakeBench], None]] = {
    "emergency stop": lambda bench: setattr(bench.fake, "emergency_stop", True),
    "status bit": lambda bench: setattr(bench.fake, "status", 0x02),
    "W": lambda bench: bench.fake.send_w(),
    "restart": lambda bench: bench.fake.restart(bench.now_s),
    "mute": lambda bench: setattr(bench.fake, "mute", True),
    "deaf": lambda bench: setattr(bench.fake, "deaf", True),
    "noisy": lambda bench: setattr(bench.fake, "w_rate", 0.1),
    "damage": lambda bench: setattr(bench.wire, "damage_rate", 1.0),
    "cut": lambda bench: setattr(bench.wire, "cut", True),
}


@pytest.mark.parametrize("what", few(TROUBLES, 6))
def test_trouble_stops_within_a_second_and_then_the_stick_must_be_let_go_first(what: str) -> None:
    bench = motor_bench()
    bench.start((0.5, 0.5))
    assert bench.wheels.power() == HALF
    TROUBLES[what](bench)
    bench.run(1.02, (0.5, 0.5))
    assert bench.wheels.power() == STOPPED
    bench.run(1.0, (0.5, 0.5))
    assert bench.wheels.power() == STOPPED
    assert bench.ax.trouble != ""
    bench.fake.emergency_stop = bench.fake.mute = bench.fake.deaf = bench.wire.cut = False
    bench.fake.status, bench.fake.w_rate, bench.wire.damage_rate = 0, 0.0, 0.0
    seen = len(bench.wheels.powers)
    bench.run(3.0, (0.5, 0.5))
    assert bench.ax.status.state == "running"
    assert bench.wheels.powers[seen:] == []
    assert "let go of the stick" in bench.ax.trouble
    assert "let go of the stick" in bench.ax.status.cause
    bench.run(0.02, (0.0, 0.0))
    assert bench.ax.trouble == ""
    bench.run(0.3, (0.5, 0.5))
    assert bench.wheels.power() == HALF
    assert bench.ax.status.cause == ""


def test_trouble_is_told_in_words() -> None:
    bench = motor_bench()
    bench.run(2.0, (0.5, 0.5))
    assert bench.ax.trouble.endswith("(let go of the stick): the connection is new")
    bench.run(0.1, (0.0, 0.0))
    bench.fake.emergency_stop = True
    bench.run(2.0, (0.5, 0.5))
    words = "the controller reports emergency stop; the emergency stop is pressed"
    assert bench.ax.trouble.startswith(words)
    assert bench.ax.status.cause == words


def test_a_status_that_is_lost_once_stops_nothing() -> None:
    bench = motor_bench()
    bench.start((0.5, 0.5))
    seen = len(bench.wheels.powers)
    taken_s = bench.ax.stream.controller.taken_s["^89"]
    while bench.ax.stream.controller.taken_s["^89"] == taken_s:
        bench.tick((0.5, 0.5))
    while not bench.port.written.endswith(b"^89\r"):
        bench.tick((0.5, 0.5))
    bench.wire.mute = True
    bench.run(0.05, (0.5, 0.5))
    bench.wire.mute = False
    bench.run(3.0, (0.5, 0.5))
    assert bench.wheels.power() == HALF
    assert [power for power in bench.wheels.powers[seen:] if power[0] not in (0.0, 64 / 127)] == []
    assert bench.ax.trouble == ""


@pytest.mark.parametrize("seed", range(2))
def test_a_line_that_spoils_every_zero_is_starved_for_the_watchdog(seed: int) -> None:
    bench = motor_bench(seed=seed)
    bench.start((0.5, 0.5))
    bench.wire.host_damage_rate = 0.6
    began_s, seen = bench.now_s, len(bench.wheels.powers)
    while bench.wheels.power() != STOPPED:
        bench.tick((0.5, 0.5))
    assert bench.now_s - began_s < 1.9
    assert bench.wheels.powers[seen:]


def test_a_cable_that_is_back_at_once_brings_zero_first() -> None:
    bench = motor_bench()
    bench.start((0.5, 0.5))
    bench.wire.cut = True
    bench.run(0.3, (0.5, 0.5))
    bench.wire.cut, begun = False, len(bench.port.written)
    bench.run(0.1, (0.5, 0.5))
    assert bench.wheels.power() == STOPPED
    assert bench.port.written[begun:].startswith(b"\r!A00\r!B00\r")


def test_a_refused_command_is_repeated_at_once() -> None:
    motors = idle_motors()
    motors.wish(0.5, 0.0)
    motors.look(1.2)
    assert motors.maybe_command("") == (1, 64)
    motors.sent(1, 64)
    motors.wish(0.5, 0.0)
    motors.look(1.24)
    assert motors.maybe_command("") == (1, 64)


def test_a_wish_from_before_a_doubt_is_forgotten() -> None:
    motors = idle_motors()
    motors.wish(1.0, 1.0)
    motors.doubt()
    motors.look(2.0)
    for channel in (1, 2):
        assert motors.maybe_command("") == (channel, 0)
        motors.sent(channel, 0)
        motors.acknowledged(channel, 0)
    assert motors.maybe_command("") is None
    motors.wish(1.0, 1.0)
    motors.look(2.1)
    assert motors.maybe_command("") == (1, 127)


def test_zero_wished_during_the_trouble_does_not_end_it() -> None:
    motors = idle_motors()
    assert motors.maybe_command("too hot") is None
    motors.wish(0.0, 0.0)
    motors.look(1.2)
    assert motors.why_off.endswith("too hot")
    assert motors.maybe_command("") is None
    motors.wish(0.0, 0.0)
    motors.look(1.3)
    assert motors.why_off == ""


def test_after_a_restart_nothing_moves_before_the_status_is_told_anew() -> None:
    bench = motor_bench()
    bench.fake.boot_s = 0.05
    bench.start((0.5, 0.5))
    bench.fake.restart(bench.now_s)
    bench.run(0.05)
    begun = len(bench.port.written)
    for _ in range(40):
        bench.run(0.05, (0.0, 0.0))
        bench.run(0.05, (0.5, 0.5))
    lines = bytes(bench.port.written[begun:]).split(b"\r")
    assert b"!A40" in lines
    assert max(lines.index(b"^89"), lines.index(b"?I")) < lines.index(b"!A40")
