"""TCP ports on real loopback sockets, in simulated time."""

import contextlib
import select
import socket
from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import pytest

from hw.device import Port, Reopens
from hw.ports.reopening import BACKLOG, CHEAP_LAST_S, READ_SIZE, RETRY_FIRST_S, SILENCE_S
from hw.ports.sockets import CONNECT_S, TcpPort
from hw.ports.wires import PortUrlError, open_port, ports_beside
from tests.support.machine.real_wires import START_S, is_lost, opened, read_all, until

TICK_S = 0.005


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(30)
        yield server


@pytest.fixture
def port(listener: socket.socket) -> Iterator[Port]:
    with contextlib.closing(open_port(f"tcp://{where(listener)}")) as port:
        yield port


def where(listener: socket.socket) -> str:
    return f"127.0.0.1:{listener.getsockname()[1]}"


def connected(listener: socket.socket, port: Port, now_s: float = START_S) -> socket.socket:
    opened(port, now_s)
    device = listener.accept()[0]
    device.settimeout(30)
    return device


@contextlib.contextmanager
def deaf_host() -> Iterator[tuple[str, socket.socket, list[socket.socket]]]:
    """Its queue of newcomers is full: the kernel drops what comes then."""
    with socket.socket() as full, contextlib.ExitStack() as stack:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        waiting = [stack.enter_context(socket.socket()) for _ in range(4)]
        for one in waiting:
            one.setblocking(False)
            one.connect_ex(full.getsockname())
        yield where(full), full, waiting


def test_a_port_opens_writes_and_reads(listener: socket.socket, port: Port) -> None:
    assert (port.opened, port.cause, port.datagrams) == (0, "not opened yet", False)
    port.write(b"too early: dropped")
    with connected(listener, port) as device:
        assert (port.opened, port.cause, port.read()) == (1, "", [])
        port.write(b"sRN STlms")
        assert device.recv(100) == b"sRN STlms"
        assert port.backlog == 0
        device.sendall(b"answer")
        assert read_all(port, 6) == b"answer"
        port.close()
        assert device.recv(10) == b""
    assert not port.poll(START_S + 1000)
    port.write(b"nothing")
    assert (port.read(), port.cause) == ([], "closed")


def test_a_refused_connection_is_tried_again_with_growing_pauses() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = where(server)

    def refused(port: Port, now_s: float) -> bool:
        return not port.poll(now_s) and port.cause.startswith("connection refused")

    with contextlib.closing(open_port(f"tcp://{address}")) as port:
        assert isinstance(port, TcpPort)
        tries, last = [], 0.0
        for tick in range(800):  # 8 s
            now_s = START_S + tick * 0.01
            until(partial(refused, port, now_s))
            if port._retry_s != last:
                last = port._retry_s
                tries.append(now_s)
        assert port.cause == f"connection refused by {address}"
    pauses_s = [later - sooner for sooner, later in pairwise(tries)]
    assert pauses_s == pytest.approx([0.2, 0.4, *[0.5] * (len(tries) - 3)], abs=0.011)


def test_a_host_that_drops_packets_is_asked_each_connect_time_and_found_at_once() -> None:
    with deaf_host() as (address, full, waiting), contextlib.ExitStack() as stack:
        port = stack.enter_context(contextlib.closing(open_port(f"tcp://{address}")))
        assert not port.poll(START_S)
        assert port.cause == f"connecting to {address}"
        assert not port.poll(START_S + CONNECT_S - 0.01)
        assert port.cause == f"connecting to {address}"
        for tick in range(1, 400):  # 2 s
            assert not port.poll(START_S + CONNECT_S + tick * TICK_S)
            assert (port.fileno(), port.cause) == (-1, f"no answer from {address}")
        for one in waiting:
            one.close()
        full.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                stack.enter_context(full.accept()[0])
        now_s = START_S + 400 * TICK_S + 2 * CONNECT_S  # the next attempt begins here
        port.poll(now_s)
        opened(port, now_s + TICK_S)


