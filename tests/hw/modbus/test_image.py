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
from tests.support import modbus_rig as rig


def coarse(rows: list[list[int]]) -> list[list[int]]:
    """The slow model of the coarse map: the worst of each block, unknown outside."""
    n, block = len(rows), -(-len(rows) // COARSE_CELLS)
    off = (COARSE_CELLS * block - n) // 2
    padded = np.zeros((COARSE_CELLS, block, COARSE_CELLS, block), dtype=int)
    padded.reshape(COARSE_CELLS * block, -1)[off : off + n, off : off + n] = rows
    blocks = padded.swapaxes(1, 2).reshape(COARSE_CELLS, COARSE_CELLS, -1)
    unknown = (blocks == 0).any(axis=2)
    worst = np.where((blocks == 2).any(axis=2), 2, np.where(unknown, 0, 1))
    return [[int(code) for code in row] for row in worst]


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
    cells = rig.some_cells(seed, size)
    if kind != "all":
        cells[...] = np.where(np.abs(cells) > (1 if kind == "free" else 0), cells, FREE)
    image = rig.new_image(size=size)
    image.publish(
        rig.START_S + 1, rig.GOOD, rig.CLEAR, rig.window_of(cells, corner, trusted=trusted, epoch=1)
    )
    count = size * stride_of(size)
    told = rig.words(image, WINDOW_CELLS, count, rig.START_S + 1)
    expected = rig.raster(cells, corner, trusted)
    assert rig.rows_of(told, size) == expected
    registers = rig.words(image, COARSE, 71, rig.START_S + 1)
    assert rig.rows_of(registers[7:-1], COARSE_CELLS) == coarse(expected)
    assert registers[0] == registers[-1] == rig.words(image, WINDOW, 1, rig.START_S + 1)[0]


def test_the_header_says_where_the_cells_lie_and_the_tail_where_the_robot_was() -> None:
    image = rig.new_image()
    head = rig.words(image, WINDOW, 10)
    x_mm, y_mm = -7 * 200 + 100, 3 * 200 + 100
    assert head == [1, 10, 0xFFFF, x_mm % 65536, 0, y_mm, 200, rig.SIZE, stride_of(rig.SIZE), 1]
    tail = rig.words(image, WINDOW_CELLS + rig.SIZE * stride_of(rig.SIZE), 7)
    assert tail == [1, 0, 1000, 0xFFFF, 65536 - 2000, 2865, 0]
    assert rig.words(image, COARSE, 7) == [1, 10, 0xFFFF, 65536 - 2400, 65535, 65536 - 400, 400]


@pytest.mark.parametrize(("first", "count"), [(171, 1), (80, 92), (170, 2), (900, 1), (999, 2)])
def test_addresses_between_the_blocks_do_not_exist(first: int, count: int) -> None:
    image = rig.new_image()
    assert image.read(rig.START_S, None, first, count) == Refusal.ADDRESS
    assert not image.can_read(first, count)
    end = WINDOW_CELLS + rig.SIZE * stride_of(rig.SIZE) + 7
    assert image.read(rig.START_S, None, end, 1) == Refusal.ADDRESS
    assert rig.words(image, end - 1, 1) == [0]


def test_the_window_is_packed_ten_times_a_second_and_at_once_when_trust_is_lost() -> None:
    image, cells = rig.new_image(), rig.some_cells(2)
    generations = []
    for tick in range(1, 51):
        now_s = rig.START_S + tick * 0.02
        image.publish(now_s, rig.GOOD, rig.CLEAR, rig.window_of(cells))
        generations.append(rig.words(image, WINDOW, 1, now_s)[0])
    assert generations[-1] == 1 + 10
    now_s += 0.02
    image.publish(now_s, rig.BAD, rig.CLEAR, rig.window_of(cells, trusted=False))
    rows = rig.rows_of(rig.words(image, WINDOW_CELLS, rig.SIZE * 4, now_s), rig.SIZE)
    assert not any(1 in row for row in rows)
    image.publish(now_s + 0.02, rig.GOOD, rig.CLEAR, rig.window_of(cells, epoch=1))
    assert rig.words(image, WINDOW, 1, now_s + 0.02)[0] == generations[-1] + 2


def test_a_map_that_nobody_publishes_or_has_yet_is_told_as_unknown() -> None:
    unpublished = RegisterImage(size=rig.SIZE, cell_mm=200, session=1, version="")
    silent = rig.START_S + STALE_S + 0.01
    for image, now_s in ((rig.new_image(), silent), (unpublished, rig.START_S)):
        count = rig.SIZE * stride_of(rig.SIZE)
        assert not any(rig.words(image, WINDOW_CELLS, count, now_s))
        assert not any(rig.words(image, COARSE + 7, 64, now_s))
        assert rig.words(image, WINDOW, 1, now_s) == rig.words(image, COARSE, 1, now_s) == [0]
        assert rig.words(image, COARSE + 1, 1, now_s) == [0xFFFF]
    assert rig.words(rig.new_image(), WINDOW, 1, rig.START_S + STALE_S - 0.01) == [1]


def test_a_view_is_frozen_by_its_first_read_by_its_header_and_by_the_latch_only() -> None:
    image = rig.new_image()
    view, other = image.new_view(), image.new_view()
    assert rig.words(image, LATCH, 1, view=view) == [0]
    assert rig.words(image, WINDOW_CELLS - 1, 1, view=view) == [1]
    now_s = rig.START_S
    for generation in (2, 3):
        now_s += PACK_S
        image.publish(now_s, rig.GOOD, rig.CLEAR, rig.window_of(rig.some_cells(generation)))
    assert rig.words(image, LATCH, 1, now_s, view) == [1]
    assert rig.words(image, WINDOW + 1, 1, now_s, view) == [210]
    assert rig.words(image, LATCH, 1, now_s) == rig.words(image, WINDOW, 1, now_s) == [3]
    assert image.write(now_s, now_s, view, "", LATCH, [9]) is Refusal.NONE
    assert rig.words(image, LATCH, 1, now_s, view) == [3]
    assert rig.words(image, LATCH, 1, now_s, other) == [0]
    assert rig.words(image, WINDOW, 12, now_s, other)[0] == 3


@pytest.mark.parametrize(
    "cause", ["too old", "trust lost", "map erased", "silent", "silent for a while"]
)
def test_a_view_that_is_too_old_or_not_trusted_any_more_is_told_only_when_frozen_anew(
    cause: str,
) -> None:
    image = rig.new_image()
    view = image.new_view()
    rig.words(image, WINDOW, 1, view=view)
    now_s = rig.START_S + PACK_S
    if cause == "silent":
        now_s += STALE_S
    elif cause == "silent for a while":
        now_s += STALE_S
        image.publish(now_s, rig.GOOD, rig.CLEAR, rig.window_of(rig.some_cells(2)))
    elif cause == "too old":
        now_s = rig.START_S + VIEW_S + 0.1
        image.publish(rig.START_S + VIEW_S, rig.GOOD, rig.CLEAR, rig.window_of(rig.some_cells(2)))
    else:
        window = rig.window_of(rig.some_cells(2))
        changes = {"trusted": False} if cause == "trust lost" else {"epoch": window.epoch + 1}
        image.publish(now_s, rig.GOOD, rig.CLEAR, replace(window, **changes))
    assert image.read(now_s, view, WINDOW_CELLS, 5) == Refusal.BUSY
    assert len(rig.words(image, WINDOW, 15, now_s, view)) == 15  # frozen anew


def test_buffers_are_used_again_however_long_it_runs() -> None:
    image = rig.new_image()
    views = [image.new_view() for _ in range(3)]
    for k in range(200):
        now_s = rig.START_S + k * PACK_S
        image.publish(now_s, rig.GOOD, rig.CLEAR, rig.window_of(rig.some_cells(k)))
        rig.words(image, WINDOW, 1, now_s, views[k % 3])
    assert len(image._packer._pool) <= 2 + len(views)


def test_a_window_of_another_size_is_an_error_of_the_caller() -> None:
    with pytest.raises(ValueError, match="29 cells"):
        rig.new_image().publish(
            rig.START_S + 1, rig.GOOD, rig.CLEAR, rig.window_of(rig.some_cells(1, 28))
        )
