"""What is drawn of a map and said of a link, and what goes over real sockets and ttys."""

import contextlib
import math
import os
import re
import socket
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN
from mapod_link.frames import GEOM, MAP, POSE, STOP_ZONE, bytes_from_frame
from mapod_link.serial_line import serial_from_frame
from mapod_link.wires import UdpWire
from tests import Capsys, Patch
from tests.support.link.planner_sender import (
    Line,
    geom_body,
    map_body,
    op,
    pose_body,
    with_map,
    zone_body,
)
from tools.cli.view import main, zone_lines
from tools.terminal import screen
from tools.terminal.planner_end import Delays, Meter, PlannerEnd, PtyWire, WatchingReceiver

U8 = npt.NDArray[np.uint8]


def window(*rows_from_far: str) -> U8:
    """A window from its picture: '#', '.', ' '; x up, y to the left."""
    image = np.array([[" .#".index(sign) for sign in row] for row in rows_from_far], np.uint8)
    return np.ascontiguousarray(image[::-1, ::-1].T)


WALLED = window("#####", "#...#", "#.#.#", "#...#", "#   #")


def test_map_x_is_up_and_y_is_left() -> None:
    cells = np.zeros((2, 3), np.uint8)  # (height along y, width along x)
    cells[0, 2] = OBSTACLE  # farthest ahead, rightmost
    cells[1, 0] = FREE  # behind, left
    assert screen.image_from_window(cells).tolist() == [[0, 2], [0, 0], [1, 0]]


@pytest.mark.parametrize(("yaw_deg", "letter"), [(0, "^"), (90, "<"), (-90, ">"), (179, "v")])
def test_a_plain_map_is_read_as_it_was_drawn(yaw_deg: float, letter: str) -> None:
    robot = screen.Robot(col=0.5, row=2.5, yaw_rad=math.radians(yaw_deg), radius=1.0)
    drawn = screen.plain_map(WALLED, robot).splitlines()
    assert drawn == ["#####", "#...#", "#.#.#", "#...#", f"# {letter} #"]


def test_the_robot_stands_in_the_cell_of_its_pose_and_is_not_drawn_outside_of_the_window() -> None:
    pose = with_map(Line(WatchingReceiver())).planner.pose
    assert pose is not None
    robot = screen.robot_in_window(pose, (-4, -3), 0.05)
    assert (robot.col, robot.row) == (4.0, 3.0)
    for far in (-30.0, 30.0):
        robot = screen.Robot(col=far, row=far, yaw_rad=0.0, radius=1.0)
        assert "^" not in screen.plain_map(WALLED, robot)
        assert "↑" not in screen.map_text(WALLED, robot).plain


def test_colours_are_those_of_the_paper_two_rows_a_line_and_the_robot_is_an_orange_arrow() -> None:
    text = screen.map_text(window("#.", " #", "..", ".."), None)
    lines = text.split("\n")
    assert [line.plain for line in lines] == ["▀▀", "  "]
    seen = [
        (str(span.style.color.name), str(span.style.bgcolor.name))
        for line in lines
        for span in line.spans
        for _ in range(span.end - span.start)
        if not isinstance(span.style, str) and span.style.color and span.style.bgcolor
    ]
    green, red, dark = screen.COLOURS[FREE], screen.COLOURS[OBSTACLE], screen.COLOURS[UNKNOWN]
    assert seen == [(red, dark), (green, red), (green, green), (green, green)]
    text = screen.map_text(
        np.full((11, 11), FREE, np.uint8), screen.Robot(5.5, 5.5, math.pi / 2, 1.5)
    )
    assert text.plain.split("\n")[2][5] == "←"
    assert screen.COLOURS[screen.ROBOT] in str([span.style for span in text.spans])


@pytest.mark.parametrize(("rows", "cols", "factor"), [(12, 11, 1), (12, 11, 5), (3, 12, 4)])
def test_a_block_shows_its_worst_class(rows: int, cols: int, factor: int) -> None:
    image = np.random.default_rng(rows).integers(0, 3, (rows, cols)).astype(np.uint8)
    small = screen.downsampled(image, factor)
    for r in range(small.shape[0]):
        for c in range(small.shape[1]):
            block = image[r * factor : (r + 1) * factor, c * factor : (c + 1) * factor]
            worst = next(s for s in (OBSTACLE, UNKNOWN, FREE) if (block == s).any())
            assert small[r, c] == worst


