"""Health: what may be told, for every combination of inputs."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.driving import health
from core.driving.health import MAP_VALID, health_of
from core.mapping import causes
from core.mapping.method import MAX_SLOPE_RAD

GOOD: dict[str, Any] = {
    "age_scan_s": 0.15,
    "age_scanner_s": 0.15,
    "age_ahrs_s": 0.15,
    "age_wheels_s": 0.4,
    "clocks_locked": True,
    "pose_known": True,
    "map_begun": True,
    "overrun": False,
    "tilt_rad": MAX_SLOPE_RAD,
    "replayed": False,
    "drop_ahead": False,
    "impaired": False,
    "stop_asked": False,
    "scan_stale_s": 0.15,
    "stalled": False,
}  # each of them just well
BAD: dict[str, tuple[Any, int, int]] = {  # what one of them makes of the word; the mode then
    "age_scan_s": (math.nextafter(0.15, 1), 0b000_0101_1111, health.FAULT),
    "age_scanner_s": (math.nextafter(0.15, 1), 0b000_0111_1110, health.RUNNING),
    "age_ahrs_s": (math.nextafter(0.15, 1), 0b000_0100_1101, health.FAULT),
    "age_wheels_s": (math.nextafter(0.4, 1), 0b000_0100_1011, health.FAULT),
    "clocks_locked": (False, 0b000_0111_0111, health.DEGRADED),
    "pose_known": (False, 0b000_0100_1111, health.FAULT),
    "map_begun": (False, 0b000_0101_1111, health.BOOTING),
    "overrun": (True, 0b000_0011_1111, health.DEGRADED),
    "tilt_rad": (math.nextafter(MAX_SLOPE_RAD, 9), 0b010_0101_1111, health.FAULT),
    "replayed": (True, 0b000_0111_1111, health.REPLAYED),
    "drop_ahead": (True, 0b000_1111_1111, health.RUNNING),
    "impaired": (True, 0b001_0111_1111, health.RUNNING),
    "stop_asked": (True, 1 << 15 | 0b111_1111, health.RUNNING),
    "scan_stale_s": (0.14, 0b000_0101_1110, health.FAULT),
    "stalled": (True, 0b000_0100_1011, health.FAULT),
}


def test_a_healthy_robot_runs_and_may_tell_free() -> None:
    assert health_of(**GOOD) == (0x7F, health.RUNNING)


@pytest.mark.parametrize("name", BAD)
def test_what_is_just_not_well_has_its_own_bits_and_mode(name: str) -> None:
    value, word, mode_ = BAD[name]
    assert health_of(**GOOD | {name: value}) == (word, mode_)


def test_where_nothing_is_well_no_bit_says_so() -> None:
    bad = {name: value for name, (value, _, _) in BAD.items()}
    warned = health.DROP_AHEAD | health.SIGHT_IMPAIRED | health.TOO_STEEP | health.STOP_ASKED
    assert health_of(**bad) == (warned, health.REPLAYED)


@given(bad=st.sets(st.sampled_from(list(BAD))))
def test_free_is_told_only_while_nothing_that_it_needs_is_bad(bad: set[str]) -> None:
    word, mode = health_of(**GOOD | {name: BAD[name][0] for name in bad})
    is_trusted = bool(word & MAP_VALID)
    needs = {name for name, (_, word, _) in BAD.items() if not word & health.MAP_VALID}
    assert is_trusted == (not bad & needs)
    if mode in (health.RUNNING, health.DEGRADED):
        assert is_trusted
    assert (mode == health.REPLAYED) == ("replayed" in bad)


def test_scans_are_stale_after_three_periods_but_no_sooner_than_the_links_time_out() -> None:
    assert [round(health.stale_s(1 / hz), 9) for hz in (50, 25, 20, 10)] == [0.15, 0.15, 0.15, 0.3]


def test_every_health_that_holds_free_back_has_a_cause_and_every_other_has_none() -> None:
    for word in range(1 << 16):
        cause = health.doubt(word)
        assert (cause == 0) == bool(word & MAP_VALID)
        assert cause == 0 or cause >= causes.FIRST_DOUBT
    well = 0x7F & ~health.MAP_VALID
    assert health.doubt(well) == causes.NOT_MAPPED
    assert health.doubt(well & ~health.POSE_VALID) == causes.NO_POSE
    assert health.doubt(well & ~health.WHEELS_OK & ~health.POSE_VALID) == causes.NO_COUNTS
    assert health.doubt(well & ~health.AHRS_OK & ~health.WHEELS_OK) == causes.NO_ATTITUDE
    assert health.doubt(well & ~health.SCANNER_OK & ~health.AHRS_OK) == causes.NO_SCANS
    assert health.doubt(well & ~health.SCANNER_OK | health.TOO_STEEP) == causes.TILTED
