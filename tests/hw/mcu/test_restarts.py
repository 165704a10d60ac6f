"""The C header and a sender that starts anew, again and again, while the receiver runs on."""

import numpy as np
import numpy.typing as npt
import pytest

from fakes.wires.wire import MemoryPort
from hw.planner_link.receivers import one_link
from tests.support.c_link import CReceiver
from tests.support.planner_line import POSE_REPORT, Sky

SIZE, TICK_S, KEY, NONCE = 31, 0.02, bytes(range(32)), 5


class Runs:
    """One receiver, and one run of the sender after the other."""

    def __init__(self, receiver: CReceiver, key: bytes | None = None) -> None:
        self.receiver, self._key = receiver, key
        self.sky = Sky(SIZE, 1)
        self.sky.change(400)
        self.now_s, self._session = 100.0, 1000

    def restart(self) -> None:
        """The next run; nothing of the one before is on the wire any more."""
        self._session += 1
        self.port = MemoryPort(datagrams=True)
        self.link = one_link(self.port, size=SIZE, session=self._session, key=self._key)
        self.sky.epoch += 1

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self.link.step(self.now_s, POSE_REPORT, self.sky.window())
            for datagram in self.port.take_datagrams():
                self.receiver.feed_datagram(self.now_s, datagram)
            for answer in self.receiver.poll(self.now_s):
                self.port.give(answer)

    @property
    def is_right(self) -> bool:
        """The receiver has the map, is sure of it, and it is the sender's."""
        window: npt.NDArray[np.uint8] = self.receiver.window()
        sure = not self.receiver.suspect and not self.receiver.stale(self.now_s)
        return sure and bool(np.array_equal(window, self.sky.meant()))


@pytest.mark.parametrize("frame_max", [64, 128, 368])
def test_a_receiver_of_short_frames_gets_its_map_from_every_run(frame_max: int) -> None:
    settings = (f"-DMAPOD_FRAME_MAX={frame_max}u",)
    runs = Runs(CReceiver(NONCE, max_cells=SIZE**2, settings=settings))
    for _ in range(3):
        runs.restart()
        runs.run(3.0)
        assert runs.is_right


def test_the_first_geometry_may_come_before_the_first_hello() -> None:
    settings = ("-DMAPOD_FRAME_MAX=64u",)
    runs = Runs(CReceiver(NONCE, max_cells=SIZE**2, settings=settings))
    runs.restart()
    runs.link.step(runs.now_s, POSE_REPORT, runs.sky.window())
    for datagram in runs.port.take_datagrams():
        runs.receiver.feed_datagram(runs.now_s, datagram)
    runs.run(3.0)
    assert runs.is_right


def test_with_a_key_a_new_nonce_lets_it_take_runs_again_and_none_of_the_old_ones() -> None:
    settings = ("-DMAPOD_LINK_LEFT_SESSIONS=2u",)
    runs = Runs(CReceiver(NONCE, key=KEY, max_cells=SIZE**2, settings=settings), KEY)
    recorded: list[bytes] = []
    for _ in range(3):
        runs.restart()
        runs.run(1.0)
        assert runs.is_right
        runs.link.step(runs.now_s + TICK_S, POSE_REPORT, runs.sky.window())
        recorded += runs.port.take_datagrams()
    runs.restart()
    runs.run(1.0)
    assert not runs.is_right
    assert runs.receiver.stale(runs.now_s)
    runs.receiver.renew(NONCE + 1)
    runs.run(1.0)
    assert runs.is_right
    assert not any(runs.receiver.feed_datagram(runs.now_s, frame) for frame in recorded)
