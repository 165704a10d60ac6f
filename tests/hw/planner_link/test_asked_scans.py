"""A sweep that was asked for arrives whole or not at all, beside everything else on the line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import SweepPoints
from fakes.planner_mcu.receiver import FakePlanner
from hw.planner_link.answers import POINT_BYTES, pack_points
from hw.planner_link.frames import SCAN, encode_frame
from mapod_link.asking import hello_body
from mapod_link.frames import TILE
from tests.support.link.planner_line import Line, Sky, SkyTiles
from tests.support.link.planner_sender import whole


def sweep_of(points: int, t_s: float, spread_m: float = 10.0, seed: int = 1) -> SweepPoints:
    lens_m = (105.25, -48.9, 0.45)
    offsets_m = np.random.default_rng(seed).uniform(-spread_m, spread_m, (points, 3))
    return SweepPoints(t_s, lens_m, offsets_m + np.array(lens_m), points)


def line_of(points: int, **how: object) -> tuple[Line, SkyTiles]:
    sky = Sky(41, 2)
    tiles = SkyTiles(sky)
    tiles.sweep = sweep_of(points, 99.5)
    line = Line(sky, tiles=tiles, **how)  # type: ignore[arg-type]
    line.settle(1.0)
    return line, tiles


@pytest.mark.parametrize(
    ("baud", "key", "loss"), [(115_200, None, 0.05), (None, bytes(32), 0.1), (None, None, 0.0)]
)
def test_a_sweep_arrives_whole_though_a_newer_one_comes_and_frames_get_lost(
    baud: int | None, key: bytes | None, loss: float
) -> None:
    line, tiles = line_of(541, baud=baud, key=key, loss=loss, seed=4)
    asked = {tiles.sweep.t_s: tiles.sweep} if tiles.sweep else {}
    line.planner.ask_scan()
    for k in range(2000):
        line.sky.change(2)
        tiles.sweep = sweep_of(541, round(line.now_s, 3), seed=k)
        asked[tiles.sweep.t_s] = tiles.sweep
        line.tick()
        if line.planner.scan is not None:
            break
    told = line.planner.scan
    assert told is not None
    meant = asked[told.t_ms / 1000]
    np.testing.assert_allclose(told.points_m, meant.points_m, atol=0.0006)
    assert told.lens_m == meant.lens_m
    assert told.returns == 541


@given(far_m=st.sampled_from([0.1, 32.0, 33.0, 70.0, 2000.0]), points=st.integers(0, 20))
def test_points_are_told_in_as_few_millimetres_as_the_farthest_allows(
    far_m: float, points: int
) -> None:
    sweep = sweep_of(points, 1.0, far_m)
    unit_mm, packed = pack_points(sweep)
    assert len(packed) == POINT_BYTES * points
    told = (
        np.frombuffer(packed, "<i2").astype(float).reshape(points, 3) * unit_mm / 1000
        + sweep.lens_m
    )
    np.testing.assert_allclose(told, sweep.points_m, atol=0.00051 * unit_mm)
    assert unit_mm == 1 or far_m > 32.0


def test_what_is_not_trusted_is_told_as_nothing_and_nobody_keeps_the_old_one() -> None:
    line, tiles = line_of(7)
    line.planner.ask_scan()
    line.settle(0.1)
    assert line.planner.scan is not None
    tiles.sweep = None
    line.planner.ask_scan()
    line.settle(0.1)
    assert line.planner.scan is None


def test_a_sweep_without_a_return_is_a_sweep() -> None:
    line, _ = line_of(0)
    line.planner.ask_scan()
    line.settle(0.1)
    assert line.planner.scan is not None
    assert line.planner.scan.points_m.shape == (0, 3)


def test_asking_at_each_tick_sends_one_question_at_a_time() -> None:
    line, _ = line_of(541, baud=115_200)
    frames = 0
    for _ in range(100):
        line.planner.ask_scan()
        line.tick()
        frames += sum(frame.type == SCAN for frame in whole(line.frames))
    assert line.planner.scan is not None
    assert line.planner.accepted[SCAN] >= 20  # some sweeps, none of them begun anew in between
    assert line.link.counters.ticks_held == 0


def test_nothing_is_taken_of_the_scanner_while_nobody_asks() -> None:
    line, tiles = line_of(541)
    taken = 0

    def counted() -> SweepPoints | None:
        nonlocal taken
        taken += 1
        return tiles.sweep

    tiles.maybe_scan = counted  # type: ignore[method-assign]
    line.planner.ask_tile("height", 0, 0, 20, 20)
    line.settle(1.0)
    assert taken == 0
    assert line.planner.accepted[TILE] > 0
    line.planner.ask_scan()
    line.settle(1.0)
    assert taken == 1


@pytest.mark.parametrize("longest", [48, 52, 60, 368])
def test_short_frames_hold_as_many_points_as_fit_or_none(longest: int) -> None:
    line, _ = line_of(30, planner=FakePlanner(ack_every=1, key=bytes(32)), key=bytes(32))
    line.link._scheduler.limit(longest)
    line.planner.ask_scan()
    for _ in range(40):
        line.tick()
        assert all(len(frame) <= longest for frame in line.frames)
        line.link._scheduler.limit(longest)
    assert (line.planner.scan is not None) == (longest - 20 - 28 >= POINT_BYTES)


def test_another_run_of_the_sender_forgets_the_sweep_of_the_one_before() -> None:
    line, _ = line_of(5)
    line.planner.ask_scan()
    line.settle(0.1)
    assert line.planner.scan is not None
    line.port.give(encode_frame(9, 0, 1, 1, hello_body(5, 10_000)))
    line.link.restart(78)
    line.settle(0.1)
    assert line.planner.scan is None
