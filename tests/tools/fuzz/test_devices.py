"""Devices as targets of the fuzzer: their programs and seeds reach what they are to reach."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from tools.fuzz.devices import CODECS, FRAMED, NEEDS, RAW, TIME, run_program, write_seeds
from tools.fuzz.program import instruction

ABLE = [
    pytest.param(
        codec,
        marks=pytest.mark.skipif(
            codec in NEEDS and find_spec(NEEDS[codec]) is None, reason=f"needs {NEEDS.get(codec)}"
        ),
    )
    for codec in CODECS
]


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
