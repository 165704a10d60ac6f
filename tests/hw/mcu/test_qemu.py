"""The C header on an emulated Cortex-M3 keeps the sender's map, over a line that loses frames."""

import random
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.serial_line import Deframer
from tests.support.link.planner_line import POSE_REPORT, Line, Sky
from tools.rig.planner.board import Board
from tools.rig.planner.build import BARE, BOARD, PLANNER, built

FREE, OBSTACLE = 1, 2
SETTLES = 100
KEY = bytes(range(32))
NOISE = random.Random(3).randbytes(5000) + b"\0"
NOISE_FRAMES = sum(map(bool, NOISE.split(b"\0")))


def build_firmware(*options: str) -> Path:
    """The header as firmware for qemu-system-arm -M mps2-an385."""
    sources = [str(BOARD / name) for name in ("board.c", "text.c", "startup.c")]
    words = (*BARE, *options, f"-I{PLANNER}", *sources)
    return built("board.elf", BOARD / "link_only.c", *words, compiler="arm-none-eabi-gcc")


class OnBoard:
    """A board as a line's receiver: it has taken all that it was fed before it answers."""

    def __init__(self, board: Board) -> None:
        self.board, self.fed = board, 0
        self.noise = 0  # bad frames that are none of the sender's
        self._deframer = Deframer()

    def feed_stream(self, now_s: float, frame: bytes) -> None:
        self.board.send(frame)
        self.fed += 1

    def poll(self, now_s: float) -> list[bytes]:
        """An emulated line is slower than the sender's simulated time."""
        while (status := self.board.status())["accepted"] + status["bad"] < self.fed + self.noise:
            pass
        return [frame for frame in self._deframer.feed(self.board.hear()) if frame]


def line_to(board: Board, size: int, key: bytes | None = None) -> Line:
    """The sender, and the board at the end of its serial line, with its map."""
    planner = cast(FakePlanner, OnBoard(board))  # it has all that a line asks of one
    line = Line(Sky(size, seed=4), baud=115_200, rate_hz=25, key=key, planner=planner)
    settle(line, board)
    return line


def move_about(line: Line, board: Board, ticks: int) -> None:
    """The world changes, the window moves, frames get lost both ways; and all is repaired."""
    line.loss = 0.1
    for k in range(ticks):
        line.sky.change(5)
        if k % 7 == 0:
            line.sky.move(*line.sky.random.integers(-3, 4, 2).tolist())
        line.tick()
    line.loss = 0.0
    settle(line, board)


def settle(line: Line, board: Board) -> None:
    """Until the board holds the sender's map; what it holds before is never free by mistake."""
    for _ in range(SETTLES):
        line.settle(0.5)
        status = board.status()
        assert status["last"] == line.link.frames_sent % 2**16
        if status["blank"] or status["suspect"]:
            continue
        held, meant = board.window(), line.sky.meant()
        assert not ((held == FREE) & (meant == OBSTACLE)).any()
        if np.array_equal(held, meant):
            return
    pytest.fail(f"no map yet: {board.status()}")


@pytest.mark.slow
def test_its_map_is_the_senders_after_losses_and_noise_on_a_small_stack(tmp_path: Path) -> None:
    with Board(build_firmware(), tmp_path) as board:
        line = line_to(board, size=61)
        for _ in range(2):
            move_about(line, board, 45)
        line.settle(1.2)
        status, receiver = board.status(), cast(OnBoard, line.planner)
        assert receiver.fed < line.link.frames_sent - 10
        assert line.link.counters.acks > 5
        assert status["x_mm"] == round(POSE_REPORT.x_m * 1000)
        assert status["bad"] == 0
        assert status["stack"] < 400, "of the whole firmware, its interrupt included"
        assert status["digest_ok"]
        before = board.window()
        board.send(NOISE)
        receiver.noise = NOISE_FRAMES
        settle(line, board)
        assert board.status()["bad"] == NOISE_FRAMES
        assert np.array_equal(board.window(), before)


@pytest.mark.slow
def test_with_a_key_it_is_believed_and_says_stop_when_nothing_comes(tmp_path: Path) -> None:
    with Board(build_firmware("-DMAPOD_LINK_AUTH"), tmp_path) as board:
        line = line_to(board, size=31, key=KEY)
        move_about(line, board, 25)
        assert board.ask("drive 300 -50 300") == "drive 36"
        requests = line.link.requests
        while not (requests.accepted or requests.refused):
            line.tick()
        assert requests.newest is not None
        assert (requests.newest.v_mps, requests.newest.w_radps) == (0.3, -0.05)
        assert board.status()["stack"] < 800
        while board.status()["stale"] == 0:
            pass
        assert board.status()["advice"] == 0
