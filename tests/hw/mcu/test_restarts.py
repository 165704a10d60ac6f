"""The C header and a sender that starts anew, again and again, while the receiver runs on."""

from collections.abc import Iterator
from itertools import count, islice
from typing import cast

import pytest

from fakes.planner_mcu.receiver import FakePlanner
from tests.support.link.c_link import CReceiver
from tests.support.link.planner_line import Line, Sky

SIZE, KEY, NONCE = 31, bytes(range(32)), 5


def runs(receiver: CReceiver, key: bytes | None = None) -> Iterator[Line]:
    """One run of the sender after the other; each begins with a GEOM, before any HELLO."""
    sky, now_s = Sky(SIZE, 1), 100.0
    sky.change(400)
    for session in count(1000):
        planner = cast(FakePlanner, receiver)  # it has all that a line asks of one
        line = Line(sky, key=key, session=session, planner=planner)
        line.now_s = now_s
        sky.epoch += 1
        yield line
        now_s = line.now_s


def is_right(line: Line) -> bool:
    """The receiver has the map, is sure of it, and it is the sender's."""
    doubts = line.planner.suspect or line.planner.stale(line.now_s)
    return not doubts and line.holds_what_is_meant()


@pytest.mark.parametrize("frame_max", [64, 128, 368])
def test_a_receiver_of_short_frames_gets_its_map_from_every_run(frame_max: int) -> None:
    settings = (f"-DMAPOD_FRAME_MAX={frame_max}u",)
    receiver = CReceiver(NONCE, max_cells=SIZE**2, settings=settings)
    for line in islice(runs(receiver), 2):
        line.settle(2.0)
        assert is_right(line)


def test_with_a_key_a_new_nonce_lets_it_take_runs_again_and_none_of_the_old_ones() -> None:
    settings = ("-DMAPOD_LINK_LEFT_SESSIONS=2u",)
    receiver = CReceiver(NONCE, key=KEY, max_cells=SIZE**2, settings=settings)
    recorded: list[bytes] = []
    lines = runs(receiver, KEY)
    for line in islice(lines, 3):
        line.settle(1.0)
        assert is_right(line)
        recorded += line.frames
    line = next(lines)
    line.settle(1.0)
    assert not is_right(line)
    assert receiver.stale(line.now_s)
    receiver.renew(NONCE + 1)
    line.settle(1.0)
    assert is_right(line)
    assert not any(receiver.feed_datagram(line.now_s, frame) for frame in recorded)
