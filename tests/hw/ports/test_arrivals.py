"""A serial port tells of arrivals by a descriptor of its own, and looks at the line only then."""

import os
import select
import tty
from collections.abc import Iterator

import pytest

from hw.device import Port
from hw.ports.wires import open_port

GENEROUS_S = 10.0


@pytest.fixture
def line() -> Iterator[tuple[Port, int]]:
    """A port on a pty, open, and the other end's descriptor."""
    other, own = os.openpty()
    tty.setraw(own)
    port = open_port(f"serial://{os.ttyname(own)}?baud=115200")
    assert port.poll(0.0)
    yield port, other
    port.close()
    os.close(other)
    os.close(own)


def is_told(port: Port, wait_s: float = 0.0) -> bool:
    """Whether the port's descriptor is readable, as an event loop sees it."""
    return bool(select.select([port.fileno()], [], [], wait_s)[0])


def test_an_arrival_is_told_until_it_is_read(line: tuple[Port, int]) -> None:
    port, other = line
    assert not is_told(port)
    assert port.read() == []
    for data in (b"first", b"second"):
        os.write(other, data)
        assert is_told(port, GENEROUS_S)
        assert is_told(port)
        assert b"".join(port.read()) == data
        assert not is_told(port)
        assert port.read() == []


def test_what_arrives_in_pieces_is_read_whole(line: tuple[Port, int]) -> None:
    port, other = line
    sent, got = os.urandom(40_000), b""
    left = memoryview(sent)
    os.set_blocking(other, False)
    while len(got) < len(sent):
        if left and select.select([], [other], [], 0.0)[1]:
            left = left[os.write(other, left[:1000]) :]
        elif not is_told(port, GENEROUS_S):
            break
        got += b"".join(port.read())
    assert got == sent


def test_a_line_that_hangs_up_is_lost_with_a_cause_and_tells_no_more() -> None:
    other, own = os.openpty()
    tty.setraw(own)
    port = open_port(f"serial://{os.ttyname(own)}?baud=115200")
    assert port.poll(0.0)
    os.close(own)
    os.close(other)
    assert is_told(port, GENEROUS_S)
    assert port.read() == []
    assert port.cause
    assert port.fileno() == -1
    port.close()
