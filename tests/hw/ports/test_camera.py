"""Cameras of this machine: what is asked of the kernel, and images as a web camera's answer."""

import doctest
import math
import os
import shutil
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from fakes.stripe.video import EXPOSURE, EXPOSURE_MODE, FakeVideo
from hw.ports import v4l2
from hw.ports.camera import BUFFERS, CameraPort
from hw.ports.url import parse_url
from hw.ports.v4l2 import Kernel
from hw.stripe.mjpeg import Event, Jpeg, MjpegParser, StreamBegun, encode_request
from tests.support.machine.real_wires import START_S, until

IMAGE = b"\xff\xd8 not looked into \xff\xd9"
HEADER = "/usr/include/linux/videodev2.h"
NAMES = {
    "CAPABILITY": "v4l2_capability",
    "FORMAT_DESCRIPTION": "v4l2_fmtdesc",
    "FORMAT": "v4l2_format",
    "STREAM": "v4l2_streamparm",
    "BUFFERS": "v4l2_requestbuffers",
    "BUFFER": "v4l2_buffer",
    "CONTROL": "v4l2_control",
}
TIME = "parm.capture.timeperframe"
FIELDS = {  # in their order, those that mean something here
    "CAPABILITY": "card version capabilities device_caps",
    "FORMAT_DESCRIPTION": "index type flags pixelformat",
    "FORMAT": "type fmt.pix.width fmt.pix.height fmt.pix.pixelformat fmt.pix.field",
    "STREAM": f"type {TIME}.numerator {TIME}.denominator",
    "BUFFERS": "count type memory",
    "BUFFER": "index type bytesused flags field timestamp.tv_sec timestamp.tv_usec sequence memory"
    " m.offset length",
    "CONTROL": "id value",
}
OFFSETS = {  # of those, on a 64-bit system
    "CAPABILITY": (16, 80, 84, 88),
    "FORMAT_DESCRIPTION": (0, 4, 8, 44),
    "FORMAT": (0, 8, 12, 16, 20),
    "STREAM": (0, 12, 16),
    "BUFFERS": (0, 4, 8),
    "BUFFER": (0, 4, 8, 12, 16, 24, 32, 56, 60, 64, 72),
    "CONTROL": (0, 4),
}
SIZES = {"CAPABILITY": 104, "FORMAT_DESCRIPTION": 64, "FORMAT": 208, "STREAM": 204, "BUFFERS": 20,
         "BUFFER": 88, "CONTROL": 8}  # fmt: skip
REQUESTS = {  # as the kernel's documentation has them
    "QUERYCAP": 0x80685600,
    "ENUM_FMT": 0xC0405602,
    "S_FMT": 0xC0D05605,
    "REQBUFS": 0xC0145608,
    "QUERYBUF": 0xC0585609,
    "QBUF": 0xC058560F,
    "DQBUF": 0xC0585611,
    "STREAMON": 0x40045612,
    "STREAMOFF": 0x40045613,
    "S_PARM": 0xC0CC5616,
    "S_CTRL": 0xC008561C,
}


def test_requests_are_the_kernels_to_the_bit() -> None:
    assert {name: getattr(v4l2, name) for name in REQUESTS} == REQUESTS
    assert {name: getattr(v4l2, name).size for name in SIZES} == SIZES
    buffer = v4l2.BUFFER.pack(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11)
    here = [struct.unpack_from("<I", buffer, at)[0] for at in OFFSETS["BUFFER"]]
    assert here == list(range(1, 12))
    wanted = v4l2.FORMAT.pack(1, 640, 480, v4l2.MJPEG, 1, 0, 0)
    assert wanted[16:20] == b"MJPG"
    assert [struct.unpack_from("<I", wanted, at)[0] for at in (0, 8, 12, 20)] == [1, 640, 480, 1]
    rate = v4l2.STREAM.pack(1, 0, 0, 1, 30)
    assert [struct.unpack_from("<I", rate, at)[0] for at in OFFSETS["STREAM"]] == [1, 1, 30]
    assert doctest.testmod(v4l2).failed == 0


@pytest.mark.skipif(
    not os.path.exists(HEADER) or not shutil.which("gcc") or struct.calcsize("@l") != 8,
    reason=f"needs a C compiler, {HEADER} and 64 bits",
)
def test_the_kernels_header_says_the_same(tmp_path: Path) -> None:
    lines = [
        "#include <stdio.h>",
        "#include <stddef.h>",
        "#include <linux/videodev2.h>",
        "int main() {",
    ]
    for key, name in NAMES.items():
        values = [f"sizeof(struct {name})"]
        values += [f"offsetof(struct {name}, {field})" for field in FIELDS[key].split()]
        lines += [f'printf("{key}");', *(f'printf(" %zu", {one});' for one in values), 'puts("");']
    lines += [f'printf("{name} %lu\\n", (unsigned long)VIDIOC_{name});' for name in REQUESTS]
    (tmp_path / "told.c").write_text("\n".join([*lines, "}"]))
    subprocess.run(["gcc", str(tmp_path / "told.c"), "-o", str(tmp_path / "told")], check=True)
    said = subprocess.run([tmp_path / "told"], capture_output=True, check=True, text=True).stdout
    told = {key: tuple(map(int, rest)) for key, *rest in map(str.split, said.splitlines())}
    assert told == {
        **{key: (SIZES[key], *OFFSETS[key]) for key in NAMES},
        **{name: (value,) for name, value in REQUESTS.items()},
    }


