"""A Kinect by libfreenect, whose own player gives what our simulated world wrote as a dump."""

import os
from pathlib import Path

import numpy as np
import pytest

from fakes.kinect.device import FakeKinect
from fakes.kinect.dump import write_dump
from fakes.kinect.sensing import U16
from fakes.world.simple import Ground
from hw.depth_images.kinect import FRAME_BYTES, KinectFrames
from hw.depth_images.parts import Part, PartsParser
from hw.device import BadFrame
from hw.ports import kinect
from hw.ports.kinect import LIBRARY, PLAYERS, KinectPort, Reader
from hw.ports.wires import open_port
from tests.support.devices.bench_kinect import options_of
from tests.support.machine.real_wires import START_S, until

PLAYER = [str(found) for found in Path("/").glob(f"{PLAYERS}/{LIBRARY}")]
INSTALLED = pytest.mark.skipif(not PLAYER, reason="needs libfreenect: apt install libfreenect0.5")


@pytest.fixture(scope="module")
def dump(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[U16]]:
    fake = FakeKinect(Ground("wall:1.6").met, 1)
    raws = [fake.sensor.picture(k / 30.0).raw for k in range(4)]
    folder = tmp_path_factory.mktemp("kinect") / "dump"
    write_dump(folder, [(k / 30.0, raw) for k, raw in enumerate(raws)])
    return folder, raws


def all_of(port: KinectPort) -> list[Part | BadFrame]:
    """What it gives until it is over."""
    parser, events = PartsParser(FRAME_BYTES), list[Part | BadFrame]()

    def is_over() -> bool:
        if port.poll(START_S):
            for piece in port.read():
                events.extend(parser.feed(START_S, piece))
        return port.cause not in ("", "not opened yet")

    until(is_over)
    return events


@INSTALLED
def test_the_library_plays_our_dump_value_for_value(dump: tuple[Path, list[U16]]) -> None:
    folder, raws = dump
    port = open_port(f"fakenect://{folder}")
    assert isinstance(port, KinectPort)
    events, frames = all_of(port), KinectFrames(options_of())
    assert port.cause == f"{folder}: gone; or, of a dump, played to its end"
    assert not port.poll(START_S + 100.0)  # it is played once
    stamps_s, numbers = [], []
    for part in events:
        assert isinstance(part, Part)
        assert part.stamp_s is not None
        stamps_s.append(part.stamp_s)
        numbers.append(part.number)  # the newest frame wins, so some may be missing
        raw = np.frombuffer(part.data, "<u2").reshape(480, 640)
        np.testing.assert_array_equal(raw, raws[part.number])
        image = frames.take(part)
        assert not isinstance(image, BadFrame)
        wall_m = np.median(image.numbers[:200]) / 1000.0
        assert wall_m == pytest.approx((1.6 - 0.2) / np.cos(np.radians(25.0)), abs=0.2)
    assert numbers[-1] == len(raws) - 1
    assert stamps_s == sorted(stamps_s)
    port.close()


@INSTALLED
def test_a_library_that_ends_its_process_ends_no_more_than_that(tmp_path: Path) -> None:
    (tmp_path / "INDEX.txt").write_text("d-1290000000.000000-1.pgm\n")
    (tmp_path / "d-1290000000.000000-1.pgm").write_bytes(b"P5 640 480 65535\ncut")
    port = open_port(f"fakenect://{tmp_path}")
    assert isinstance(port, KinectPort)
    all_of(port)
    assert port.cause.startswith(f"{tmp_path}: ")
    port.close()


@INSTALLED
def test_a_camera_that_is_not_there_is_told_and_looked_for_again() -> None:
    port = open_port("kinect:///7?format=mm")
    assert isinstance(port, KinectPort)
    assert all_of(port) == []
    assert port.cause.startswith("Kinect 7: not there: libfreenect finds ")
    until(lambda: port.poll(START_S + 100.0) or port._reader is not None)
    port.close()


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinect, "LIBRARY", "libnowhere.so.1")
    port = open_port("kinect:///0?format=raw")
    assert isinstance(port, KinectPort)
    assert all_of(port) == []
    assert port.cause.startswith("Kinect 0: needs libfreenect: apt install libfreenect0.5 (lib")
    port.close()
    missing = open_port("fakenect:///nowhere")
    until(lambda: missing.poll(START_S) or missing.cause != "not opened yet")
    assert missing.cause == "no such device /nowhere"
    missing.close()


@INSTALLED
def test_a_process_ends_with_its_port(dump: tuple[Path, list[U16]]) -> None:
    port = open_port(f"fakenect://{dump[0]}")
    assert isinstance(port, KinectPort)
    until(lambda: port.poll(START_S))
    assert isinstance(port._reader, Reader)
    port.reopen("no image for 0.5 s")  # a gap in the dump
    assert port.poll(START_S)
    pid = port._reader._process.pid
    assert port.fileno() >= 0
    port.close()
    until(lambda: not os.path.exists(f"/proc/{pid}"))
