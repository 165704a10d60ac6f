"""The bench of the planner link: its drive, its line, its meter, and what a link has to keep."""

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest

from core.records import FREE, OBSTACLE, UNKNOWN, ObstacleMap
from mapod_link import bodies
from mapod_link.frames import MAP, bytes_from_frame, frame_from_bytes
from mapod_link.serial_line import serial_from_frame
from tests.support.cases import few
from tools.bench.drive import Playback, drive
from tools.bench.link import row
from tools.bench.link_meter import Meter, View
from tools.bench.link_run import LOSS, Case, Lane, LinePort, Run, measure

SHORT_S = 3.0
FRAME = bytes_from_frame(MAP, 1, 1000, bytes(10) + b"\x01")


def test_playing_slowly_tells_the_same_windows_as_playing_fast() -> None:
    fast, slow = (Playback(drive(101, SHORT_S)) for _ in range(2))
    told: dict[tuple[int, int], int] = {}
    for tick in range(round(SHORT_S * 10)):
        for part in range(4, -1, -1):
            window = fast.until(tick / 10 - part / 50)
            told |= states(window, window.changed)
        merged = slow.until(tick / 10)
        np.testing.assert_array_equal(merged.cells, window.cells)
        assert (merged.corner_i, merged.corner_j) == (window.corner_i, window.corner_j)
    there = states(merged, np.flatnonzero(merged.cells))
    assert len(there) > 200
    assert {cell: told.get(cell) for cell in there} == there
    all_told = states(merged, np.arange(merged.cells.size)).keys() & told.keys()
    assert {cell for cell in all_told if told[cell] != UNKNOWN} == there.keys()


