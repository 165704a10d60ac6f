"""Windows on their way to a page: what it puts together is the map, wherever that has moved."""

import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN
from mapod_link.frames import GEOM, MAP, POSE
from tests.support.link.planner_sender import Line, geom_body, map_body, op, pose_body
from tools.terminal.planner_end import WatchingReceiver
from tools.view.history import MOST_BYTES, SPAN_S, History
from tools.view.window import ScanLine, Window, window_of

Cells = dict[tuple[int, int], int]  # by the world's column and row; unknown are left out


def header_and_payload(message: str | bytes) -> tuple[int, dict[str, float], bytes]:
    assert isinstance(message, bytes)
    kind, zero, size = struct.unpack_from("<BBH", message)
    assert zero == 0
    return kind, json.loads(message[4 : 4 + size]), message[4 + size :]


def put_together(held: Cells, message: bytes) -> Cells:
    """What a page knows after a message: a slow and obvious page."""
    if not message:
        return held
    kind, header, payload = header_and_payload(message)
    i, j, size = int(header["i"]), int(header["j"]), int(header["size"])
    if kind == 1:
        cells = {(i + k % size, j + k // size): state for k, state in enumerate(payload)}
    else:
        assert kind == 2
        inside = {(i + column, j + row) for row in range(size) for column in range(size)}
        cells = {cell: state for cell, state in held.items() if cell in inside}
        for index, state in struct.iter_unpack("<IB", payload):
            cells[(i + index % size, j + index // size)] = state
    return {cell: state for cell, state in cells.items() if state}


def window(i: int, j: int, cells: list[int], epoch: int = 1, t_s: float = 1.0) -> Window:
    side = int(len(cells) ** 0.5)
    return Window(t_s, epoch, i, j, 0.05, np.array(cells, np.uint8).reshape(side, side))


SIDE = 6
CELLS = st.lists(st.sampled_from([0, 0, 0, 0, 1, 2]), min_size=SIDE**2, max_size=SIDE**2)
PLACES = st.integers(-8, 8)
WINDOWS = st.builds(window, PLACES, PLACES, CELLS, st.integers(1, 2))


@given(st.lists(WINDOWS, min_size=1, max_size=6))
def test_a_page_holds_what_the_server_holds(windows: list[Window]) -> None:
    held: Window | None = None
    page: Cells = {}
    for now in windows:
        page = put_together(page, now.since(held))
        assert page == put_together({}, now.whole())
        held = now


def test_changes_are_five_bytes_a_cell_and_what_stays_costs_nothing() -> None:
    before = window(10, -3, [1] * 35 + [0])
    after = window(10, -3, [1] * 34 + [2, 0])
    kind, header, payload = header_and_payload(after.since(before))
    assert (kind, header, payload) == (
        2,
        {"i": 10, "j": -3, "size": 6, "t_s": 1.0},
        b"\x22\0\0\0\2",
    )
    assert window(10, -3, [1] * 34 + [2, 0]).since(after) == b""
    whole = header_and_payload(after.whole())
    assert whole[1] == {"i": 10, "j": -3, "size": 6, "cell_m": 0.05, "epoch": 1, "t_s": 1.0}


def test_the_map_of_a_run_that_has_ended_is_told_as_unknown() -> None:
    line = Line(WatchingReceiver())
    assert window_of(line.planner, 0.0, 0, None) is None
    line.send(GEOM, geom_body())
    line.send(POSE, pose_body())
    line.send(MAP, map_body(op(FREE, 9) + op(OBSTACLE, 1)))
    before = window_of(line.planner, 0.1, 1, None)
    assert before is not None
    assert before.cells.shape == (9, 9)  # of 9 x 5: the rest is not known
    assert [int((before.cells == state).sum()) for state in (FREE, OBSTACLE, UNKNOWN)] == [9, 1, 71]
    line.send(GEOM, geom_body(session=99))
    after = window_of(line.planner, 0.2, 2, before)
    assert after is not None
    assert not after.cells.any()
    assert put_together(put_together({}, before.whole()), after.since(before)) == {}


def kept(history: History, t_s: float, cells: list[int], size: int = 0) -> None:
    state = json.dumps({"type": "state", "t_s": t_s, "more": "x" * size})[:-1].encode()
    scan = ScanLine(t_s, np.full((3, 3), t_s, np.float32))
    history.keep(t_s, state, window(round(t_s), 0, cells, t_s=t_s), scan)


def test_a_moment_is_told_with_what_was_known_then() -> None:
    history = History()
    assert history.at(0.0) is None
    for k in range(120):
        kept(history, k / 10, [k % 3] * 36)
    for asked_s, state_s, others_s in (
        (-9, 0, 0),
        (0.56, 0.5, 0.5),
        (3.34, 3.3, 3.0),
        (99, 11.9, 11.5),
    ):
        moment = history.at(asked_s)
        assert moment is not None
        state, whole, scan = moment.messages()
        assert json.loads(str(state))["t_s"] == state_s
        assert json.loads(str(state))["history"] is True
        kind, header, cells = header_and_payload(whole)
        assert (kind, header["t_s"], header["history"]) == (1, others_s, True)
        assert set(cells) == {round(others_s * 10) % 3}
        kind, header, points = header_and_payload(scan)
        assert (kind, header["n"], header["history"]) == (4, 3, True)
        assert struct.unpack("<9f", points) == pytest.approx([others_s] * 9)


def test_five_minutes_are_kept_and_less_where_they_are_large() -> None:
    history = History()
    for k in range(3 * int(SPAN_S)):
        kept(history, k, [1] * 36)
    assert history.from_s == 2 * SPAN_S - 1
    for k in range(200):
        kept(history, 3 * SPAN_S + k / 10, [2] * 36, size=500_000)
        assert history.megabytes <= MOST_BYTES / 1e6
    assert history.from_s is not None
    assert history.from_s > 3 * SPAN_S
    for k in range(int(SPAN_S)):  # what is forgotten takes no room
        kept(history, 5 * SPAN_S + k, [])
    assert history.megabytes < 0.2
