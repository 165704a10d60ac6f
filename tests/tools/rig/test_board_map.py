"""The emulated microcontroller holds the app's obstacle map, cell for cell, after frames were lost.

World, fakes and app run on the simulated clock; the board's clock is held at the same time. Frames
to and from it get lost, get damaged, and do not pass at all for a while; afterwards both maps must
be alike within the protocol's recovery time.
"""

import random
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import pytest

from core.records import FREE, OBSTACLE
from tools.rig.board import EmulatedBoard
from tools.rig.c_planner import PlannerSettings
from tools.rig.loop import Loop

BAUD = 115_200
QUIET_S = 0.02  # a board that nothing is sent to is looked after so often
RECOVERY_S = 0.5  # docs/planner-link.md, section 11: 99 of 100 losses are repaired in 0.24 s
OBSTACLES, FREES = 2, 1  # on the wire


class BoardOnLine:
    """The board as a planner on a serial line that loses, damages and withholds frames.

    Attributes:
        loss, damage: shares of the frames, both ways.
        cut: nothing passes.
    """

    def __init__(self, board: EmulatedBoard) -> None:
        self.board, self.loss, self.damage, self.cut = board, 0.0, 0.0, False
        self.spoiled = 0
        self._random = random.Random(4)
        self._down = self._up = b""
        self._spoke_s = 0.0
        self._taken = 0  # frames that the board has got, whole or not

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """The app's bytes to the board, and the board's answer to the app, at the same instant."""
        self.board.hold_clock(now_s)
        *frames, self._down = (self._down + received).split(b"\0")
        passed = [frame for frame in map(self._rough, filter(None, frames)) if frame]
        if passed:
            self.board.send(b"".join(frame + b"\0" for frame in passed))
            self._taken += len(passed)
            while (status := self.board.status())["accepted"] + status["bad_frames"] < self._taken:
                pass  # the emulator is slower than the simulated line at times
        elif now_s - self._spoke_s < QUIET_S:
            return b""
        self._spoke_s = now_s
        self.board.let_speak()
        *answers, self._up = (self._up + self.board.hear()).split(b"\0")
        rough = [answer for answer in map(self._rough, filter(None, answers)) if answer]
        return b"".join(answer + b"\0" for answer in rough)

    def feed_datagram(self, now_s: float, data: bytes) -> None:
        """Not on this line."""
        raise NotImplementedError

    def poll(self, now_s: float) -> list[bytes]:
        """Not on this line."""
        raise NotImplementedError

    def _rough(self, frame: bytes) -> bytes:
        """What is left of a frame; b"" if it is lost."""
        if self.cut or self._random.random() < self.loss:
            self.spoiled += 1
            return b""
        if self._random.random() < self.damage:
            self.spoiled += 1
            at = self._random.randrange(len(frame))
            return frame[:at] + bytes([frame[at] ^ 0x55 or 1]) + frame[at + 1 :]
        return frame


@pytest.fixture
def board(tmp_path_factory: pytest.TempPathFactory) -> Iterator[EmulatedBoard]:
    settings = PlannerSettings(start_clear_m=9.0)
    with EmulatedBoard(settings, tmp_path_factory.mktemp("b")) as running:
        yield running


def as_told(loop: Loop) -> npt.NDArray[np.uint8]:
    """The app's window as the wire has it."""
    cells = loop.map_now()
    told = np.zeros(cells.shape, np.uint8)
    told[cells == FREE], told[cells == OBSTACLE] = FREES, OBSTACLES
    return told


def seconds_until_alike(loop: Loop, board: EmulatedBoard, at_most_s: float) -> float:
    """How long it takes from now; more than `at_most_s` if it takes longer."""
    from_s = loop.now_s
    while loop.now_s - from_s <= at_most_s:
        (_, _), held = board.snapshot()
        if held.shape == (101, 101) and np.array_equal(held, as_told(loop)):
            break
        loop.run(0.02)
    return loop.now_s - from_s


@pytest.mark.slow
def test_the_boards_map_equals_the_apps_after_any_loss(board: EmulatedBoard) -> None:
    line = BoardOnLine(board)
    loop = Loop("corridor", 3, planner=line, baud=BAUD)
    loop.run(3.5)
    board.goal(12.0, 0.0)
    for loss, damage in ((0.05, 0.05), (0.25, 0.05)):
        line.loss, line.damage = loss, damage
        loop.run(1.5)
        line.loss = line.damage = 0.0
        assert seconds_until_alike(loop, board, RECOVERY_S) <= RECOVERY_S
    line.cut = True
    loop.run(0.6)
    line.cut = False
    assert seconds_until_alike(loop, board, RECOVERY_S) <= RECOVERY_S
    assert line.spoiled > 30
    assert loop.rig.world.pose()[0] > 0.3  # it drove meanwhile
    held = board.window()
    assert (held == FREES).sum() > 20
    assert (held == OBSTACLES).sum() > 50
