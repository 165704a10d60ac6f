"""The app as the live loop lets it take turns: when one is due, and as bytes arrive."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app import TURNS, App, LinkPace
from core.driving.control import LOOP_S
from core.driving.health import NO_OVERRUN
from tests.support.robot.closed_loop import ClosedLoop
from tests.support.robot.shipped import shipped
from wiring import no_ports

FINE_HZ = 1000  # steps of the simulated world
MOTORS = {"enable_motors": True, "unknown_stops": False}


class LiveLoop(ClosedLoop):
    """World and fakes in steps of a millisecond; the app takes a turn only where the loop would."""

    def __init__(self, **robot: bool) -> None:
        config = shipped(loop={"rate_hz": FINE_HZ}, robot=robot)
        super().__init__(config, drives=not robot)
        self.turns: list[tuple[str, ...]] = []  # names of what was readable
        self.run(4.0)
        self.turns.clear()

    def step(self) -> None:
        self._advance()
        ports = {**self.ports, "planner": self.link_port}.items()
        plan = self.app.plan
        listened = [
            p for p, from_s in zip(plan.ports, plan.hears_s, strict=False) if self.now_s >= from_s
        ]
        heard = {name: port for name, port in ports if port.has_arrived and port in listened}
        if heard or self.now_s >= plan.due_s:
            self.turns.append(tuple(heard))
            self.app.turn(self.now_s, heard.values())
        self._link_wire.step(self.now_s)


@pytest.fixture(scope="module")
def live() -> LiveLoop:
    return LiveLoop()


def test_all_is_heard_and_mapped_though_only_what_is_due_or_readable_is_looked_at(
    live: LiveLoop,
) -> None:
    app, pairs_s, ticks = live.app, set[float](), live.app.loop.ticks
    added, dropped = app.mapper.counts.scans_added, app.mapper.counts.scans_dropped
    live.run(1.0, lambda: pairs_s.add(app.mapper.delivered_counts_s))
    assert [device.status.state for device in app.devices.of_scans] == ["running"] * 3
    assert app.mapper.counts.scans_added - added == pytest.approx(25, abs=1)
    assert (app.mapper.counts.scans_dropped, app.mapper.odometry.breaks) == (dropped, 0)
    assert len(pairs_s) == pytest.approx(20, abs=2)
    assert app.loop.ticks - ticks <= 110  # of 1000: the link's, one for each query on its way
    assert sum("drive" in heard for heard in live.turns) <= 80  # not for each of 500 characters
    assert live.planner.pose is not None
    assert live.planner.pose.health & NO_OVERRUN  # though steps are rare


def test_the_first_turn_is_never_late() -> None:
    app = App(shipped(), no_ports(shipped()), session=0)
    for now_s in (100.0, 100.02):
        app.turn(now_s)
        assert app.report(now_s)[1].health & NO_OVERRUN
    app.turn(100.02 + 1.1 * LOOP_S)
    assert not app.report(100.2)[1].health & NO_OVERRUN


def test_a_wire_that_never_falls_silent_does_not_keep_the_app_from_its_ticks(
    live: LiveLoop,
) -> None:
    app, ticks = live.app, live.app.loop.ticks
    for _ in range(10 * TURNS):
        app.turn(live.now_s, [app.devices.ahrs.port])
        if not app.plan.ports:
            assert app.plan.due_s <= live.now_s + 1 / FINE_HZ + 1e-9
            live.step()
    assert app.loop.ticks - ticks >= 9


def test_a_device_that_falls_silent_is_given_up_in_time(live: LiveLoop) -> None:
    def runs() -> bool:
        return live.app.devices.ahrs.status.state == "running"

    live.wires["ahrs"].mute = True
    begun_s = live.now_s
    while runs():
        live.step()
    assert live.now_s - begun_s == pytest.approx(0.5, abs=0.03)
    live.wires["ahrs"].mute = False
    live.run(3.0)
    assert runs()


def test_a_device_that_is_gone_brings_the_ticks_back(live: LiveLoop) -> None:
    live.wires["ahrs"].cut = True
    live.run(0.1)
    ticks = live.app.loop.ticks
    live.run(0.1)
    assert live.app.loop.ticks - ticks > 90
    live.wires["ahrs"].cut = False
    live.run(3.0)
    assert live.app.devices.ahrs.status.state == "running"


def test_a_wish_to_drive_is_heard_as_it_arrives_and_the_wheels_follow() -> None:
    loop = LiveLoop(**MOTORS)
    loop.planner.drive(loop.now_s, 0.1, 0.0, 0.5)
    asked_s, newest = loop.now_s, loop.app.planners.requests.newest
    while loop.app.planners.requests.newest is newest:
        loop.step()
        assert loop.now_s < asked_s + 0.004
    for _ in range(10):
        loop.planner.drive(loop.now_s, 0.1, 0.0, 0.5)
        loop.run(0.1)
    assert loop.rig.drive.powers() != (0, 0)


INSTANTS = st.lists(st.tuples(st.floats(0.0005, 0.03), st.booleans()), min_size=1, max_size=200)


@given(INSTANTS)
def test_the_planner_hears_each_tick_and_a_new_map_within_half_of_one(
    instants: list[tuple[float, bool]],
) -> None:
    pace, now_s, told_s, mapped_s = LinkPace(0.02), 0.0, 0.0, math.inf
    pace.told(0.0)
    for passed_s, mapped in instants:
        before_s, now_s = now_s, now_s + passed_s
        mapped_s = min(mapped_s, now_s) if mapped else mapped_s
        due = pace.is_due(now_s, mapped)
        assert due or now_s < told_s + 0.025
        assert due or now_s < max(mapped_s, told_s + 0.01)
        assert not due or now_s > told_s + 0.01 - 2e-6 or before_s == 0.0
        if due:
            pace.told(now_s)
            told_s, mapped_s = now_s, math.inf
        assert pace.due_s > now_s
