"""Tiles and what else a planner asks for: frames of the sheet, pieces, budgets, and asking only."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.planner_mcu.receiver import FakePlanner
from hw.device import BadFrame
from hw.planner_link.frames import ASK, GEOM, MAP, POSE, STOP_ZONE, TILE, TILE_HEAD, encode_frame
from hw.planner_link.messages import ASK_TILE, Ask, decode_answer
from hw.planner_link.tiles import F32, MOST_REFUSALS, pack_values
from mapod_link.asking import hello_body
from mapod_link.frames import MAX_FRAME, bytes_from_frame
from tests.support.link.planner_line import ZONE, Line, Sky, SkyTiles
from tests.support.link.planner_sender import whole

NAN = math.nan


@given(body=st.binary(max_size=16))
def test_what_is_no_valid_question_is_refused(body: bytes) -> None:
    told = decode_answer(encode_frame(ASK, 0, 1, 1, body))
    valid = len(body) == 12 and body[2] & 0x7F != 0
    assert isinstance(told, Ask) == valid
    if isinstance(told, BadFrame):
        assert told.reason == "ASK out of range"


@given(
    values=st.lists(
        st.one_of(st.sampled_from([1.0, -1.0, 0.0, NAN, math.inf]), st.floats(-50, 50, width=32)),
        min_size=1,
        max_size=40,
    ),
    trusted=st.booleans(),
)
def test_values_are_packed_as_a_slow_model_packs_them(values: list[float], trusted: bool) -> None:
    array: F32 = np.array(values, dtype=np.float32)
    classes = [2 if v == 1 else int(v == -1 and trusted) for v in values]
    packed = pack_values(0, array, trusted)
    assert [packed[k // 4] >> 2 * (k % 4) & 3 for k in range(len(values))] == classes
    heights = np.frombuffer(pack_values(1, array, trusted), "<i2")
    variances = np.frombuffer(pack_values(2, array, trusted), "<u2")
    slopes = np.frombuffer(pack_values(3, array, trusted), "<u2")
    ages = np.frombuffer(pack_values(5, array, trusted), "<u2")
    assert pack_values(6, array, trusted) == pack_values(1, array, trusted)
    edges = np.frombuffer(pack_values(7, array, trusted), "<u2")
    footholds = np.frombuffer(pack_values(8, array, trusted), "<u2")
    assert pack_values(9, array, trusted) == pack_values(1, array, trusted)
    sigmas = np.frombuffer(pack_values(10, array, trusted), "<u2")
    assert pack_values(11, array, trusted) == pack_values(10, array, trusted)
    for k, value in enumerate(array.tolist()):
        if math.isnan(value):
            assert (heights[k], variances[k], slopes[k]) == (-32_768, 65_535, 65_535)
            assert ages[k] == edges[k] == footholds[k] == sigmas[k] == 65_535
            continue
        assert heights[k] == pytest.approx(max(-32_767, min(32_767, value * 1e3)), abs=0.501)
        least = max(0.0, min(65_534.0, value * 1e6))
        assert least - 1e-3 <= variances[k] <= least + 1.001
        older = max(0.0, min(65_534.0, value * 10))
        assert older - 1e-3 <= ages[k] <= older + 1.001
        wider = max(0.0, min(65_534.0, value * 1e4))
        assert wider - 1e-3 <= sigmas[k] <= wider + 1.001
        assert slopes[k] == pytest.approx(max(0, min(65_534, value * 1e4)), abs=0.501)
        assert edges[k] == pytest.approx(max(0, min(65_534, value * 1e3)), abs=0.501)
        assert footholds[k] == pytest.approx(max(0, min(10_000, value * 1e4)), abs=0.501)


def ask(line: Line, ask_id: int, layer: int, rectangle: tuple[int, int, int, int]) -> None:
    """A question for a tile, as bytes on the wire."""
    body = struct.pack("<HBBhhHH", ask_id, ASK_TILE, layer, *rectangle)
    line.port.give(bytes_from_frame(ASK, ask_id, round(1000 * line.now_s), body))


def pieces(line: Line) -> list[tuple[int, ...]]:
    """What the last tick's TILE frames say: all fields up to `first`, and `count`."""
    found = []
    for frame in whole(line.frames):
        if frame.type == TILE:
            head = TILE_HEAD.unpack_from(frame.body)
            found.append((*head[:7], int.from_bytes(head[7], "little"), head[9]))
    return found


