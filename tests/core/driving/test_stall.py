"""Wheels that have power and do not turn: what is noticed, how soon, and when it is over."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from config_file import load_config, with_changes
from core.driving.stall import UNFOLLOWED_M, StallWatch
from core.records import WheelCounts
from tests import ROOT

CONFIG = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
COUNTS_PER_M = 2000 / (2 * math.pi * 0.15)  # of the shipped robot
TICK_S, POLL_TICKS = 0.005, 10


class Wheels:
    """A watch, and wheels that follow what they are told by shares, left and right."""

    def __init__(self) -> None:
        self.watch, self.now_s = StallWatch(CONFIG), 0.0
        self.counts, self.restarts, self._ticks = [0.0, 0.0], 0, 0
        self.run(0.1, (0.0, 0.0), (1.0, 1.0))

    def run(self, seconds: float, power: tuple[float, float], follow: tuple[float, float]) -> None:
        """Time with both wheels at a power, -1..1."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s, self._ticks = self.now_s + TICK_S, self._ticks + 1
            for k in (0, 1):
                self.counts[k] += follow[k] * power[k] * TICK_S * COUNTS_PER_M
            if self._ticks % POLL_TICKS == 0:
                self.watch.counted(
                    WheelCounts(self.now_s, self.counts[0], self.counts[1], self.restarts)
                )
            self.watch.told(self.now_s, *power)


@given(power=st.floats(0.1, 1.0), sense=st.sampled_from([1.0, -1.0]), stuck=st.sampled_from([0, 1]))
def test_a_counter_that_stands_is_noticed_after_a_short_way(
    power: float, sense: float, stuck: int
) -> None:
    wheels = Wheels()
    follow = (0.0, 1.0) if stuck == 0 else (1.0, 0.0)
    wheels.run(0.9 * UNFOLLOWED_M / power, (sense * power, sense * power), follow)
    assert not wheels.watch.stalled
    wheels.run(
        0.2 * UNFOLLOWED_M / power + (POLL_TICKS + 2) * TICK_S,
        (sense * power, sense * power),
        follow,
    )
    assert wheels.watch.stalled


@given(power=st.floats(0.0, 1.0), share=st.floats(0.4, 1.5), seconds=st.floats(1.0, 5.0))
def test_wheels_that_turn_are_in_order_even_when_they_lag(
    power: float, share: float, seconds: float
) -> None:
    wheels = Wheels()
    wheels.run(seconds, (power, -power), (share, share))
    assert not wheels.watch.stalled


def test_it_is_over_when_the_counter_moves_and_not_when_the_power_goes() -> None:
    wheels = Wheels()
    wheels.run(1.0, (0.5, 0.5), (0.0, 1.0))
    wheels.run(20.0, (0.0, 0.0), (1.0, 1.0))
    assert wheels.watch.stalled
    wheels.counts[0] += 0.12 * COUNTS_PER_M  # somebody pushes it
    wheels.run(0.1, (0.0, 0.0), (1.0, 1.0))
    assert not wheels.watch.stalled


def test_it_is_over_when_the_counters_begin_anew() -> None:
    wheels = Wheels()
    wheels.run(1.0, (0.5, 0.5), (0.0, 0.0))
    assert wheels.watch.stalled
    wheels.restarts += 1
    wheels.run(0.1, (0.0, 0.0), (1.0, 1.0))
    assert not wheels.watch.stalled


def test_it_is_over_when_the_controller_says_that_the_wheels_had_no_power() -> None:
    wheels = Wheels()
    wheels.run(1.0, (0.5, 0.5), (0.0, 0.0))
    assert wheels.watch.stalled
    left, right = wheels.counts
    wheels.watch.counted(WheelCounts(wheels.now_s, left, right, 0, cut_off=True))
    assert not wheels.watch.stalled
    wheels.run(1.0, (0.5, 0.5), (0.0, 0.0))
    assert wheels.watch.stalled, "power again, and the counters stand still"


@pytest.mark.parametrize("wheel", [0, 1])
@pytest.mark.parametrize(("short_m", "stalled"), [(0.151, True), (0.149, False)])
def test_a_wheel_may_be_sent_on_by_so_much_more_than_five_times_what_it_turned(
    wheel: int, short_m: float, stalled: bool
) -> None:
    watch = StallWatch(
        with_changes(
            CONFIG,
            robot={"wheel_radius_m": 0.1, "encoder_ppr": 100, "gear_ratio": 3.0},
            drive={"full_power_mps": 0.5},
        )
    )
    assert not watch.stalled
    per_m = 4 * 100 * 3.0 / (2 * math.pi * 0.1)
    watch.counted(WheelCounts(0.0, 5000.0, 7000.0, 0))
    for k in range(11):
        watch.told(0.05 * k, *((-0.8, 0.5) if wheel == 0 else (0.5, 0.8)))  # 0.2 and 0.125 m
    turned = [0.125 / 5 * per_m, 0.125 / 5 * per_m]
    turned[wheel] = -(0.2 - short_m) / 5 * per_m
    watch.counted(WheelCounts(0.5, 5000.0 + turned[0], 7000.0 + turned[1], 0))
    assert watch.stalled is stalled


def test_creeping_against_friction_is_no_stall() -> None:
    wheels = Wheels()
    wheels.run(10.0, (0.09, 0.09), (0.0, 0.0))
    assert not wheels.watch.stalled


def test_counters_that_are_not_read_for_a_while_are_no_stall() -> None:
    wheels = Wheels()
    for _ in range(200):  # one second without readings
        wheels.now_s += TICK_S
        wheels.watch.told(wheels.now_s, 1.0, 1.0)
    assert not wheels.watch.stalled
    wheels.counts = [COUNTS_PER_M, COUNTS_PER_M]
    wheels.run(0.2, (0.0, 0.0), (1.0, 1.0))
    assert not wheels.watch.stalled
