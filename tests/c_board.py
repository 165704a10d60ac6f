"""The C header as firmware on an emulated Cortex-M3; one socket is its line, one its text."""

import select
import socket
import subprocess
from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt

from tests.c_link import MCU, built, needs

GENEROUS_S = 60.0  # nothing here takes long; a loaded machine may
SOURCES = [MCU / "qemu" / name for name in ("firmware.c", "board.c", "startup.c")]
BARE = (
    "-Os", "-mcpu=cortex-m3", "-mthumb", "-ffreestanding", "-ffunction-sections",
    "-fno-tree-loop-distribute-patterns", "-nostdlib", "-Wl,--gc-sections",
    "-T", str(MCU / "qemu" / "board.ld"),
)  # fmt: skip


def build_firmware(*options: str) -> Path:
    """The program for qemu-system-arm -M mps2-an385."""
    package = "gcc-arm-none-eabi libnewlib-arm-none-eabi"
    words = (*BARE, *options, *map(str, SOURCES[1:]))
    compiler = "arm-none-eabi-gcc"
    return built("board.elf", "qemu/firmware.c", *words, compiler=compiler, package=package)


class Board:
    """A running board; `with` ends it."""

    def __init__(self, firmware: Path, folder: Path) -> None:
        qemu = needs("qemu-system-arm", "qemu-system-arm")
        listeners = {name: socket.socket(socket.AF_UNIX) for name in ("link", "text")}
        serials: list[str] = []
        for name, listener in listeners.items():
            listener.bind(str(folder / name))
            listener.listen(1)
            listener.settimeout(GENEROUS_S)
            serials += ["-chardev", f"socket,id={name},path={folder / name}"]
            serials += ["-serial", f"chardev:{name}"]
        command = [qemu, "-M", "mps2-an385", "-display", "none", "-monitor", "none"]
        self._process = subprocess.Popen(
            [*command, *serials, "-kernel", str(firmware)], stderr=subprocess.PIPE
        )
        self.link, self.text = (listeners[name].accept()[0] for name in ("link", "text"))
        for listener in listeners.values():
            listener.close()
        self._unread = self._heard = b""

    def __enter__(self) -> "Board":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.kill()
        self._process.communicate()
        self.link.close()
        self.text.close()

    def hear(self) -> bytes:
        """What the board has sent on its serial line since the last call; waits for nothing."""
        self._take(0.0)
        heard, self._heard = self._heard, b""
        return heard

    def ask(self, word: str) -> str:
        """The line that answers a word."""
        self.text.sendall(word.encode() + b"\n")
        return self._line()

    def status(self) -> dict[str, int]:
        """What the board says of its receiver."""
        words = self.ask("status").split()[1:]
        return {name: int(value) for name, value in (word.split("=") for word in words)}

    def window(self) -> npt.NDArray[np.uint8]:
        """(height, width) cells as the board holds them."""
        _, width, height = self.ask("dump").split()
        rows = [self._line() for _ in range(int(height))]
        digits = np.frombuffer("".join(rows).encode(), np.uint8) - ord("0")
        return digits.reshape(int(height), int(width))

    def _line(self) -> str:
        while b"\n" not in self._unread:
            assert self._take(GENEROUS_S), "the board says nothing"
        line, self._unread = self._unread.split(b"\n", 1)
        return line.decode()

    def _take(self, wait_s: float) -> bool:
        """Reads both sockets: a board stands still while nobody takes what it sends."""
        ready, _, _ = select.select([self.link, self.text], [], [], wait_s)
        if self.link in ready:
            self._heard += self.link.recv(4096)
        if self.text in ready:
            self._unread += self.text.recv(65_536)
        return bool(ready)
