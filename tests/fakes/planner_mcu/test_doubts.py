"""The C planner stops on every doubt, says why, and goes on when the doubt is gone."""

import pytest
from msgspec.structs import replace

from core.driving.zone import OBSTRUCTED, UNSEEN
from core.records import OBSTACLE, UNKNOWN, StopZoneReport
from tests.support.link.c_bench import STOP, Bench, driving, set_out, zone_report
from tools.rig.planner.host import PlannerSettings

SLOW_MPS = 0.15


@pytest.mark.parametrize(
    ("health", "mode", "why"),
    [
        (0x7F, 0, "not running"),
        (0x7F, 3, "not running"),
        (0x7F, 4, "not running"),
        (0x7F & ~0x10, 1, "pose is not valid"),
        (0x7F & ~0x20, 1, "map is not valid"),
        (0x7F | 1 << 7, 1, "drop-off"),
        (0x7F | 1 << 9, 1, "too steep"),
        (0x7F | 1 << 15, 1, "emergency stop"),
    ],
)
def test_what_the_sender_doubts_stops_it_at_once(health: int, mode: int, why: str) -> None:
    bench = driving(Bench())
    bench.health, bench.mode = health, mode
    bench.run(0.2)
    assert bench.newest == (0.0, 0.0)
    assert why in bench.state.why
    bench.health, bench.mode = 0x7F, 1
    bench.run(1.5)
    assert bench.newest[0] > 0.0, "and it goes on when the doubt is gone"


def test_a_silent_sender_stops_it() -> None:
    bench = driving(Bench())
    bench.silent = True
    bench.run(0.4)
    assert (bench.newest, bench.state.why) == ((0.0, 0.0), "the link is stale")


def test_lost_frames_make_it_slow_until_they_are_made_good() -> None:
    bench = driving(Bench())
    bench.moves = (0.6, 0.0)
    bench.run(1.0)
    assert bench.newest[0] > 2 * SLOW_MPS
    for tick in range(30):
        bench.lose = tick % 3 != 2
        bench.tick()
        assert bench.state.suspect == (tick >= 2)
        assert tick < 2 or bench.newest[0] == SLOW_MPS
    bench.lose = False
    bench.run(3.0)
    assert not bench.state.suspect
    assert bench.newest[0] > 2 * SLOW_MPS


@pytest.mark.parametrize("zone", [zone_report(state=STOP), zone_report(0.0, 0.0, state=0)])
def test_the_stop_zone_limits_it_and_stops_it_also_when_it_knows_nothing(
    zone: StopZoneReport,
) -> None:
    bench = driving(Bench())
    bench.moves = (0.5, 0.0)
    bench.zone = zone_report(ahead_mps=0.2)
    bench.run(0.5)
    assert 0.0 < bench.newest[0] <= 0.2
    bench.zone = zone
    bench.run(0.3)
    assert bench.newest == (0.0, 0.0)
    assert "stop zone" in bench.state.why


def test_where_the_stop_zone_stops_it_as_often_as_it_asks_it_goes_back() -> None:
    bench = Bench()
    set_out(bench, 8.0, 0.0)
    bench.run(5.0)
    at_m, asked = bench.place[0], set[bool]()
    for _ in range(600):
        is_ahead = bench.newest[0] > 0.0
        bench.zone = zone_report(state=STOP) if is_ahead else zone_report()
        bench.moves = bench.newest if bench.newest[0] < 0.0 else (0.0, 0.0)
        asked.add(is_ahead)
        bench.tick()
        if bench.place[0] < at_m - 1.0:
            break
    assert asked == {True, False}
    assert bench.place[0] < at_m - 1.0


def test_a_sender_that_starts_anew_ends_the_drive_and_nothing_is_assumed_clear_then() -> None:
    bench = Bench(PlannerSettings(start_clear_m=9.0))
    bench.cells[:] = UNKNOWN
    driving(bench)
    bench.session += 1
    bench.begin_link()
    bench.run(2.0)
    assert bench.state.state == "stopped"
    assert bench.state.why == "the sender has started anew"
    assert bench.newest == (0.0, 0.0)
    bench.planner.goal(5.0, 0.0)
    bench.asked.clear()
    bench.run(5.0)
    assert bench.state.state == "driving"
    assert {drive[:2] for drive in bench.asked} == {(0.0, 0.0)}


def test_a_robot_that_does_not_obey_is_let_go_of_now_and_then() -> None:
    bench = driving(Bench())
    bench.run(12.0)
    zeros = sum(drive[:2] == (0.0, 0.0) for drive in bench.asked)
    assert zeros >= 4
    assert any(drive[:2] != (0.0, 0.0) for drive in bench.asked[-40:])
    while bench.state.state != "stopped":  # and in the end it is given up
        assert bench.now_s < 270.0
        bench.run(1.0)


def test_a_start_that_the_sender_does_not_vouch_for_any_more_is_assumed_clear_no_farther() -> None:
    bench = Bench(PlannerSettings(start_clear_m=9.0))
    bench.cells[:] = UNKNOWN
    driving(bench)
    bench.zone = replace(zone_report(state=STOP), causes=UNSEEN)
    bench.run(40.0)
    bench.zone = zone_report()
    bench.run(2.0)
    assert bench.newest == (0.0, 0.0)  # all around is unknown
    bench = Bench(PlannerSettings(start_clear_m=9.0))
    bench.cells[:] = UNKNOWN
    driving(bench)
    bench.zone = replace(zone_report(state=STOP), causes=UNSEEN | OBSTRUCTED)
    bench.run(20.0)
    bench.zone = zone_report()
    asked: list[float] = []
    bench.run(10.0, lambda: asked.append(bench.newest[0]))
    assert max(asked) > 0.0  # that is another matter


@pytest.mark.slow
def test_where_no_way_leads_it_gives_up_in_the_end_and_says_why() -> None:
    bench = Bench()
    bench.put((4.0, 4.4), (-10.2, 10.2), OBSTACLE)
    set_out(bench, 8.0, 0.0)
    while bench.state.state != "stopped":
        assert bench.now_s < 400.0
        bench.run(1.0)
    assert bench.state.why in ("no way over seen ground", "the goal is too near to an obstacle")
