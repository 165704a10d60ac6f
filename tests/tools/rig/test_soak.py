"""The soak's short form, and that it notices what it is there for."""

import math

import pytest

from core.motion.odometry import Odometry
from tools.rig.soak import (
    GROWN_MB,
    LEG_S,
    RECOVERS_S,
    WARM_LEGS,
    Ends,
    LegResult,
    Soak,
    is_well,
    main,
)

pytestmark = pytest.mark.slow


def leg(number: int, resident_mb: float, *complaints: str) -> LegResult:
    return LegResult(number, (), complaints, 0.0, (0.0, 0.0), resident_mb, 0.0)


@pytest.fixture(scope="module")
def soak() -> Soak:
    soak = Soak(seed=3)
    list(soak.legs(1.0))
    return soak


def test_a_leg_with_faults_ends_well_and_has_crossed_no_end_yet(soak: Soak) -> None:
    [only] = soak.results[:1]
    assert only.faults
    assert only.complaints == ()
    assert soak.way_m > 1.0
    assert soak.ends.crossed["link, milliseconds"] == 0


def test_minutes_of_driving_with_faults_cross_the_ends_of_clocks_and_counters(soak: Soak) -> None:
    told = [result.complaints for result in soak.legs(9.5 * LEG_S)]  # of some 140 frames a second
    assert told == [()] * len(told)
    crossed = soak.ends.crossed
    for name in (
        "scanner, microseconds",
        "scanner, scans",
        "attitude sensor, samples",
        "link, milliseconds",
        "link, sessions",
        "link, numbers of frames",
    ):
        assert crossed[name] >= 1, name
    assert crossed["wheel 1, counts"] + crossed["wheel 2, counts"] >= 1
    assert is_well(soak)


def test_a_robot_that_has_tipped_over_is_carried_back_upright(soak: Soak) -> None:
    carried = soak.carried
    soak.world._data.qpos[3:7] = math.cos(0.6), math.sin(0.6), 0.0, 0.0
    soak._run(1.0)
    assert soak.world.has_tipped()
    soak._recover(soak.loop.now_s + RECOVERS_S)
    assert soak.carried == carried + 1
    assert not soak.world.has_tipped()
    assert soak._is_well()


def test_a_robot_whose_wheels_turn_and_that_does_not_is_carried_back_and_turned(
    soak: Soak,
) -> None:
    carried, odometry = soak.carried, soak.loop.app.mapper.odometry
    assert isinstance(odometry, Odometry)
    soak.planner._motion, soak.planner._until_s = (0.0, 0.0), math.inf
    soak._run(2.0)
    odometry.wheels.ignored = True
    soak._run(1.0)
    assert not soak._is_well()
    soak.planner._until_s = -math.inf
    soak._recover(soak.loop.now_s + RECOVERS_S)
    assert soak.carried == carried + 1
    assert soak._is_well()


def test_what_is_wrong_at_the_end_of_a_leg_is_told(soak: Soak) -> None:
    soak.loop.app.loop.ticks += 1
    soak.loop.app.monitor.halts += 1
    soak._look()
    soak.planner.numbers.taken += 1000
    said = "; ".join(soak._complaints(0.02, float("nan")))
    for words in ("ticks counted", "frames were sent", "halted", "scanner's clock", "attitude's"):
        assert words in said


def test_memory_that_grows_after_it_was_warm_is_not_well(soak: Soak) -> None:
    for each_mb, well in ((0.0, True), (1.0, False)):
        soak.results = [leg(k, 200.0 + 50 * (k < WARM_LEGS) + each_mb * k) for k in range(60)]
        assert (soak.grown_mb() < GROWN_MB) is well
        assert is_well(soak) is well
    soak.results = [leg(k, 200.0) for k in range(60)] + [leg(60, 200.0, "something")]
    assert not is_well(soak)


def test_an_end_is_crossed_where_a_counter_leaps_by_more_than_half_its_turn() -> None:
    ends = Ends()
    for value in (65000, 65535, 2, 1, 65535, 40000, 5):
        ends.look("counter", value, 2**16)
    assert ends.crossed["counter"] == 3  # over its end, back, and far down at once
    for value in (65530, 4, 64536, 65535, 0):
        ends.look("scans", value, 2**16, most=100)
    assert ends.crossed["scans"] == 2  # but not where it began anew


def test_no_hours_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--hours", "0"])
    assert "--hours must be above 0" in capsys.readouterr().err
