"""Objects and path in the terminal: bytes of the link in, a picture out."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from mapod_link.frames import DIGEST, GEOM, MAP, OBJECTS, PATH, POSE
from tests.support.link.object_frames import (
    Corners,
    gone_record,
    object_record,
    objects_body,
    path_body,
)
from tests.support.link.planner_sender import Line, geom_body, map_body, op, pose_body
from tools.terminal import screen
from tools.terminal.outlines import MOVING, cells_on, lines_of
from tools.terminal.planner_end import Meter, WatchingReceiver

BOX: Corners = ((-100, -50), (99, -50), (99, 49), (-100, 49))  # 4 x 2 cells of 50 mm


def line_with_map() -> Line[WatchingReceiver]:
    """9 x 9 cells of 50 mm, fresh for 10 s: all free but for an obstacle in the middle."""
    line = Line(WatchingReceiver())
    line.send(GEOM, geom_body(width=9, height=9, stale_ms=10_000))
    line.send(POSE, pose_body())
    line.send(MAP, map_body(op(1, 40) + op(2, 1) + op(1, 40), ox=-4, oy=-4))
    return line


def box(number: int, kind: int, x_mm: int, y_mm: int, age_ms: int = 40) -> bytes:
    velocity = (600, -250) if kind == 3 else (0, 0)
    return object_record(number, kind, BOX, (x_mm, y_mm), velocity=velocity, age_ms=age_ms)


def drawn(line: Line[WatchingReceiver], now_s: float | None = None) -> list[str]:
    now_s = line.now_s if now_s is None else now_s
    lines = lines_of(line.planner, now_s)
    return screen.plain_map(line.planner.window(), None, 1, lines).splitlines()


BARE = [".........", ".........", ".........", ".........", "....#....", *4 * ["........."]]


def test_objects_and_path_lie_where_they_were_told_and_what_is_gone_goes() -> None:
    line = line_with_map()
    assert drawn(line) == BARE
    still, moving = box(3, 2, 100, 100), box(258, 3, -100, -50)
    line.send(OBJECTS, objects_body([still, moving], [still, moving]))
    points = [(-50, -100), (0, 0), (0, 220), (200, 220)]
    line.send(PATH, path_body(points, ahead=1))
    shown = drawn(line)
    assert "".join(shown).count("#") == 1  # no path hides an obstacle
    assert shown == ["*........", *3 * ["*.oo....."], "**oo#....", *4 * [".....mm.."]]
    line.send(OBJECTS, objects_body([gone_record(3)], [moving]))
    line.send(PATH, path_body(points, ahead=4))  # it is done
    assert set("".join(drawn(line))) == {".", "#", "m"}
    line.send(GEOM, geom_body(width=9, height=9, session=99, stale_ms=10_000))
    assert not lines_of(line.planner, line.now_s).any


def test_what_nobody_tells_of_any_more_goes_at_once_and_is_said_to() -> None:
    line = line_with_map()
    records = [box(3, 1, 100, 100), box(258, 3, -100, -50, age_ms=300)]
    line.send(OBJECTS, objects_body(records, records))
    line.send(PATH, path_body([(-200, -200), (200, -200)]))
    at_s = line.now_s
    assert {"o", "m", "*"} < set("".join(drawn(line)))
    assert set("".join(drawn(line, at_s + 0.25))) == {".", "#", "o", "*"}  # 0.55 s old: where?
    assert set("".join(drawn(line, at_s + 0.4))) == {".", "#", "*"}
    assert drawn(line, at_s + 0.8) == BARE
    assert "objects  0; not sure: objects come late" in picture(line, at_s + 0.8)
    line.send(OBJECTS, objects_body(records, records, look_ms=1100))
    assert "objects  0; not sure: nothing looks for objects" in picture(line, line.now_s)
    line.send(OBJECTS, objects_body(records, records))
    assert "objects  2, 1 moving\n" in picture(line, line.now_s)
    assert "██ object" in picture(line, line.now_s)
    line.send(DIGEST, b"", lost=True)
    line.send(POSE, pose_body())
    said = picture(line, line.now_s)  # they stay, for most of them are right
    assert "objects  2, 1 moving; not sure: a frame is missing" in said
    assert lines_of(line.planner, line.now_s).any
    assert not lines_of(line.planner, line.now_s + 20.0).any


def picture(line: Line[WatchingReceiver], now_s: float) -> str:
    console = Console(width=160, height=60, color_system=None, force_terminal=True)
    with console.capture() as capture:
        console.print(screen.picture(line.planner, Meter(), now_s, 160, 60))
    return "\n".join(row.rstrip() for row in capture.get().splitlines()) + "\n"


PLACES = st.floats(-20, 30) | st.sampled_from([0.0, 5.0, 8.0, -1e9, 1e9, math.nan])
LINES = st.lists(st.tuples(PLACES, PLACES), min_size=1, max_size=4)


@given(LINES)
def test_a_line_meets_the_cells_that_a_walk_along_it_meets(
    corners: list[tuple[float, float]],
) -> None:
    line, size = np.array(corners), (8, 5)
    cells = {(int(col), int(row)) for col, row in cells_on(line, size, 0.4)}
    for (x0, y0), (x1, y1) in pairwise(corners):
        if not all(abs(place) < 100 for place in (x0, y0, x1, y1)):
            continue
        for share in np.linspace(0.0, 1.0, 200):
            x, y = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
            if 0 <= x < 8 and 0 <= y < 5:  # it may cut a corner between two samples
                near = {(math.floor(x + dx), math.floor(y + dy)) for dx in (-0.4, 0, 0.4)
                        for dy in (-0.4, 0, 0.4)}  # fmt: skip
                assert near & cells
    assert all(0 <= col < 8 and 0 <= row < 5 for col, row in cells)


@pytest.mark.parametrize("factor", [1, 2, 5])
def test_a_coarser_picture_has_the_same_things(factor: int) -> None:
    line = line_with_map()
    records = [box(3, 1, 100, 100), box(258, 3, -100, -50)]
    line.send(OBJECTS, objects_body(records, records))
    lines = lines_of(line.planner, line.now_s)
    window = line.planner.window()
    assert {"o", "m"} & set(screen.plain_map(window, None, factor, lines))
    text = screen.map_text(window, None, factor, lines)
    assert screen.COLOURS[MOVING] in str([span.style for span in text.spans])
