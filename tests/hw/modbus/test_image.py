"""The register image: the window as registers, views that never mix, and the status block."""

import math
import re
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from core.records import FREE
from hw.modbus import layout
from hw.modbus.image import PACK_S, VIEW_S, RegisterImage
from hw.modbus.layout import (
    COARSE,
    COARSE_CELLS,
    LATCH,
    STATUS_BLOCK,
    WINDOW,
    WINDOW_CELLS,
    Block,
    Entry,
    Refusal,
    stride_of,
)
from hw.modbus.status import STALE_S
from tests.support.machine import modbus_rig as rig
from tools.docs.modbus_table import DOCUMENT, MARKS, MEANINGS, SECTIONS, filled


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


UNKNOWN_ZONE = replace(
    rig.CLEAR, free_ahead_m=0.0, nearest_m=math.nan, sectors_m=(math.nan,) * 8, state=0, causes=8
)


def entry_of(
    image: RegisterImage, name: str, now_s: float = rig.START_S, utc_s: float = 0.0
) -> int:
    entry = next(entry for entry in STATUS_BLOCK.entries if entry.name == name)
    data = image.read(now_s, None, entry.address, entry.registers, utc_s)
    assert not isinstance(data, Refusal)
    return int(struct.unpack(f">{entry.format}", data)[0])


def test_blocks_do_not_overlap_and_have_room_for_what_is_in_them() -> None:
    blocks = [layout.STATUS_BLOCK, layout.LATCH_BLOCK, layout.COARSE_BLOCK, layout.DRIVE_BLOCK]
    blocks.append(layout.window_block(401))
    ends = [block.first + block.size for block in blocks]
    assert all(end <= block.first for end, block in zip(ends, blocks[1:], strict=False))
    assert ends[-1] <= 65536
    assert layout.COARSE_BLOCK.size == 71
    for block in blocks:
        assert len({entry.name for entry in block.entries}) == len(block.entries)
    with pytest.raises(AssertionError, match="begins in the entry before it"):
        Block(0, 4, [Entry("a", 0, "u32", "", ""), Entry("b", 1, "u16", "", "")])


EXPECTED = """
magic 19792, word_order_test 305419896, instance 5, uptime 0, utc 1800000000
version_major_minor 525, version_patch 4, coarse_cell 400, coarse_cells 21
x 1000, y -2000, heading 2865, quality 100, speed 250, turn -573, pitch 57, roll -115
sigma_position 65535, sigma_heading 65535, link_health 127, mode 1, faults 0, health 95
age_scan 10, age_attitude 20, age_encoders 30, age_window 10, age_pose 0
stop_zone 1, zone_causes 0, nearest 500, bearing 573, contact 1239
sector_0 1000, sector_2 65535, sector_7 500, free_ahead 1999, obstacle_ahead 2500
free_behind 1000, obstacle_behind 65535, allowed_ahead 499, allowed_behind 400
window_cells 29, window_stride 4, window_first 1000, window_registers 116
"""


def test_the_status_is_told_in_its_units_and_the_stop_zone_rounded_to_the_safe_side() -> None:
    image = rig.new_image(session=2**32 + 5, version="2.13.4")
    zone = replace(rig.CLEAR, free_ahead_m=1.9999, allowed_ahead_mps=0.4999, contact_s=1.2399)
    image.publish(rig.START_S, rig.GOOD, zone, rig.window_of(rig.some_cells(1)))
    for pair in EXPECTED.strip().replace("\n", ", ").split(", "):
        name, value = pair.split()
        assert entry_of(image, name, rig.START_S, 1.8e9) == int(value), name
    assert image.read(rig.START_S, None, 6, 8) == b"mapod".ljust(16, b"\0")
    image.publish(rig.START_S, rig.GOOD, UNKNOWN_ZONE, rig.window_of(rig.some_cells(1)))
    assert entry_of(image, "nearest") == entry_of(image, "sector_3") == 0


def test_uptime_and_ages_go_on_and_the_heartbeat_with_publications_only() -> None:
    image = rig.new_image()
    entry_of(image, "uptime")
    assert entry_of(image, "age_scan", rig.START_S + 0.5) == 510
    assert entry_of(image, "age_pose", rig.START_S + 0.5) == 500
    assert entry_of(image, "age_attitude", rig.START_S + 70) == 65535
    image.publish(rig.START_S + 7.5, rig.GOOD, rig.CLEAR, rig.window_of(rig.some_cells(1)))
    assert entry_of(image, "heartbeat", rig.START_S + 7.5) == 7
    assert entry_of(image, "uptime", rig.START_S + 70.2) == 70
    assert entry_of(image, "heartbeat", rig.START_S + 70.2) == 7


