"""The obstacle window as registers: what is packed, when it is told, and that views never mix."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import FREE
from hw.modbus.image import PACK_S, VIEW_S, RegisterImage
from hw.modbus.layout import COARSE, COARSE_CELLS, LATCH, WINDOW, WINDOW_CELLS, Refusal, stride_of
from hw.modbus.status import STALE_S
from tests.support.modbus_rig import (
    BAD,
    CLEAR,
    GOOD,
    SIZE,
    START_S,
    new_image,
    raster,
    rows_of,
    some_cells,
    window_of,
    words,
)


def coarse(rows: list[list[int]]) -> list[list[int]]:
    """The slow model of the coarse map: the worst of each block, unknown outside."""
    n = len(rows)
    block = -(-n // COARSE_CELLS)
    off = (COARSE_CELLS * block - n) // 2

    def code(row: int, column: int) -> int:
        inside = 0 <= row < n and 0 <= column < n
        return rows[row][column] if inside else 0

    def worst(row: int, column: int) -> int:
        held = {
            code(row * block - off + r, column * block - off + c)
            for r in range(block)
            for c in range(block)
        }
        return 2 if 2 in held else (0 if 0 in held else 1)

    return [[worst(row, column) for column in range(COARSE_CELLS)] for row in range(COARSE_CELLS)]


@given(
    size=st.sampled_from([3, 8, 21, 22, 29]),
    corner=st.tuples(st.integers(-200, 200), st.integers(-200, 200)),
    trusted=st.booleans(),
    kind=st.sampled_from(["all", "free", "few"]),
    seed=st.integers(0, 1000),
)
def test_cells_and_coarse_cells_equal_a_slow_model(
    size: int, corner: tuple[int, int], trusted: bool, kind: str, seed: int
) -> None:
    cells = some_cells(seed, size)
    if kind != "all":
        cells[...] = np.where(np.abs(cells) > (1 if kind == "free" else 0), cells, FREE)
    image = new_image(size=size)
    image.publish(START_S + 1, GOOD, CLEAR, window_of(cells, corner, trusted=trusted, epoch=1))
    count = size * stride_of(size)
    told = words(image, WINDOW_CELLS, count, START_S + 1)
    expected = raster(cells, corner, trusted)
    assert rows_of(told, size) == expected
    registers = words(image, COARSE, 71, START_S + 1)
    assert rows_of(registers[7:-1], COARSE_CELLS) == coarse(expected)
    assert registers[0] == registers[-1] == words(image, WINDOW, 1, START_S + 1)[0]


def test_the_header_says_where_the_cells_lie_and_the_tail_where_the_robot_was() -> None:
    image = new_image()
    head = words(image, WINDOW, 10)
    x_mm, y_mm = -7 * 200 + 100, 3 * 200 + 100
    assert head == [1, 10, 0xFFFF, x_mm % 65536, 0, y_mm, 200, SIZE, stride_of(SIZE), 1]
    tail = words(image, WINDOW_CELLS + SIZE * stride_of(SIZE), 7)
    assert tail == [1, 0, 1000, 0xFFFF, 65536 - 2000, 2865, 0]
    assert words(image, COARSE, 7) == [1, 10, 0xFFFF, 65536 - 2400, 65535, 65536 - 400, 400]


@pytest.mark.parametrize(("first", "count"), [(171, 1), (80, 92), (170, 2), (900, 1), (999, 2)])
def test_addresses_between_the_blocks_do_not_exist(first: int, count: int) -> None:
    image = new_image()
    assert image.read(START_S, None, first, count) == Refusal.ADDRESS
    assert not image.can_read(first, count)
    end = WINDOW_CELLS + SIZE * stride_of(SIZE) + 7
    assert image.read(START_S, None, end, 1) == Refusal.ADDRESS
    assert words(image, end - 1, 1) == [0]


def test_the_window_is_packed_ten_times_a_second_and_at_once_when_trust_is_lost() -> None:
    image, cells = new_image(), some_cells(2)
    generations = []
    for tick in range(1, 51):
        now_s = START_S + tick * 0.02
        image.publish(now_s, GOOD, CLEAR, window_of(cells))
        generations.append(words(image, WINDOW, 1, now_s)[0])
    assert generations[-1] == 1 + 10
    now_s += 0.02
    image.publish(now_s, BAD, CLEAR, window_of(cells, trusted=False))
    rows = rows_of(words(image, WINDOW_CELLS, SIZE * 4, now_s), SIZE)
    assert not any(1 in row for row in rows)
    image.publish(now_s + 0.02, GOOD, CLEAR, window_of(cells, epoch=1))
    assert words(image, WINDOW, 1, now_s + 0.02)[0] == generations[-1] + 2


def test_a_map_that_nobody_publishes_or_has_yet_is_told_as_unknown() -> None:
    unpublished = RegisterImage(size=SIZE, cell_mm=200, session=1, version="")
    silent = START_S + STALE_S + 0.01
    for image, now_s in ((new_image(), silent), (unpublished, START_S)):
        count = SIZE * stride_of(SIZE)
        assert not any(words(image, WINDOW_CELLS, count, now_s))
        assert not any(words(image, COARSE + 7, 64, now_s))
        assert words(image, WINDOW, 1, now_s) == words(image, COARSE, 1, now_s) == [0]
        assert words(image, COARSE + 1, 1, now_s) == [0xFFFF]
    assert words(new_image(), WINDOW, 1, START_S + STALE_S - 0.01) == [1]


def test_a_view_is_frozen_by_its_first_read_by_its_header_and_by_the_latch_only() -> None:
    image = new_image()
    view, other = image.new_view(), image.new_view()
    assert words(image, LATCH, 1, view=view) == [0]
    assert words(image, WINDOW_CELLS - 1, 1, view=view) == [1]
    now_s = START_S
    for generation in (2, 3):
        now_s += PACK_S
        image.publish(now_s, GOOD, CLEAR, window_of(some_cells(generation)))
    assert words(image, LATCH, 1, now_s, view) == [1]
    assert words(image, WINDOW + 1, 1, now_s, view) == [210]
    assert words(image, LATCH, 1, now_s) == words(image, WINDOW, 1, now_s) == [3]
    assert image.write(now_s, now_s, view, "", LATCH, [9]) is Refusal.NONE
    assert words(image, LATCH, 1, now_s, view) == [3]
    assert words(image, LATCH, 1, now_s, other) == [0]
    assert words(image, WINDOW, 12, now_s, other)[0] == 3


@pytest.mark.parametrize(
    "cause", ["too old", "trust lost", "map erased", "silent", "silent for a while"]
)
def test_a_view_that_is_too_old_or_not_trusted_any_more_is_told_only_when_frozen_anew(
    cause: str,
) -> None:
    image = new_image()
    view = image.new_view()
    words(image, WINDOW, 1, view=view)
    now_s = START_S + PACK_S
    if cause == "silent":
        now_s += STALE_S
    elif cause == "silent for a while":
        now_s += STALE_S
        image.publish(now_s, GOOD, CLEAR, window_of(some_cells(2)))
    elif cause == "too old":
        now_s = START_S + VIEW_S + 0.1
        image.publish(START_S + VIEW_S, GOOD, CLEAR, window_of(some_cells(2)))
    else:
        window = window_of(some_cells(2))
        changes = {"trusted": False} if cause == "trust lost" else {"epoch": window.epoch + 1}
        image.publish(now_s, GOOD, CLEAR, replace(window, **changes))
    assert image.read(now_s, view, WINDOW_CELLS, 5) == Refusal.BUSY
    assert len(words(image, WINDOW, 15, now_s, view)) == 15  # frozen anew


def test_buffers_are_used_again_however_long_it_runs() -> None:
    image = new_image()
    views = [image.new_view() for _ in range(3)]
    for k in range(200):
        now_s = START_S + k * PACK_S
        image.publish(now_s, GOOD, CLEAR, window_of(some_cells(k)))
        words(image, WINDOW, 1, now_s, views[k % 3])
    assert len(image._packer._pool) <= 2 + len(views)


def test_a_window_of_another_size_is_an_error_of_the_caller() -> None:
    with pytest.raises(ValueError, match="29 cells"):
        new_image().publish(START_S + 1, GOOD, CLEAR, window_of(some_cells(1, 28)))
