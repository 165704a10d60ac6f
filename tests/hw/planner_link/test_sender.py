"""The sender: maps equal, budgets kept, the most urgent first, lines of all rates."""

import math

import numpy as np
import pytest
from cobs import cobs
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from core.records import FREE, OBSTACLE
from fakes.wires.wire import MemoryPort
from hw.planner_link.frames import (
    ACK,
    DIGEST,
    GEOM,
    MAP,
    POSE,
    STOP_ZONE,
    STOP_ZONE_BODY,
    encode_stop_zone,
)
from hw.planner_link.scheduler import FrameScheduler
from mapod_link.frames import Frame, bytes_from_frame, frame_from_bytes
from tests.support.cases import examples, few
from tests.support.link.planner_line import ZONE, HeldPort, Line, Sky, SkyTiles
from tests.support.link.planner_sender import whole

INF, NAN = math.inf, math.nan


class Uart(MemoryPort):
    """A serial line that takes bytes as fast as its rate, from a buffer of the kernel's.

    `backlog` is what that buffer does not take.
    """

    def __init__(self, baud: int, buffer_bytes: int = 4096) -> None:
        self._bytes_per_s, self._most = baud / 10, buffer_bytes
        self._left, self._polled_s = 0.0, -1.0  # bytes not sent yet
        self.worst_left = 0.0  # at a tick's begin
        super().__init__(datagrams=False)

    def poll(self, now_s: float) -> bool:
        if self._polled_s >= 0.0:
            self._left = max(0.0, self._left - (now_s - self._polled_s) * self._bytes_per_s)
            self.worst_left = max(self.worst_left, self._left)
        self._polled_s = now_s
        return super().poll(now_s)

    def write(self, data: bytes) -> None:
        super().write(data)
        self._left += len(data)

    @property
    def backlog(self) -> int:
        return max(0, math.ceil(self._left) - self._most)

    @backlog.setter
    def backlog(self, waiting: int) -> None:
        """Known from the time alone."""


@pytest.mark.parametrize(
    ("baud", "size", "rate_hz", "key", "buffer_bytes"),  # the kernel's, that `backlog` leaves out
    few(
        [
            (115_200, 101, 50, bytes(32), 0), (921_600, 201, 50, bytes(32), 0),
            (115_200, 201, 25, None, 4096), (230_400, 201, 50, None, 0),
        ],
        1,
    ),
)  # fmt: skip
def test_no_line_is_ever_more_than_a_tick_behind(
    baud: int, size: int, rate_hz: float, key: bytes | None, buffer_bytes: int
) -> None:
    port, sky = Uart(baud, buffer_bytes), Sky(size, 2)
    line = Line(sky, baud=baud, rate_hz=rate_hz, key=key, port=port, zone=ZONE, tiles=SkyTiles(sky))
    for k in range(round(3 * rate_hz)):
        sky.change(k % 80)
        if k % 40 == 0:
            sky.show(sky.every_other, OBSTACLE if k % 80 else FREE)
        line.tick()
    assert port.worst_left <= baud / 10 / rate_hz
    assert line.link.counters.ticks_held == 0
    assert line.planner.accepted[POSE] >= round(3 * rate_hz) - 1  # with a key none before HELLO
    assert sum(line.tick_bytes) <= 0.86 * baud / 10 * 3 + 2 * baud / 10 / rate_hz


def test_a_full_wire_is_left_alone_until_it_has_room_and_gets_nothing_outdated() -> None:
    port = HeldPort()
    line = Line(Sky(31, 2), baud=115_200, port=port, zone=ZONE)
    line.settle(0.5)
    port.held = True
    for _ in range(30):
        line.sky.change(20)
        line.sky.move(1, 0)
        line.tick()
        assert line.frames == []
    port.held = False
    assert line.link.counters.ticks_held == 30
    line.tick()
    frame: bytes = cobs.decode(line.frames[0].strip(b"\0"))  # type: ignore[no-untyped-call]
    first = frame_from_bytes(frame)
    assert isinstance(first, Frame)
    assert first.t_ms == round(1000 * line.now_s)
    line.settle(0.5)
    assert line.holds_what_is_meant()
    assert not line.planner.suspect
    assert line.planner.numbers.missing == 0


