"""The C header compiles without a warning wherever it should, and keeps to its figures."""

import subprocess
from pathlib import Path

import pytest

from tests.support.cases import few
from tests.support.link.planner_sender import vector
from tools.rig.c_sizes import (
    AUTH,
    CORE_SET,
    CORES,
    GCC,
    NO_TILES,
    header_stack,
    linked,
    state_bytes,
    undefined,
)
from tools.rig.planner.build import MCU, STRICT, CompileError, compile_c

SETTINGS = {
    "with tags": (AUTH,),
    "as it is": (),
    "without tiles": (NO_TILES,),
    "static": ("-DMAPOD_LINK_STATIC",),
    "short frames": ("-DMAPOD_FRAME_MAX=64u",),
    "big endian": ("-DMAPOD_LINK_BIG_ENDIAN", AUTH),
    "with objects": ("-DMAPOD_LINK_OBJECTS", AUTH),
}
# Section 12 of the protocol
CODE = {"cortex-m0": 2.4 * 1024, "cortex-m3": 2.1 * 1024, "cortex-m4": 2.1 * 1024}
STATE, STACK, CRC_TABLE = 460, 200, 64
MORE_CODE_WITH_TAGS, MORE_STACK_WITH_TAGS = 856, 350


@pytest.mark.parametrize("settings", few(SETTINGS, 1))
@pytest.mark.parametrize("compiler", few(["gcc", GCC, "clang"], 2))
def test_it_compiles_strictly(compiler: str, settings: str, tmp_path: Path) -> None:
    core = ("-Os", "-mcpu=cortex-m0", "-mthumb") if compiler == GCC else ("-O2",)
    words = (*STRICT, *core, *SETTINGS[settings], "-c", str(MCU / "example.c"))
    compile_c(compiler, tmp_path / "x.o", *words)


@pytest.mark.parametrize("core", few(CORES, 1))
def test_clang_compiles_it_for_a_cortex_m_without_any_system_header(
    core: str, tmp_path: Path
) -> None:
    (tmp_path / "string.h").write_text(
        "#include <stddef.h>\n"
        "void *memset(void *to, int value, size_t count);\n"
        "void *memcpy(void *to, const void *from, size_t count);\n"
    )
    alone = ("--target=arm-none-eabi", f"-mcpu={core}", "-mthumb", "-ffreestanding")
    words = (*STRICT, "-Os", *alone, f"-I{tmp_path}", "-c", str(MCU / "example.c"))
    compile_c("clang", tmp_path / "x.o", *words)


@pytest.mark.parametrize("compiler", few(["g++", "clang++"], 1))
def test_it_compiles_strictly_as_cpp_and_links_with_the_c_of_another_file(
    compiler: str, tmp_path: Path
) -> None:
    strict = [word for word in STRICT if word != "-std=c99"]
    user = tmp_path / "user.cpp"
    user.write_text(USER)
    whole = tmp_path / "whole.c"
    whole.write_text('#define MAPOD_LINK_IMPLEMENTATION\n#include "mapod_link.h"\n')
    both = ("-x", "c++", "-std=c++11", *strict)
    compile_c(compiler, tmp_path / "alone.o", *both, "-c", str(whole))
    c_object = compile_c("gcc", tmp_path / "whole.o", *STRICT, "-c", str(whole))
    words = ("-std=c++11", *strict, str(user), str(c_object))
    program = compile_c(compiler, tmp_path / "user", *words)
    assert subprocess.run([str(program)], check=False).returncode == 0


def test_a_frame_buffer_of_a_wrong_size_is_refused(tmp_path: Path) -> None:
    for size in (63, 369):
        words = (f"-DMAPOD_FRAME_MAX={size}u", "-c", str(MCU / "example.c"))
        with pytest.raises(CompileError, match="must be within 64 to 368"):
            compile_c("gcc", tmp_path / "x.o", *words)


@pytest.mark.slow
@pytest.mark.parametrize("core", CORES)
def test_code_state_and_stack_are_within_the_protocols_figures(core: str) -> None:
    size, keyed = linked(core, CORE_SET, NO_TILES), (*CORE_SET, "mapod_link_set_key")
    assert size.code <= CODE[core]
    assert size.tables <= CRC_TABLE + 16
    assert state_bytes(core)[0] <= STATE
    assert header_stack(core) < STACK
    more = linked(core, keyed, NO_TILES, AUTH).code - size.code
    assert more <= MORE_CODE_WITH_TAGS
    assert header_stack(core, AUTH) - header_stack(core) <= MORE_STACK_WITH_TAGS
    assert undefined(core, AUTH) <= {"memset", "memcpy"}


USER = """
#include "mapod_link.h"
static mapod_link link_to_mapod;
static uint8_t cells[MAPOD_CELL_BYTES(3, 3)];
int main() {
    mapod_link_init(&link_to_mapod, cells, 9);
    return mapod_link_advice(&link_to_mapod, 0) == MAPOD_STOP ? 0 : 1;
}
"""
BOARD = """
#include <stdio.h>
#include "mapod_link.h"
static const uint8_t heard[] = {%s};
static uint32_t at, written;
static uint8_t seen[8];
void planner_start(void);
void planner_loop(void);
uint32_t board_now_ms(void) { return 5000u; }
bool board_read(uint8_t *byte)
{
    *byte = heard[(at < sizeof heard) ? at : 0u];
    at++;
    return at <= sizeof heard;
}
void board_write(const uint8_t *bytes, uint32_t count)
{
    seen[written] = bytes[1];
    written += (count > 0u) ? 1u : 0u;
}
uint32_t board_random(void) { return 4711u; }
void board_obstacle(int32_t x_mm, int32_t y_mm)
{
    (void)printf("%%d,%%d ", (int)x_mm, (int)y_mm);
}
void board_move(enum mapod_advice advice)
{
    (void)printf("%%d %%02x\\n", (int)advice, seen[0]);
}
#ifdef MAPOD_LINK_OBJECTS
void board_object(const struct mapod_object *object, bool all_known)
{
    (void)printf("object %%u %%d ", (unsigned)object->id, (int)all_known);
}
#endif
int main(void)
{
    planner_start();
    planner_loop();
    return 0;
}
"""

OBSTACLES = " ".join(f"{x},{y}" for y in (500, 550) for x in (-500, -450, -400))


@pytest.mark.parametrize(
    ("names", "settings", "told"),
    [
        (("geom", "pose", "map"), (), f"{OBSTACLES} 2 18"),  # go
        (("geom", "pose", "map", "objects"), SETTINGS["with objects"],
         f"{OBSTACLES} object 258 0 object 3 0 1 18"),  # slow: frames are missing
    ],
)  # fmt: skip
def test_the_example_runs_as_it_is_printed(
    names: tuple[str, ...], settings: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    line = b"".join(vector(f"{name}_serial") for name in names)
    board = tmp_path / "board.c"
    board.write_text(BOARD % ", ".join(map(str, line)))
    sources = (str(board), str(MCU / "example.c"))
    program = compile_c("gcc", tmp_path / "example", *STRICT, *settings, *sources)
    done = subprocess.run([str(program)], capture_output=True, text=True, check=True)
    assert done.stdout == f"{told}\n", "obstacles from the robot, advice, an ACK was sent"