@pytest.mark.parametrize(("baud", "key", "loss"), [(115_200, bytes(32), 0.1), (None, None, 0.1)])
def test_a_tile_arrives_whole_beside_a_map_that_changes_and_moves(
    baud: int | None, key: bytes | None, loss: float
) -> None:
    sky = Sky(61, 4, (32_740, -32_780))
    line = Line(sky, baud=baud, loss=loss, key=key, tiles=SkyTiles(sky), seed=3)
    line.settle(0.3)
    tile = line.planner.ask_tile("height", 32_760, -32_770, 30, 20)
    classes = line.planner.ask_tile("class", 3, 5, 40, 40, in_window=True)
    worst = 0
    for k in range(400):
        if k % 10 == 0:
            sky.move(1, 0)
        sky.change(2)
        line.tick()
        worst = max(worst, sum(line.tick_bytes[-50:]))
        if tile.complete and classes.complete:
            break
    assert tile.complete
    assert classes.complete
    heights = [
        [((7 * i + 13 * j) % 400 - 200) / 1000 for i in range(32_760, 32_790)]
        for j in range(-32_770, -32_750)
    ]
    np.testing.assert_allclose(tile.values, heights, atol=6e-4)
    assert baud != 115_200 or worst <= 11_520


def test_a_tile_waits_for_changes_and_leaves_the_refresh_its_share() -> None:
    sky = Sky(101, 1)
    line = Line(sky, baud=115_200, tiles=SkyTiles(sky))
    line.planner.greet()
    line.settle(2.0)
    line.planner.ask_tile("height", 0, 0, 101, 60)
    line.settle(1.0)
    before = line.planner.accepted[TILE]
    assert before > 20  # some 3 KB a second beside everything else
    sky.show(sky.every_other, 1)  # far more than a tick carries
    waits = 0
    while not line.holds_what_is_meant():
        line.tick()
        waits += 1
        assert max(line.tick_bytes[-2:]) <= 11_520 / 50 * 1.85 + 2
        assert line.planner.accepted[TILE] <= before + 1
    assert 10 < waits < 60
    line.settle(2.5)
    assert line.planner.accepted[TILE] > 2 * before
    assert line.link.counters.ticks_held == 0


@pytest.mark.parametrize(
    ("rectangle", "layer", "status"),
    [((0, 0, 0, 5), 1, 2), ((0, 0, 402, 401), 1, 2), ((0, 0, 5, 5), 3, 1), ((0, 0, 5, 5), 12, 1)],
)
def test_a_tile_that_cannot_be_had_is_answered_by_its_status(
    rectangle: tuple[int, int, int, int], layer: int, status: int
) -> None:
    sky = Sky(9, 1)
    line = Line(sky, tiles=SkyTiles(sky))
    line.settle(0.1)
    ask(line, 77, layer, rectangle)
    line.tick()
    assert pieces(line) == [(77, layer, status, *rectangle, 0, 0)]
    line.tick()
    assert pieces(line) == []


def test_five_tiles_at_a_time_are_one_too_many_and_the_same_id_replaces() -> None:
    sky = Sky(41, 1)
    line = Line(sky, tiles=SkyTiles(sky))
    line.settle(1.0)
    for ask_id in (1, 2, 3, 4, 3, 5):
        ask(line, ask_id, 1, (0, 0, 20, 20))
    seen = []
    for _ in range(10):
        line.tick()
        seen += [(piece[0], piece[2]) for piece in pieces(line)]
    assert seen[0] == (5, 3)
    assert list(dict.fromkeys(seen[1:])) == [(1, 0), (2, 0), (4, 0), (3, 0)]
    assert not line.link._answers.waiting


