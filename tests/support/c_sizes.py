"""Code, state and stack of the C header on a Cortex-M: `python -m tests.support.c_sizes`.

Code is what the linker keeps for the functions that section 12 of the protocol names, compiled with
-Os; memset and memcpy are the board's own and not counted. The deepest stack is the worst path
through the compiler's own call graph, from a byte fed or an ACK built, without those two.
"""

import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tests.support.c_link import MCU, STRICT, compile_c, needs

PACKAGE = "gcc-arm-none-eabi libnewlib-arm-none-eabi"
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


@dataclass(frozen=True, slots=True)
class Size:
    """Of what the linker keeps, bytes."""

    code: int
    tables: int


@cache
def linked(core: str, functions: tuple[str, ...], *defines: str) -> Size:
    """Code of some functions and all that they need; only memset and memcpy are from outside."""
    kept = [f"-Wl,-u,{name}" for name in functions]
    bare: tuple[str, ...] = ("-nostdlib", "-nostartfiles", "-Wl,--gc-sections", "-Wl,-e,0")
    absent = [f"-Wl,--defsym={name}=0" for name in ("memset", "memcpy")]
    source = str(MCU / "sizes.c")
    with tempfile.TemporaryDirectory() as folder:
        chosen = (f"-mcpu={core}", *defines, *bare, *kept, *absent, source)
        elf = compile_c("arm-none-eabi-gcc", PACKAGE, Path(folder) / "x.elf", *OPTIONS, *chosen)
        lines = _output("arm-none-eabi-size", "-A", str(elf)).splitlines()
    sizes = {
        words[0]: int(words[1])
        for line in lines
        if (words := line.split())[:1] and words[0].startswith(".")
    }
    return Size(sizes[".text"], sizes.get(".rodata", 0))


def state_bytes(core: str, *defines: str) -> tuple[int, int]:
    """(struct mapod_link, struct mapod_talk)."""
    symbols = _compiled(core, *defines)[0]
    found = re.findall(r"^\S+ (\S+) \w size_of_(\w+)$", symbols, re.MULTILINE)
    sizes = {name: int(size, 16) for size, name in found}
    return sizes["link"], sizes["talk"]


def deepest_stack(core: str, functions: tuple[str, ...], *defines: str) -> int:
    """Bytes of the worst path from any of the functions; calls do not recurse."""
    text = _compiled(core, *defines)[1]
    node = r'node: { title: "(?:[^"]*:)?(\w+[\w.]*)" label: "[^"]*?(\d+) bytes \(([\w,]+)\)'
    own = {}
    for name, size, kind in re.findall(node, text):
        assert kind == "static", f"{name}: its stack has no bound"
        own[name] = int(size)
    calls: dict[str, set[str]] = defaultdict(set)
    edge = r'edge: { sourcename: "(?:[^"]*:)?(\w+[\w.]*)" targetname: "(?:[^"]*:)?(\w+[\w.]*)"'
    for caller, called in re.findall(edge, text):
        calls[caller].add(called)

    def depth(name: str, path: tuple[str, ...]) -> int:
        assert name not in path, f"{name} calls itself"
        below = [depth(called, (*path, name)) for called in calls[name] if called in own]
        return own[name] + max(below, default=0)

    return max(depth(name, ()) for name in functions)


def undefined(core: str, *defines: str) -> set[str]:
    """What the header takes from outside on that core."""
    symbols = _compiled(core, *defines)[0]
    return set(re.findall(r"^ +U (\w+)$", symbols, re.MULTILINE))


@cache
def _compiled(core: str, *defines: str) -> tuple[str, str]:
    """(symbols as nm lists them, call graph with stacks) of the whole header."""
    with tempfile.TemporaryDirectory() as folder:
        obj = Path(folder) / "x.o"
        words = (f"-mcpu={core}", *defines, "-fcallgraph-info=su", "-c", str(MCU / "sizes.c"))
        compile_c("arm-none-eabi-gcc", PACKAGE, obj, *OPTIONS, *words)
        return _output("arm-none-eabi-nm", "-S", str(obj)), obj.with_suffix(".ci").read_text()


def _output(program: str, *arguments: str) -> str:
    command = [needs(program, PACKAGE), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def report() -> list[str]:
    """All figures, as lines of a table."""
    lines = ["bytes                                    cortex-m0 cortex-m3 cortex-m4"]

    def row(title: str, numbers: list[int]) -> None:
        lines.append(f"{title:40s}" + "".join(f"{number:10d}" for number in numbers))

    core = [linked(name, CORE_SET, NO_TILES) for name in CORES]
    auth = [linked(name, CORE_SET, NO_TILES, AUTH) for name in CORES]
    keys = [linked(name, (*CORE_SET, "mapod_link_set_key"), AUTH, NO_TILES) for name in CORES]
    tiles = [linked(name, CORE_SET) for name in CORES]
    every = [linked(name, CORE_SET + REST) for name in CORES]
    row("decoder with ACK (section 12): code", [size.code for size in core])
    row("  its tables (CRC, sizes)", [size.tables for size in core])
    pairs = list(zip(core, keys, strict=True))
    row("with tags: code more", [key.code - size.code for size, key in pairs])
    row("  tables more", [key.tables - size.tables for size, key in zip(core, auth, strict=True)])
    row("checks of STOP_ZONE and TILE: code more", [
        more.code - size.code for size, more in zip(core, tiles, strict=True)
    ])  # fmt: skip
    row("all that the header offers, no tags", [size.code + size.tables for size in every])
    row("struct mapod_link", [state_bytes(name)[0] for name in CORES])
    row("struct mapod_talk", [state_bytes(name)[1] for name in CORES])
    row("struct mapod_link with tags", [state_bytes(name, AUTH)[0] for name in CORES])
    row("deepest stack", [deepest_stack(name, CORE_SET) for name in CORES])
    row("deepest stack with tags", [deepest_stack(name, CORE_SET, AUTH) for name in CORES])
    return lines


def main() -> None:
    """Print the figures."""
    sys.stdout.write("\n".join([*report(), ""]))


if __name__ == "__main__":
    main()
