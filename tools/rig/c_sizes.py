"""Code, state and stack on a Cortex-M: `python -m tools.rig.c_sizes header` or `... planner`.

Of the header: what the linker keeps for the functions that section 12 of the protocol names, -Os;
memset and memcpy are the board's own and not counted. Of the planner: its firmware as it runs in
the emulator. Flash is code, tables and the first values of variables; RAM is all variables. The
deepest stack is the worst path through the compiler's own call graph; an interrupt comes on top.
"""

import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tools.rig.planner.build import (
    BOARD,
    CORTEX_M3,
    MCU,
    PLANNER,
    STRICT,
    CompileError,
    MissingToolError,
    build_planner_firmware,
    compile_c,
    planner_sources,
    program,
    shipped_robot,
)

GCC = "arm-none-eabi-gcc"
CORES = ("cortex-m0", "cortex-m3", "cortex-m4")
CORE_SET = (
    "mapod_link_init", "mapod_link_byte", "mapod_link_datagram", "mapod_link_cell",
    "mapod_link_pose", "mapod_link_suspect", "mapod_link_stale", "mapod_talk_init",
    "mapod_talk_ack",
)  # fmt: skip
REST = (
    "mapod_link_advice", "mapod_link_check_digest", "mapod_link_at", "mapod_talk_poll",
    "mapod_talk_serial", "mapod_talk_drive", "mapod_talk_external_pose", "mapod_talk_ask",
    "mapod_zone_from", "mapod_zone_advice", "mapod_tile_from", "mapod_tile_value",
)  # fmt: skip
NO_TILES, AUTH = "-DMAPOD_LINK_NO_TILES", "-DMAPOD_LINK_AUTH"
OPTIONS = (*STRICT, "-Os", "-mthumb", "-ffunction-sections", "-fdata-sections")
WINDOWS = (101, 201)  # cells along an edge; the planner has room for the second as shipped
NODE = re.compile(r'node: { title: "(?:[^"]*:)?([\w.]+)" label: "[^"]*?(\d+) bytes \(([\w,]+)\)')
EDGE = re.compile(r'edge: { sourcename: "(?:[^"]*:)?([\w.]+)" targetname: "(?:[^"]*:)?([\w.]+)"')


class Size(NamedTuple):
    """Of what the linker keeps, bytes."""

    code: int
    tables: int


class FirmwareSize(NamedTuple):
    """Of a firmware, bytes."""

    flash: int
    ram: int  # without the stack
    planner: int  # of that, the planner's own state: link, map, driver


@cache
def linked(core: str, functions: tuple[str, ...], *defines: str) -> Size:
    """Code of some functions and all that they need; only memset and memcpy are from outside."""
    kept = [f"-Wl,-u,{name}" for name in functions]
    bare: tuple[str, ...] = ("-nostdlib", "-nostartfiles", "-Wl,--gc-sections", "-Wl,-e,0")
    absent = [f"-Wl,--defsym={name}=0" for name in ("memset", "memcpy")]
    with tempfile.TemporaryDirectory() as folder:
        chosen = (f"-mcpu={core}", *defines, *bare, *kept, *absent, str(MCU / "sizes.c"))
        elf = compile_c(GCC, Path(folder) / "x.elf", *OPTIONS, *chosen)
        lines = _output("arm-none-eabi-size", "-A", str(elf)).splitlines()
    rows = [line.split() for line in lines if line.startswith(".")]
    sizes = {row[0]: int(row[1]) for row in rows}
    return Size(sizes[".text"], sizes.get(".rodata", 0))


def state_bytes(core: str, *defines: str) -> tuple[int, int]:
    symbols = _compiled(core, *defines)[0]
    found = re.findall(r"^\S+ (\S+) \w size_of_(\w+)$", symbols, re.MULTILINE)
    sizes = {name: int(size, 16) for size, name in found}
    return sizes["link"], sizes["talk"]


def undefined(core: str, *defines: str) -> set[str]:
    symbols = _compiled(core, *defines)[0]
    return set(re.findall(r"^ +U (\w+)$", symbols, re.MULTILINE))


def header_stack(core: str, *defines: str) -> int:
    return deepest_stack([_compiled(core, *defines)[1]], CORE_SET)


