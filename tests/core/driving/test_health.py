"""Health: what may be told, for every combination of inputs."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from core.driving import health
from core.driving.health import Inputs, health_word, mode, trusted
from core.mapping.method import MAX_SLOPE_RAD

GOOD = Inputs(0.05, 0.05, 0.01, 0.08, True, True, True, False, 0.01, False)
AGES = st.one_of(st.floats(0, 2), st.just(float("inf")))


def test_a_healthy_robot_runs_and_may_tell_free() -> None:
    word = health_word(GOOD)
    assert word == 0x7F
    assert trusted(word)
    assert mode(word, GOOD) == health.RUNNING


@given(
    ages=st.tuples(AGES, AGES, AGES, AGES),
    flags=st.tuples(*[st.booleans()] * 5),
    tilt=st.floats(0, 1),
)
def test_free_is_told_only_while_every_input_is_fresh_and_the_pose_known(
    ages: tuple[float, float, float, float], flags: tuple[bool, ...], tilt: float
) -> None:
    locked, pose, begun, overrun, replayed = flags
    inputs = Inputs(*ages, locked, pose, begun, overrun, tilt, replayed)
    word = health_word(inputs)
    fresh = ages[0] <= 0.15 and ages[2] <= 0.15 and ages[3] <= 0.4
    assert trusted(word) == (fresh and pose and begun and tilt <= MAX_SLOPE_RAD)
    if mode(word, inputs) in (health.RUNNING, health.DEGRADED):
        assert trusted(word)
    assert (mode(word, inputs) == health.REPLAYED) == replayed


def test_each_stale_input_clears_its_own_bit_and_the_map() -> None:
    for inputs, bit in (
        (replace(GOOD, age_scan_s=0.2, age_scanner_s=0.2), health.SCANNER_OK),
        (replace(GOOD, age_ahrs_s=0.2), health.AHRS_OK),
        (replace(GOOD, age_wheels_s=0.5), health.WHEELS_OK),
    ):
        word = health_word(inputs)
        assert not word & bit
        assert not word & health.MAP_VALID
        assert mode(word, inputs) == health.FAULT


def test_an_overrun_or_an_unlocked_clock_degrades_and_no_scan_yet_is_booting() -> None:
    for inputs in (replace(GOOD, overrun=True), replace(GOOD, clocks_locked=False)):
        assert mode(health_word(inputs), inputs) == health.DEGRADED
    inputs = replace(GOOD, map_begun=False)
    assert mode(health_word(inputs), inputs) == health.BOOTING


def test_a_slope_too_steep_for_the_map_is_said() -> None:
    word = health_word(replace(GOOD, tilt_rad=0.5))
    assert word & health.TOO_STEEP
    assert not trusted(word)


def test_what_warns_has_a_bit_of_its_own_and_leaves_the_map_valid() -> None:
    for warning, bit in (
        ({"drop_ahead": True}, health.DROP_AHEAD),
        ({"impaired": True}, health.SIGHT_IMPAIRED),
        ({"stop_asked": True}, health.STOP_ASKED),
    ):
        word = health_word(replace(GOOD, **warning))
        assert word == health_word(GOOD) | bit
        assert trusted(word)


def test_scans_are_stale_after_three_periods_but_no_sooner_than_the_links_time_out() -> None:
    assert [round(health.stale_s(1 / hz), 9) for hz in (50, 25, 20, 10)] == [0.15, 0.15, 0.15, 0.3]
    slow = replace(GOOD, age_scan_s=0.29, age_scanner_s=0.29, scan_stale_s=0.3)
    assert trusted(health_word(slow))
    assert not trusted(health_word(replace(slow, age_scan_s=0.31)))
