"""The status block: each register where the document says, and nothing good told without cause."""

import math
import re
import struct
from dataclasses import replace

import pytest

from hw.modbus import layout
from hw.modbus.image import RegisterImage
from hw.modbus.layout import STATUS_BLOCK, Block, Entry, Refusal
from hw.modbus.status import STALE_S
from tests.support.modbus_rig import BAD, CLEAR, GOOD, START_S, new_image, some_cells, window_of
from tools.docs.modbus_table import DOCUMENT, MARKS, MEANINGS, SECTIONS, filled

UNKNOWN_ZONE = replace(
    CLEAR, free_ahead_m=0.0, nearest_m=math.nan, sectors_m=(math.nan,) * 8, state=0, causes=8
)


def told(image: RegisterImage, name: str, now_s: float = START_S, utc_s: float = 0.0) -> int:
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
    image = new_image(session=2**32 + 5, version="2.13.4")
    zone = replace(CLEAR, free_ahead_m=1.9999, allowed_ahead_mps=0.4999, contact_s=1.2399)
    image.publish(START_S, GOOD, zone, window_of(some_cells(1)))
    for pair in EXPECTED.strip().replace("\n", ", ").split(", "):
        name, value = pair.split()
        assert told(image, name, START_S, 1.8e9) == int(value), name
    assert image.read(START_S, None, 6, 8) == b"mapod".ljust(16, b"\0")
    image.publish(START_S, GOOD, UNKNOWN_ZONE, window_of(some_cells(1)))
    assert told(image, "nearest") == told(image, "sector_3") == 0


def test_uptime_and_ages_go_on_and_the_heartbeat_with_publications_only() -> None:
    image = new_image()
    told(image, "uptime")
    assert told(image, "age_scan", START_S + 0.5) == 510
    assert told(image, "age_pose", START_S + 0.5) == 500
    assert told(image, "age_attitude", START_S + 70) == 65535
    image.publish(START_S + 7.5, GOOD, CLEAR, window_of(some_cells(1)))
    assert told(image, "heartbeat", START_S + 7.5) == 7
    assert told(image, "uptime", START_S + 70.2) == 70
    assert told(image, "heartbeat", START_S + 70.2) == 7


@pytest.mark.parametrize("started", [True, False])
def test_nothing_good_is_told_once_mapod_is_silent_or_before_it_speaks(started: bool) -> None:
    image = new_image() if started else RegisterImage(size=29, cell_mm=200, session=7, version="")
    image_pose = replace(GOOD, health=0x7F | 1 << 8 | 1 << 15)
    if started:
        image.publish(START_S, image_pose, CLEAR, window_of(some_cells(1)), planner_heard=True)
    now_s = START_S + STALE_S + 0.1
    for name in ("generation", "generation_again", "generation_end", "stop_zone", "quality"):
        assert told(image, name, now_s) == 0
    for name in ("free_ahead", "free_behind", "allowed_ahead", "allowed_behind", "contact"):
        assert told(image, name, now_s) == 0
    assert told(image, "nearest", now_s) == told(image, "sector_2", now_s) == 0
    assert told(image, "zone_causes", now_s) == 8
    assert told(image, "health", now_s) == 1 << 15
    assert told(image, "link_health", now_s) == (1 << 8 | 1 << 15 if started else 0)
    assert told(image, "mode", now_s) == (3 if started else 0)
    assert told(image, "faults", now_s) == (9 if started else 7)


def test_what_is_wrong_is_counted_and_shows_in_one_bit() -> None:
    image = new_image()
    image.publish(START_S, BAD, CLEAR, window_of(some_cells(1), trusted=False), planner_heard=True)
    assert told(image, "health") == 1 << 2 | 1 << 5 | 1 << 6 | 1 << 15
    assert told(image, "faults") == 5
    assert told(image, "age_pose") == 65535
    assert told(image, "quality") == 0


def test_the_generation_counts_publications_and_is_the_same_at_all_its_places() -> None:
    image = new_image()
    for k in range(2, 5):
        image.publish(START_S + k, GOOD, CLEAR, window_of(some_cells(1)), sigma_m=0.1, sigma_rad=1)
        places = ("generation", "generation_again", "generation_end")
        assert {told(image, name, START_S + k) for name in places} == {k}
    assert told(image, "sigma_position", START_S + 4) == 100
    assert told(image, "sigma_heading", START_S + 4) == 5730


def test_numbers_out_of_range_stay_at_the_end_of_their_range() -> None:
    image = new_image()
    wild = replace(GOOD, x_m=1e9, y_m=-1e9, v_mps=-100.0, w_radps=math.inf, yaw_rad=math.nan)
    image.publish(START_S, wild, CLEAR, window_of(some_cells(1), (10**9, -(10**9)), epoch=1))
    names = ("x", "y", "speed", "turn", "heading", "window_x", "window_y")
    values = [told(image, name) for name in names]
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