@pytest.mark.parametrize("started", [True, False])
def test_nothing_good_is_told_once_mapod_is_silent_or_before_it_speaks(started: bool) -> None:
    image = (
        rig.new_image() if started else RegisterImage(size=29, cell_mm=200, session=7, version="")
    )
    image_pose = replace(rig.GOOD, health=0x7F | 1 << 8 | 1 << 15)
    if started:
        image.publish(
            rig.START_S, image_pose, rig.CLEAR, rig.window_of(rig.some_cells(1)), planner_heard=True
        )
    now_s = rig.START_S + STALE_S + 0.1
    for name in ("generation", "generation_again", "generation_end", "stop_zone", "quality"):
        assert entry_of(image, name, now_s) == 0
    for name in ("free_ahead", "free_behind", "allowed_ahead", "allowed_behind", "contact"):
        assert entry_of(image, name, now_s) == 0
    assert entry_of(image, "nearest", now_s) == entry_of(image, "sector_2", now_s) == 0
    assert entry_of(image, "zone_causes", now_s) == 8
    assert entry_of(image, "health", now_s) == 1 << 15
    assert entry_of(image, "link_health", now_s) == (1 << 8 | 1 << 15 if started else 0)
    assert entry_of(image, "mode", now_s) == (3 if started else 0)
    assert entry_of(image, "faults", now_s) == (9 if started else 7)


def test_what_is_wrong_is_counted_and_shows_in_one_bit() -> None:
    image = rig.new_image()
    image.publish(
        rig.START_S,
        rig.BAD,
        rig.CLEAR,
        rig.window_of(rig.some_cells(1), trusted=False),
        planner_heard=True,
    )
    assert entry_of(image, "health") == 1 << 2 | 1 << 5 | 1 << 6 | 1 << 15
    assert entry_of(image, "faults") == 5
    assert entry_of(image, "age_pose") == 65535
    assert entry_of(image, "quality") == 0


def test_the_generation_counts_publications_and_is_the_same_at_all_its_places() -> None:
    image = rig.new_image()
    for k in range(2, 5):
        image.publish(
            rig.START_S + k,
            rig.GOOD,
            rig.CLEAR,
            rig.window_of(rig.some_cells(1)),
            sigma_m=0.1,
            sigma_rad=1,
        )
        places = ("generation", "generation_again", "generation_end")
        assert {entry_of(image, name, rig.START_S + k) for name in places} == {k}
    assert entry_of(image, "sigma_position", rig.START_S + 4) == 100
    assert entry_of(image, "sigma_heading", rig.START_S + 4) == 5730


def test_numbers_out_of_range_stay_at_the_end_of_their_range() -> None:
    image = rig.new_image()
    wild = replace(rig.GOOD, x_m=1e9, y_m=-1e9, v_mps=-100.0, w_radps=math.inf, yaw_rad=math.nan)
    image.publish(
        rig.START_S, wild, rig.CLEAR, rig.window_of(rig.some_cells(1), (10**9, -(10**9)), epoch=1)
    )
    names = ("x", "y", "speed", "turn", "heading", "window_x", "window_y")
    values = [entry_of(image, name) for name in names]
    assert values == [2**31 - 1, -(2**31), -32768, 32767, 0, 2**31 - 1, -(2**31)]


TEXT = DOCUMENT.read_text(encoding="utf-8")


def test_the_document_has_every_table_of_the_code_once() -> None:
    assert filled(TEXT) == TEXT
    assert filled(MARKS.sub(r"<!-- begin \1 -->\nold\n<!-- end \1 -->", TEXT)) == TEXT
    names = [found[1] for found in MARKS.finditer(TEXT)]
    assert sorted(names) == sorted(SECTIONS)
    assert set(MEANINGS) == set(Refusal) - {Refusal.NONE}


def test_registers_that_the_text_names_are_where_it_says() -> None:
    blocks = [layout.STATUS_BLOCK, layout.DRIVE_BLOCK, layout.window_block(101)]
    places = {(entry.name, entry.address) for block in blocks for entry in block.entries}
    named = {(name, int(at)) for name, at in re.findall(r"`(\w+)` \((\d+)\)", TEXT)}
    assert len(named) > 8
    assert named <= places