def firmware_size(window_cells: int) -> FirmwareSize:
    firmware = build_planner_firmware(replace(shipped_robot(), window_cells=window_cells))
    words = _output("arm-none-eabi-size", str(firmware)).splitlines()[1].split()
    text, data, bss = (int(word) for word in words[:3])
    stack = 4096
    symbols = _output("arm-none-eabi-nm", "-S", str(firmware))
    found = re.search(r"^\S+ (\S+) \w planner$", symbols, re.MULTILINE)
    assert found, "the firmware has no planner"
    return FirmwareSize(text + data, data + bss - stack, int(found[1], 16))


def firmware_stack() -> int:
    """Bytes of the worst path from the planner's `main`."""
    sources = [*planner_sources(), str(PLANNER / "firmware.c")]
    sources += [str(BOARD / name) for name in ("board.c", "text.c")]
    words = (*STRICT, *CORTEX_M3, "-ffreestanding", *shipped_robot().options())
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "x.o"
        graphs = [_call_graph(made, *words, "-c", source) for source in sources]
    return deepest_stack(graphs, ["main"])


def deepest_stack(graphs: Iterable[str], roots: Iterable[str]) -> int:
    """Bytes of the worst path from any root through the compiler's call graphs; none recurses."""
    own: dict[str, int] = {}
    calls: dict[str, set[str]] = defaultdict(set)
    for text in graphs:
        for name, size, kind in NODE.findall(text):
            assert kind == "static", f"{name}: its stack has no bound"
            own[name] = int(size)
        for caller, called in EDGE.findall(text):
            calls[caller].add(called)

    def depth(name: str, path: tuple[str, ...]) -> int:
        assert name not in path, f"{name} calls itself"
        below = [depth(called, (*path, name)) for called in calls[name] if called in own]
        return own[name] + max(below, default=0)

    return max(depth(name, ()) for name in roots)


@cache
def _compiled(core: str, *defines: str) -> tuple[str, str]:
    """(symbols as nm lists them, call graph with stacks) of the whole header."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "x.o"
        words = (f"-mcpu={core}", *defines, "-c", str(MCU / "sizes.c"))
        graph = _call_graph(made, *OPTIONS, *words)
        return _output("arm-none-eabi-nm", "-S", str(made)), graph


def _call_graph(made: Path, *words: str) -> str:
    compile_c(GCC, made, *words, "-fcallgraph-info=su")
    return made.with_suffix(".ci").read_text()


def _output(name: str, *arguments: str) -> str:
    command = [program(name), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def header_report() -> list[str]:
    lines = ["bytes                                    cortex-m0 cortex-m3 cortex-m4"]
    keyed = (*CORE_SET, "mapod_link_set_key")
    figures: dict[str, Callable[[str], int]] = {
        "decoder with ACK (section 12): code": lambda core: linked(core, CORE_SET, NO_TILES).code,
        "  its tables (CRC, sizes)": lambda core: linked(core, CORE_SET, NO_TILES).tables,
        "with tags: code": lambda core: linked(core, keyed, AUTH, NO_TILES).code,
        "  tables": lambda core: linked(core, keyed, AUTH, NO_TILES).tables,
        "with checks of STOP_ZONE and TILE: code": lambda core: linked(core, CORE_SET).code,
        "all that the header offers: code": lambda core: linked(core, CORE_SET + REST).code,
        "struct mapod_link": lambda core: state_bytes(core)[0],
        "struct mapod_talk": lambda core: state_bytes(core)[1],
        "struct mapod_link with tags": lambda core: state_bytes(core, AUTH)[0],
        "deepest stack": header_stack,
        "deepest stack with tags": lambda core: header_stack(core, AUTH),
    }
    for title, figure in figures.items():
        lines.append(f"{title:40s}" + "".join(f"{figure(core):10d}" for core in CORES))
    return lines


def planner_report() -> list[str]:
    lines = ["the planner's firmware on a Cortex-M3, gcc -Os, tags included; bytes"]
    lines.append("window         flash       RAM   of that the planner")
    for cells in WINDOWS:
        size = firmware_size(cells)
        lines.append(f"{cells:3d} x {cells:3d} {size.flash:10d} {size.ram:9d} {size.planner:21d}")
    lines.append(f"deepest stack: {firmware_stack()}")
    return lines


REPORTS = {"header": header_report, "planner": planner_report}


def main(words: list[str] | None = None) -> int:
    chosen = sys.argv[1:] if words is None else words
    if len(chosen) != 1 or chosen[0] not in REPORTS:
        sys.stderr.write(f"use: python -m tools.rig.c_sizes {' | '.join(REPORTS)}\n")
        return 2
    try:
        sys.stdout.write("\n".join([*REPORTS[chosen[0]](), ""]))
    except (MissingToolError, CompileError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
