"""A folder of images, played at its times as a web camera would send them."""

import gc
import os
import select
from functools import partial
from pathlib import Path

import pytest

from hw.depth_images.parts import Part, PartsParser
from hw.ports.folder import FolderPort, Timer
from hw.ports.wires import open_port
from hw.stripe.mjpeg import Event, Jpeg, MjpegParser, StreamBegun, encode_request
from tests.support.machine.real_wires import START_S, until

IMAGES = [b"\xff\xd8 %d \xff\xd9" % k for k in range(3)]


def folder_of(folder: Path, lines: str) -> FolderPort:
    for k, image in enumerate(IMAGES):
        (folder / f"{k}.jpg").write_bytes(image)
    (folder / "times.csv").write_text(lines)
    port = open_port(f"folder://{folder}")
    assert isinstance(port, FolderPort)
    until(lambda: port.poll(START_S) or port.cause != "not opened yet")
    return port


class Reader:
    """Reads it at given times."""

    def __init__(self, port: FolderPort) -> None:
        self.port, self.parser = port, MjpegParser(10_000)

    def at(self, now_s: float) -> list[Event]:
        self.port.poll(now_s)
        return [one for piece in self.port.read() for one in self.parser.feed(now_s, piece)]


def test_each_image_comes_at_its_time_once(tmp_path: Path) -> None:
    port = folder_of(tmp_path, "0.jpg,7.5\n1.jpg,7.6\n2.jpg,8.0\n")
    reader = Reader(port)
    assert reader.at(START_S + 5.0) == []  # nobody has asked
    port.write(encode_request("camera", "/stream"))
    begun_s = START_S + 6.0
    first, *rest = reader.at(begun_s)
    assert first == StreamBegun()
    assert rest == [Jpeg(IMAGES[0], begun_s, begun_s, round(begun_s * 1e6))]
    assert reader.at(begun_s + 0.09) == []
    late_s = begun_s + 0.12  # its stamp is its time, not that of the turn
    assert reader.at(late_s) == [Jpeg(IMAGES[1], late_s, late_s, round((begun_s + 0.1) * 1e6))]
    assert [type(one) for one in reader.at(begun_s + 0.5)] == [Jpeg]
    assert reader.at(begun_s + 0.6) == []
    assert port.cause == f"all 3 images of {tmp_path} are sent"
    assert not port.poll(begun_s + 100.0)
    assert port.fileno() == -1
    port.close()


def test_what_is_said_of_the_lens_comes_first(tmp_path: Path) -> None:
    (tmp_path / "camera.toml").write_text("said of the lens")
    port = folder_of(tmp_path, "0.jpg,0\n")
    port.write(encode_request("camera", "/"))
    port.poll(START_S)
    events = PartsParser(100).feed(START_S, b"".join(port.read()))
    told = [(one.data, one.kind, one.stamp_s) for one in events if isinstance(one, Part)]
    lens = b"said of the lens", "application/toml", None
    assert told == [lens, (IMAGES[0], "", START_S)]
    port.close()
    (tmp_path / "camera.toml").write_bytes(b" " * 5000)
    port = folder_of(tmp_path, "0.jpg,0\n")
    assert "camera.toml must be of 4096 bytes or fewer, is of 5000" in port.cause
    port.close()


@pytest.mark.parametrize(
    ("lines", "cause"),
    [
        ("", "times.csv names no image"),
        ("0.jpg,soon\n", "times.csv, line 1: needs file,seconds; is '0.jpg,soon'"),
        ("0.jpg,1\n1.jpg,nan\n", "line 2: needs file,seconds"),
        ("0.jpg,1\n1.jpg,0.5\n", "line 2: 0.5 s is before the line above"),
        ("none.jpg,1\n", "none.jpg: No such file or directory"),
        ("pipe.jpg,1\n", "pipe.jpg is no file"),
        ("huge.jpg,1\n", "has more than 512 MiB of images: play fewer"),
        ("0.jpg,0\n1.jpg,1e300\n", "times.csv, line 2: is 1e+300 s after the first, over 1e+06"),
        ("0.jpg,-1e308\n1.jpg,1e308\n", "times.csv, line 2: is inf s after the first, over 1e+06"),
        ("0.jpg,1\n" + 200_000 * "x", "times.csv is no table: field larger than field limit"),
    ],
)
def test_what_cannot_be_played_is_told(tmp_path: Path, lines: str, cause: str) -> None:
    os.mkfifo(tmp_path / "pipe.jpg")
    with open(tmp_path / "huge.jpg", "wb") as huge:
        huge.truncate(1 << 42)
    port = folder_of(tmp_path, lines)
    assert cause in port.cause
    port.close()


def test_a_mark_that_some_editors_put_before_a_text_is_no_part_of_a_name(tmp_path: Path) -> None:
    port = folder_of(tmp_path, "\ufeff0.jpg,0\n")
    assert port.cause == ""
    port.close()


def test_a_gap_between_two_images_is_no_reason_to_begin_anew(tmp_path: Path) -> None:
    port = folder_of(tmp_path, "0.jpg,0\n1.jpg,0.1\n2.jpg,5\n")
    reader = Reader(port)
    port.write(encode_request("camera", "/"))
    given = [one for k in range(3) for one in reader.at(START_S + 0.1 * k)]
    port.reopen("no image for 0.5 s")
    port.write(encode_request("camera", "/"))
    given += [one for k in range(60) for one in reader.at(START_S + 0.3 + 0.1 * k)]
    assert [one.data for one in given if isinstance(one, Jpeg)] == IMAGES
    port.close()


def test_what_fails_to_open_again_and_again_leaves_nothing_behind(tmp_path: Path) -> None:
    port = folder_of(tmp_path, "none.jpg,1\n")

    def has_failed(at_s: float) -> bool:
        assert not port.poll(at_s)
        return port._retry_s > at_s

    gc.collect()
    gc.disable()  # as in the app
    try:
        for k in range(1, 6):
            until(partial(has_failed, START_S + 10.0 * k))
        assert gc.collect() == 0
    finally:
        gc.enable()
    port.close()


def test_the_timer_is_readable_when_its_instant_is_over() -> None:
    timer = Timer()
    timer.set(1e9)
    assert not timer.is_due()
    timer.set(0.0)
    assert select.select([timer.fd], [], [])[0] == [timer.fd]
    timer.close()