def states(window: ObstacleMap, at: npt.NDArray[np.integer]) -> dict[tuple[int, int], int]:
    """States of cells of the ring by the world cell that each stands for."""
    size, ci, cj = len(window.cells), window.corner_i, window.corner_j
    i, j = ci + (at % size - ci) % size, cj + (at // size - cj) % size
    return dict(
        zip(zip(i.tolist(), j.tolist(), strict=True), window.cells.flat[at].tolist(), strict=True)
    )


def test_a_serial_line_takes_ten_bits_a_byte_and_datagrams_have_only_their_delay() -> None:
    lane = Lane(115_200, 0.010, 0.0, 1)
    data = serial_from_frame(FRAME)
    lane.send(5.0, data + data)
    lane.send(5.0, data)
    byte_s = 10 / 115_200
    assert lane.waiting_s(5.0) == pytest.approx(3 * len(data) * byte_s)
    assert lane.arrivals(5.0) == []
    times = [arrival.at_s for arrival in lane.arrivals(6.0)]
    assert times == pytest.approx([5.010 + k * len(data) * byte_s for k in (1, 2, 3)])
    lane.send(7.0, data)
    assert lane.waiting_s(7.0) == pytest.approx(len(data) * byte_s)
    assert lane.bytes_sent == 4 * len(data)
    lane = Lane(None, 0.010, 0.0, 1)
    lane.send(5.0, FRAME)
    lane.send(5.0, FRAME)
    assert [(a.at_s, a.frame) for a in lane.arrivals(5.02)] == [(5.010, FRAME)] * 2


def test_the_ports_backlog_is_what_its_buffer_cannot_take() -> None:
    down, up = Lane(9600, 0.0, 0.0, 1), Lane(9600, 0.0, 0.0, 2)
    port = LinePort(down, up, buffer_bytes=20)
    data = serial_from_frame(FRAME)
    port.write(data)
    assert port.backlog == len(data) - 20
    port.now_s = len(data) * 10 / 9600
    assert port.backlog == 0
    up.send(port.now_s, data)
    port.now_s += 1.0
    assert port.read() == [data]
    assert port.read() == []


class Scripted:
    """A meter on a window of 5 x 5 whose receiver does as the test says."""

    def __init__(self) -> None:
        self.meter = Meter(5)
        self.cells = np.zeros((5, 5), dtype=np.uint8)
        self.world = np.zeros((5, 5), dtype=np.int8)
        self.is_suspect = False
        self.mean(0.0, [], UNKNOWN)
        self.meter.begin(0.0)

    @property
    def view(self) -> View:
        return View(self.cells, (0, 0), self.is_suspect)

    def mean(self, now_s: float, at: list[int], state: int) -> None:
        self.world.ravel()[at] = state
        changed = np.array(at, dtype=np.int32)
        self.meter.mean(now_s, ObstacleMap(self.world, 0, 0, changed, 0, True))

    def send(self, at_s: float, tick_s: float, start: int, ops: bytes, arrives: bool) -> None:
        head = bodies.MAP_HEAD.pack(0, 0, 0, 7, start.to_bytes(3, "little"))
        frame = frame_from_bytes(bytes_from_frame(MAP, 1, round(1000 * tick_s), head + ops))
        assert not isinstance(frame, str)
        if arrives:
            self.meter.take(at_s, tick_s, frame, self.view)
        else:
            self.meter.lose(at_s, frame, self.view)


def test_a_new_obstacle_is_timed_from_its_tick_to_the_frame_that_tells_it() -> None:
    rig = Scripted()
    rig.mean(1.00, [7, 8], OBSTACLE)
    rig.cells.ravel()[7] = bodies.OBSTACLE
    rig.send(1.03, 1.00, 7, b"\x80", arrives=True)
    rig.mean(1.04, [], UNKNOWN)
    rig.cells.ravel()[8] = bodies.OBSTACLE
    rig.send(1.07, 1.04, 8, b"\x80", arrives=True)
    got = rig.meter.readings
    assert np.concatenate(got.told_s) == pytest.approx([0.0, 0.04])
    assert np.concatenate(got.held_s) == pytest.approx([0.03, 0.07])
    rig = Scripted()  # one that is gone before it was told counts apart
    rig.mean(1.00, [7], OBSTACLE)
    rig.mean(1.04, [7], FREE)
    rig.send(1.07, 1.04, 7, b"\x40", arrives=True)
    assert np.concatenate(rig.meter.readings.told_s).size == 0


def test_a_cell_that_a_loss_has_hit_and_suspect_time_are_timed() -> None:
    rig = Scripted()
    rig.mean(1.00, [7, 8], FREE)
    rig.cells.ravel()[8] = bodies.FREE
    rig.send(1.03, 1.00, 7, b"\x41", arrives=False)  # 7 and 8; 8 is right by chance
    rig.send(1.07, 1.04, 0, b"\x00", arrives=True)
    rig.cells.ravel()[7] = bodies.FREE
    rig.send(1.15, 1.12, 7, b"\x40", arrives=True)
    assert np.concatenate(rig.meter.readings.recovered_s) == pytest.approx([0.12])
    rig = Scripted()
    for at_s, is_suspect in ((1.0, False), (1.1, True), (1.2, True), (1.4, False), (1.6, True)):
        rig.is_suspect = is_suspect
        rig.send(at_s, at_s, 0, b"\x00", arrives=True)
    rig.meter.end(1.7)
    assert rig.meter.readings.suspect_s == pytest.approx(0.4)


class Careless(Run):
    """A receiver that never says that it may be wrong."""

    def __init__(self, case: Case) -> None:
        super().__init__(case)
        view = self.far.view
        self.far.view = lambda: dataclasses.replace(  # type: ignore[method-assign]
            view(), is_suspect=False
        )


def test_the_meter_sees_a_receiver_that_hides_its_doubt() -> None:
    run = Careless(Case(115_200, 25, "tick", 101, drives=False, loss=0.2, seconds=SHORT_S))
    run.go()
    assert run.meter.readings.unsafe > 0


@pytest.mark.parametrize(
    "case",
    [
        Case(115_200, 25, "tick", 101, drives=False, seconds=SHORT_S),
        pytest.param(Case(115_200, 25, "tick", seed=2), marks=pytest.mark.slow),
        pytest.param(Case(115_200, 25, "10 Hz", seed=2), marks=pytest.mark.slow),
    ],
    ids=lambda case: f"{case.ack} {case.seconds:g} s {case.drives}",
)
def test_the_line_to_judge_by_tells_soon_and_mends_soon(case: Case) -> None:
    """115 200 baud, 25 Hz, 1 % of the frames lost."""
    got = measure(case)
    assert got.new_obstacles > 40 * case.seconds
    assert got.held_ms[1] <= 2 * 1000 / case.rate_hz
    assert got.recovered > 0
    assert got.recovery_ms[1] <= 500.0
    assert got.worst_wait_ticks <= 1.0
    assert got.bytes_per_s <= 0.85 * 11_520
    assert got.unsafe == 0
    assert row(case, got).startswith(f"115.2 k 25 Hz {case.size} {case.ack} ")


@pytest.mark.parametrize(
    "case",
    few(
        [
            Case(115_200, 50, "none", 101, drives=False, loss=0.1),
            Case(None, 50, "tick", 101, drives=False, loss=0.3),
            Case(115_200, 50, "tick", 101, drives=False),
            Case(921_600, 50, "tick", 201, drives=False, loss=0.2),
            Case(115_200, 25, "10 Hz", 201, drives=False, loss=0.05),
            Case(115_200, 10, "tick", 401, drives=False),
        ],
        3,
    ),
    ids=lambda case: f"{case.line} {case.size} {case.ack} {case.loss}",
)
def test_whoever_is_sure_holds_no_wrong_free(case: Case) -> None:
    got = measure(dataclasses.replace(case, seconds=SHORT_S))
    assert got.unsafe == 0
    if case.loss == LOSS:
        assert got.worst_wait_ticks <= 1.0
