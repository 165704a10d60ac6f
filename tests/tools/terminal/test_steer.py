"""Driving from the viewer: held keys become requests, and everything else ends them."""

import os
import termios
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapod_link.asking import DRIVE_BODY
from mapod_link.frames import DRIVE, frame_from_bytes
from tests.support.link.planner_sender import begun, pose_body
from tools.terminal.steer import HELD_S, HELP, Steering, keys_of, ways_from_keys


@pytest.fixture
def keyboard() -> Iterator[tuple[int, int]]:
    """The hand's and the program's end of a terminal."""
    hand, terminal = os.openpty()
    os.set_blocking(hand, False)
    yield hand, terminal
    os.close(hand)
    os.close(terminal)


class Driver:
    """Steering of a planner that has a map, on a clock of its own."""

    def __init__(self, terminal: int) -> None:
        self.line = begun()
        self.line.planner.poll(0.0)
        self.steering = Steering(self.line.planner, terminal, 0.4, 0.8)
        self.now_s = 1.0

    def run(self, seconds: float, typed: bytes = b"") -> list[tuple[int, int, int]]:
        """(v, w, valid_ms) of the requests sent; `typed` comes once every 40 ms."""
        asked = []
        for step in range(round(seconds / 0.02)):
            self.now_s += 0.02
            if step % 2 == 0:
                self.steering.take(self.now_s, typed)
            self.steering.step(self.now_s)
            for data in self.line.planner.poll(self.now_s):
                frame = frame_from_bytes(data)
                assert not isinstance(frame, str)
                if frame.type == DRIVE:
                    asked.append(DRIVE_BODY.unpack(frame.body)[2:5])
        return asked


@pytest.mark.parametrize(
    ("typed", "v", "w"),
    [(b"w", 400, 0), (b"S", -400, 0), (b"\x1b[D", 0, 800), (b"\x1bOC", 0, -800)],
)
def test_a_held_key_asks_ten_times_a_second(
    keyboard: tuple[int, int], typed: bytes, v: int, w: int
) -> None:
    asked = Driver(keyboard[1]).run(2.0, typed)
    assert 18 <= len(asked) <= 21
    assert set(asked) == {(v, w, 300)}


def test_a_released_key_says_stop_three_times(keyboard: tuple[int, int]) -> None:
    driver = Driver(keyboard[1])
    driver.run(1.0, b"w")
    asked = driver.run(2.0)
    assert asked[-3:] == [(0, 0, 0)] * 3
    assert asked.count((400, 0, 300)) <= HELD_S / 0.1 + 1
    assert len(asked) <= HELD_S / 0.1 + 4


def test_any_other_key_stops_at_once_and_at_the_end_it_stops(keyboard: tuple[int, int]) -> None:
    driver = Driver(keyboard[1])
    driver.run(1.0, b"w")
    driver.steering.take(driver.now_s, b" ")
    assert set(driver.run(1.0)) == {(0, 0, 0)}
    driver.run(0.5, b"d")
    driver.steering.stop(driver.now_s)
    [data] = driver.line.planner.poll(driver.now_s)
    frame = frame_from_bytes(data)
    assert not isinstance(frame, str)
    assert DRIVE_BODY.unpack(frame.body)[2:5] == (0, 0, 0)
    driver.steering.stop(driver.now_s)
    assert driver.line.planner.poll(driver.now_s) == []


def test_keys_come_from_the_terminal(keyboard: tuple[int, int]) -> None:
    hand, terminal = keyboard
    before = termios.tcgetattr(terminal)
    with keys_of(terminal):
        driver = Driver(terminal)
        os.write(hand, b"\x1b[A")
        assert (400, 0, 300) in driver.run(0.2)
        assert not termios.tcgetattr(terminal)[3] & (termios.ECHO | termios.ICANON)
        assert termios.tcgetattr(terminal)[3] & termios.ISIG
    assert termios.tcgetattr(terminal) == before


def test_without_a_terminal_it_refuses() -> None:
    end, other = os.pipe()
    with pytest.raises(ValueError, match="needs a terminal"), keys_of(end):
        pass
    os.close(end)
    os.close(other)


@given(st.binary(max_size=40))
def test_any_bytes_from_a_terminal_mean_a_way_or_a_stop(typed: bytes) -> None:
    ways = ways_from_keys(typed)
    assert set(ways) <= {"", "forward", "back", "left", "right"}
    assert bool(ways) is bool(typed)


def test_what_is_asked_and_why_it_stands_is_told(keyboard: tuple[int, int]) -> None:
    driver = Driver(keyboard[1])
    line = driver.line
    assert driver.steering.words(driver.now_s) == HELP
    driver.run(0.5, b"w")
    assert driver.steering.words(driver.now_s) == "forward, 0.4 m/s"
    driver.run(2.0, b"w")
    assert driver.steering.words(driver.now_s).endswith("the robot stands; link stale")
    line.now_s = driver.now_s
    line.send(2, pose_body())
    line.send(3, bytes(7) + bytes([0, 0, 0]))
    driver.run(0.1, b"a")
    assert driver.steering.words(driver.now_s) == "turn left, 0.8 rad/s"
