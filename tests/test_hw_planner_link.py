"""The sender against the receiver of the fakes: maps equal, budgets kept, gaps repaired."""

import math
import random

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import FREE, OBSTACLE, ObstacleWindow, PoseReport
from fakes.planner import FakePlanner
from fakes.wire import MemoryPort
from hw.planner_frames import MAP, POSE
from hw.planner_link import PlannerLink

I8 = npt.NDArray[np.int8]
I32 = npt.NDArray[np.int32]
POSE_REPORT = PoseReport(1.0, 2.0, 0.3, 0.0, 0.0, 0.5, 0.1, 0x7F, 0.02, 0.01, 0.05, 1)
CODE = np.array([0, 2, 1], dtype=np.uint8)  # by cell value: unknown, obstacle (1), free (-1)


class Sky:
    """A window that changes and moves at random, as the obstacle map does."""

    def __init__(self, size: int, seed: int, corner: tuple[int, int] = (0, 0)) -> None:
        self.size, self.random = size, np.random.default_rng(seed)
        self.cells: I8 = np.zeros((size, size), dtype=np.int8)
        self.corner = corner
        self.epoch = 0
        self.trusted = True
        self._changed: list[int] = []

    def change(self, count: int) -> None:
        """Some cells get another meaning; in lumps, as beams touch them."""
        for _ in range(count):
            j, i = self.random.integers(0, self.size, 2)
            value = self.random.choice([FREE, FREE, OBSTACLE, 0])
            for n in range(int(self.random.integers(1, 6))):
                at = (int(j), int(i + n) % self.size)
                self.cells[at] = value
                self._changed.append(at[0] * self.size + at[1])

    def move(self, di: int, dj: int) -> None:
        """The window moves: what enters is unknown."""
        old_i, old_j = self.corner
        self.corner = (old_i + di, old_j + dj)
        for i in range(self.corner[0], self.corner[0] + self.size):
            if not old_i <= i < old_i + self.size:
                self.cells[:, i % self.size] = 0
        for j in range(self.corner[1], self.corner[1] + self.size):
            if not old_j <= j < old_j + self.size:
                self.cells[j % self.size, :] = 0

    def window(self) -> ObstacleWindow:
        """As the core hands it over."""
        changed: I32 = np.array(sorted(set(self._changed)), dtype=np.int32)
        self._changed.clear()
        return ObstacleWindow(self.cells, *self.corner, changed, self.epoch, self.trusted)

    def meant(self) -> npt.NDArray[np.uint8]:
        """What the planner should hold, in window coordinates."""
        cells = np.roll(self.cells, (-self.corner[1], -self.corner[0]), axis=(0, 1))
        codes = CODE[cells]
        return codes if self.trusted else np.where(codes == 1, 0, codes).astype(np.uint8)


class HeldPort(MemoryPort):
    """A wire whose far end takes bytes only when the test says so."""

    held = False

    @property
    def backlog(self) -> int:
        """Bytes that wait."""
        return 100 if self.held else 0

    @backlog.setter
    def backlog(self, waiting: int) -> None:
        """The test alone decides."""


class Line:
    """A sender and a receiver with a wire in between that may lose frames."""

    def __init__(
        self,
        sky: Sky,
        *,
        baud: int | None = None,
        rate_hz: float = 50,
        loss: float = 0.0,
        ack_every: int = 1,
        key: bytes | None = None,
        seed: int = 0,
        port: MemoryPort | None = None,
    ) -> None:
        self.sky, self.rate_hz, self.loss = sky, rate_hz, loss
        self.port = port or MemoryPort(datagrams=baud is None)
        self.link = PlannerLink(
            self.port,
            size=sky.size,
            cell_mm=200,
            session=77,
            tick_s=1 / rate_hz,
            line_baud=baud,
            key=key,
            stale_ms=150,
        )
        self.planner = FakePlanner(ack_every=ack_every, key=key)
        self.now_s, self.random = 100.0, random.Random(seed)
        self.tick_bytes: list[int] = []
        self.frames: list[bytes] = []  # of the last tick
        self.last_arrived = True

    def tick(self) -> None:
        """One tick of the link."""
        self.now_s += 1 / self.rate_hz
        self.link.step(self.now_s, POSE_REPORT, self.sky.window())
        pieces = self.port.take_datagrams()
        self.tick_bytes.append(sum(map(len, pieces)))
        self.frames = pieces
        self.last_arrived = True  # the tick's last frame: without it, no gap can show yet
        for piece in pieces:
            self.last_arrived = self.random.random() >= self.loss
            if self.last_arrived:
                if self.port.datagrams:
                    self.planner.feed_datagram(self.now_s, piece)
                else:
                    self.planner.feed_stream(self.now_s, piece)
        for frame in self.planner.poll(self.now_s):
            if self.random.random() >= self.loss:
                self.port.give(frame if self.port.datagrams else self._serial(frame))

    @staticmethod
    def _serial(frame: bytes) -> bytes:
        from fakes.planner_frames import serial_from_frame

        return serial_from_frame(frame)

    def settle(self, seconds: float) -> None:
        """Let time pass without changes."""
        for _ in range(round(seconds * self.rate_hz)):
            self.tick()

    def holds_what_is_meant(self) -> bool:
        """Receiver's map equals the sender's, cell by cell."""
        return bool(np.array_equal(self.planner.window(), self.sky.meant()))


