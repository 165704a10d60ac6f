"""What a frame means: the sheet's points, and in words what can't be."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import DepthCamera
from hw.device import BadFrame
from hw.visionary.blob import Blob, BlobParser
from hw.visionary.depth import FrameHead, head_of, no_numbers, numbers_of
from hw.visionary.description import Description, description_of
from hw.visionary.rays import camera_of
from tests.support.devices.visionary_vectors import T_MINI, S

T_MINI_MM = {  # row, column: x, y, z as section 7 has them, in the camera's axes
    (0, 0): (-339.034, -226.022, 903.220),
    (0, 1): (-119.713, -239.427, 953.765),
    (1, 0): (-356.671, 0, 949.876),
    (1, 1): (-126.824, 0, 1006.116),
    (1, 2): (126.824, 0, 1006.116),
    (1, 3): (356.671, 0, 949.876),
    (2, 0): (-1388.682, 925.788, 3730.548),
    (2, 1): (-59.842, 119.683, 471.762),
    (2, 2): (239.367, 478.734, 1917.049),
}
S_MM = {
    (0, 0): (-375, -250, 985),
    (1, 0): (-1125, 0, 2985),
    (1, 1): (-375, 0, 2985),
    (1, 2): (375, 0, 2985),
    (1, 3): (1125, 0, 2985),
}


def blob_of(data: bytes) -> Blob:
    (blob,) = BlobParser().feed(0.0, data)
    assert isinstance(blob, Blob)
    return blob


def told_by(xml: bytes) -> Description:
    told = description_of(xml)
    assert isinstance(told, Description), told
    return told


XML = bytes(blob_of(T_MINI).xml)
BINARY = bytes(blob_of(T_MINI).binary)
TOLD = told_by(XML)
NOTHING = no_numbers(3, 4)


def with_(pattern: str, value: str) -> bytes:
    changed, count = re.subn(pattern, value, XML.decode())
    assert count
    return changed.encode()


@pytest.mark.parametrize(("data", "points_mm"), [(T_MINI, T_MINI_MM), (S, S_MM)])
def test_points_are_those_of_the_sheet(
    data: bytes, points_mm: dict[tuple[int, int], tuple[float, float, float]]
) -> None:
    blob = blob_of(data)
    told = told_by(bytes(blob.xml))
    camera, head = camera_of(told), head_of(blob.binary, told)
    assert isinstance(camera, DepthCamera)
    assert isinstance(head, FrameHead)
    assert (head.stamp_ms, head.is_crc_right, head.status) == (1795358159123, True, 0)
    numbers, count, _ = numbers_of(blob.binary, head, told, 0, NOTHING)
    assert count == np.count_nonzero(numbers) == 9
    assert not numbers[[0, 0, 2], [2, 3, 3]].any()  # 0, 65535, a state of 4
    points = np.array(camera.offset_m) + numbers[..., None] * camera.rays
    for (row, column), (x, y, z) in points_mm.items():  # there x is right, y down, z ahead
        wanted = 0.001 * np.array([z, -x, -y])
        np.testing.assert_allclose(points[row, column], wanted, atol=1e-6)


def test_positive_focal_lengths_turn_nothing_round() -> None:
    camera = camera_of(told_by(with_("-4.000000", "4.000000")))
    assert isinstance(camera, DepthCamera)
    assert (camera.rays[0, 0, 1:] > 0).all()  # the first pixel is left, and up
    assert (camera.rays[2, 3, 1:] < 0).all()


def test_an_old_camera_is_believed_by_its_confidence() -> None:
    told = told_by(with_("Visionary-T Mini CX", "Visionary-T CX"))
    assert (told.has_states, told.unit_mm) == (False, 1.0)
    head = head_of(memoryview(BINARY), told)
    assert isinstance(head, FrameHead)
    numbers, _, changed = numbers_of(memoryview(BINARY), head, told, 1, NOTHING)
    assert list(zip(*np.nonzero(numbers), strict=True)) == [(2, 3)]  # the only one above 0
    assert changed == 1


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        (b"<a", "no XML"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]>' + XML, "DOCTYPE"),
        (b"<SickRecord/>", "without a depth map"),
        (with_("<Width>4", "<Width>40000"), "40000 x 3 px, allowed are 2 .. 2048"),
        (with_("<Width>4", "<Width>four"), "Width = 'four'"),
        (with_("<FX>-4", "<FX>-400"), "camera matrix that can't be: FX -400"),
        (with_("<CX>1.5", "<CX>9.5"), "CX 9.5"),
        (with_("<FX>-4.000000", "<FX>nan"), "CameraMatrix/FX = 'nan'"),
        (with_("uint16</Distance", "uint32</Distance"), "no depths of uint16"),
        (with_("uint16</Confidence", "uint64</Confidence"), "neither uint8 nor uint16"),
        (with_("uint16</Intensity", "text</Intensity"), "Intensity of type 'text'"),
        (
            with_('Mini CX(.*?)exponent="0"', r'CX\1exponent="99"'),
            "decimalexponent = '99'",
        ),
        (with_("<value>-10", "<value>-90000"), "a lens that is"),
        (with_("<value>0.0", "<value>0.3"), "a mounting of its own that turns it"),
        (with_("<value>-10.000000</value>", ""), "no matrix from camera to world"),
    ],
)
def test_a_description_that_cant_be_is_refused_in_words(xml: bytes, words: str) -> None:
    told = description_of(xml)
    assert isinstance(told, str)
    assert words in told


def test_a_distortion_that_folds_the_image_is_refused() -> None:
    camera = camera_of(told_by(with_("<K1>-0.1", "<K1>-2.1")))
    assert camera == "the camera's distortion folds its image: K1 -2.1, K2 0.25"


def test_an_old_depth_set_tells_no_number() -> None:
    length = (90).to_bytes(4, "little")
    old = length + BINARY[4:12] + b"\x01\x00" + BINARY[20:-4] + length
    head = head_of(memoryview(old), TOLD)
    assert isinstance(head, FrameHead)
    assert (head.number, head.maps_at) == (-1, 14)
    numbers, count, _ = numbers_of(memoryview(old), head, TOLD, 0, NOTHING)
    assert (count, numbers[0, 0], numbers[2, 3]) == (9, 4000, 0)


@pytest.mark.parametrize(
    ("binary", "words"),
    [
        (BINARY[:10], "too short"),
        (BINARY[:-1], "a depth set of 100 bytes in 99, 4 x 3 px need 100"),
        (b"\x64" + BINARY[1:], "a depth set of 104 bytes"),
        (BINARY[:-4] + bytes(4), "whose lengths differ"),
        (BINARY[:12] + b"\x03" + BINARY[13:], "of version 3"),
        (BINARY[:4] + bytes(8) + BINARY[12:], "impossible time"),
    ],
)
def test_a_depth_set_that_cant_be_is_refused_in_words(binary: bytes, words: str) -> None:
    head = head_of(memoryview(binary), TOLD)
    assert isinstance(head, BadFrame)
    assert words in head.reason


@given(st.lists(st.tuples(st.integers(0, len(XML) - 1), st.binary(max_size=4)), max_size=6))
def test_no_description_makes_it_raise(places: list[tuple[int, bytes]]) -> None:
    xml = bytearray(XML)
    for at, data in places:
        xml[at : at + len(data)] = data
    told = description_of(bytes(xml))
    if isinstance(told, Description):
        camera_of(told)


@given(st.binary(max_size=120), st.integers(0, 120))
def test_no_depth_set_makes_it_raise(data: bytes, at: int) -> None:
    binary = memoryview(BINARY[:at] + data + BINARY[at + len(data) :])
    head = head_of(binary, TOLD)
    if isinstance(head, FrameHead):
        numbers_of(binary, head, TOLD, 0, NOTHING)