def test_a_lost_connection_is_opened_again(listener: socket.socket, port: Port) -> None:
    with connected(listener, port) as device:
        device.sendall(b"last words")
    assert read_all(port, 10) == b"last words"
    until(partial(is_lost, port, START_S))
    assert port.cause == f"connection closed by {where(listener)}"
    assert not port.poll(START_S + RETRY_FIRST_S - 0.01)
    device = connected(listener, port, START_S + RETRY_FIRST_S)
    assert (port.opened, port.cause) == (2, "")
    port.write(b"unread")
    until(lambda: select.select([device], [], [], 0)[0])
    device.close()  # with bytes unread: a reset
    until(partial(is_lost, port, START_S + RETRY_FIRST_S))
    assert port.cause == f"connection reset by {where(listener)}"


@pytest.mark.parametrize("brings", [b"", b"x"])
def test_pauses_grow_unless_connections_bring_bytes(
    brings: bytes, listener: socket.socket, port: Port
) -> None:
    now_s = START_S
    for pause_s in (0.2, 0.4, 0.8) if not brings else (0.2, 0.2, 0.2):
        with connected(listener, port, now_s) as device:
            device.sendall(brings)
        assert read_all(port, len(brings)) == brings
        until(partial(is_lost, port, now_s))
        assert not port.poll(now_s + pause_s - 0.01)
        now_s += pause_s + 1e-6
    opened(port, now_s)


def test_a_peer_that_takes_no_bytes_is_dropped(listener: socket.socket, port: Port) -> None:
    with connected(listener, port):
        while port.poll(START_S):
            port.write(bytes(4096))
            assert port.backlog <= BACKLOG
        assert port.cause.endswith("is not taking bytes")
        assert port.backlog == 0


def test_what_waits_follows_and_one_read_is_bounded(listener: socket.socket, port: Port) -> None:
    with connected(listener, port) as device:
        sent = bytearray()
        while not port.backlog:
            piece = len(sent).to_bytes(4, "big") * 512
            port.write(piece)
            sent += piece
        received = bytearray()
        while len(received) < len(sent):
            received += device.recv(1 << 20)
            assert port.poll(START_S)
        assert received == sent
        assert port.backlog == 0
        device.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while device.send(bytes(100_000)):
                pass
        assert 0 < sum(map(len, port.read())) <= READ_SIZE


def test_a_port_reopens_after_the_shortest_pause(listener: socket.socket, port: Port) -> None:
    assert isinstance(port, Reopens)
    assert port.silence_s == SILENCE_S
    now_s = START_S
    for count in (1, 2, 3, 4):  # and nothing was ever heard
        with connected(listener, port, now_s) as device:
            assert port.opened == count
            port.reopen("nothing heard for 10 s")
            assert (port.fileno(), port.cause) == (-1, "nothing heard for 10 s")
            assert device.recv(10) == b""  # the device's end knows
        assert not port.poll(now_s + RETRY_FIRST_S - 0.01)
        now_s += RETRY_FIRST_S + 1e-6


def test_reading_in_vain_is_no_loss(listener: socket.socket, port: Port) -> None:
    with connected(listener, port) as device:
        assert port.poll(START_S)
        for _ in range(3):  # in a step, and between two
            assert port.read() == []
        assert port.poll(START_S)
        device.sendall(b"there")
        assert read_all(port, 5) == b"there"


def test_a_host_without_an_address_is_an_error() -> None:
    with pytest.raises(PortUrlError, match="has no known address"):
        open_port(f"tcp://{'x' * 70}.invalid:1")
    with contextlib.closing(open_port("udp://[::1]:9750")) as port:
        assert port.cause == "not opened yet"
    assert CHEAP_LAST_S <= CONNECT_S


def test_a_port_beside_another_is_of_the_same_host(listener: socket.socket) -> None:
    number = listener.getsockname()[1]
    with contextlib.closing(ports_beside("tcp://127.0.0.1:1")(number)) as port:
        connected(listener, port).close()
    with pytest.raises(PortUrlError, match="must be tcp://host:port"):
        ports_beside("udp://127.0.0.1:1")
