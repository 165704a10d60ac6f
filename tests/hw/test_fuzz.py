"""The short form of `make fuzz`: each codec with its session against a guided fuzzer."""

import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import ROOT
from tools.fuzz import CODECS, FRAMED, RAW, TIME, instruction, run_program

RUNS = 1500


@pytest.mark.slow
@pytest.mark.skipif(
    platform.machine() != "x86_64",
    reason="the fuzzer has no wheel for this machine's processor",
)
@pytest.mark.parametrize("codec", CODECS)
def test_no_bytes_from_a_device_raise_hang_or_fill_the_memory(codec: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tools.fuzz", "--codec", codec]
    found = subprocess.run(
        [*command, "--seconds", "0", "--runs", str(RUNS)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert found.returncode == 0, found.stderr[-3000:]
    executed = re.search(r"stat::number_of_executed_units: (\d+)", found.stderr)
    assert executed is not None
    assert int(executed[1]) >= RUNS  # the seeds come on top


@pytest.mark.parametrize("codec", CODECS)
def test_the_harness_itself_feeds_frames_junk_and_time(codec: str) -> None:
    program = instruction(RAW, b"junk\x02\xfa\r") + instruction(FRAMED, b"\x31")
    program += instruction(TIME, b"")[:1] + (500).to_bytes(2, "big")
    run_program(codec, program + instruction(FRAMED, b"sAN SetAccessMode \x01"))