@pytest.mark.parametrize("size", [(160, 52), (80, 24), (20, 5), (1, 1)])
def test_the_picture_fits_the_terminal(size: tuple[int, int]) -> None:
    line = with_map(Line(WatchingReceiver()), 101, 101)
    line.send(MAP, map_body(op(OBSTACLE, 5000) + op(FREE, 5201)))
    told = shown(line, *size)
    drawn = told.splitlines()
    assert max(len(row) for row in drawn) <= max(size[0], 1)
    if size[0] >= 80:
        assert len(drawn) <= size[1]
        assert "would go" in told
        assert "5201 free, 5000 obstacle" in told


def shown(line: Line[WatchingReceiver], width: int = 160, height: int = 60) -> str:
    meter = Meter()
    meter.take(line.now_s, line.planner)
    console = Console(width=width, height=height, color_system=None, force_terminal=True)
    with console.capture() as capture:
        console.print(screen.picture(line.planner, meter, line.now_s, width, height))
    return capture.get()


def test_the_picture_says_what_is_wrong() -> None:
    line = Line(WatchingReceiver())
    assert "waiting for the map's geometry" in shown(line)
    line.send(GEOM, geom_body())
    assert "BLANK" in shown(line)
    line.send(POSE, pose_body(health=0x0037 | 1 << 7, mode=2))
    line.send(MAP, map_body())
    drawn = shown(line)
    assert "no clock lock, no pace" in drawn
    assert "drop-off ahead" in drawn
    assert "degraded" in drawn
    assert "would stop: drop-off ahead" in drawn
    line.send(MAP, map_body(), lost=True)
    line.send(POSE, pose_body())
    assert "SUSPECT" in shown(line)
    line.now_s += 0.2
    assert "STALE" in shown(line)
    line.send(POSE, pose_body(mode=4))
    assert "replayed or simulated data" in shown(line)


def test_the_stop_zone_has_a_line_of_its_own_once_there_is_one() -> None:
    line = with_map(Line(WatchingReceiver()))
    assert zone_lines(line.planner.stop_zone, line.now_s) == []
    line.send(STOP_ZONE, zone_body(2, 0b11))
    [drawn] = zone_lines(line.planner.stop_zone, line.now_s)
    assert drawn.plain == (
        "way      slow: an obstacle, ground not seen"
        "  ahead 1.25 m, 0.65 m/s  behind 0.00 m, 0.00 m/s"
    )
    assert {str(span.style) for span in drawn.spans} == {screen.LABEL, screen.POOR}
    [old] = zone_lines(line.planner.stop_zone, line.now_s + 1.2)
    assert old.plain.startswith("way      not heard for 1.2 s  ahead 0.00 m, 0.00 m/s")
    assert {str(span.style) for span in old.spans} == {screen.LABEL, screen.BAD}
    for state, style in ((0, screen.BAD), (1, screen.GOOD), (3, screen.BAD), (7, screen.BAD)):
        line.send(STOP_ZONE, zone_body(state))
        [drawn] = zone_lines(line.planner.stop_zone, line.now_s)
        assert style in [str(span.style) for span in drawn.spans]


def metered(clock_ahead_ms: int, delays_ms: list[float]) -> Meter:
    """A meter that saw 50 MAP frames a second, late by so much."""
    planner, meter = WatchingReceiver(), Meter()
    planner.feed_datagram(0.0, bytes_from_frame(GEOM, 1, clock_ahead_ms, geom_body()))
    for i, delay_ms in enumerate(delays_ms):
        tick_ms = 1000 + 20 * i
        frame = bytes_from_frame(MAP, 2 + i, tick_ms + clock_ahead_ms, map_body())
        planner.feed_datagram((tick_ms + delay_ms) / 1000, frame)
        meter.take(tick_ms / 1000, planner)
    return meter


def test_delays_are_those_of_a_common_clock() -> None:
    meter = metered(0, [1.5] * 98 + [7.0] * 2)
    assert meter.same_clock
    assert meter.link.quantile_ms(0.5) == pytest.approx(1.5, abs=0.11)
    assert meter.link.quantile_ms(0.99) == pytest.approx(7.0, abs=0.11)


def test_without_a_common_clock_delays_are_those_above_the_fastest_also_across_a_wrap() -> None:
    meter = metered(2**32 - 2500, [1.5] * 99 + [7.0])
    assert not meter.same_clock
    assert meter.link.quantile_ms(0.5) == pytest.approx(0.0, abs=0.11)
    assert meter.link_ms == pytest.approx(5.5)


