"""Flash, RAM and stack of the planner on a Cortex-M3: `python -m tools.rig.planner_sizes`.

Flash is code, tables and the first values of variables; RAM is all variables, the ring of the
interrupt included. The deepest stack is the worst path through the compiler's own call graph, from
`main`; an interrupt comes on top. Where a tool is missing, the words say which package has it.
"""

import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from tools.rig.c_build import (
    CORTEX_M3,
    MCU,
    STRICT,
    CompileError,
    MissingToolError,
    build_planner_firmware,
    compile_c,
    planner_sources,
    program,
)

GCC = "arm-none-eabi-gcc"
LARGEST = 201  # cells along an edge, as shipped
WINDOWS = (101, LARGEST)
NODE = re.compile(r'node: { title: "([^"]*)" label: "[^"]*?(\d+) bytes \(([\w,]+)\)')
EDGE = re.compile(r'edge: { sourcename: "([^"]*)" targetname: "([^"]*)"')


@dataclass(frozen=True, slots=True)
class Size:
    """Of a firmware, bytes."""

    flash: int
    ram: int  # without the stack
    planner: int  # of that, the planner's own state: link, map, driver


def size_of(window_cells: int) -> Size:
    """The firmware for windows of so many cells along an edge."""
    cells = f"-DFIELD_CELLS=({window_cells}u*{window_cells}u)"
    firmware = build_planner_firmware(*([cells] if window_cells != LARGEST else []))
    words = _output("arm-none-eabi-size", str(firmware)).splitlines()[1].split()
    text, data, bss = (int(word) for word in words[:3])
    stack = 4096
    symbols = _output("arm-none-eabi-nm", "-S", str(firmware))
    found = re.search(r"^\S+ (\S+) \w planner$", symbols, re.MULTILINE)
    assert found, "the firmware has no planner"
    return Size(text + data, data + bss - stack, int(found[1], 16))


def deepest_stack() -> int:
    """Bytes of the worst path from `main`; calls do not recurse."""
    own: dict[str, int] = {}
    calls: dict[str, set[str]] = defaultdict(set)
    sources = [*planner_sources(), str(MCU / "planner" / "firmware.c"), str(MCU / "qemu/board.c")]
    with tempfile.TemporaryDirectory() as folder:
        for source in sources:
            made = Path(folder) / f"{Path(source).stem}.o"
            words = (*STRICT, *CORTEX_M3, "-ffreestanding", "-DMAPOD_LINK_AUTH")
            compile_c(GCC, made, *words, "-fcallgraph-info=su", "-c", source)
            text = made.with_suffix(".ci").read_text()
            for name, size, kind in NODE.findall(text):
                assert kind == "static", f"{name}: its stack has no bound"
                own[_plain(name)] = int(size)
            for caller, called in EDGE.findall(text):
                calls[_plain(caller)].add(_plain(called))

    def depth(name: str, path: tuple[str, ...]) -> int:
        assert name not in path, f"{name} calls itself"
        below = [depth(called, (*path, name)) for called in calls[name] if called in own]
        return own[name] + max(below, default=0)

    return depth("main", ())


def _plain(title: str) -> str:
    """A function's name: a static one's title begins with its file."""
    return title.rsplit(":", 1)[-1]


def _output(name: str, *arguments: str) -> str:
    return subprocess.run(
        [program(name), *arguments], capture_output=True, text=True, check=True
    ).stdout


def report() -> list[str]:
    """All figures, as lines of a table."""
    lines = ["the planner's firmware on a Cortex-M3, gcc -Os, tags included; bytes"]
    lines.append("window         flash       RAM   of that the planner")
    for cells in WINDOWS:
        size = size_of(cells)
        lines.append(f"{cells:3d} x {cells:3d} {size.flash:10d} {size.ram:9d} {size.planner:21d}")
    lines.append(f"deepest stack: {deepest_stack()}")
    return lines


def main() -> int:
    """Print the figures; 2: a tool is missing, or the compiler is not content."""
    try:
        sys.stdout.write("\n".join([*report(), ""]))
    except (MissingToolError, CompileError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
