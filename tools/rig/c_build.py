"""Compiles what is in hw/mcu, for this machine and for the emulated Cortex-M3.

A program's name tells of which sources and words it was made: what has not changed is not compiled
again, and processes that build at the same time do each other no harm.
"""

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

MCU = Path(__file__).parent.parent.parent / "hw" / "mcu"
BUILD = MCU / "build"
STRICT = (
    "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wpedantic", "-Werror",
    "-ffp-contract=off",
)  # fmt: skip
CORTEX_M3 = ("-Os", "-mcpu=cortex-m3", "-mthumb")
BARE = (
    *CORTEX_M3, "-ffreestanding", "-ffunction-sections", "-fdata-sections",
    "-fno-tree-loop-distribute-patterns", "-nostdlib", "-Wl,--gc-sections",
    "-T", str(MCU / "qemu" / "board.ld"),
)  # fmt: skip
PACKAGES = {  # Debian's, by program
    "gcc": "gcc libc6-dev",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "arm-none-eabi-size": "binutils-arm-none-eabi",
    "arm-none-eabi-nm": "binutils-arm-none-eabi",
    "qemu-system-arm": "qemu-system-arm",
}


class MissingToolError(Exception):
    """A program that is not installed; its words name the Debian packages that have it."""


class CompileError(Exception):
    """A compiler is not content; its words."""


def program(name: str, package: str = "") -> str:
    """The path of an installed program.

    Raises:
        MissingToolError: there is none.
    """
    path = shutil.which(name)
    if path is None:
        raise MissingToolError(f"needs {name}: apt install {package or PACKAGES.get(name, name)}")
    return path


def compile_c(compiler: str, output: Path, *arguments: str, package: str = "") -> Path:
    """Runs a compiler.

    Raises:
        MissingToolError, CompileError: there is none; it is not content.
    """
    command = [program(compiler, package), *arguments, f"-I{MCU}", "-o", str(output)]
    output.parent.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CompileError(done.stderr)
    return output


def built(
    name: str, source: str, *arguments: str, compiler: str = "gcc", package: str = ""
) -> Path:
    """A program or library of a file in hw/mcu; compiled anew where sources or words changed.

    Raises:
        MissingToolError, CompileError: as `compile_c`.
    """
    sources = sorted(path for path in MCU.rglob("*.[chl]*") if BUILD not in path.parents)
    content = repr((compiler, source, arguments)).encode()
    content += b"".join(path.read_bytes() for path in sources if path.is_file())
    stem, dot, suffix = name.partition(".")
    path = BUILD / f"{stem}-{hashlib.sha256(content).hexdigest()[:16]}{dot}{suffix}"
    if not path.exists():
        made = BUILD / f"{os.getpid()}-{path.name}"
        words = (*STRICT, *arguments, str(MCU / source))
        os.replace(compile_c(compiler, made, *words, package=package), path)
    return path


def planner_sources() -> list[str]:
    """All of the planner but its firmware."""
    folder = MCU / "planner"
    return [str(path) for path in sorted(folder.glob("*.c")) if path.name != "firmware.c"]


def build_planner_library() -> Path:
    """The planner for this machine, as a shared library with tags."""
    words = ("-O3", "-shared", "-fPIC", "-DMAPOD_LINK_AUTH", *planner_sources())
    return built("planner.so", "host/driver_library.c", *words)


def build_planner_firmware(*options: str) -> Path:
    """The planner for qemu-system-arm -M mps2-an385."""
    board = [str(MCU / "qemu" / name) for name in ("board.c", "startup.c")]
    words = (*BARE, "-DMAPOD_LINK_AUTH", "-DBOARD_RING=16384u", *options, *board)
    words = (*words, *planner_sources(), "-lgcc")
    return built("planner.elf", "planner/firmware.c", *words, compiler="arm-none-eabi-gcc")


def main() -> int:
    """Build the planner's firmware and print where it lies; 2: a tool is missing."""
    try:
        sys.stdout.write(f"{build_planner_firmware()}\n")
    except (MissingToolError, CompileError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
