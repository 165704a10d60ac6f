"""Raw values, PNG and camera files to numbers and rays, against others' programs and tables."""

import gzip
import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from hw.depth_images.folder import CAMERA_KIND, FolderFrames, lens_of
from hw.depth_images.kinect import FRAME_BYTES, MM_KIND, RAW_KIND, KinectFrames, mm_of_raws
from hw.depth_images.parts import Part
from hw.depth_images.png import PngError, numbers_of
from hw.depth_images.rays import Pinhole, camera_of
from hw.device import BadFrame
from tests import ROOT
from tests.support.devices.bench_kinect import options_of

LENS = """size_px = [640, 480]
focal_px = [525.0, 525.0]
centre_px = [320.0, 240.0]
units_per_m = 1000.0
along = "axis"
mirrored = false
"""


def png(numbers: np.ndarray[Any, Any], **given: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(numbers).save(file, "PNG", **given)
    return file.getvalue()


def part(data: bytes, kind: str) -> Part:
    return Part(data, kind, 5.0, 7, 5.01, 5.02)


def test_raw_values_are_the_millimetres_of_the_zero_plane() -> None:
    mm = mm_of_raws(options_of())
    told = {600: 705, 640: 768, 700: 887, 800: 1193, 900: 1824, 1000: 3864, 1050: 8767}
    assert {raw: int(mm[raw]) for raw in told} == told
    assert not mm[[2047, 1085, 1500, 2046]].any()
    steps = np.diff(mm[600:1000].astype(float))
    assert (steps > 0).all()
    near, far = np.searchsorted(mm[:1000], [1000, 2000])
    assert (mm[near + 1] - mm[near], mm[far + 1] - mm[far]) == (
        3,
        12,
    )  # as sheets tell: by its square


def test_a_kinects_frames_are_little_endian_and_bounded() -> None:
    frames = KinectFrames(options_of())
    raw = np.full((480, 640), 2047, "<u2")
    raw[0, 0], raw[479, 639] = 800, 900
    image = frames.take(part(raw.tobytes(), RAW_KIND))
    assert not isinstance(image, BadFrame)
    assert (image.numbers[0, 0], image.numbers[479, 639], image.numbers.sum()) == (1193, 1824, 3017)
    assert (image.t_s, image.counter, image.arrived_s) == (5.0, 7, 5.02)
    for data, kind, why in (
        (b"\0" * (FRAME_BYTES - 2), RAW_KIND, "a frame of 614398 bytes, a Kinect's has 614400"),
        (b"\0\x08" * (FRAME_BYTES // 2), RAW_KIND, "a raw value of 2048, allowed are 0 .. 2047"),
        (b"\x11\x27" * (FRAME_BYTES // 2), MM_KIND, "a depth of 10001 mm"),
        (b"\0" * FRAME_BYTES, "image/jpeg", "frames of kind 'image/jpeg' are no Kinect's"),
    ):
        refused = frames.take(part(data, kind))
        assert isinstance(refused, BadFrame)
        assert why in refused.reason


@pytest.mark.parametrize("level", [0, 1, 9])
def test_what_another_program_wrote_is_read_number_for_number(level: int) -> None:
    random = np.random.default_rng(3)
    packed = (ROOT / "tests/vectors/kinect/boxes_1.u16.gz").read_bytes()
    real = np.frombuffer(gzip.decompress(packed), "<u2").reshape(480, 640)
    for numbers in (real, random.integers(0, 65536, (5, 3), dtype=np.uint16)):
        h, w = numbers.shape
        read = numbers_of(png(numbers, compress_level=level), (w, h))
        np.testing.assert_array_equal(read, numbers)


@given(st.integers(1, 6), st.integers(1, 6), st.data())
def test_every_filter_is_undone(height: int, width: int, data: st.DataObject) -> None:
    numbers = np.array(
        data.draw(st.lists(st.integers(0, 65535), min_size=height * width, max_size=height * width))
    ).reshape(height, width)
    kinds = data.draw(st.lists(st.integers(0, 4), min_size=height, max_size=height))
    rows = [[b for n in row for b in divmod(int(n), 256)] for row in numbers]
    raw = b""
    for i, kind in enumerate(kinds):
        raw += bytes([kind])
        for j, byte in enumerate(rows[i]):
            a = rows[i][j - 2] if j >= 2 else 0
            b = rows[i - 1][j] if i else 0
            c = rows[i - 1][j - 2] if i and j >= 2 else 0
            paeth = min((a, b, c), key=lambda guess: abs(a + b - c - guess))
            raw += bytes([(byte - (0, a, b, (a + b) // 2, paeth)[kind]) % 256])
    np.testing.assert_array_equal(numbers_of(made(height, width, raw), (width, height)), numbers)


def chunk(kind: bytes, body: bytes) -> bytes:
    crc = zlib.crc32(kind + body)
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", crc)


def made(height: int, width: int, raw: bytes, depth: int = 16, colour: int = 0) -> bytes:
    head = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    packed = zlib.compress(raw)
    chunks = chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


GOOD = png(np.arange(12, dtype=np.uint16).reshape(3, 4))


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"\xff\xd8\xff", "an image that is no PNG"),
        (GOOD[:-1], "a PNG without its end"),
        (GOOD[:40], "a PNG without its end"),
        (GOOD[:45] + b"\x00" + GOOD[46:], "a PNG with a wrong checksum"),
        (made(4, 3, b""), "an image of 3 x 4 px, its camera has 4 x 3"),
        (made(3, 4, b"\0" * 26), "a PNG that lacks part of its image"),
        (made(3, 4, b"\0" * 28), "or has too much"),
        (made(3, 4, b"\0" * 10_000_000), "or has too much"),  # no more is inflated
        (made(3, 4, b"\5" * 27), "a filter that is unknown"),
        (made(3, 4, b"\0" * 15, depth=8), "a PNG of 8 bits, colour type 0: depths are of 16 bits"),
        (made(3, 4, b"\0" * 75, colour=2), "a PNG of 16 bits, colour type 2"),
        (GOOD[:8] + chunk(b"IDAT", b"junk") + chunk(b"IEND", b""), "a PNG without a head"),
    ],
)
def test_a_png_that_is_damaged_or_of_another_kind_is_refused(data: bytes, why: str) -> None:
    with pytest.raises(PngError, match=why):
        numbers_of(data, (4, 3))


@given(st.binary(max_size=80), st.integers(0, len(GOOD) - 1), st.integers(0, 255))
def test_no_bytes_of_a_folder_raise(junk: bytes, at: int, byte: int) -> None:
    frames = FolderFrames()
    lens = LENS.replace("640, 480", "4, 3").replace("525.0", "4.0")
    lens = lens.replace("320.0", "2.0").replace("240.0", "1.0")
    assert frames.take(part(lens.encode(), CAMERA_KIND)) is None
    assert not isinstance(frames.take(part(GOOD, "")), BadFrame)
    bent = GOOD[:at] + bytes([byte]) + GOOD[at + 1 :]
    taken = frames.take(part(bent, ""))
    assert bent == GOOD or isinstance(taken, BadFrame)
    assert isinstance(frames.take(part(junk, "")), BadFrame)
    frames.take(part(lens.encode()[:at] + junk, CAMERA_KIND))


@pytest.mark.parametrize(
    ("given", "instead", "why"),
    [
        ("[640, 480]", "[640, 1]", "Expected `int` >= 2"),
        ("1000.0", "1.0", "Expected `float` >= 50"),
        ("525.0, 525.0", "525.0", "Expected `array` of length 2"),
        ("525.0, 525.0", "5250.0, 525.0", "fx 5250, cx 320 for 640 px"),
        ("525.0, 525.0", "-525.0, 525.0", "fx -525, cx 320 for 640 px"),
        ("525.0, 525.0", "nan, 525.0", "fx nan"),
        ("320.0", "700.0", "fx 525, cx 700 for 640 px"),
        ("mirrored = false", "", "missing required field `mirrored`"),
        ("mirrored", "fish_eye = 1\nmirrored", "unknown field `fish_eye`"),
        ('"axis"', '"z"', "Invalid enum value 'z'"),
        ("[640, 480]", "[" * 2000, "a camera.toml that can't be"),
    ],
)
def test_a_camera_file_that_cannot_be_is_told(given: str, instead: str, why: str) -> None:
    told = lens_of(LENS.replace(given, instead).encode())
    assert isinstance(told, str)
    assert why in told


def test_rays_are_those_of_a_pinhole() -> None:
    lens = Pinhole((4, 2), (2.0, 4.0), (1.0, 0.5), 0.5, False, False)
    rays = camera_of(lens).rays
    np.testing.assert_allclose(rays[1, 3] * 2, [1.0, -1.0, -0.125])
    mirrored = camera_of(Pinhole((4, 2), (2.0, 4.0), (1.0, 0.5), 0.5, False, True)).rays
    np.testing.assert_allclose(mirrored * [1, -1, 1], rays)
    along = camera_of(Pinhole((4, 2), (2.0, 4.0), (1.0, 0.5), 0.5, True, False)).rays
    np.testing.assert_allclose(np.linalg.norm(along, axis=2), 0.5, rtol=1e-6)
    assert (np.cross(along, rays) < 1e-6).all()
