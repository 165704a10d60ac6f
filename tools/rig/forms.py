"""The forms that the planner of the live rig comes in: emulated board, the same C here, a real MCU.

Each has the port that the app is to open, and says what the planner is about.
"""

from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from config_file import load_config
from mapod_link.receiver import Receiver
from mapod_link.wires import UdpWire
from tools.rig.board import EmulatedBoard
from tools.rig.c_build import MissingToolError, robot_from_config
from tools.rig.c_planner import CPlanner, PlannerSettings, PlannerState
from tools.rig.config import BOARD, HOST, RigConfig

Window = tuple[npt.NDArray[np.uint8], tuple[int, int]]  # (height, width), and its lowest cell
ASK_EVERY_S = 0.2  # what a board is about


class Form:
    """A real MCU on a port: it is driven by itself, or by nobody, and says nothing."""

    words = "a real planner"
    remark = ""  # why it is another one than was asked for
    state: PlannerState | None = None  # what it is about, as last heard; None: it does not say

    def __init__(self, url: str) -> None:
        self.url = url  # the port that the app opens

    def step(self, now_s: float) -> None:
        """Move on; called often."""

    def goal(self, x_m: float, y_m: float) -> None:
        """Go there, map frame."""

    def halt(self) -> None:
        """Stand."""

    def maybe_map(self) -> Window | None:
        """Its map as it holds it; None: unsaid."""
        return None

    def close(self) -> None:
        """Let go of all."""


class HostForm(Form):
    """The planner's C as a library, on UDP."""

    words = "the planner's C on this machine, over UDP"

    def __init__(self, settings: PlannerSettings, nonce: int) -> None:
        self._planner, self._wire = CPlanner(settings, nonce), UdpWire("127.0.0.1", 0)
        super().__init__(self._wire.url)

    def step(self, now_s: float) -> None:
        self._wire.feed(cast(Receiver, self._planner))  # it asks for no more than datagrams
        for frame in self._planner.poll(now_s):
            self._wire.write(frame)
        self.state = self._planner.state(now_s)

    def goal(self, x_m: float, y_m: float) -> None:
        self._planner.goal(x_m, y_m)

    def halt(self) -> None:
        self._planner.halt()

    def maybe_map(self) -> Window | None:
        return self._planner.snapshot()

    def close(self) -> None:
        self._wire.close()


class BoardForm(Form):
    """The planner's firmware on an emulated Cortex-M3, whose UART is a pty."""

    words = "the planner's firmware on an emulated Cortex-M3, its UART on a pty"

    def __init__(self, settings: PlannerSettings, folder: Path, baud: int) -> None:
        folder.mkdir(exist_ok=True)
        self._board = EmulatedBoard(settings, folder, link="pty")
        super().__init__(f"serial://{self._board.link_path}?baud={baud}")
        self._asked_s = float("-inf")

    def step(self, now_s: float) -> None:
        if now_s - self._asked_s >= ASK_EVERY_S:
            self._asked_s, self.state = now_s, self._board.state()

    def goal(self, x_m: float, y_m: float) -> None:
        self._board.goal(x_m, y_m)

    def halt(self) -> None:
        self._board.halt()

    def maybe_map(self) -> Window | None:
        return self._board.snapshot()

    def close(self) -> None:
        self._board.close()


def form_of(config: RigConfig, clear_m: float, folder: Path) -> Form:
    """The planner that the bench asks for; the one here, where there is no emulator.

    Args:
        clear_m: how far around the start the operator vouches for the ground.

    Raises:
        MissingToolError: not even this machine's compiler is there.
        ConfigError: the robot of the settings is none that the planner in C can drive.
    """
    wanted, remark = config.devices.planner, ""
    if wanted not in (BOARD, HOST):
        return Form(wanted)
    robot = robot_from_config(load_config(Path(config.robot.config).read_text(encoding="utf-8")))
    settings = PlannerSettings(clear_m, config.planner.unknown_mps, robot)
    if wanted == BOARD:
        try:
            return BoardForm(settings, folder / "board", config.planner.board_baud)
        except MissingToolError as missing:
            remark = f"{missing}; taking the planner's C on this machine instead"
    form = HostForm(settings, config.world.seed + 1)
    form.remark = remark
    return form
