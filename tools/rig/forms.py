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
ON_HOST = "the planner's C on this machine, over UDP"
ON_BOARD = "the planner's firmware on an emulated Cortex-M3, its UART on a pty"


class Form:
    """A planner at work. Without one of ours it is a real MCU: driven by itself, or by nobody."""

    def __init__(
        self,
        url: str,
        words: str = "a real planner",
        planner: CPlanner | EmulatedBoard | None = None,
        wire: UdpWire | None = None,
    ) -> None:
        self.url, self.words = url, words  # the port that the app opens
        self.remark = ""  # why it is another one than was asked for
        self.state: PlannerState | None = None  # as last heard; None: it does not say
        self._planner, self._wire = planner, wire
        self._asked_s = float("-inf")

    def step(self, now_s: float) -> None:
        """Move on; called often."""
        if isinstance(self._planner, EmulatedBoard):
            if now_s - self._asked_s >= ASK_EVERY_S:
                self._asked_s, self.state = now_s, self._planner.state()
        elif self._planner and self._wire:
            self._wire.feed(cast(Receiver, self._planner))  # it asks for no more than datagrams
            for frame in self._planner.poll(now_s):
                self._wire.write(frame)
            self.state = self._planner.state(now_s)

    def goal(self, x_m: float, y_m: float) -> None:
        if self._planner:
            self._planner.goal(x_m, y_m)

    def halt(self) -> None:
        if self._planner:
            self._planner.halt()

    def maybe_map(self) -> Window | None:
        return self._planner.snapshot() if self._planner else None

    def close(self) -> None:
        if isinstance(self._planner, EmulatedBoard):
            self._planner.close()
        if self._wire:
            self._wire.close()


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
            (folder / "board").mkdir(exist_ok=True)
            board = EmulatedBoard(settings, folder / "board", link="pty")
            url = f"serial://{board.link_path}?baud={config.planner.board_baud}"
            return Form(url, ON_BOARD, board)
        except MissingToolError as missing:
            remark = f"{missing}; taking the planner's C on this machine instead"
    wire = UdpWire("127.0.0.1", 0)
    form = Form(wire.url, ON_HOST, CPlanner(settings, config.world.seed + 1), wire)
    form.remark = remark
    return form