def test_a_line_that_is_too_slow_leaves_out_ticks_and_is_not_overrun() -> None:
    port = Uart(19_200, 256)
    line = Line(Sky(21, 2), baud=19_200, port=port, zone=ZONE)
    for _ in range(200):
        line.sky.change(5)
        line.tick()
    assert line.link.counters.ticks_held > 100
    assert sum(line.tick_bytes) <= 0.87 * 1920 * 4 + 400
    assert port.worst_left < 300


def types(line: Line) -> list[int]:
    return [frame.type for frame in whole(line.frames)]


def test_the_stop_zone_comes_every_100_ms_and_at_once_when_it_changes() -> None:
    line = Line(Sky(21, 2), zone=ZONE)
    line.settle(1.0)
    assert line.planner.accepted[STOP_ZONE] == 10
    while STOP_ZONE not in types(line):
        line.tick()
    for zone in (replace(ZONE, state=3), replace(ZONE, state=3, causes=7), ZONE):
        line.zone = zone
        line.tick()
        assert types(line)[:2] == [POSE, STOP_ZONE]
        line.tick()
        assert STOP_ZONE not in types(line)
    line.zone = replace(ZONE, free_ahead_m=0.1)  # a number alone waits for its turn
    line.tick()
    assert STOP_ZONE not in types(line)


def test_what_a_stop_zone_cannot_say_is_told_as_the_worse() -> None:
    wild = replace(
        ZONE, free_ahead_m=INF, free_behind_m=-3.0, obstacle_ahead_m=80.0, contact_s=NAN,
        allowed_ahead_mps=1e9, allowed_behind_mps=NAN, nearest_m=INF, bearing_rad=NAN,
    )  # fmt: skip
    told = STOP_ZONE_BODY.unpack(encode_stop_zone(wild))
    assert told == (65_534, 65_534, 0, 65_535, 0, 65_534, 0, 65_535, 0, 2, 3)
    told = STOP_ZONE_BODY.unpack(encode_stop_zone(replace(ZONE, free_ahead_m=1.2519)))
    assert told[0] == 1251


def test_a_digest_comes_last_and_once_a_second() -> None:
    line = Line(Sky(21, 2))
    for _ in range(200):
        line.sky.change(3)
        line.tick()
        if DIGEST in types(line):
            assert types(line)[-1] == DIGEST
            assert types(line)[-2] == MAP
    assert line.planner.accepted[DIGEST] == 4
    assert line.planner.accepted[MAP] >= 200
    assert line.planner.needs.digest_ok
    assert line.planner.accepted[GEOM] == 4


@pytest.mark.parametrize("rate_hz", [10, 50])
def test_a_serial_line_that_was_idle_begins_with_a_zero(rate_hz: float) -> None:
    line = Line(Sky(9, 2), baud=115_200, rate_hz=rate_hz)
    line.settle(2 / rate_hz)
    assert [frame[0] == 0 for frame in line.frames[:2]] == [rate_hz == 10, False]


def test_a_new_obstacle_is_told_in_two_ticks() -> None:
    sky = Sky(41, 2)
    line = Line(sky)
    line.settle(1.0)
    sky.show(sky.every_other, OBSTACLE)
    told: list[int] = []
    for _ in range(4):
        line.loss = 1.0 if not told else 0.0  # all of the first tick's frames are lost
        line.tick()
        told.append(int((line.planner.window() == 2).sum()))
    assert told[0] == 0
    assert told[1] == 21 * 21