def test_rates_are_those_of_the_last_two_seconds() -> None:
    meter = metered(0, [1.0] * 300)
    maps, poses, bytes_per_s = meter.rates(1.0 + 299 * 0.02)
    assert maps == pytest.approx(50, abs=1)
    assert poses == 0
    assert bytes_per_s == pytest.approx(50 * 22, rel=0.02)
    assert Meter().rates(5.0) == (0.0, 0.0, 0.0)


@given(st.lists(st.floats(-5, 3000), min_size=1, max_size=50), st.floats(0, 1))
def test_a_quantile_is_right_to_a_tenth_of_a_millisecond(values: list[float], part: float) -> None:
    delays = Delays()
    for value in values:
        delays.add(value)
    kept = sorted(min(max(value, 0.0), 1999.95) for value in values)
    exact = kept[max(1, math.ceil(part * len(kept))) - 1]
    assert delays.quantile_ms(part) == pytest.approx(exact, abs=0.1001)
    assert math.isnan(Delays().quantile_ms(0.5))


def test_a_pty_is_as_slow_as_the_line_it_stands_for() -> None:
    pty = PtyWire(9600)
    other = os.open(pty.url.removeprefix("serial://").split("?")[0], os.O_RDWR | os.O_NOCTTY)
    junk = serial_from_frame(b"x" * 300) * 3  # 0.94 s of line
    os.write(other, junk)
    end = PlannerEnd(pty, WatchingReceiver())
    now_s = began_s = end.step(0.0)
    while not end.planner.rejected.total():
        assert now_s - began_s < 60.0, "nothing came"
        now_s = end.step(0.02)
    assert now_s - began_s > 0.25
    os.close(other)
    pty.close()


def test_the_viewer_says_that_nothing_came(capsys: Capsys) -> None:
    assert main(["--terminal", "--port", "udp://127.0.0.1:0", "--seconds", "0.05"]) == 0
    assert "no map has arrived" in capsys.readouterr().out


def test_the_page_tells_its_address_first(capsys: Capsys, tmp_path: Path) -> None:
    wire, kept = ["udp://127.0.0.1:0", "--seconds", "0.05"], tmp_path / "token"
    assert main([*wire, "--http", "127.0.0.1:0"]) == 0
    first, second, _ = capsys.readouterr().out.split("\n")
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/#token=[\w-]{22}", first)
    assert re.fullmatch(r"watching udp://127\.0\.0\.1:\d+; Ctrl-C ends", second)
    assert main([*wire, "--http", "[::1]:0", "--token-file", str(kept)]) == 0
    said = capsys.readouterr().out  # of no terminal: it may be kept in a log
    assert re.match(rf"http://\[::1\]:\d+/#token=\.\.\. \(it is in {kept}\)\n", said)
    assert kept.read_text().strip() not in said


def test_what_the_page_cannot_have_is_said_in_one_line(
    capsys: Capsys, tmp_path: Path, monkeypatch: Patch
) -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as http,
        contextlib.closing(UdpWire("127.0.0.1", 0)) as wire,
    ):
        taken = f"127.0.0.1:{http.getsockname()[1]}"
        cases = [
            (["udp://127.0.0.1:0", "--http", taken], 1, f"--http {taken}: "),
            ([wire.url, "--terminal"], 1, f"mapod view: {wire.url}: Address already in use"),
            (["udp://127.0.0.1:99999"], 2, "the port must be within 1..65535, is 99999"),
            ([wire.url], 1, "Give the page a receiver of its own: [planner] port = ["),
            (["nonsense"], 2, "nonsense: must be udp://"),
            (["--config", str(tmp_path / "none.toml")], 2, "none.toml: No such file"),
            (["--token-file", str(tmp_path)], 2, "Is a directory"),
        ]
        for arguments, status, words in cases:
            assert main(arguments) == status
            said = capsys.readouterr()
            assert words in said.err
            assert (said.out, said.err.count("\n")) == ("", 1)
    with pytest.raises(SystemExit, match="2"):
        main(["udp://127.0.0.1:1", "--port", "udp://127.0.0.1:2"])
    assert "URL and --port are the same: give one of them" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "aiohttp", None)  # as where it is not installed
    assert main([]) == 2
    assert "extra view" in capsys.readouterr().err
