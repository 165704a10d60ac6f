"""How the bytes of a planner are taken in: bounded a call, in order, anew on each connection."""

import pytest

from fakes.wires.wire import MemoryPort
from hw.device import BadFrame
from hw.planner_link.input import TICK_BYTES, FrameInput
from mapod_link.serial_line import serial_from_frame

FRAMES = [bytes([k % 250 + 1]) * (13 + k % 300) for k in range(400)]
ONE, TWO = bytes(range(20)), bytes(range(1, 21))


@pytest.mark.parametrize("datagrams", [True, False])
def test_a_flood_is_taken_in_bounded_portions_and_in_order(datagrams: bool) -> None:
    port = MemoryPort(datagrams)
    source = FrameInput(port)
    if datagrams:
        for frame in FRAMES:
            port.give(frame)
    else:
        port.give(b"".join(map(serial_from_frame, FRAMES)))
    found: list[bytes | BadFrame] = []
    while portion := source.read():
        sizes = [len(frame) for frame in portion if isinstance(frame, bytes)]
        assert sum(sizes) <= TICK_BYTES + 368
        found += portion
    assert found == FRAMES


def test_a_new_connection_begins_with_a_whole_frame() -> None:
    port = MemoryPort()
    source = FrameInput(port)
    port.give(serial_from_frame(ONE) + b"\x09half of")
    assert source.read() == [ONE]
    port.connected = False
    port.connected = True
    port.give(serial_from_frame(TWO))
    assert source.read() == [TWO]


def test_what_waits_of_an_old_connection_is_not_taken_for_the_new_one() -> None:
    port = MemoryPort()
    source = FrameInput(port)
    port.give(serial_from_frame(ONE) * 2000)
    assert source.read()
    port.connected = False
    port.connected = True
    port.give(serial_from_frame(TWO))
    assert source.read() == [TWO]
