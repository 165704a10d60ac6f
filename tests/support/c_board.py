"""The C header as firmware on an emulated Cortex-M3, for tests; see `tools.rig.board`."""

from pathlib import Path

from tests.support.c_link import MCU, built, needs
from tools.rig.board import Board as AnyBoard
from tools.rig.c_build import BARE

SOURCES = [MCU / "qemu" / name for name in ("board.c", "startup.c")]


def build_firmware(*options: str) -> Path:
    """The program for qemu-system-arm -M mps2-an385."""
    words = (*BARE, *options, *map(str, SOURCES))
    return built("board.elf", "qemu/firmware.c", *words, compiler="arm-none-eabi-gcc")


class Board(AnyBoard):
    """A running board; skips the test where there is no emulator."""

    def __init__(self, firmware: Path, folder: Path) -> None:
        needs("qemu-system-arm")
        super().__init__(firmware, folder)
