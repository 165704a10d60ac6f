"""What a recorded app tells beside its calls: its state now and then, and what went wrong."""

import json
from typing import Any, cast

import numpy as np
import pytest

import recorder
from fakes.scenes.scene import Scene, Solid
from recording.foxglove import Messages, RobotShape
from recording.packing import Heights, scan_from, state_from
from recording.process import WriterProcess
from recording.records import FLIGHT, HEIGHTS, SCAN, STATE, Record
from tests.support.robot.recorded import ListTap, RecordedLoop
from tests.support.robot.shipped import FLOOR, shipped

READY: dict[str, Any] = {"enable_motors": True, "start_clear_m": 12.0}


def told(loop: RecordedLoop, kind: bytes) -> list[Record]:
    assert isinstance(loop.tap, ListTap)
    return [record for record in loop.tap.records if record.kind == kind]


def flights(loop: RecordedLoop) -> list[dict[str, str]]:
    return [json.loads(record.data) for record in told(loop, FLIGHT)]


def test_states_are_the_apps_own_at_the_rate_of_the_settings() -> None:
    loop = RecordedLoop(ListTap, shipped(record={"rate_hz": 5}))
    loop.run(3.2)
    taken = told(loop, STATE)
    assert 14 <= len(taken) <= 17
    state = state_from(taken[-1].t_s, taken[-1].data)
    window = loop.app.mapper.maps.window
    assert state.window is not None
    assert (state.window.corner_i, state.window.corner_j) == (
        window.grid.corner_i, window.grid.corner_j
    )  # fmt: skip
    codes = np.array([2, 0, 1])[1 - loop.map_now()]  # of obstacle, unknown, free
    assert (state.window.states != codes).mean() < 0.05  # what few scans changed since
    assert (codes == 1).sum() > 10
    assert (codes == 2).sum() > 20
    [*_, scanned] = told(loop, SCAN)
    scan = scan_from(scanned.data)
    assert len(scan.ranges_m) == 481
    assert np.isfinite(scan.ranges_m).sum() > 400
    assert scan.points_map is not None
    points = loop.app.tiles.maybe_scan()
    assert points is not None
    assert len(scan.points_map) > 400
    assert np.abs(scan.points_map.mean(axis=0) - points.points_m.mean(axis=0)).max() < 0.2
    told_heights = told(loop, HEIGHTS)
    heights = Heights()
    whole = [found for record in told_heights if (found := heights.take(record.data))]
    assert 1 <= len(whole) <= 2  # they are gathered every two seconds
    place, height_m, _ = whole[-1]
    assert Heights().take(told_heights[-1].data) is None  # of which the first rows are missing
    layer = loop.app.mapper.maybe_layer("height")
    assert layer is not None
    assert (place.corner_i, place.corner_j) == (layer.corner_i, layer.corner_j)
    both = np.isfinite(height_m) & np.isfinite(layer.values)
    assert both.sum() > 50
    assert np.abs(height_m - layer.values)[both].mean() < 0.02
    shape = RobotShape(0.5, 0.2, 0.6, (0.2, 0.0, 1.0), (0.0, 0.1, 0.0))
    topics = {topic for topic, _, _ in Messages(shape, 0.0).of_state(state)}
    assert {"/map", "/pose", "/tf", "/scene", "/health"} <= topics


def test_a_stop_before_an_obstacle_is_worth_a_flight_and_standing_there_is_none() -> None:
    box = Solid("box", (3.33, 3.83), (-0.83, 0.87), (0.0, 0.93))
    scene = Scene("hall", (FLOOR, box))
    loop = RecordedLoop(ListTap, shipped(robot=READY), scene, drives=False)
    loop.run(2.0)
    for _ in range(110):
        loop.planner.drive(loop.now_s, 0.9, 0.0, 0.2)
        loop.run(0.05)
    assert loop.app.pilot.control.blocked_by == "an obstacle is in the way"
    [flight] = flights(loop)
    why = "an obstacle is in the way"
    assert flight == {"cause": "stop", "message": why, "after_s": 1.0}


def test_a_device_that_is_lost_is_worth_one_flight_in_ten_seconds() -> None:
    loop = RecordedLoop(ListTap, shipped())
    loop.run(2.5)
    for _ in range(2):
        loop.wires["scanner"].cut = True
        loop.run(0.5)
        loop.wires["scanner"].cut = False
        loop.run(2.0)
    [flight] = flights(loop)
    assert flight["cause"] in ("fault", "scanner-lost")
    loop.run(8.0)
    loop.wires["ahrs"].cut = True
    loop.run(0.5)
    assert len(flights(loop)) == 2


def test_the_end_waits_for_a_slow_writer_once_and_no_longer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s, waited_s = [100.0], list[float]()

    class SlowTap(ListTap):
        def end(self, wait_s: float) -> None:
            now_s[0] += wait_s - 0.5

    class SlowProcess:
        def close(self, wait_s: float) -> bool:
            waited_s.append(wait_s)
            return False

        def reports(self) -> list[dict[str, Any]]:
            return []

        def let_go(self) -> None: ...

    monkeypatch.setattr("recorder.time.monotonic", lambda: now_s[0])
    process = cast(WriterProcess, SlowProcess())
    recorder.Recorder(shipped(), "0.1", SlowTap(lambda: 0.0), process).close()
    assert waited_s == [0.5]
