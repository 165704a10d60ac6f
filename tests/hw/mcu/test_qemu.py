"""The C header on an emulated Cortex-M3 keeps the sender's map, over a line that loses frames."""

import random
from pathlib import Path

import numpy as np
import pytest

from fakes.wires.memory import MemoryPort
from hw.planner_link.receivers import one_link
from tests.support.planner_line import POSE_REPORT, Sky
from tools.rig.board import Board
from tools.rig.c_build import BARE, BOARD, PLANNER, built

FREE, OBSTACLE = 1, 2
SETTLES = 100
KEY = bytes(range(32))
TICK_S = 0.04
NOISE = random.Random(3).randbytes(5000) + b"\0"
NOISE_FRAMES = sum(map(bool, NOISE.split(b"\0")))


def build_firmware(*options: str) -> Path:
    """The header as firmware for qemu-system-arm -M mps2-an385."""
    sources = [str(BOARD / name) for name in ("board.c", "text.c", "startup.c")]
    words = (*BARE, *options, f"-I{PLANNER}", *sources)
    return built("board.elf", BOARD / "link_only.c", *words, compiler="arm-none-eabi-gcc")


class Wire:
    """The sender, and the board at the end of its serial line; the sender's time is simulated."""

    def __init__(self, board: Board, size: int, key: bytes | None = None) -> None:
        self.board, self.sky, self.port = board, Sky(size, seed=4), MemoryPort()
        self.link = one_link(
            self.port, size=size, session=0x5A17C0DE, tick_s=TICK_S, line_baud=115_200, key=key
        )
        self.now_s, self.random, self.lost, self.sent = 50.0, random.Random(9), 0, 0
        self.noise = 0  # bad frames that are none of the sender's

    def tick(self, loss: float) -> None:
        """One tick of the sender; frames get lost both ways."""
        self.now_s += TICK_S
        self.link.step(self.now_s, POSE_REPORT, self.sky.window())
        for frame in self.port.take_datagrams():
            self.sent += 1
            if self.random.random() < loss:
                self.lost += 1
            else:
                self.board.send(frame)
        while self._waiting():
            pass  # an emulated line is slower than the sender's simulated time
        heard = self.board.hear()
        if heard and self.random.random() >= loss:
            self.port.give(heard)

    def _waiting(self) -> bool:
        status = self.board.status()
        return status["accepted"] + status["bad"] - self.noise < self.sent - self.lost

    def move_about(self, ticks: int, loss: float) -> None:
        """The world changes, the window moves."""
        for k in range(ticks):
            self.sky.change(5)
            if k % 7 == 0:
                self.sky.move(self.random.randint(-3, 3), self.random.randint(-3, 3))
            self.tick(loss)

    def settle(self) -> None:
        """Until the board holds the sender's map; what it holds before is never free by mistake."""
        for _ in range(SETTLES):
            for _ in range(12):
                self.tick(0.0)
            status = self.board.status()
            assert status["last"] == self.sent % 2**16
            if status["blank"] or status["suspect"]:
                continue
            held, meant = self.board.window(), self.sky.meant()
            assert not ((held == FREE) & (meant == OBSTACLE)).any()
            if np.array_equal(held, meant):
                return
        pytest.fail(f"no map yet: {self.board.status()}")


@pytest.mark.slow
def test_its_map_is_the_senders_after_losses_and_noise_on_a_small_stack(
    tmp_path: Path,
) -> None:
    with Board(build_firmware(), tmp_path) as board:
        wire = Wire(board, size=61)
        wire.settle()
        for _ in range(2):
            wire.move_about(45, loss=0.1)
            wire.settle()
        for _ in range(30):
            wire.tick(0.0)
        status = board.status()
        assert wire.lost > 10
        assert wire.link.counters.acks > 5
        assert status["x_mm"] == round(POSE_REPORT.x_m * 1000)
        assert status["bad"] == 0
        assert status["stack"] < 400, "of the whole firmware, its interrupt included"
        assert status["digest_ok"]
        before = board.window()
        board.send(NOISE)
        while board.status()["bad"] != NOISE_FRAMES:
            pass
        wire.noise = NOISE_FRAMES
        wire.settle()
        assert np.array_equal(board.window(), before)


def test_with_a_key_it_is_believed_and_says_stop_when_nothing_comes(
    tmp_path: Path,
) -> None:
    with Board(build_firmware("-DMAPOD_LINK_AUTH"), tmp_path) as board:
        wire = Wire(board, size=41, key=KEY)
        wire.settle()
        wire.move_about(40, loss=0.1)
        wire.settle()
        assert board.ask("drive 300 -50 300") == "drive 36"
        while not (wire.link.requests.accepted or wire.link.requests.refused):
            wire.tick(0.0)
        request = wire.link.requests.newest
        assert request is not None
        assert (request.v_mps, request.w_radps) == (0.3, -0.05)
        assert board.status()["stack"] < 800
        while board.status()["stale"] == 0:
            pass
        assert board.status()["advice"] == 0