@given(
    size=st.integers(3, 40),
    corner=st.tuples(st.integers(-33000, 33000), st.integers(-33000, 33000)),
    moves=st.lists(
        st.tuples(st.integers(-5, 5), st.integers(-5, 5), st.integers(0, 30)), max_size=25
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


@pytest.mark.parametrize("ack_every", [0, 1])
@pytest.mark.parametrize("baud", [None, 115_200, 921_600])
@pytest.mark.parametrize("corner", [(0, 0), (32_760, -32_770)])
def test_with_loss_no_free_stands_for_an_obstacle_unless_suspect_and_all_is_repaired(
    ack_every: int, baud: int | None, corner: tuple[int, int]
) -> None:
    line = Line(Sky(31, 5, corner), baud=baud, loss=0.05, ack_every=ack_every, seed=9)
    told = np.zeros((31, 31), dtype=np.uint8)
    for k in range(400):
        if k % 7 == 0:
            line.sky.move(k // 7 % 3 - 1, k // 7 % 2)
        line.sky.change(4)
        line.tick()
        corner_i, corner_j = line.sky.corner
        told = np.roll(line.link._map.told.reshape(31, 31), (-corner_j, -corner_i), axis=(0, 1))
        if line.last_arrived and not line.planner.suspect:
            wrong = (line.planner.window() == 1) & (told == 2)
            assert not wrong.any(), k
    line.loss = 0.0
    line.settle(3.0)
    assert line.holds_what_is_meant()
    assert not line.planner.suspect
    assert line.planner.gaps > 0


def test_a_slow_line_is_never_asked_for_more_than_it_carries() -> None:
    line = Line(Sky(101, 1), baud=115_200)
    for _ in range(250):
        line.sky.change(60)
        line.tick()
    carried = 11_520 * 0.85 / 50
    sums = np.convolve(line.tick_bytes, np.ones(50), "valid")
    assert float(sums.max()) <= 50 * carried + 4 * carried
    assert max(line.tick_bytes) < 6 * carried


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
    assert not (line.planner.window() == 1).any()
    assert (line.planner.window() == 2).any()
    line.settle(1.0)
    assert not (line.planner.window() == 1).any()
    line.sky.trusted = True
    line.tick()
    assert line.holds_what_is_meant()


def test_every_tick_has_a_pose_and_a_map_frame_and_a_geometry_each_second() -> None:
    line = Line(Sky(101, 1), baud=115_200)
    for _ in range(100):
        line.tick()
    kinds = line.planner.accepted
    assert kinds[POSE] == 100
    assert kinds[MAP] >= 100
    assert 2 <= kinds[1] <= 4


def test_an_erased_map_begins_a_new_epoch_on_both_ends() -> None:
    line = Line(Sky(21, 3))
    line.sky.change(100)
    line.settle(0.2)
    geom = line.planner.geom
    line.sky.cells[:] = 0
    line.sky.epoch += 1
    line.tick()
    assert not line.planner.window().any()
    assert geom is not None
    assert line.planner.geom is not None
    assert line.planner.geom.geom_id != geom.geom_id


def test_need_full_and_a_restarted_planner_get_everything_again() -> None:
    line = Line(Sky(21, 3))
    line.sky.change(100)
    line.settle(0.5)
    line.planner.need_full = True
    line.settle(0.2)
    assert line.holds_what_is_meant()
    line.planner = FakePlanner(seed=99, ack_every=1)
    line.settle(0.5)
    assert line.holds_what_is_meant()


def test_a_planner_that_is_too_small_gets_poses_but_no_map() -> None:
    line = Line(Sky(21, 3))
    line.planner = FakePlanner(ack_every=1, max_cells=400)
    line.settle(0.5)
    assert "lower obstacle.window_cells" in line.link.refusal
    before = line.planner.accepted[MAP]
    line.settle(0.5)
    assert line.planner.accepted[MAP] == before


def test_while_the_line_is_behind_nothing_is_sent_and_nothing_forgotten() -> None:
    port = HeldPort()
    line = Line(Sky(21, 3), baud=115_200, port=port)
    line.settle(0.2)
    line.sky.change(50)
    port.held = True
    sent = line.link.frames_sent
    line.settle(0.2)
    assert line.link.frames_sent == sent
    assert line.link.ticks_held == 10
    port.held = False
    line.settle(1.0)
    assert line.holds_what_is_meant()
    assert line.planner.missing == 0


def test_an_authenticated_link_is_understood_with_the_key_and_not_with_another() -> None:
    line = Line(Sky(21, 3), key=bytes(range(32)))
    line.sky.change(50)
    line.settle(1.0)
    assert line.holds_what_is_meant()
    stranger = FakePlanner(key=bytes(32))
    for frame in line.frames:
        stranger.feed_datagram(line.now_s, frame)
    assert stranger.blank
    assert sum(stranger.accepted.values()) == 0


def test_two_senders_with_the_same_input_send_the_same_bytes() -> None:
    runs = []
    for _ in range(2):
        line = Line(Sky(31, 8), loss=0.02)
        frames = b""
        for k in range(100):
            line.sky.move(k % 2, 0)
            line.sky.change(5)
            line.tick()
            frames += b"".join(line.frames)
        runs.append(frames)
    assert runs[0] == runs[1]


@given(pieces=st.lists(st.binary(max_size=60), max_size=20), datagrams=st.booleans())
def test_no_answer_makes_the_sender_raise(pieces: list[bytes], datagrams: bool) -> None:
    line = Line(Sky(9, 1), baud=None if datagrams else 115_200)
    line.tick()
    for piece in pieces:
        line.port.give(piece)
        line.tick()
    assert line.link.answers_rejected >= 0
    assert not math.isinf(line.link.bytes_sent)
