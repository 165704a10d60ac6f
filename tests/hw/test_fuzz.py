"""The short form of `make fuzz`: each codec with its session against a guided fuzzer."""

import platform
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests import ROOT
from tools.fuzz import CODECS, FRAMED, NEEDS, RAW, TIME, instruction, run_program, write_seeds

RUNS = 1500
LARGE = ("kinect", "visionary", "folder")  # images of up to 300 000 numbers each
ABLE = [
    pytest.param(
        codec,
        marks=pytest.mark.skipif(
            codec in NEEDS and find_spec(NEEDS[codec]) is None, reason=f"needs {NEEDS.get(codec)}"
        ),
    )
    for codec in CODECS
]


@pytest.mark.slow
@pytest.mark.skipif(
    platform.machine() != "x86_64",
    reason="the fuzzer has no wheel for this machine's processor",
)
@pytest.mark.parametrize("codec", ABLE)
def test_no_bytes_from_a_device_raise_hang_or_fill_the_memory(codec: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tools.fuzz", "--codec", codec]
    runs = RUNS // 5 if codec in LARGE else RUNS
    found = subprocess.run(
        [*command, "--seconds", "0", "--runs", str(runs)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert found.returncode == 0, found.stderr[-3000:]
    executed = re.search(r"stat::number_of_executed_units: (\d+)", found.stderr)
    assert executed is not None
    assert int(executed[1]) >= runs  # the seeds come on top


@pytest.mark.parametrize("codec", ABLE)
def test_the_harness_itself_feeds_frames_junk_and_time(codec: str) -> None:
    program = instruction(RAW, b"junk\x02\xfa\r") + instruction(FRAMED, b"\x31")
    program += instruction(TIME, b"")[:1] + (500).to_bytes(2, "big")
    run_program(codec, program + instruction(FRAMED, b"sAN SetAccessMode \x01"))


@pytest.mark.parametrize(
    ("codec", "least"),
    [
        ("visionary", {"conversation": 1, "frames": 7}),
        ("kinect", {"conversation": 0, "frames": 8}),
        ("folder", {"conversation": 20, "middle": 0}),
    ],
)
def test_depth_cameras_measure_in_their_seeds(
    codec: str, least: dict[str, int], tmp_path: Path
) -> None:
    write_seeds(codec, tmp_path)
    for name, count in least.items():
        assert run_program(codec, (tmp_path / name).read_bytes()) >= count


def test_the_camera_measures_in_its_seed_and_by_framed_images(tmp_path: Path) -> None:
    pytest.importorskip(NEEDS["stripe"])
    write_seeds("stripe", tmp_path)
    assert run_program("stripe", (tmp_path / "conversation").read_bytes()) > 0
    assert run_program("stripe", (tmp_path / "image").read_bytes()) == 1
