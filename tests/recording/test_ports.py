"""A recorded port can do what the port can, and tells what came of each of its uses."""

import socket

from fakes.wires.wire import MemoryPort
from hw.device import Gathers, Reopens
from hw.ports.serial import SerialPort
from hw.ports.url import parse_url
from hw.ports.wires import open_port
from recording.ports import RecordedPort, abilities, recorded
from recording.records import CHANGED, IN, LOST, OPENED, OUT, PORT_STATE, READ_ENDED
from tests.support.robot.recorded import ListTap


def told(tap: ListTap) -> list[tuple[bytes, bytes]]:
    """Kind and data of the records since the last call."""
    records, tap.records = tap.records, []
    return [(record.kind, record.data) for record in records]


def test_bytes_that_come_with_a_later_read_of_a_call_are_told_to() -> None:
    port, tap = MemoryPort(), ListTap(lambda: 1.0)
    tapped = recorded(port, 2, tap, tap.clock)
    assert tapped.poll(1.0)
    told(tap)
    tap.calls += 1
    assert tapped.read() == tapped.read() == []
    port.give(b"late")
    assert tapped.read() == [b"late"]
    assert told(tap) == [(READ_ENDED, b""), (READ_ENDED, b""), (IN, b"late")]
    tap.calls += 1
    port.give(b"a")
    assert tapped.read() == [b"a"]
    assert told(tap) == [(IN, b"a")]
    tapped.write(b"out")
    state = PORT_STATE.pack(2, True, 1, 3)  # the second use; three bytes in the backlog
    assert told(tap) == [(OUT, b"out"), (CHANGED, state)]


def test_a_loss_that_reading_finds_is_told_with_that_read() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        tap = ListTap(lambda: 5.0)
        port = open_port(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        tapped = recorded(port, 0, tap, tap.clock)
        while not tapped.poll(5.0):
            pass
        server.accept()[0].close()
        kinds = [kind for kind, _ in told(tap)]
        assert kinds.count(OPENED) == 1
        tap.calls += 1
        while tapped.fileno() >= 0:
            tap.calls += 1
            assert tapped.read() == []
        lost, (kind, data) = told(tap)[-2:]
        assert lost == (LOST, tapped.cause.encode())
        assert (kind, PORT_STATE.unpack_from(data)) == (CHANGED, (1, False, 1, 0))
        tapped.close()


def test_a_recorded_port_can_neither_less_nor_more_than_the_port() -> None:
    tap = ListTap(lambda: 0.0)
    line = SerialPort(parse_url("serial:///dev/none?baud=9600"))
    for port, reopens, gathers in ((MemoryPort(), False, False), (line, True, True)):
        tapped: RecordedPort = recorded(port, 0, tap, tap.clock)
        assert (isinstance(tapped, Reopens), isinstance(tapped, Gathers)) == (reopens, gathers)
        assert abilities(tapped) == abilities(port)
