"""Firmware of fakes/planner_mcu on an emulated Cortex-M3 (`qemu-system-arm`), both UARTs.

UART0 is the planner's line: a socket that this process reads and writes, or a pty that mapod opens.
UART1 takes words and gives lines. A board stands still while nobody takes what it sends, so that
whoever waits for a line here takes both.
"""

import ctypes
import functools
import math
import re
import select
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Literal, Self

import numpy as np
import numpy.typing as npt

from tools.rig.planner.build import build_planner_firmware, program
from tools.rig.planner.host import PlannerSettings, PlannerState, planner_state

U8 = npt.NDArray[np.uint8]
GENEROUS_S = 60.0  # nothing here takes long; a loaded machine may
LIBC, PR_SET_PDEATHSIG = ctypes.CDLL(None), 1  # an emulator ends with who started it
PTY = re.compile(rb"redirected to (\S+) \(label link\)")
NAMES = ("clear_mm", "unknown_mmps")  # of the settings


class BoardError(Exception):
    """The emulator has ended, or the board does not answer."""


class Board:
    """A running board; `with` ends it.

    Args:
        folder: for the sockets; its path must be short (a socket's has 107 bytes).
        link: "socket": `send` and `hear` are the line; "pty": `link_path` is.

    Raises:
        MissingToolError: no emulator is installed.
    """

    def __init__(
        self, firmware: Path, folder: Path, link: Literal["socket", "pty"] = "socket"
    ) -> None:
        names = ["link", "text"] if link == "socket" else ["text"]
        listeners = {name: socket.socket(socket.AF_UNIX) for name in names}
        serials = [] if link == "socket" else ["-chardev", "pty,id=link", "-serial", "chardev:link"]
        for name, listener in listeners.items():
            listener.bind(str(folder / name))
            listener.listen(1)
            listener.settimeout(GENEROUS_S)
            serials += ["-chardev", f"socket,id={name},path={folder / name}"]
            serials += ["-serial", f"chardev:{name}"]
        try:
            self.process = _emulator([*serials, "-kernel", str(firmware)])
        except BaseException:
            for listener in listeners.values():
                listener.close()
            raise
        try:
            sockets = {name: listener.accept()[0] for name, listener in listeners.items()}
            self.text, self.link = sockets["text"], sockets.get("link")
            self.link_path = str(folder / "link") if self.link else self._pty()
        except (OSError, BoardError):
            self._end()
            raise
        finally:
            for listener in listeners.values():
                listener.close()
        self._unread = self._heard = b""

    def _pty(self) -> str:
        assert self.process.stdout is not None
        told = self.process.stdout.readline()
        found = PTY.search(told)
        if not found:
            raise BoardError(f"the emulator names no pty: {told!r}")
        return found[1].decode()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *what: object) -> None:
        self.close()

    def close(self) -> None:
        self._end()
        for end in (self.link, self.text):
            if end is not None:
                end.close()

    def _end(self) -> None:
        self.process.kill()
        self.process.communicate()

    def send(self, data: bytes) -> None:
        """Bytes to the board's line; takes what it sends meanwhile."""
        assert self.link is not None, "its line is a pty"
        left = memoryview(data)
        until_s = time.monotonic() + GENEROUS_S
        while left:
            _, writable, _ = select.select([], [self.link], [], 0.01)
            if writable:
                left = left[self.link.send(left[:2048]) :]
            else:
                self._take(0.0)
            if time.monotonic() > until_s:
                raise BoardError("the board takes nothing")

    def hear(self) -> bytes:
        self._take(0.0)
        heard, self._heard = self._heard, b""
        return heard

    def ask(self, words: str) -> str:
        """The line that answers a line. Raises BoardError: none came."""
        try:
            self.text.sendall(words.encode() + b"\n")
        except OSError as gone:
            raise BoardError("the emulator has ended") from gone
        return self._line()

    def status(self) -> dict[str, int]:
        words = self.ask("status").split()[1:]
        return {name: int(value) for name, value in (word.split("=") for word in words)}

    def window(self) -> U8:
        """(height, width) cells as the board holds them: 0 unknown, 1 free, 2 obstacle."""
        return self.snapshot()[0]

    def snapshot(self) -> tuple[U8, tuple[int, int]]:
        """That, and its lowest column and row in the endless grid, modulo 65 536 as int16."""
        width, height, *origin = (int(word) for word in self.ask("dump").split()[1:])
        rows = [self._line() for _ in range(height)]
        digits = np.frombuffer("".join(rows).encode(), np.uint8) - ord("0")
        return digits.reshape(height, width), (origin[0], origin[1])

    def _line(self) -> str:
        until_s = time.monotonic() + GENEROUS_S
        while b"\n" not in self._unread:
            left_s = until_s - time.monotonic()
            if left_s <= 0.0 or not self._take(left_s):
                raise BoardError("the board says nothing")
        line, self._unread = self._unread.split(b"\n", 1)
        return line.decode()

    def _take(self, wait_s: float) -> bool:
        ends = [end for end in (self.link, self.text) if end is not None]
        ready, _, _ = select.select(ends, [], [], wait_s)
        for end in ready:
            try:
                data = end.recv(65_536)
            except ConnectionError:
                data = b""
            if not data:
                raise BoardError("the emulator has ended")
            if end is self.text:
                self._unread += data
            else:
                self._heard += data
        return bool(ready)


class EmulatedBoard(Board):
    """The planner's firmware, set up and started. It keeps its own time, in whole milliseconds.

    Args:
        nonce: of its HELLO; another one for each start.

    Raises:
        MissingToolError, CompileError: see `tools.rig.c_build`.
    """

    def __init__(
        self,
        settings: PlannerSettings,
        folder: Path,
        link: Literal["socket", "pty"] = "socket",
        nonce: int = 1,
    ) -> None:
        super().__init__(build_planner_firmware(settings.robot), folder, link)
        try:
            for name, value in zip(NAMES, settings.thousandths(), strict=True):
                self.ask(f"set {name} {value}")
            self.ask(f"start {nonce}")
        except (OSError, BoardError):
            self.close()
            raise

    def goal(self, x_m: float, y_m: float) -> None:
        self.ask(f"goal {round(x_m * 1000)} {round(y_m * 1000)}")

    def halt(self) -> None:
        self.ask("halt")

    def hold_clock(self, now_s: float) -> None:
        """Let its clock stand at this time; from then on it speaks only after `let_speak`."""
        self.ask(f"clock {math.floor(now_s * 1000 + 1e-6)}")

    def let_speak(self) -> None:
        """All that the planner has to say at the time at which its clock stands."""
        self.ask("poll")

    def state(self) -> PlannerState:
        return planner_state(self.status())


def _emulator(arguments: list[str]) -> "subprocess.Popen[bytes]":
    """It ends with this process; a terminal's Ctrl-C is for the rig, which then ends it."""
    command = [program("qemu-system-arm"), "-M", "mps2-an385", "-display", "none"]
    return subprocess.Popen(
        [*command, "-monitor", "none", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=functools.partial(LIBC.prctl, PR_SET_PDEATHSIG, signal.SIGKILL),
    )
