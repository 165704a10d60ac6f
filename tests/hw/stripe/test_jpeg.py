"""Whole JPEGs are told from those that lack a part, whatever their encoder chose."""

import io
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.stripe.jpeg import TORN, UNCHECKED, fault_of_image, with_tables
from tests.hw.stripe.pictures import Picture, slope
from tests.support.cases import examples

Image: Any = pytest.importorskip("PIL.Image")
SHOT = Picture(1).line(slope()).shot()
END = 2  # bytes of its end mark


def file_of(**options: Any) -> bytes:
    out = io.BytesIO()
    picture = Image.fromarray(SHOT)
    picture.convert(options.pop("mode", "RGB")).resize(options.pop("size", (640, 480))).save(
        out, "JPEG", **options
    )
    return out.getvalue()


USUAL = file_of(quality=90, subsampling=1)


@pytest.mark.parametrize(
    "options",
    [
        {"quality": 20},
        {"quality": 95},
        {"subsampling": 0},
        {"subsampling": 2, "size": (333, 111)},
        {"optimize": True},
        {"restart_marker_blocks": 7},
        {"restart_marker_rows": 1},
        {"mode": "L"},
    ],
)
def test_what_is_whole_is_whole_and_half_of_it_is_not(options: dict[str, Any]) -> None:
    data = file_of(**options)
    assert fault_of_image(data) == ""
    assert fault_of_image(data[:-END] + b"\xff\xff\xff\xd9") == ""  # filling
    half = len(data) // 2
    assert fault_of_image(data[:half] + data[-END:]) == TORN
    assert fault_of_image(data[:half] + data[half + 200 :]) == TORN


def test_of_tears_of_twenty_bytes_most_are_found_of_a_hundred_nearly_all() -> None:
    chance = random.Random(1)

    def found(size: int) -> int:
        firsts = [chance.randrange(700, len(USUAL) - END - size) for _ in range(200)]
        return sum(fault_of_image(USUAL[:at] + USUAL[at + size :]) != "" for at in firsts)

    assert found(20) > 120
    assert found(100) > 190


def test_an_image_without_tables_has_the_usual_ones() -> None:
    bare = USUAL
    while (at := bare.find(b"\xff\xc4")) > 0:
        bare = bare[:at] + bare[at + 2 + int.from_bytes(bare[at + 2 : at + 4], "big") :]
    assert fault_of_image(bare) == UNCHECKED
    whole = with_tables(bare)
    assert fault_of_image(whole) == ""
    shown = [Image.open(io.BytesIO(data)).tobytes() for data in (whole, USUAL)]
    assert shown[0] == shown[1]
    assert with_tables(USUAL) == USUAL


def test_what_cannot_be_checked_is_told() -> None:
    assert fault_of_image(file_of(progressive=True)) == UNCHECKED
    tables = USUAL.index(b"\xff\xc4")
    length = 2 + int.from_bytes(USUAL[tables + 2 : tables + 4], "big")
    assert fault_of_image(USUAL[:tables] + USUAL[tables + length :]) == UNCHECKED
    assert fault_of_image(b"\xff\xd8") == UNCHECKED


@settings(max_examples=examples(200))
@given(st.data())
def test_no_bytes_make_it_raise(data: st.DataObject) -> None:
    damaged = bytearray(USUAL)
    for _ in range(data.draw(st.integers(1, 6))):
        most = data.draw(st.sampled_from([700, len(damaged) - 1]))
        damaged[data.draw(st.integers(2, most))] = data.draw(st.integers(0, 255))
    assert fault_of_image(bytes(damaged)) in ("", TORN, UNCHECKED)
    assert fault_of_image(bytes(damaged[: data.draw(st.integers(0, len(damaged)))])) != ""
