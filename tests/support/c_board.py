"""The C header as firmware on an emulated Cortex-M3, for tests; see `tools.rig.board`."""

from pathlib import Path

from tools.rig.c_build import BARE, BOARD, PLANNER, built

SOURCES = [str(BOARD / name) for name in ("board.c", "text.c", "startup.c")]


def build_firmware(*options: str) -> Path:
    """The program for qemu-system-arm -M mps2-an385."""
    words = (*BARE, *options, f"-I{PLANNER}", *SOURCES)
    return built("board.elf", BOARD / "link_only.c", *words, compiler="arm-none-eabi-gcc")
