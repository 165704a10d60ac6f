"""The forms that the planner of the live rig comes in: emulated board, the same C here, a real MCU.

Each has the port that the app is to open, and says what the planner is about. The real one says
nothing: its firmware is its owner's.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Protocol, cast

import numpy as np
import numpy.typing as npt

from config_file import load_config
from mapod_link.receiver import Receiver
from mapod_link.wires import UdpWire
from tools.rig.board import BoardError, EmulatedBoard
from tools.rig.c_build import MissingToolError, robot_from_config
from tools.rig.c_planner import CPlanner, PlannerSettings, PlannerState
from tools.rig.config import BOARD, HOST, RigConfig

U8 = npt.NDArray[np.uint8]
ASK_EVERY_S = 0.2  # what a board is about


class Form(Protocol):
    """A planner at work."""

    words: str  # what it is
    url: str  # the port that the app opens

    @property
    def state(self) -> PlannerState | None:
        """What it is about, as last heard; None: it does not say."""

    def step(self, now_s: float) -> None:
        """Move on; called often."""

    def goal(self, x_m: float, y_m: float) -> None:
        """Go there, map frame."""

    def halt(self) -> None:
        """Stand."""

    def maybe_map(self) -> tuple[U8, tuple[int, int]] | None:
        """Its window (height, width) as it holds it, and the window's lowest cell; None: unsaid."""

    def close(self) -> None:
        """Let go of all."""


class HostForm:
    """The planner's C as a library, on UDP."""

    words = "the planner's C on this machine, over UDP"

    def __init__(self, settings: PlannerSettings, nonce: int) -> None:
        self._planner, self._wire = CPlanner(settings, nonce), UdpWire("127.0.0.1", 0)
        self.url = self._wire.url
        self._now_s = 0.0

    @property
    def state(self) -> PlannerState | None:
        """As of now."""
        return self._planner.state(self._now_s)

    def step(self, now_s: float) -> None:
        """Hear, decide, answer."""
        self._wire.feed(cast(Receiver, self._planner))  # it asks for no more than datagrams
        self._now_s = now_s
        for frame in self._planner.poll(now_s):
            self._wire.write(frame)

    def goal(self, x_m: float, y_m: float) -> None:
        """Go there."""
        self._planner.goal(x_m, y_m)

    def halt(self) -> None:
        """Stand."""
        self._planner.halt()

    def maybe_map(self) -> tuple[U8, tuple[int, int]] | None:
        """As it is."""
        return self._planner.window(), self._planner.origin()

    def close(self) -> None:
        """No port any more."""
        self._wire.close()


@contextlib.contextmanager
def emulator() -> Iterator[None]:
    """Says whose pipe it is that has broken.

    Raises:
        BoardError: the emulator is gone.
    """
    try:
        yield
    except OSError as error:
        raise BoardError(f"the emulator of the planner's board has ended ({error})") from None


class BoardForm:
    """The planner's firmware on an emulated Cortex-M3, whose UART is a pty."""

    words = "the planner's firmware on an emulated Cortex-M3, its UART on a pty"

    def __init__(self, settings: PlannerSettings, folder: Path, baud: int) -> None:
        folder.mkdir(exist_ok=True)
        self._open = contextlib.ExitStack()
        self._board = self._open.enter_context(EmulatedBoard(settings, folder, link="pty"))
        self.url = f"serial://{self._board.link_path}?baud={baud}"
        self._asked_s = float("-inf")
        self.state: PlannerState | None = None

    def step(self, now_s: float) -> None:
        """Ask now and then what it is about."""
        if now_s - self._asked_s >= ASK_EVERY_S:
            self._asked_s = now_s
            with emulator():
                self.state = self._board.state()

    def goal(self, x_m: float, y_m: float) -> None:
        """Go there."""
        with emulator():
            self._board.goal(x_m, y_m)

    def halt(self) -> None:
        """Stand."""
        with emulator():
            self._board.halt()

    def maybe_map(self) -> tuple[U8, tuple[int, int]] | None:
        """As the board dumps it."""
        with emulator():
            origin, window = self._board.snapshot()
        return window, origin

    def close(self) -> None:
        """The emulator ends."""
        self._open.close()


class RealForm:
    """A microcontroller of somebody's own, on a port: it is driven by itself, or by nobody."""

    words = "a real planner"
    state: PlannerState | None = None

    def __init__(self, url: str) -> None:
        self.url = url

    def step(self, now_s: float) -> None:
        """It lives its own life."""

    def goal(self, x_m: float, y_m: float) -> None:
        """Nobody can tell it."""

    def halt(self) -> None:
        """Nor this: ending the app stops the robot."""

    def maybe_map(self) -> tuple[U8, tuple[int, int]] | None:
        """It does not say."""
        return None

    def close(self) -> None:
        """Nothing was opened here."""


def form_of(config: RigConfig, settings: PlannerSettings, folder: Path) -> tuple[Form, str]:
    """The planner that the bench asks for; and why it is another one, in words, or "".

    Raises:
        MissingToolError: not even this machine's compiler is there.
        ConfigError: the robot of the settings is none that the planner in C can drive.
    """
    if config.planner not in (BOARD, HOST):
        return RealForm(config.planner), ""
    app = load_config(Path(config.config).read_text(encoding="utf-8"))
    settings, remark = replace(settings, robot=robot_from_config(app)), ""
    if config.planner == BOARD:
        try:
            return BoardForm(settings, folder / "board", config.board_baud), ""
        except MissingToolError as missing:
            remark = f"{missing}; taking the planner's C on this machine instead"
    return HostForm(settings, config.seed + 1), remark
