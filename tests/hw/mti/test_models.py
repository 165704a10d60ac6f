"""Models of MTi as they are found on a shelf, in whichever state; outputs that fit their line."""

import math
import struct

import pytest

from hw.mti.output import legacy_output, new_outputs
from tests.support.mti_frames import framed, wire
from tests.support.scripted_mti import NEW_REQUEST, TICK_S, Bench, Scripted, ScriptedNew

HALF = math.sqrt(0.5)


class Split(ScriptedNew):
    """Orientation and rate of turn in two messages, the rate half as often."""

    def message(self) -> bytes:
        self.ticks = (self.ticks + 100) % 864_000_000
        stamp = struct.pack(">HBH HBI", 0x1020, 2, self.counter, 0x1060, 4, self.ticks)
        first = framed(0x36, stamp + struct.pack(">HB4f", 0x2010, 16, HALF, 0.0, 0.0, HALF))
        if self.counter % 2:
            return first
        return first + framed(0x36, stamp + struct.pack(">HB3f", 0x8020, 12, 0.01, -0.02, 0.25))


def test_a_device_that_keeps_north_east_down_is_turned() -> None:
    device = Scripted()  # an MTi-G
    device.answers[wire("ReqDID")] = framed(0x01, bytes.fromhex("01500618"))
    device.registers |= {0xD0: "1836", 0xD2: "80000203"}  # GPS, UTC, 16.32, NED
    device.stubborn = {0xD2: "80000005"}
    bench = Bench(device)
    assert bench.run_until("running", 3.0), bench.cause()
    w, x, y, z = bench.run(1.0)[-1].q_earth_sensor
    yaw = math.degrees(math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))
    assert yaw == pytest.approx(-90.0, abs=0.1)  # north-east-down said 90


def test_a_legacy_id_that_answers_like_a_newer_device_is_one_and_the_other_way_round() -> None:
    new = ScriptedNew()
    new.answers[wire("ReqDID")] = framed(0x01, bytes.fromhex("00300001"))
    old = Scripted()
    old.answers[wire("ReqDID")] = framed(0x01, bytes.fromhex("03600001"))
    for device in (new, old):
        bench = Bench(device)
        assert bench.run_until("running", 3.0), bench.cause()


def test_split_messages_give_every_attitude_with_the_rate_of_its_own_instant() -> None:
    device = Split()
    device.ticks = 1000
    bench = Bench(device)
    assert bench.run_until("running", 3.0), bench.cause()
    bench.run(1.0)
    begin_s, held_s, attitudes = bench.now_s, [], []
    for _ in range(200):
        for attitude in bench.run(TICK_S):
            attitudes.append(attitude)
            held_s.append(bench.now_s - attitude.t_s)
    assert bench.now_s - begin_s == pytest.approx(1.0)
    with_rate = [attitude for attitude in attitudes if math.isfinite(attitude.rate_radps[0])]
    assert len(held_s) == 100
    assert len(with_rate) == 50
    assert max(held_s) < 0.0073 + 0.010 + 2 * TICK_S
    assert bench.mti.status.missed == bench.mti.status.rejected == 0


@pytest.mark.parametrize(
    ("rate_hz", "baud", "settings", "cause"),
    [
        (100, 115200, "00000005", ""),
        (100, 57600, "00000005", ""),
        (100, 38400, "00000055", ""),
        (100, 28800, "00000005", "28800 baud carry no rate of turn at 100 samples a second"),
        (100, 9600, "00000055", "9600 baud carry 30.0"),
        (200, 115200, "00000005", ""),
    ],
)
def test_a_legacy_output_is_chosen_that_its_line_carries(
    rate_hz: float, baud: int, settings: str, cause: str
) -> None:
    device = Scripted()
    bench = Bench(device, rate_hz, baud)
    assert bench.run_until("running", 3.0), bench.cause()
    assert device.registers[0xD2] == settings
    assert bench.cause().startswith(cause)
    assert bool(bench.cause()) == bool(cause)


@pytest.mark.parametrize("baud", [4800, 9600, 19200, 38400, 57600, 115200, 921600])
@pytest.mark.parametrize("rate_hz", [10, 50, 100, 200, 400, 512])
def test_what_is_asked_for_never_exceeds_the_line(rate_hz: float, baud: int) -> None:
    legacy = legacy_output(rate_hz, baud)
    numbers = 3 * (legacy.mode == 6) * (3 - bin(legacy.settings & 0x70).count("1")) + 3
    assert 115200 / legacy.period * (5 + 4 * numbers + 2) * 10 < baud
    assert legacy.remark or 115200 / legacy.period == pytest.approx(rate_hz, rel=0.01)
    sizes = {0x1020: 5, 0x1060: 7, 0x2010: 19, 0x2030: 15, 0x8020: 15, 0xC020: 15}
    for choice in new_outputs(rate_hz, baud):
        frame = 5 + sum(sizes[identifier] for identifier, _ in choice.outputs)
        assert choice.rate_hz * frame * 10 < baud
        assert choice.remark or choice.rate_hz == rate_hz


def test_a_newer_device_on_a_slow_line_is_asked_for_less_and_says_so() -> None:
    bench = Bench(ScriptedNew(), 100, 19200)
    assert bench.run_until("running", 3.0), bench.cause()
    assert NEW_REQUEST not in bench.device.heard
    assert "19200 baud carry 25 samples a second, not 100" in bench.cause()