class Bench:
    """A camera on a node that is there, its port, and what reads it."""

    def __init__(self, folder: Path, more: str = "") -> None:
        self.node, self.video, self.now_s = folder / "video0", FakeVideo(), START_S
        self.node.touch()
        url = f"v4l2://{self.node}?width=640&height=480&rate=30{more}"
        kernel: Kernel = self.video  # type: ignore[assignment]
        self.port, self.parser = CameraPort(parse_url(url), kernel), MjpegParser(100_000)

    def settle(self, is_so: Callable[[], bool]) -> None:
        def step() -> bool:
            self.now_s += 0.005
            self.port.poll(self.now_s)
            return is_so()

        until(step)

    def open(self) -> None:
        self.settle(lambda: self.port.cause == "")
        self.port.write(encode_request("camera", "/stream"))

    def read(self) -> list[Event]:
        self.port.poll(self.now_s)
        return [one for piece in self.port.read() for one in self.parser.feed(self.now_s, piece)]


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_images_come_with_the_drivers_time(bench: Bench) -> None:
    bench.open()
    video = bench.video
    assert (video.size, video.pixels, video.rate_hz) == ((640, 480), b"MJPG", 30.0)
    assert video.controls == {}
    assert bench.read() == [StreamBegun()]
    for k in range(3 * BUFFERS):  # each buffer goes back to the driver
        video.show(IMAGE + b"\0\0", 12.5 + k)
        assert bench.read() == [Jpeg(IMAGE, bench.now_s, bench.now_s, 12_500_000 + k * 1_000_000)]
    video.clock = 0
    video.show(IMAGE, 40.0)
    [event] = bench.read()
    assert isinstance(event, Jpeg)
    assert event.stamp_us is None  # by an unknown clock
    assert bench.read() == []
    assert video.lost == 0
    bench.port.close()
    until(lambda: not video.is_open)


def test_before_it_is_asked_nothing_is_told_and_no_buffer_is_kept(bench: Bench) -> None:
    bench.settle(lambda: bench.port.cause == "")
    for k in range(2 * BUFFERS):
        bench.video.show(IMAGE, float(k))
        assert bench.read() == []
    assert bench.video.lost == 0
    bench.port.close()


def test_damaged_images_are_counted_and_cost_no_other(bench: Bench) -> None:
    bench.open()
    bench.read()
    bench.video.is_bad = True
    bench.video.show(IMAGE, 1.0)
    [event] = bench.read()
    assert not isinstance(event, Jpeg)
    assert "no JPEG" in str(event)
    bench.video.is_bad = False
    bench.video.show(IMAGE, 2.0)
    assert [type(event) for event in bench.read()] == [Jpeg]
    bench.port.close()


def test_unplugged_it_is_lost_and_plugged_in_it_comes_back(bench: Bench) -> None:
    bench.open()
    bench.read()
    bench.video.unplug()
    bench.node.unlink()
    bench.read()
    assert bench.port.cause == f"no such device {bench.node}"
    assert bench.port.fileno() == -1
    bench.video.plug()
    bench.node.touch()
    bench.parser = MjpegParser(100_000)
    bench.open()
    assert bench.port.opened == 2
    bench.video.show(IMAGE, 3.0)
    assert [type(event) for event in bench.read()] == [StreamBegun, Jpeg]
    bench.port.close()


@pytest.mark.parametrize(
    ("name", "value", "cause"),
    [
        ("formats", [b"YUYV"], "gives no MJPEG, but YUYV: mapod needs a camera that does"),
        ("is_camera", False, "is no camera"),
        ("of_this_node", 0x04800000, "gives no images: a camera has several nodes"),
        ("is_used", True, "is in use by another program"),
        ("refuses_exposure", True, "does not take exposure_us=2000: Invalid argument"),
    ],
)
def test_what_is_wrong_is_told_in_words(
    tmp_path: Path, name: str, value: object, cause: str
) -> None:
    bench = Bench(tmp_path, "&exposure_us=2000")
    setattr(bench.video, name, value)
    bench.settle(lambda: bench.port.cause != "not opened yet")
    assert str(bench.node) in bench.port.cause
    assert cause in bench.port.cause
    assert not bench.video.is_open
    bench.port.close()


def test_the_exposure_is_set_where_it_is_given(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "&exposure_us=2000")
    bench.open()
    assert bench.video.controls == {EXPOSURE_MODE: 1, EXPOSURE: 20}
    bench.port.close()


def test_a_file_that_is_no_device_is_told(tmp_path: Path) -> None:
    (tmp_path / "video0").touch()
    url = parse_url(f"v4l2://{tmp_path}/video0?width=640&height=480&rate=30")
    port = CameraPort(url)
    until(lambda: port.poll(START_S) or port.cause != "not opened yet")
    assert port.cause == f"{tmp_path}/video0: is no camera"
    assert not math.isfinite(port._retry_s) or port._retry_s > START_S
    port.close()
