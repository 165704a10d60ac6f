"""The planner's firmware on the emulated Cortex-M3 does what its host form does, byte for byte."""

import time
from pathlib import Path

import numpy as np
import pytest

from mapod_link.serial_line import serial_from_frame
from tests.support.c_bench import Bench, drives_of, random_ground
from tools.rig.board import EmulatedBoard
from tools.rig.c_build import BUILD, MCU, MissingToolError, built, program
from tools.rig.c_planner import CPlanner, PlannerSettings
from tools.rig.c_sizes import firmware_size, firmware_stack

SETTINGS = PlannerSettings(start_clear_m=2.0)
NONCE = 7
PATIENCE_S = 60.0


def board(folder: Path, key: bytes | None = None) -> EmulatedBoard:
    """The planner on a board, its line a socket."""
    return EmulatedBoard(SETTINGS, folder, key=key, nonce=NONCE)


class Both:
    """The planner of a bench, and beside it a board that hears the same bytes at the same times."""

    def __init__(self, emulated: EmulatedBoard) -> None:
        self.board, self.bench = emulated, Bench(SETTINGS)
        self.heard = b""  # of the board

    def tick(self) -> None:
        """One tick of the sender for both; the board's clock stands meanwhile."""
        bench = self.bench
        bench.heard.clear()
        bench.tick()
        self.board.hold_clock(bench.now_s)
        self.board.send(b"".join(serial_from_frame(frame) for frame in bench.heard))
        until_s = time.monotonic() + PATIENCE_S
        while self.board.status()["accepted"] < bench.state.accepted:
            assert time.monotonic() < until_s
        self.board.let_speak()
        self.heard += self.board.hear()


def frames_from_line(line: bytes) -> list[bytes]:
    """Frames of a serial line."""
    frames = []
    for piece in line.split(b"\0"):
        frame, at = bytearray(), 0
        while at < len(piece):
            code = piece[at]
            frame += piece[at + 1 : at + code]
            at += code
            if code < 255 and at < len(piece):
                frame.append(0)
        if frame:
            frames.append(bytes(frame))
    return frames


def test_host_and_board_ask_for_the_same_motions_and_hold_the_same_map(tmp_path: Path) -> None:
    with board(tmp_path) as emulated:
        both = Both(emulated)
        bench = both.bench
        random_ground(bench, 11, 0.08)
        bench.obeys = True
        for tick in range(70):
            if tick == 8:
                bench.planner.goal(6.0, -3.0)
                emulated.goal(6.0, -3.0)
            both.tick()
        emulated.status()
        both.heard += emulated.hear()
        asked = drives_of(frames_from_line(both.heard))
        assert len(asked) >= 25
        assert asked == bench.asked
        assert any(drive[0] > 0.3 for drive in asked)
        assert np.array_equal(emulated.window(), bench.planner.window())
        assert emulated.origin() == bench.planner.origin()
        assert emulated.state() == bench.state
        assert emulated.status()["stack"] < 1200


def test_a_board_keeps_time_and_says_hello_until_it_is_heard(tmp_path: Path) -> None:
    with board(tmp_path) as emulated:
        assert emulated.state().blank
        heard, until_s = b"", time.monotonic() + PATIENCE_S
        while heard.count(b"\0") < 3:
            heard += emulated.hear()
            assert time.monotonic() < until_s
        assert all(frame[0] == 0x19 for frame in frames_from_line(heard[: heard.rindex(b"\0")]))


def test_a_board_with_a_pty_names_it(tmp_path: Path) -> None:
    with EmulatedBoard(SETTINGS, tmp_path, "pty") as emulated:
        assert Path(emulated.link_path).is_char_device()
        emulated.goal(1.5, -2.0)
        assert emulated.state().goal == (1.5, -2.0)
        emulated.halt()
        assert emulated.state().state == "idle"


def test_flash_ram_and_stack_are_told_and_small() -> None:
    small, large = firmware_size(101), firmware_size(201)  # the second is what the board runs
    assert 10_000 < small.flash < 32_000
    assert small.ram < 200_000
    assert small.planner < large.planner < 500_000
    assert 300 < firmware_stack() < 2000


def test_a_serial_line_and_datagrams_carry_the_same_planner() -> None:
    planner = CPlanner(SETTINGS, nonce=NONCE)
    bench = Bench(SETTINGS)
    bench.run(0.2)
    bench.planner.goal(4.0, 1.0)
    planner.goal(4.0, 1.0)
    on_line: list[bytes] = []
    for _ in range(40):
        bench.heard.clear()
        bench.tick()
        line = b"".join(serial_from_frame(frame) for frame in bench.heard)
        planner.feed_stream(bench.now_s, line[: len(line) // 2])
        on_line.append(planner.exchange(bench.now_s, line[len(line) // 2 :]))
    told = frames_from_line(b"".join(on_line))
    assert {frame[0] for frame in told} >= {0x18, 0x19}
    assert planner.state(bench.now_s).accepted > 60


def test_a_missing_tool_is_named_with_its_package() -> None:
    with pytest.raises(MissingToolError, match="apt install"):
        program("no-such-compiler")


def test_what_has_not_changed_is_not_compiled_again() -> None:
    source = MCU / "host" / "receiver.c"
    first = built("receiver", source, "-O2")
    made = first.stat().st_mtime_ns
    assert built("receiver", source, "-O2").stat().st_mtime_ns == made
    assert first.parent == BUILD
