"""The planner's firmware on the emulated Cortex-M3 does what its host form does, byte for byte."""

import tty
from pathlib import Path

import numpy as np
import pytest

from mapod_link.serial_line import Deframer, serial_from_frame
from tests.support.link.c_bench import Bench, drives_of, random_ground
from tools.rig.c_sizes import firmware_size, firmware_stack
from tools.rig.planner.board import EmulatedBoard
from tools.rig.planner.build import BUILD, MCU, MissingToolError, built, program
from tools.rig.planner.host import PlannerSettings

SETTINGS = PlannerSettings(start_clear_m=2.0)
NONCE = 7


def frames_of(line: bytes) -> list[bytes]:
    """Frames of a serial line; all are whole."""
    frames = Deframer().feed(line)
    assert None not in frames
    return [frame for frame in frames if frame is not None]


def tick(emulated: EmulatedBoard, bench: Bench) -> bytes:
    """One tick of the sender for both; gives what the board says, whose clock stands meanwhile."""
    bench.heard.clear()
    bench.tick()
    emulated.hold_clock(bench.now_s)
    emulated.send(b"".join(serial_from_frame(frame) for frame in bench.heard))
    while emulated.status()["accepted"] < bench.state.accepted:
        pass
    emulated.let_speak()
    return emulated.hear()


@pytest.mark.parametrize("ticks", [24, pytest.param(70, marks=pytest.mark.slow)])
def test_host_and_board_ask_for_the_same_motions_and_hold_the_same_map(
    ticks: int, tmp_path: Path
) -> None:
    with EmulatedBoard(SETTINGS, tmp_path, nonce=NONCE) as emulated:
        bench = Bench(SETTINGS)
        random_ground(bench, 11, 0.08)
        bench.obeys = True
        heard = b"".join(tick(emulated, bench) for _ in range(8))
        bench.planner.goal(6.0, -3.0)
        emulated.goal(6.0, -3.0)
        heard += b"".join(tick(emulated, bench) for _ in range(8, ticks))
        emulated.status()
        asked = drives_of(frames_of(heard + emulated.hear()))
        assert len(asked) >= (ticks - 20) / 2
        assert asked == bench.asked
        assert any(drive[:2] != (0.0, 0.0) for drive in asked)
        (window, origin), (expected, at) = emulated.snapshot(), bench.planner.snapshot()
        assert np.array_equal(window, expected)
        assert origin == at
        assert emulated.state() == bench.state
        assert emulated.status()["stack"] < 1200


def test_a_board_says_hello_on_its_pty_until_it_is_heard_and_obeys_its_text(tmp_path: Path) -> None:
    with EmulatedBoard(SETTINGS, tmp_path, "pty") as emulated:
        heard = b""
        with Path(emulated.link_path).open("rb", buffering=0) as line:
            tty.setraw(line.fileno())
            while heard.count(b"\0") < 3:  # the first may be cut
                heard += line.read(64)
        _, *hellos, _ = heard.split(b"\0")
        assert all(frame[0] == 0x19 for frame in frames_of(b"\0".join([*hellos, b""])))
        assert emulated.state().blank
        emulated.goal(1.5, -2.0)
        assert emulated.state().goal == (1.5, -2.0)
        emulated.halt()
        assert emulated.state().state == "idle"
        assert emulated.ask("set unknown_mmps 7") == "set 7"
        assert emulated.ask("set front_mm 7") == "set what?"


@pytest.mark.slow
def test_flash_ram_and_stack_are_told_and_small() -> None:
    small, large = firmware_size(101), firmware_size(201)  # the second is what the board runs
    assert 10_000 < small.flash < 32_000
    assert small.ram < 200_000
    assert small.planner < large.planner < 500_000
    assert 300 < firmware_stack() < 2000


def test_a_missing_tool_is_named_with_its_package() -> None:
    with pytest.raises(MissingToolError, match="apt install"):
        program("no-such-compiler")


def test_what_has_not_changed_is_not_compiled_again() -> None:
    source = MCU / "host" / "receiver.c"
    first = built("receiver", source, "-O2")
    made = first.stat().st_mtime_ns
    assert built("receiver", source, "-O2").stat().st_mtime_ns == made
    assert first.parent == BUILD
