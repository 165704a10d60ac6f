"""Compiles the C of hw/mcu and of fakes/planner_mcu, for this machine and for a Cortex-M3.

A program's name tells of which sources and words it was made: what has not changed is not compiled
again, and processes that build at the same time do each other no harm. With MAPOD_C_SANITIZE set,
what is compiled for this machine runs under the address and undefined behaviour sanitizers.
"""

import functools
import hashlib
import math
import os
import shutil
import subprocess
from dataclasses import dataclass, fields
from pathlib import Path

from config_file import load_config
from core.config import Config, ConfigError

ROOT = Path(__file__).parents[3]
MCU = ROOT / "hw" / "mcu"
PLANNER = ROOT / "fakes" / "planner_mcu"
BOARD = PLANNER / "board"
BUILD = ROOT / "build" / "c"
STRICT = (
    "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wpedantic", "-Werror",
    "-ffp-contract=off",
)  # fmt: skip
CORTEX_M3 = ("-Os", "-mcpu=cortex-m3", "-mthumb")
BARE = (
    *CORTEX_M3, "-ffreestanding", "-ffunction-sections", "-fdata-sections",
    "-fno-tree-loop-distribute-patterns", "-nostdlib", "-Wl,--gc-sections",
    "-T", str(BOARD / "board.ld"),
)  # fmt: skip
HOST = next(filter(shutil.which, ("gcc", "clang", "cc")), "gcc")  # the compiler of this machine
SANITIZED = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
PACKAGES = {  # Debian's, by program
    "gcc": "gcc libc6-dev",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "arm-none-eabi-size": "binutils-arm-none-eabi",
    "arm-none-eabi-nm": "binutils-arm-none-eabi",
    "clang": "clang libclang-rt-dev",
    "qemu-system-arm": "qemu-system-arm",
}


class MissingToolError(Exception):
    """A program that is not installed; its words name the Debian packages that have it."""


class CompileError(Exception):
    """A compiler is not content; its words."""


def program(name: str) -> str:
    """The path of an installed program. Raises MissingToolError: there is none."""
    path = shutil.which(name)
    if path is None:
        raise MissingToolError(f"needs {name}: apt install {PACKAGES.get(name, name)}")
    return path


def compile_c(compiler: str, output: Path, *arguments: str) -> Path:
    """Runs a compiler. Raises MissingToolError, CompileError: there is none; it is not content."""
    command = [program(compiler), *arguments, f"-I{MCU}", "-o", str(output)]
    output.parent.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CompileError(done.stderr)
    return output


def built(name: str, source: Path, *arguments: str, compiler: str = HOST) -> Path:
    """A program or library; compiled anew where sources or words changed; see `compile_c`."""
    if os.environ.get("MAPOD_C_SANITIZE") and not compiler.startswith("arm-"):
        arguments = (*arguments, *SANITIZED)
    words = (*STRICT, *arguments, str(source))
    content = repr((compiler, words)).encode()
    for folder in (MCU, PLANNER):
        sources = sorted(path for path in folder.rglob("*") if path.suffix in (".c", ".h", ".ld"))
        content += b"".join(path.read_bytes() for path in sources)
    stem, dot, suffix = name.partition(".")
    path = BUILD / f"{stem}-{hashlib.sha256(content).hexdigest()[:16]}{dot}{suffix}"
    if not path.exists():
        made = BUILD / f"{os.getpid()}-{path.name}"
        os.replace(compile_c(compiler, made, *words), path)
    return path


@dataclass(frozen=True, slots=True)
class PlannerRobot:
    """What the planner is compiled for, in mm, mm/s and mrad/s: the robot, its laser's mount."""

    front_mm: int
    rear_mm: int
    width_mm: int
    margin_mm: int
    max_mmps: int
    max_mradps: int
    line_mm: int  # from the drive axle to where the laser's plane meets level ground
    window_cells: int = 201  # along an edge of the largest map that it has room for

    def options(self) -> tuple[str, ...]:
        """Words for the compiler; the header robot.h that they name is made here."""
        lines = ["/* Made by tools/rig/planner/build.py from the settings of the robot. */"]
        lines += [f"#define ROBOT_{f.name.upper()} {getattr(self, f.name)}" for f in fields(self)]
        text = "\n".join([*lines, ""])
        folder = BUILD / f"robot-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        header = folder / "robot.h"
        if not header.exists():
            folder.mkdir(parents=True, exist_ok=True)
            made = folder / f"{os.getpid()}"
            made.write_text(text, encoding="utf-8")
            os.replace(made, header)
        return f"-I{folder}", f"-I{PLANNER}", "-DMAPOD_LINK_AUTH"


def robot_from_config(config: Config) -> PlannerRobot:
    """The robot of these settings. Raises ConfigError: the planner can't drive it."""
    robot, scanner = config.robot, config.scanner
    if scanner.mount_tilt_deg < 1.0:
        raise ConfigError(
            "scanner.mount_tilt_deg: the planner in C needs a laser that looks down on the "
            f"ground, by 1 deg or more, it is {scanner.mount_tilt_deg:g}"
        )
    tilt_rad = math.radians(scanner.mount_tilt_deg)
    line_m = scanner.mount_x_m + scanner.mount_z_m / math.tan(tilt_rad)
    if not 1.0 <= line_m <= 30.0:
        raise ConfigError(
            "scanner.mount_tilt_deg: the planner in C needs a laser that meets the ground 1 to "
            f"30 m ahead of the drive axle, it does so at {line_m:.2f} m"
        )
    return PlannerRobot(
        front_mm=round(robot.front_m * 1000),
        rear_mm=round(robot.rear_m * 1000),
        width_mm=round(robot.width_m * 1000),
        margin_mm=round(robot.stop_margin_m * 1000),
        max_mmps=round(min(5.0, robot.max_speed_mps) * 1000),
        max_mradps=round(min(5.0, robot.max_turn_radps) * 1000),
        line_mm=round(line_m * 100) * 10,
    )


@functools.cache
def shipped_robot() -> PlannerRobot:
    return robot_from_config(load_config((ROOT / "mapod.toml").read_text(encoding="utf-8")))


def planner_sources() -> list[str]:
    """All of the planner but its firmware and its library for a host."""
    ends = ("firmware.c", "library.c")
    return [str(path) for path in sorted(PLANNER.glob("*.c")) if path.name not in ends]


def build_planner_library(robot: PlannerRobot) -> Path:
    words = ("-O3", "-shared", "-fPIC", *robot.options(), *planner_sources())
    return built("planner.so", PLANNER / "library.c", *words)


def build_planner_firmware(robot: PlannerRobot) -> Path:
    """The planner for qemu-system-arm -M mps2-an385."""
    board = [str(BOARD / name) for name in ("board.c", "text.c", "startup.c")]
    words = (*BARE, *robot.options(), "-DBOARD_RING=16384u", *board, *planner_sources(), "-lgcc")
    return built("planner.elf", PLANNER / "firmware.c", *words, compiler="arm-none-eabi-gcc")