def test_no_flood_of_questions_is_kept() -> None:
    tiles = Line(Sky(9, 1)).link._answers.tiles
    for ask_id in range(10_000):
        tiles.take(Ask(1, 1, ask_id, ASK_TILE, 0, 0, 0, 1 if ask_id % 2 else 0, 1))
    assert len(tiles._tiles) <= 4
    assert len(tiles._refused) <= MOST_REFUSALS


@pytest.mark.parametrize("longest", [48, 60, 65_535])
def test_frames_are_no_longer_than_the_planner_and_the_protocol_take(longest: int) -> None:
    sky = Sky(21, 1)
    line = Line(sky, tiles=SkyTiles(sky), zone=ZONE)
    line.planner.mute = True
    line.port.give(encode_frame(9, 0, 1, 1, hello_body(longest, 10_000, longest)))
    ask(line, longest, 1, (0, 0, 20, 20))
    lengths = []
    for _ in range(60):
        sky.change(100 if longest == 65_535 else 1)
        line.tick()
        lengths += [len(frame) for frame in line.frames]
    assert min(longest, MAX_FRAME) - 3 <= max(lengths) <= min(longest, MAX_FRAME)
    assert line.planner.accepted[TILE] > 0


def test_a_planner_that_only_asks_gets_nothing_unasked_and_costs_no_memory() -> None:
    sky = Sky(41, 1)
    planner = FakePlanner(poll_only=True, ack_every=1, seed=5)
    line = Line(sky, tiles=SkyTiles(sky), zone=ZONE, planner=planner)
    line.settle(0.1)
    planner.accepted.clear()
    for _ in range(100):
        sky.change(20)
        sky.move(1, 0)
        line.tick()
        assert line.frames == []
    assert line.link._map.mark_again() == 0
    assert not line.link._repair._sent
    assert planner.ask(line.now_s, geometry=True, pose=True, stop_zone=True)
    line.settle(0.3)
    assert dict(planner.accepted) == {GEOM: 1, POSE: 1, STOP_ZONE: 1}


def test_a_planner_may_begin_to_be_told_again() -> None:
    sky = Sky(21, 1)
    line = Line(sky, planner=FakePlanner(poll_only=True, seed=5))
    line.settle(0.3)
    sky.change(50)
    line.settle(0.1)
    line.planner = FakePlanner(seed=6, ack_every=1)
    line.planner.greet()
    for frame in line.planner.poll(line.now_s):
        line.port.give(frame)
    for _ in range(10):
        line.tick()
    assert line.holds_what_is_meant()


def test_who_is_to_push_nothing_calls_out_on_datagrams_until_somebody_asks() -> None:
    sky = Sky(9, 1)
    line = Line(sky, push=False, zone=ZONE)
    line.planner.mute = True
    line.settle(10.0)
    assert dict(line.planner.accepted) == {GEOM: 10}
    line.planner.mute = False
    line.planner.greet()
    line.settle(3.0)
    assert line.planner.accepted[GEOM] <= 12
    assert line.planner.accepted[MAP] == line.planner.accepted[POSE] == 0
    serial = Line(sky, baud=115_200, push=False)
    serial.planner.mute = True
    serial.settle(5.0)
    assert serial.link.frames_sent == 0
    serial.planner.mute = False
    serial.planner.greet()
    serial.settle(1.0)
    assert 1 <= serial.planner.accepted[GEOM] <= 3


def test_who_asks_a_run_that_has_told_no_geometry_yet_gets_one_with_the_answer() -> None:
    sky, planner = Sky(11, 3), FakePlanner(poll_only=True)
    before = Line(sky, push=False, planner=planner)
    before.settle(0.2)
    after = Line(sky, push=False, planner=planner, session=78)
    after.now_s = before.now_s
    planner.ask(after.now_s, pose=True)
    after.settle(0.1)
    assert planner.geom is not None
    assert planner.geom.session == 78