def test_every_byte_that_goes_out_is_paid_for_also_the_zero_after_a_pause() -> None:
    port = MemoryPort(datagrams=False)
    scheduler = FrameScheduler(port, 115_200, 0.04, None, 130, 1)
    scheduler.earn(1.0)
    scheduler.earn(1.04)
    before = scheduler.budget.credit
    scheduler.queue(POSE, bytes(range(1, 25)))  # COBS of a frame without spare bytes
    scheduler.write(1.04)
    assert len(port.take()) == before - scheduler.budget.credit


@settings(max_examples=examples(30))
@given(
    size=st.integers(3, 40),
    corner=st.tuples(st.integers(-33000, 33000), st.integers(-33000, 33000)),
    moves=st.lists(
        st.tuples(st.integers(-5, 5), st.integers(-5, 5), st.integers(0, 30)), max_size=12
    ),
    seed=st.integers(0, 1000),
)
def test_without_loss_the_planner_holds_the_map_after_every_tick(
    size: int, corner: tuple[int, int], moves: list[tuple[int, int, int]], seed: int
) -> None:
    line = Line(Sky(size, seed, corner))
    for di, dj, count in moves:
        line.sky.move(di, dj)
        line.sky.change(count)
        line.tick()
        assert line.holds_what_is_meant()
        assert not line.planner.suspect


def test_a_line_that_was_quiet_for_long_is_not_flooded_by_the_next_burst() -> None:
    sky = Sky(101, 1)
    line = Line(sky, baud=115_200)
    sky.show(sky.every_other, FREE)
    line.settle(5.0)
    line.tick_bytes.clear()
    sky.show(sky.every_other, OBSTACLE)
    line.settle(0.2)
    carried = 11_520 * 0.85 / 50
    assert max(line.tick_bytes) < 3 * carried
    assert sum(line.tick_bytes[:5]) < 8 * carried


def test_a_slow_line_spends_on_the_refresh_what_changes_leave() -> None:
    line = Line(Sky(101, 1), baud=115_200, ack_every=0)
    line.sky.change(606)
    line.settle(4.0)
    at = np.argwhere(line.planner.window() == 2)[::20]
    line.planner._map._cells[at[:, 0], at[:, 1]] = 1  # gone wrong, and nobody knows
    line.settle(0.6)
    assert line.holds_what_is_meant()


def test_new_obstacles_near_the_robot_go_first_when_not_all_fits() -> None:
    sky = Sky(101, 1)
    line = Line(sky, baud=115_200)
    line.settle(2.0)
    sky.cells[::2, ::2] = FREE  # 2601 runs: far more than a tick carries
    sky.cells[45:56:2, 45:56:2] = OBSTACLE
    sky.cells[0:20:2, 1:21:2] = OBSTACLE
    sky._changed = list(range(101 * 101))
    line.tick()
    near = line.planner.window()[45:56:2, 45:56:2]
    assert (near == 2).all()
    assert int((line.planner.window() == 1).sum()) < 1500
    line.settle(4.0)
    assert line.holds_what_is_meant()


def test_free_is_taken_back_at_once_when_the_map_is_not_to_be_trusted() -> None:
    line = Line(Sky(41, 3))
    line.sky.change(200)
    line.settle(0.5)
    assert (line.planner.window() == 1).any()
    line.sky.trusted = False
    line.tick()
    assert set(line.planner.window().flat) == {0, 2}
    line.settle(1.0)
    assert set(line.planner.window().flat) == {0, 2}
    line.sky.trusted = True
    line.tick()
    assert line.holds_what_is_meant()


def test_acknowledgements_of_the_old_map_on_their_way_do_not_start_the_new_one_again() -> None:
    line = Line(Sky(41, 3))
    line.sky.change(200)
    line.settle(0.5)
    late = line.planner.ack(line.now_s)
    geometries = line.planner.accepted[GEOM]
    line.sky.cells[:] = 0
    line.sky.epoch += 1
    line.tick()
    assert not line.planner.window().any()
    line.port.give(bytes_from_frame(ACK, 99, 0, late))
    line.sky.change(3)
    line.settle(0.2)
    assert line.planner.accepted[GEOM] == geometries + 1
    assert line.holds_what_is_meant()
